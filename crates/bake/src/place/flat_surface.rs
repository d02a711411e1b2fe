//! The largest flat surface of a scene: a floor, a table or a wall.

use super::evidence::Evidence;
use super::ground::{self, Foreground, SurfaceSample};
use glam::DVec3;
use trisplat_scene::Rng;
use trisplat_scene::math::geometry::{scatter_matrix, symmetric_eigen};

/// Number of planes tried before the best is refined.
const TRIES: u64 = 2048;
/// Passes of the refinement.
const PASSES: usize = 12;
/// Thickness of a surface as a share of the distance of the cameras.
const THICKNESS: f64 = 0.01;
/// Minimum share of the points around the middle of the scene that lie on a clear surface.
const MIN_SHARE_OF_POINTS: f64 = 0.05;
/// Minimum share of the triangles' area there that lies on a clear surface: triangles scatter about
/// their surfaces, so every slice contains some.
const MIN_SHARE_OF_AREA: f64 = 0.15;
/// Minimum standard deviation of a clear surface along its narrow side, as a share of the distance
/// of the cameras.
const MIN_WIDTH: f64 = 0.05;
/// Number of samples that compare surfaces.
const MAX_COMPARED_SAMPLES: usize = 4000;

/// A flat surface.
pub(super) struct EstimatedSurface {
    /// Points up; a unit vector.
    pub(super) normal: DVec3,
    /// Share of all samples by weight.
    pub(super) share: f64,
}

/// The largest flat surface whose normal is within `cone` degrees of `up`, when there is a clear
/// one.
pub(super) fn largest_surface(
    scene: Foreground,
    evidence: Evidence,
    up: DVec3,
    cone: f64,
) -> Option<EstimatedSurface> {
    let region = ground::region(scene, evidence.cameras)?;
    let (samples, clear_share) = if evidence.points.is_empty() {
        (ground::faces(scene, &region), MIN_SHARE_OF_AREA)
    } else {
        (ground::points(evidence.points, &region), MIN_SHARE_OF_POINTS)
    };
    let min_cosine = libm::cos(cone.to_radians());
    let thickness = THICKNESS * region.radius;
    let near = |s: &SurfaceSample, point: DVec3, normal: DVec3| {
        (s.position - point).dot(normal).abs() < thickness
    };
    let sampled: Vec<SurfaceSample> = samples
        .iter()
        .step_by(samples.len().div_ceil(MAX_COMPARED_SAMPLES).max(1))
        .copied()
        .collect();
    let supported = |(point, normal): (DVec3, DVec3)| {
        sampled.iter().filter(|s| near(s, point, normal)).map(|s| s.weight).sum::<f64>()
    };
    let planes = planes(&sampled).filter(|(_, normal)| normal.dot(up).abs() > min_cosine);
    let best = planes.map(|plane| (supported(plane), plane)).max_by(|a, b| a.0.total_cmp(&b.0))?;
    let (mut point, mut normal) = best.1;
    let mut width = 0.0;
    let mut support = 0.0;
    for _ in 0..PASSES {
        let on_plane: Vec<&SurfaceSample> =
            samples.iter().filter(|s| near(s, point, normal)).collect();
        support = on_plane.iter().map(|s| s.weight).sum::<f64>();
        if support <= 0.0 {
            return None;
        }
        point = on_plane.iter().map(|s| s.position * s.weight).sum::<DVec3>() / support;
        let [thin, narrow, _] = symmetric_eigen(scatter_matrix(
            on_plane.iter().map(|s| (s.position - point, s.weight)),
        ));
        normal = thin.1;
        width = narrow.0.max(0.0).sqrt();
    }
    let normal = if normal.dot(up) < 0.0 { -normal } else { normal };
    let share = support / samples.iter().map(|s| s.weight).sum::<f64>();
    let clear =
        share >= clear_share && width >= MIN_WIDTH * region.radius && normal.dot(up) > min_cosine;
    clear.then_some(EstimatedSurface { normal, share })
}

/// Planes through three of the samples, chosen by weight: a point and a unit normal each.
fn planes(samples: &[SurfaceSample]) -> impl Iterator<Item = (DVec3, DVec3)> {
    let mut sum = 0.0;
    let sums: Vec<f64> = samples
        .iter()
        .map(|s| {
            sum += s.weight;
            sum
        })
        .collect();
    let rng = Rng::new(0, "level surface", 0);
    let tries = if samples.len() < 3 { 0 } else { TRIES };
    (0..tries).filter_map(move |i| {
        let [a, b, c] = [0, 1, 2].map(|k| {
            let at = sums.partition_point(|s| *s <= rng.uniform_f64(3 * i + k) * sum);
            samples[at.min(samples.len() - 1)].position
        });
        let normal = (b - a).cross(c - a).try_normalize()?;
        Some((a, normal))
    })
}
