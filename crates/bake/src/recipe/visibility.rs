//! Triangles that cameras see.

use super::Recipe;
use super::values::SceneCameras;
use crate::budget::TriangleBudget;
use crate::prune::connected_flags;
use crate::surroundings::protected_faces;
use crate::unseen::{FaceLimit, UnseenDetails, UnseenOptions, masked, unseen};
use crate::views::Views;
use trisplat_scene::Result;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::Outcome;
use trisplat_surface::connected_parts;

impl Recipe<'_> {
    /// As soon as triangles are opaque and hide each other, before later stages work on hidden
    /// ones.
    pub(super) fn unseen(
        &mut self,
        mut mesh: Mesh,
        input_backdrop: Option<&Mesh>,
        mut views: Option<&mut Views>,
        cameras: &SceneCameras,
        is_soft: bool,
    ) -> Result<Mesh> {
        let options = self.options;
        let is_soup = self.is_soup;
        let backdrop = self.backdrop_in_gaps(&mesh, input_backdrop);
        let has_backdrop = backdrop.is_some();
        let budget =
            if has_backdrop { self.budget } else { TriangleBudget::new(self.budget.scene) };
        if let Some(backdrop) = backdrop {
            let shell = vec![true; backdrop.face_count()];
            mesh.append(Mesh { shell, ..backdrop })?;
        }
        let max_faces = match &views {
            Some(_) if self.budget.input_backdrop == 0 => {
                options.backdrop.scene_budget(budget.total)
            }
            _ => budget.total,
        };
        // Chosen cameras have not seen everything: they rank triangles, but drop none as unseen.
        let are_chosen = cameras.photos.is_empty();
        let unseen_options = UnseenOptions {
            keep_unseen: options.unseen.keep_unseen || are_chosen,
            ..options.unseen.clone()
        };
        let cameras = if are_chosen && max_faces.is_none() { &[] } else { &cameras.visibility[..] };
        let mut mesh =
            self.long_stage(mesh, Mesh::counts, |mesh, details: &mut UnseenDetails, progress| {
                // In a soft scene, `reshape` will still move the triangles that hide others.
                if !is_soft {
                    let progress = &mut progress.part(0.0, 0.5);
                    details.masked = masked(mesh, views.as_deref_mut(), &unseen_options, progress)?;
                }
                let mut protected = protected_faces(mesh, &budget);
                // A scene that keeps its shell gets no sphere, so its budget leaves no room for
                // one.
                let max_faces = if protected.is_empty() { max_faces } else { budget.total };
                let exceeds = max_faces.is_some_and(|most| mesh.face_count() as u64 > most);
                if exceeds && !is_soup {
                    protect_connected(mesh, &mut protected);
                }
                let are_whole = !is_soup && !exceeds && unseen_options.max_error.is_none();
                let parts = if are_whole && !cameras.is_empty() {
                    connected_parts(mesh)
                } else {
                    Vec::new()
                };
                let limit = FaceLimit { max_faces, protected, parts };
                let outcome =
                    unseen(mesh, cameras, views, &unseen_options, &limit, details, progress)?;
                Ok(if details.masked.is_some_and(|dropped| dropped > 0) {
                    Outcome::Changed(())
                } else {
                    outcome
                })
            })?;
        if has_backdrop {
            mesh.take_shell();
        }
        Ok(mesh)
    }

    /// The backdrop of the input, if a limit makes gaps in `mesh` that show it.
    fn backdrop_in_gaps(&self, mesh: &Mesh, input_backdrop: Option<&Mesh>) -> Option<Mesh> {
        let is_plain = |mesh: &Mesh| {
            mesh.indices.is_empty() && mesh.texture.is_none() && mesh.shell.is_empty()
        };
        let faces = mesh.face_count() as u64;
        let is_limited = self.budget.input_backdrop > 0
            && self.budget.scene.is_some_and(|max_faces| max_faces < faces);
        input_backdrop
            .filter(|backdrop| is_limited && is_plain(backdrop) && is_plain(mesh))
            .cloned()
    }
}

/// Protects faces of connected parts too, which have met their share of the limit already.
fn protect_connected(mesh: &Mesh, protected: &mut Vec<bool>) {
    let connected = connected_flags(mesh);
    if connected.contains(&true) {
        protected.resize(mesh.face_count(), false);
        for (protected, connected) in protected.iter_mut().zip(connected) {
            *protected |= connected;
        }
    }
}
