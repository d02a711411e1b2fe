//! What stands behind the scene: the shell of a training, a backdrop of the input, a sphere, or a panorama.

use super::Recipe;
use crate::backdrop::{BackdropWhen, Sky, backdrop, closed, is_scattered, keep_backdrop, take_sky};
use crate::refit::{RefitColors, smooth_shell};
use crate::shell::{cut, is_cut, middle, take_shell};
use crate::views::Views;
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::Outcome;
use trisplat_scene::{Asset, Placement, Result};

impl Recipe<'_> {
    /// The shell counts as backdrop, outside the levels. A scene that is cropped, or baked without a
    /// backdrop, keeps its shell as part of the scene.
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

    /// One closed surface in place of a shell that is made of shards. The shells of several inputs stay.
    pub(super) fn whole_shell(&self, shell: Mesh, scene: &Mesh, watching: &[Camera]) -> Mesh {
        // A panorama makes a surface of its own.
        if self.options.backdrop.backdrop == BackdropWhen::Sky || !is_scattered(&shell) {
            return shell;
        }
        let center = middle(&shell, watching);
        let reach = scene.positions.iter().map(|v| v.distance(center)).fold(0.0, f32::max);
        closed(&shell, center, reach)
    }

    /// Colours that run softly, unless colours are to stay: in a shell that is cut, or as they are where pictures will be fitted.
    pub(super) fn soft_shell(&self, mut shell: Mesh, scene_faces: usize, has_pictures: bool) -> Mesh {
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
    fn is_cropped(&self) -> bool {
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

    /// Behind the remaining triangles, and before colours are taken from the photos: colours of holes belong
    /// to the sphere.
    pub(super) fn backdrop(
        &mut self,
        mesh: Mesh,
        behind: Option<Mesh>,
        views: Option<&mut Views>,
    ) -> Result<Mesh> {
        let (options, cropped) = (&self.options.backdrop, self.is_cropped());
        self.report.stage(self.observer, mesh, Mesh::counts, |mesh, details| match behind {
            _ if cropped => Ok(Outcome::Skipped("the scene is cropped: its surroundings were removed")),
            Some(behind) => keep_backdrop(mesh, behind, options, details),
            None => backdrop(mesh, views, options, details),
        })
    }
}
