//! Visible area of each face.

use super::views::{self, Views};
use trisplat_raster::solid::{NO_FACE, SolidRasterizer};
use trisplat_scene::{Result, camera::Camera, mesh::Mesh, report::StageProgress};

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
    let mut solid = SolidRasterizer::new();
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

/// The share of each face's visible area in unmasked pixels; `None` for faces that no photo sees. `[F]`
///
/// `samples_along`: as for [`visible_px`]. Errors: a photo that cannot be decoded.
pub(crate) fn counted_share(
    mesh: &Mesh,
    views: &mut Views,
    samples_along: u32,
    progress: &mut StageProgress<'_>,
) -> Result<Vec<Option<f32>>> {
    let options = views::drawing(views.cameras(), mesh, samples_along);
    let mut solid = SolidRasterizer::new();
    // Samples, and the weights of their pixels.
    let mut seen_of = vec![(0u64, 0u64); mesh.face_count()];
    views.prefetch(&(0..views.len()).collect::<Vec<_>>());
    for view in 0..views.len() {
        progress.set(view, views.len());
        let photo = views.photo(view)?;
        let seen = solid.visibility(mesh, views.camera(view), &options);
        for (sample, &face) in (0u32..).zip(&seen.face).filter(|(_, face)| **face != NO_FACE) {
            let (x, y) = (sample % seen.size.x / samples_along, sample / seen.size.x / samples_along);
            let pixel = (y * photo.size.x + x) as usize;
            let (samples, weights) = &mut seen_of[face as usize];
            *samples += 1;
            *weights += photo.alpha.as_ref().map_or(255, |alpha| u64::from(alpha[pixel]));
        }
    }
    let share = |(samples, weights): (u64, u64)| {
        (samples > 0).then(|| (weights as f64 / (255.0 * samples as f64)) as f32)
    };
    Ok(seen_of.into_iter().map(share).collect())
}
