//! The solid rasteriser: defines an engine's picture, on the CPU.
//!
//! ```text
//! faces ──► project, clip, bin ──► tiles ──► fill (nearest face of every sample) ──► resolve ──► Pixels
//!                                                                              └──► export ──► Visibility
//! ```
//!
//! Every other renderer of this project is compared with this definition:
//!
//! * A triangle is clipped at the near plane and at a guard band far outside the picture; both sides are drawn;
//!   opacity is ignored: everything is opaque.
//! * Corners are snapped to 1/256 of a sample, as GPUs do; from there on edge functions are exact, so a shared
//!   edge neither gaps nor overlaps. A sample on an edge belongs to the triangle for which it is a top or left edge.
//! * Samples lie at the centres of a regular grid of N x N per pixel.
//! * The nearest face wins: greatest 1/z, which is affine on the screen; ties go to the lower face index. This
//!   does not depend on the order of drawing, hence not on the number of threads.
//! * Colours are interpolated perspective-correctly in linear light, averaged over a pixel's samples in linear
//!   light, then sRGB-encoded and rounded.

mod bin;
mod bins;
mod fill;
mod projector;
mod resolve;
mod shade;
mod visibility;

pub use resolve::SolidRasterOptions;
pub use visibility::{Barycentrics, FaceBarycentrics, NO_FACE, Nearest, PlaneTile, Visibility};

use bin::{Faces, PAIRS_PER_ROUND, rounds};
use bins::Batch;
use projector::Projector;
use trisplat_scene::{camera::Camera, image::RgbImage, mesh::Mesh};

/// The rasteriser: scratch memory that is reused from frame to frame.
#[derive(Debug, Default)]
pub struct SolidRasterizer {
    batches: Vec<Batch>,
    visibility: Visibility,
    /// Most pairs of triangles and tiles in the bins at once, where tests set fewer than usual.
    pairs_per_round: Option<usize>,
}

impl SolidRasterizer {
    /// A rasteriser without scratch memory.
    pub fn new() -> Self {
        Self::default()
    }

    fn pairs(&self) -> usize {
        self.pairs_per_round.unwrap_or(PAIRS_PER_ROUND)
    }

    /// The picture of `camera`, in 8 bits. The same bytes for any number of threads.
    ///
    /// The mesh must be valid ([`Mesh::validate_shape`]) and the options valid for the camera's size.
    pub fn render(&mut self, mesh: &Mesh, camera: &Camera, options: &SolidRasterOptions) -> RgbImage {
        let projector = Projector::new(camera, options.samples, options.near);
        let pairs = self.pairs();
        let faces = binned(&mut self.batches, mesh, &projector, pairs);
        resolve::picture(&faces, mesh, &projector, options)
    }

    /// The face and depth that every sample sees.
    pub fn visibility(&mut self, mesh: &Mesh, camera: &Camera, options: &SolidRasterOptions) -> &Visibility {
        let projector = Projector::new(camera, options.samples, options.near);
        let pairs = self.pairs();
        let faces = binned(&mut self.batches, mesh, &projector, pairs);
        resolve::export(&faces, &projector, &mut self.visibility);
        &self.visibility
    }

    /// The nearest face of each plane at every sample: face f belongs to plane `plane_of[f]` of `planes`.
    /// Tiles are given to `on_tile` several at a time and in any order. `[F]`
    pub fn planes(
        &mut self,
        mesh: &Mesh,
        camera: &Camera,
        options: &SolidRasterOptions,
        (planes, plane_of): (usize, &[u8]),
        on_tile: impl Fn(&PlaneTile<'_>) + Sync,
    ) {
        let projector = Projector::new(camera, options.samples, options.near);
        let pairs = self.pairs();
        visibility::planes(&mut self.batches, mesh, &projector, pairs, (planes, plane_of), on_tile);
    }
}

/// The faces of a mesh, ready for the tiles.
fn binned<'a>(batches: &'a mut Vec<Batch>, mesh: &Mesh, projector: &Projector, pairs: usize) -> Faces<'a> {
    rounds(batches, mesh, projector, (pairs, 1), |keys, batches, tile| {
        fill::fill(&mut keys[0], batches, tile, projector.size);
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat3, UVec2, Vec2, Vec3};
    use trisplat_scene::Rng;
    use trisplat_scene::mesh::Colors;

    const SIZE: UVec2 = UVec2::new(300, 170);

    fn camera() -> Camera {
        let (rotation, translation) = (Mat3::IDENTITY, Vec3::ZERO);
        Camera { rotation, translation, focal: Vec2::splat(200.0), center: SIZE.as_vec2() / 2.0, size: SIZE }
    }

    /// Triangles of all sizes, many of them across the picture, tilted and level, some through the near plane.
    fn deep(faces: u64) -> Mesh {
        let (mut positions, mut colors) = (Vec::new(), Vec::new());
        for i in 0..faces {
            let rng = Rng::new(5, "deep", i);
            let point = |k: u64| Vec3::from([0, 1, 2].map(|c| 2.0 * rng.uniform(3 * k + c) - 1.0));
            let depth = 6.0 - 5.9 * rng.uniform(30);
            let (reach, tilt) = [(4.0, 0.0), (0.2, 0.5), (6.0, 0.3), (0.02, 1.0)][i as usize % 4];
            let center = point(0) * depth * 0.4;
            for k in 1..4 {
                let corner = center + reach * depth * point(k);
                positions.push(Vec3::new(corner.x, corner.y, depth + tilt * reach * point(k).z));
            }
            colors.push([31, 32, 33].map(|c| rng.uniform(c)));
        }
        Mesh { positions, colors: Colors::Face(colors), ..Mesh::default() }
    }

    #[test]
    fn rounds_change_no_sample() {
        let (mesh, camera) = (deep(6000), camera());
        for samples in [1, 2] {
            let options = SolidRasterOptions { samples, ..SolidRasterOptions::default() };
            let mut whole =
                SolidRasterizer { pairs_per_round: Some(usize::MAX), ..SolidRasterizer::default() };
            let picture = whole.render(&mesh, &camera, &options);
            whole.visibility(&mesh, &camera, &options);
            for pairs in [1, 5000, 40_000] {
                let mut rounds =
                    SolidRasterizer { pairs_per_round: Some(pairs), ..SolidRasterizer::default() };
                assert!(rounds.render(&mesh, &camera, &options) == picture, "{pairs}");
                assert!(*rounds.visibility(&mesh, &camera, &options) == whole.visibility);
            }
        }
    }

    #[test]
    fn what_is_hidden_takes_no_memory() {
        let flat = |z: f32| [Vec3::new(-30.0, -30.0, z), Vec3::new(30.0, -30.0, z), Vec3::new(0.0, 60.0, z)];
        let positions = (0..20_000).flat_map(|i| flat(2.0 + 1e-4 * (i * 7919 % 20_000) as f32)).collect();
        let mesh = Mesh { positions, colors: Colors::Face(vec![[0.5; 3]; 20_000]), ..Mesh::default() };
        let mut solid = SolidRasterizer { pairs_per_round: Some(2000), ..SolidRasterizer::default() };
        let seen = solid.visibility(&mesh, &camera(), &SolidRasterOptions::default());
        assert!(seen.face.iter().all(|face| *face == 0));
        let held: usize = solid.batches.iter().flat_map(|b| &b.bins).map(|bin| bin.large.capacity()).sum();
        assert!(held < 40_000, "{held} pairs");
    }
}
