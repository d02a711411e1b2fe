//! Colours from pictures.

use super::Recipe;
use crate::lit::Lit;
use crate::refit::{UnseenColors, refit};
use crate::sh::sh;
use crate::texture::texture;
use crate::views::Views;
use trisplat_scene::Result;
use trisplat_scene::mesh::Mesh;

impl Recipe<'_> {
    /// On the remaining triangles, because colours depend on which parts of them are visible. Faces
    /// from `scene_faces` on are the backdrop.
    pub(super) fn refit(
        &mut self,
        mesh: Mesh,
        scene_faces: usize,
        views: Option<&mut Views>,
    ) -> Result<(Mesh, Option<UnseenColors>)> {
        let options = &self.options.refit;
        let mut unseen_colors = None;
        let mesh = self.long_stage(mesh, Mesh::counts, |mesh, details, progress| {
            let refitted = refit(mesh, scene_faces, views, options, details, progress)?;
            unseen_colors = refitted.unseen;
            Ok(refitted.outcome)
        })?;
        Ok((mesh, unseen_colors))
    }

    /// On fitted colours, beside which harmonics show what the direction changes. Faces from
    /// `scene_faces` on are the backdrop.
    pub(super) fn sh(
        &mut self,
        mesh: Mesh,
        scene_faces: usize,
        views: Option<&mut Views>,
    ) -> Result<Mesh> {
        let options = &self.options.sh;
        let is_lit = self.options.lit.lit != Lit::Off;
        let instead = if self.options.texture.is_wanted() {
            Some("a texture")
        } else {
            is_lit.then_some("normals for lights")
        };
        self.long_stage(mesh, Mesh::counts, |mesh, details, progress| {
            sh(mesh, scene_faces, views, instead, options, details, progress)
        })
    }

    /// On fitted colours: texels store differences from them.
    pub(super) fn texture(
        &mut self,
        mesh: Mesh,
        unseen_colors: Option<UnseenColors>,
        views: Option<&mut Views>,
    ) -> Result<Mesh> {
        let options = &self.options.texture;
        let (mesh, details) = self.report.long_stage(
            self.observer,
            mesh,
            Mesh::counts,
            |mesh, details, progress| {
                texture(mesh, views, unseen_colors, options, details, progress)
            },
        )?;
        let warning = details.warning().filter(|_| mesh.texture.is_some());
        self.report.warnings.extend(warning);
        Ok(mesh)
    }
}
