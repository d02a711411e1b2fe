//! The first triangles: one per point of the sparse cloud, as large as the gap to its neighbours
//! (Held et al. 2025, section 3.3).
//!
//! ```text
//! v_i = q + k · d · u_i      d: mean distance to the three nearest points, u_i: uniform on the unit sphere
//! ```

use super::options::InitOptions;
use glam::Vec3;
use trisplat_scene::math::lists::median;
use trisplat_scene::math::neighbours::mean_distances;
use trisplat_scene::{Rng, Soup, sh0_from_rgb};

/// First opacity (0.28, supplement).
pub(super) const FIRST_OPACITY: f32 = 0.28;
/// First σ (1.16, supplement).
pub(super) const FIRST_SIGMA: f32 = 1.16;

/// A coloured point of the sparse cloud, in training space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct InitPoint {
    /// Position.
    pub position: Vec3,
    /// Colour, sRGB-encoded, in [0, 1].
    pub rgb: [f32; 3],
}

/// The first soup, SH degree 0. Points that are not finite are left out.
pub(crate) fn first_soup(points: &[InitPoint], options: &InitOptions, seed: u64) -> Soup {
    let points: Vec<InitPoint> =
        points.iter().copied().filter(|p| p.position.is_finite()).collect();
    let distances = mean_distances(&points.iter().map(|p| p.position).collect::<Vec<_>>());
    // A point without neighbours, or at the same place as these, gets the median size.
    let typical = median(distances.iter().copied().filter(|d| *d > 0.0).collect(), f32::total_cmp)
        .unwrap_or(0.05);
    let radii: Vec<f32> = distances
        .iter()
        .map(|&d| options.size as f32 * if d > 1e-4 * typical { d } else { typical })
        .collect();

    let rng = Rng::new(seed, "init", 0);
    let n = points.len();
    Soup {
        vertices: (0..n)
            .map(|i| {
                std::array::from_fn(|c| {
                    points[i].position + radii[i] * rng.on_sphere((3 * i + c) as u64)
                })
            })
            .collect(),
        opacity: vec![FIRST_OPACITY; n],
        sigma: vec![FIRST_SIGMA; n],
        sh: points.iter().map(|p| p.rgb.map(sh0_from_rgb)).collect(),
        sh_degree: 0,
        ..Soup::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(n: u64) -> Vec<InitPoint> {
        let rng = Rng::new(9, "grid", 0);
        (0..n)
            .map(|i| InitPoint {
                position: Vec3::new(
                    rng.uniform(3 * i),
                    rng.uniform(3 * i + 1),
                    rng.uniform(3 * i + 2),
                ),
                rgb: [0.5, 0.25, 1.0],
            })
            .collect()
    }

    #[test]
    fn corners_lie_on_spheres_around_the_points() {
        let points = grid(200);
        let options = InitOptions::default();
        let distances = mean_distances(&points.iter().map(|p| p.position).collect::<Vec<_>>());
        let soup = first_soup(&points, &options, 1);
        soup.validate().unwrap();
        assert_eq!(soup.len(), 200);
        for (i, corners) in soup.vertices.iter().enumerate() {
            for corner in corners {
                let radius = corner.distance(points[i].position);
                assert!((radius / (2.2 * distances[i]) - 1.0).abs() < 1e-3, "{radius}");
            }
        }
        assert!((soup.rgb(0)[1] - 0.25).abs() < 1e-6);
        assert_eq!(soup, first_soup(&points, &options, 1));
        assert_ne!(soup, first_soup(&points, &options, 2));
    }

    #[test]
    fn odd_clouds_give_valid_soups() {
        let options = InitOptions::default();
        let same = vec![InitPoint { position: Vec3::ONE, rgb: [0.0; 3] }; 5];
        let mut broken = grid(10);
        broken[3].position.x = f32::NAN;
        for (points, least) in [(vec![], 0), (grid(1), 1), (grid(2), 2), (same, 5), (broken, 9)] {
            let soup = first_soup(&points, &options, 0);
            soup.validate().unwrap();
            assert!(soup.len() >= least);
        }
    }
}
