//! Adds photos to a fit.

use super::equations::Fit;
use super::photo_equations::{Gatherer, Observation};
use crate::views::{SAMPLES, Views};
use trisplat_raster::solid::{SolidRasterOptions, SolidRasterizer};
use trisplat_scene::{Result, mesh::Mesh, report::StageProgress};

/// Number of photos at which the first pass is half coupled. Coupled neighbours share the residual of their
/// pixel. With many photos this is sharper. With few photos one triangle corrects the error of another, which
/// looks wrong from other places.
const HALF_COUPLED: f32 = 40.0;

/// Renders the scene from each photo's camera, and adds the photo's pixels to the normal equations.
pub(super) struct Accumulator {
    solid: SolidRasterizer,
    drawing: SolidRasterOptions,
    gatherer: Gatherer,
    pub(super) fit: Fit,
    /// See [`Observation::coupling`].
    pub(super) coupling: f32,
    /// Mean error of each photo when it was last added, sRGB-encoded.
    pub(super) errors: Vec<[f32; 3]>,
}

impl Accumulator {
    /// Nothing added yet. `flatness` is λ, px.
    pub(super) fn new(mesh: &Mesh, views: &Views, flatness: f32) -> Self {
        Self {
            solid: SolidRasterizer::new(),
            drawing: views.drawing(mesh, SAMPLES),
            gatherer: Gatherer::new(mesh.face_count()),
            fit: Fit::new(mesh, flatness),
            coupling: views.len() as f32 / (views.len() as f32 + HALF_COUPLED),
            errors: vec![[0.0; 3]; views.len()],
        }
    }

    /// Adds the photos `chosen` to the sums of the fit, in their order, with this sign: -1 takes them back.
    pub(super) fn add(
        &mut self,
        mesh: &Mesh,
        views: &mut Views,
        chosen: &[usize],
        sign: f32,
        mut progress: StageProgress<'_>,
    ) -> Result<()> {
        views.prefetch(chosen);
        for (done, &view) in chosen.iter().enumerate() {
            progress.set(done, chosen.len());
            let photo = views.photo(view)?;
            let camera = views.camera(view);
            let visibility = self.solid.visibility(mesh, camera, &self.drawing);
            let background = self.drawing.background;
            let seen =
                Observation { mesh, camera, photo: &photo, visibility, background, coupling: self.coupling };
            self.errors[view] = self.gatherer.gather(&seen, &mut self.fit, sign);
        }
        Ok(())
    }
}
