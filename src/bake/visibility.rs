//! Visible area of each face.

use super::views::{self, Views};
use crate::camera::Camera;
use crate::error::Result;
use crate::image::Pixels;
use crate::mesh::Mesh;
use crate::raster::solid::{NO_FACE, Solid};
use crate::report::StageProgress;

/// The visible area of each face in all cameras together, px. `[F]`
///
/// `samples_along`: samples per pixel along each axis.
pub fn visible_px(
    mesh: &Mesh,
    cameras: &[Camera],
    samples_along: u32,
    mut progress: StageProgress<'_>,
) -> Vec<f32> {
    let options = views::drawing(cameras, mesh, samples_along);
    let mut solid = Solid::new();
    let mut samples = vec![0u64; mesh.face_count()];
    for (done, camera) in cameras.iter().enumerate() {
        progress.set(done, cameras.len());
        for &face in &solid.visibility(mesh, camera, &options).face {
            if face != NO_FACE {
                samples[face as usize] += 1;
            }
        }
    }
    let per_sample = 1.0 / f64::from(samples_along * samples_along);
    samples.into_iter().map(|n| (n as f64 * per_sample) as f32).collect()
}

/// The visible area of a face, and how much of it masks leave.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counted {
    /// Samples that show the face, in all photos together.
    pub samples: u64,
    /// The sum of the weights of their pixels, 0 to 255 each.
    pub weights: u64,
}

impl Counted {
    /// The share of the visible area in unmasked pixels; `None` for a face that no photo sees.
    pub fn share(self) -> Option<f32> {
        (self.samples > 0).then(|| (self.weights as f64 / (255.0 * self.samples as f64)) as f32)
    }
}

/// The visible area of each face in unmasked pixels. `[F]`
///
/// `samples_along`: as for [`visible_px`]. `also` has each photo with its camera, once. Errors: a photo that cannot be
/// decoded.
pub fn counted(
    mesh: &Mesh,
    views: &mut Views,
    samples_along: u32,
    mut also: impl FnMut(&Camera, &Pixels),
    progress: &mut StageProgress<'_>,
) -> Result<Vec<Counted>> {
    let options = views::drawing(views.cameras(), mesh, samples_along);
    let mut solid = Solid::new();
    let mut counted = vec![Counted::default(); mesh.face_count()];
    views.prefetch(&(0..views.len()).collect::<Vec<_>>());
    for view in 0..views.len() {
        progress.set(view, views.len());
        let photo = views.photo(view)?;
        also(views.camera(view), &photo);
        let seen = solid.visibility(mesh, views.camera(view), &options);
        for (sample, &face) in (0u32..).zip(&seen.face).filter(|(_, face)| **face != NO_FACE) {
            let (x, y) = (sample % seen.size.x / samples_along, sample / seen.size.x / samples_along);
            let pixel = (y * photo.size.x + x) as usize;
            let face = &mut counted[face as usize];
            face.samples += 1;
            face.weights += photo.alpha.as_ref().map_or(255, |alpha| u64::from(alpha[pixel]));
        }
    }
    Ok(counted)
}
