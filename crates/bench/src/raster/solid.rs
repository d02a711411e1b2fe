//! Small triangles for the solid rasteriser, which are hard for engines.

use super::timing::{CaseCost, RasterCase, camera, time};
use glam::{UVec2, Vec3};
use trisplat_raster::solid::{SolidRasterOptions, SolidRasterizer};
use trisplat_scene::{
    Rng,
    mesh::{Colors, Mesh},
};

/// Corners lie within this distance of a triangle's middle, px of a picture 1280 px wide.
const REACH_PX: f32 = 2.0;

/// `count` triangles a few px large, unconnected and in no order, that fill the view of [`camera`]; with one
/// colour per corner.
pub(super) fn mesh(count: usize, size: UVec2) -> Mesh {
    let focal = 0.9 * size.x as f32;
    let half = size.as_vec2() / 2.0 / focal;
    let (mut positions, mut colors) = (Vec::with_capacity(3 * count), Vec::with_capacity(3 * count));
    for i in 0..count {
        let rng = Rng::new(7, "bench solid", i as u64);
        let u = |k| rng.uniform(k) * 2.0 - 1.0;
        let z = 2.0 + 3.0 * rng.uniform(9);
        let center = Vec3::new(u(0) * half.x * z, u(1) * half.y * z, z);
        let radius = REACH_PX / (0.9 * 1280.0) * z;
        for k in 0..3 {
            positions.push(center + radius * Vec3::new(u(11 + 3 * k), u(12 + 3 * k), 0.3 * u(13 + 3 * k)));
            colors.push([30, 31, 32].map(|c| rng.uniform(3 * k + c)));
        }
    }
    Mesh { positions, colors: Colors::Vertex(colors), ..Mesh::default() }
}

/// What a frame costs.
pub(super) fn cost(case: &RasterCase, frames: usize) -> CaseCost {
    let (mesh, camera) = (mesh(case.triangles, case.size), camera(case.size));
    let mut solid = SolidRasterizer::new();
    time(frames, || {
        solid.render(&mesh, &camera, &SolidRasterOptions::default());
        solid.timings().to_vec()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_raster::solid::NO_FACE;

    #[test]
    fn triangles_are_small_and_cover_most_of_the_picture() {
        let size = UVec2::new(1280, 720);
        let (mesh, camera) = (mesh(200_000, size), camera(size));
        let mut solid = SolidRasterizer::new();
        let seen = solid.visibility(&mesh, &camera, &SolidRasterOptions::default());
        let covered = seen.face.iter().filter(|f| **f != NO_FACE).count() as f64 / seen.face.len() as f64;
        // Mean area 2.4 px, so 200,000 cover at most 0.53 of 921,600 px; some of them overlap by chance.
        assert!((0.2..0.5).contains(&covered), "{covered}");
    }
}
