//! What stands behind the scene: the shell of a training, a backdrop of the input, a sphere, or a
//! panorama.

use super::Recipe;
use crate::backdrop::{
    BackdropWhen, Sky, backdrop, closed, is_scattered, keep_backdrop, share_behind, take_sky,
};
use crate::refit::{RefitColors, smooth_shell};
use crate::shell::{cut, few, is_cut, middle, take_shell};
use crate::texture::with_texture;
use crate::views::Views;
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::Outcome;
use trisplat_scene::{Asset, Placement, Result, Scene};

impl Recipe<'_> {
    /// The triangles that a limit leaves for surroundings, if `all` triangles exceed it and
    /// surroundings are among them.
    fn most_behind(&self, all: usize) -> Option<u64> {
        let are_written = matches!(
            self.options.backdrop.backdrop,
            BackdropWhen::Auto | BackdropWhen::Sphere | BackdropWhen::File
        );
        let budget = self.options.prune.max_triangles.filter(|most| *most < all as u64);
        budget.filter(|_| are_written && !self.is_cropped()).map(share_behind)
    }

    /// The backdrop of the input, of fewer triangles where a limit asks for that.
    ///
    /// # Errors
    ///
    /// More triangles than a texture has texels.
    pub(super) fn few_given(
        &self,
        given: Option<Mesh>,
        scene: &Scene,
        watching: &[Camera],
    ) -> Result<Option<Mesh>> {
        let Some(given) = given else { return Ok(None) };
        let count = scene.triangle_count();
        match self.most_behind(count + given.face_count()) {
            Some(most) if given.face_count() as u64 > most => {
                let corners = (0..count).flat_map(|i| scene.corners(i));
                let mut small = few(&given, corners, watching, most);
                smooth_shell(&mut small);
                let is_textured = given.texture.is_some() && small.face_count() > 0;
                let small = if is_textured { with_texture(small)? } else { small };
                Ok(Some(small).filter(|small| small.face_count() > 0))
            }
            _ => Ok(Some(given)),
        }
    }

    /// `mesh` with a shell of fewer triangles where a limit asks for that; `given` are those of
    /// another backdrop.
    ///
    /// # Errors
    ///
    /// More vertices than 32 bits count.
    pub(super) fn few_shell(
        &self,
        mut mesh: Mesh,
        given: usize,
        watching: &[Camera],
    ) -> Result<Mesh> {
        let count = mesh.shell.iter().filter(|shell| **shell).count();
        let most = self
            .most_behind(mesh.face_count() + given)
            .map(|most| most.saturating_sub(given as u64));
        let Some(most) = most.filter(|most| count as u64 > *most && count < mesh.face_count())
        else {
            return Ok(mesh);
        };
        let shell = take_shell(&mut mesh, watching);
        let small = few(&shell, mesh.positions.iter().copied(), watching, most);
        mesh.append(Mesh { shell: vec![true; small.face_count()], ..small })?;
        Ok(mesh)
    }

    /// The triangles of the backdrop of the input that a limit counts.
    pub(super) fn counted(&self, given: Option<&Mesh>) -> usize {
        let is_written = self.most_behind(usize::MAX).is_some();
        given.filter(|_| is_written).map_or(0, Mesh::face_count)
    }

    /// The shell counts as backdrop, outside the levels. A scene that is cropped, or baked without
    /// a backdrop, keeps its shell as part of the scene.
    pub(super) fn part_shell(&self, mut mesh: Mesh, watching: &[Camera]) -> (Mesh, Mesh) {
        if self.is_cropped() || self.options.backdrop.backdrop == BackdropWhen::Off {
            // It is part of the scene from here on.
            mesh.shell.clear();
            return (mesh, Mesh::default());
        }
        let behind = take_shell(&mut mesh, watching);
        // Without other triangles the shell is the scene.
        if mesh.face_count() == 0 { (behind, mesh) } else { (mesh, behind) }
    }

    /// One closed surface in place of a shell that is made of shards. The shells of several inputs
    /// stay.
    pub(super) fn whole_shell(
        &self,
        shell: Mesh,
        scene: &Mesh,
        given: usize,
        watching: &[Camera],
    ) -> Mesh {
        // A panorama makes a surface of its own.
        if self.options.backdrop.backdrop == BackdropWhen::Sky || !is_scattered(&shell) {
            return shell;
        }
        let center = middle(&shell, watching);
        let reach = scene.positions.iter().map(|v| v.distance(center)).fold(0.0, f32::max);
        let left = |most: u64| most.saturating_sub((scene.face_count() + given) as u64);
        let most = self.options.prune.max_triangles.map_or(u64::MAX, left);
        closed(&shell, center, reach, most).unwrap_or(shell)
    }

    /// Colours that run softly, unless colours are to stay: in a shell that is cut, or as they are
    /// where pictures will be fitted.
    pub(super) fn soft_shell(
        &self,
        mut shell: Mesh,
        scene_faces: usize,
        has_pictures: bool,
    ) -> Mesh {
        // A panorama has the shape of the shell only.
        let cuts = self.options.backdrop.backdrop != BackdropWhen::Sky
            && is_cut(&shell, scene_faces, self.options.prune.max_triangles);
        match (self.options.refit.refit, cuts, has_pictures) {
            (RefitColors::Off, ..) | (_, false, true) => {}
            (_, true, _) => shell = cut(&shell),
            (_, false, false) => smooth_shell(&mut shell),
        }
        shell
    }

    /// Whether a region of the scene is baked, to which surroundings do not belong.
    pub(super) fn is_cropped(&self) -> bool {
        !self.options.crop.crop.is_empty() && self.options.backdrop.backdrop == BackdropWhen::Auto
    }

    /// The panorama that replaces the backdrop, if that is asked for.
    pub(super) fn sky(
        &self,
        mesh: &Mesh,
        behind: Option<&Mesh>,
        views: Option<&mut Views>,
        watching: &[Camera],
    ) -> Result<Sky> {
        match self.options.backdrop.backdrop {
            BackdropWhen::Sky => Sky::behind(mesh, behind, views, watching),
            _ => Ok(Sky::default()),
        }
    }

    /// Gives the scene and its levels the panorama, if that is asked for.
    pub(super) fn put_sky(&mut self, asset: &mut Asset, sky: Sky, placement: &Placement) {
        let wants_sky = self.options.backdrop.backdrop == BackdropWhen::Sky;
        if wants_sky && !take_sky(asset, sky, placement) {
            let warning = "no sky is written: it needs photos (`dataset`), or a scene with a shell";
            self.report.warnings.push(warning.to_owned());
        }
    }

    /// Behind the remaining triangles, and before colours are taken from the photos: colours of
    /// holes belong to the sphere.
    pub(super) fn backdrop(
        &mut self,
        mesh: Mesh,
        behind: Option<Mesh>,
        views: Option<&mut Views>,
    ) -> Result<Mesh> {
        let options = &self.options.backdrop;
        let cropped = self.is_cropped();
        self.report.stage(self.observer, mesh, Mesh::counts, |mesh, details| match behind {
            _ if cropped => {
                Ok(Outcome::Skipped("the scene is cropped: its surroundings were removed"))
            }
            Some(behind) => keep_backdrop(mesh, behind, options, details),
            None => backdrop(mesh, views, options, self.options.prune.max_triangles, details),
        })
    }
}
