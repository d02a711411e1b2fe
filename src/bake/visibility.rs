//! How much of each face cameras see.

use super::views;
use crate::camera::Camera;
use crate::mesh::Mesh;
use crate::raster::solid::{NO_FACE, Solid};
use crate::report::StageProgress;

/// The area of each face that all cameras together see, after everything in front of it, px. `[F]`
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
