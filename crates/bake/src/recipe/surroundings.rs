//! Surroundings of the scene: the backdrop of the input, the shell of a training, a sphere, or a
//! panorama.

use super::Recipe;
use super::values::SceneCameras;
use crate::erase::EraseList;
use crate::refit::{RefitColors, smooth_shell};
use crate::surroundings::{
    BackdropWhen, Sky, Surroundings, backdrop, close_surface, has_room_for_quarters, is_scattered,
    keep_backdrop, quarter_faces, replace_backdrop, shell_center, simplified_shell, take_shell,
};
use crate::texture::with_texture;
use crate::views::Views;
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::Outcome;
use trisplat_scene::{Asset, Placement, Provenance, Result, Scene, SurroundingsStorage};

impl Recipe<'_> {
    /// On triangles that no longer move, scene and surroundings, before levels and colours.
    pub(super) fn erase(
        &mut self,
        mesh: Mesh,
        backdrop: Option<&mut Mesh>,
        provenance: &Provenance,
    ) -> Result<Mesh> {
        let Some(path) = &self.options.erase.erase else { return Ok(mesh) };
        let list = EraseList::read(path, provenance)?;
        self.stage(mesh, Mesh::counts, |mesh, details| list.erase(mesh, backdrop, details))
    }

    /// True if only a region of the scene is baked, to which surroundings do not belong.
    pub(super) fn drops_surroundings(&self) -> bool {
        self.options.crop.is_cropped() && self.options.backdrop.backdrop == BackdropWhen::Auto
    }

    /// True if surroundings are written as triangles, which a limit counts.
    fn writes_surroundings(&self) -> bool {
        let are_triangles = matches!(
            self.options.backdrop.backdrop,
            BackdropWhen::Auto | BackdropWhen::Sphere | BackdropWhen::File
        );
        are_triangles && !self.drops_surroundings()
    }

    /// The triangles that a limit leaves for surroundings, if `all` triangles exceed it and
    /// surroundings are among them.
    fn surroundings_budget(&self, all: usize) -> Option<u64> {
        self.budget.surroundings_among(all).filter(|_| self.writes_surroundings())
    }

    /// Triangles of the input's backdrop that a limit counts.
    pub(super) fn counted_triangles(&self, input_backdrop: Option<&Mesh>) -> usize {
        let is_counted = self.surroundings_budget(usize::MAX).is_some();
        input_backdrop.filter(|_| is_counted).map_or(0, Mesh::face_count)
    }

    /// The backdrop of the input, of fewer triangles where a limit asks for that.
    ///
    /// # Errors
    ///
    /// More triangles than a texture has texels.
    pub(super) fn simplify_input_backdrop(
        &self,
        input_backdrop: Option<Mesh>,
        scene: &Scene,
        cameras: &[Camera],
    ) -> Result<Option<Mesh>> {
        let Some(backdrop) = input_backdrop else { return Ok(None) };
        let scene_faces = scene.triangle_count();
        let budget = self.surroundings_budget(scene_faces + backdrop.face_count());
        let Some(budget) = budget.filter(|budget| backdrop.face_count() as u64 > *budget) else {
            return Ok(Some(backdrop));
        };
        let corners = (0..scene_faces).flat_map(|face| scene.corners(face));
        let mut simplified = simplified_shell(&backdrop, corners, cameras, budget);
        if simplified.face_count() == 0 {
            return Ok(None);
        }
        smooth_shell(&mut simplified);
        if backdrop.texture.is_some() {
            return with_texture(simplified).map(Some);
        }
        Ok(Some(simplified))
    }

    /// `mesh` with a shell of fewer triangles where a limit asks for that.
    ///
    /// # Errors
    ///
    /// More vertices than 32 bits count.
    pub(super) fn simplify_shell(&self, mut mesh: Mesh, cameras: &[Camera]) -> Result<Mesh> {
        let backdrop_faces = self.budget.input_backdrop;
        let shell_faces = mesh.shell.iter().filter(|is_shell| **is_shell).count();
        let budget = self
            .surroundings_budget(mesh.face_count() + backdrop_faces)
            .map(|budget| budget.saturating_sub(backdrop_faces as u64))
            .filter(|budget| shell_faces as u64 > *budget && shell_faces < mesh.face_count());
        let Some(budget) = budget else {
            return Ok(mesh);
        };
        let shell = take_shell(&mut mesh, cameras);
        let corners = mesh.positions.iter().copied();
        let simplified = simplified_shell(&shell, corners, cameras, budget);
        mesh.append(Mesh { shell: vec![true; simplified.face_count()], ..simplified })?;
        Ok(mesh)
    }

    /// Splits `mesh` into the scene and its surroundings: the input's backdrop and the shell, as
    /// one closed surface in place of shards. The shells of several inputs stay as they are.
    pub(super) fn surroundings(
        &self,
        mesh: Mesh,
        input_backdrop: Option<Mesh>,
        is_merged: bool,
        views: Option<&mut Views>,
        cameras: &SceneCameras,
    ) -> Result<(Mesh, Surroundings)> {
        let cameras = &cameras.visibility[..];
        let (mesh, shell) = self.split_off_shell(mesh, cameras);
        let shell = if is_merged { shell } else { self.close_shell(shell, &mesh, cameras) };
        let shell = self.smooth_shell(shell, &mesh, views.is_some());
        let mut surroundings = Surroundings::join(input_backdrop, shell)?;
        if self.options.backdrop.backdrop == BackdropWhen::Sky {
            surroundings.sky = Sky::new(&mesh, surroundings.mesh.as_ref(), views, cameras)?;
        }
        Ok((mesh, surroundings))
    }

    /// The shell counts as backdrop, outside the levels. A scene that is cropped, or baked without
    /// a backdrop, keeps its shell as part of the scene.
    fn split_off_shell(&self, mut mesh: Mesh, cameras: &[Camera]) -> (Mesh, Mesh) {
        if self.drops_surroundings() || self.options.backdrop.backdrop == BackdropWhen::Off {
            // The shell is part of the scene from here on.
            mesh.shell.clear();
            return (mesh, Mesh::default());
        }
        let shell = take_shell(&mut mesh, cameras);
        // Without other triangles the shell is the scene.
        if mesh.face_count() == 0 { (shell, mesh) } else { (mesh, shell) }
    }

    /// One closed surface in place of a shell that is made of shards.
    fn close_shell(&self, shell: Mesh, scene: &Mesh, cameras: &[Camera]) -> Mesh {
        // A panorama makes a surface of its own.
        if self.options.backdrop.backdrop == BackdropWhen::Sky || !is_scattered(&shell) {
            return shell;
        }
        let center = shell_center(&shell, cameras);
        let reach = scene.positions.iter().map(|v| v.distance(center)).fold(0.0, f32::max);
        let max_faces = self.budget.rest_beside(scene.face_count());
        close_surface(&shell, center, reach, max_faces).unwrap_or(shell)
    }

    /// Colours that run softly, unless colours are to stay: in a shell cut into quarters, or as
    /// they are where pictures will be fitted.
    fn smooth_shell(&self, mut shell: Mesh, scene: &Mesh, has_pictures: bool) -> Mesh {
        // A panorama has the shape of the shell only.
        let scene_faces = scene.face_count() + self.budget.input_backdrop;
        let has_room = self.options.backdrop.backdrop != BackdropWhen::Sky
            && has_room_for_quarters(&shell, scene_faces, &self.budget);
        if self.options.refit.refit == RefitColors::Off {
            return shell;
        }
        if has_room {
            return quarter_faces(&shell);
        }
        if !has_pictures {
            smooth_shell(&mut shell);
        }
        shell
    }

    /// Behind the remaining triangles, and before colours are taken from the photos: colours of
    /// holes belong to the sphere.
    pub(super) fn backdrop(
        &mut self,
        mesh: Mesh,
        surroundings: Option<Mesh>,
        views: Option<&mut Views>,
    ) -> Result<Mesh> {
        let options = &self.options.backdrop;
        let drops_surroundings = self.drops_surroundings();
        let budget = self.budget.surroundings;
        self.stage(mesh, Mesh::counts, |mesh, details| {
            if drops_surroundings {
                return Ok(Outcome::Skipped("the scene is cropped: its surroundings were removed"));
            }
            match surroundings {
                Some(surroundings) => keep_backdrop(mesh, surroundings, options, details),
                None => backdrop(mesh, views, options, budget, details),
            }
        })
    }

    /// Chooses the storage of the surroundings, of the scene and its levels.
    pub(super) fn store_surroundings(
        &mut self,
        asset: &mut Asset,
        sky: Sky,
        placement: &Placement,
    ) {
        match self.options.backdrop.backdrop {
            BackdropWhen::File => asset.surroundings = SurroundingsStorage::BackdropFile,
            BackdropWhen::Sky if !replace_backdrop(asset, sky, placement) => {
                let warning =
                    "no sky is written: it needs photos (`dataset`), or a scene with a shell";
                self.report.warnings.push(warning.to_owned());
            }
            _ => {}
        }
    }
}
