//! Chooses the photos to compare with each photo, and its range of depths.

use super::options::MOST_NEIGHBORS;
use crate::camera::Camera;
use crate::dataset::{Point, View, cloud};
use glam::Vec3;
use rayon::prelude::*;

/// Least angle between two rays for a good measurement of a point, radians: 8 degrees.
const GOOD_ANGLE: f32 = 0.14;
/// Deviation of the angle beyond [`GOOD_ANGLE`] at which surfaces look too different, radians.
const ANGLE_DEVIATION: f32 = 0.22;
/// Most points of a photo for choosing its neighbours.
const POINTS: usize = 200;
/// Least points in a photo's view for its range of depths.
const LEAST_POINTS: usize = 8;
/// Number of random points when points are missing.
const RANDOM_POINTS: usize = 4000;
/// Share of the points that may be outside the range of depths, on each side.
const OUTLIERS: f32 = 0.01;
/// The nearest depth, as a factor of that of the nearest points, and the farthest as one of the farthest
/// points'.
const MARGINS: [f32; 2] = [0.7, 2.0];

/// A photo's neighbours and depths.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Surroundings {
    /// Other photos, the best first.
    pub(super) neighbors: Vec<usize>,
    /// Least and largest 1/depth.
    pub(super) range: [f32; 2],
    /// Points that its camera frames.
    pub(super) points: Vec<Vec3>,
}

/// The surroundings of each photo.
pub(super) fn surroundings(views: &[&View], points: &[Point]) -> Vec<Surroundings> {
    let mut positions: Vec<Vec3> = points.iter().map(|p| p.position).collect();
    let framed = |position: &Vec3| views.iter().filter(|view| view.camera.frames(*position)).count();
    if positions.iter().filter(|p| framed(p) > 1).take(LEAST_POINTS).count() < LEAST_POINTS {
        positions.extend(cloud::random(views, RANDOM_POINTS, 0).iter().map(|p| p.position));
    }
    let of = |i: usize| {
        let camera = &views[i].camera;
        let points: Vec<Vec3> = positions.iter().copied().filter(|p| camera.frames(*p)).collect();
        let neighbors = neighbors(views, i, &points);
        Surroundings { neighbors, range: range(camera, &points), points }
    };
    (0..views.len()).into_par_iter().map(of).collect()
}

/// The photos that show the same surface from good angles, best first. Points of chosen photos count less, so
/// that neighbours lie on all sides.
fn neighbors(views: &[&View], own: usize, points: &[Vec3]) -> Vec<usize> {
    let camera = &views[own].camera;
    let step = points.len().div_ceil(POINTS).max(1);
    let some: Vec<Vec3> = points.iter().copied().step_by(step).collect();
    let mut left: Vec<(usize, Vec<f32>)> = (0..views.len())
        .filter(|other| *other != own)
        .map(|other| (other, some.iter().map(|p| score(camera, &views[other].camera, *p)).collect()))
        .collect();
    let (mut chosen, mut shown) = (Vec::new(), vec![0.0f32; some.len()]);
    while chosen.len() < MOST_NEIGHBORS {
        let gain = |scores: &[f32]| -> f32 {
            scores.iter().zip(&shown).map(|(score, shown)| score / (1.0 + shown)).sum()
        };
        let gains = left.iter().map(|(_, scores)| gain(scores)).enumerate();
        // Of equals the first.
        let best = gains.fold((0, 0.0), |best, (k, gain)| if gain > best.1 { (k, gain) } else { best });
        if best.1 <= 0.0 {
            break;
        }
        let (other, scores) = left.remove(best.0);
        chosen.push(other);
        shown.iter_mut().zip(&scores).for_each(|(shown, score)| *shown += score);
    }
    chosen
}

/// How well a second camera measures a point of the first.
fn score(camera: &Camera, other: &Camera, point: Vec3) -> f32 {
    if !other.frames(point) {
        return 0.0;
    }
    let (a, b) = (camera.position() - point, other.position() - point);
    let angle = a.angle_between(b);
    let good = (angle / GOOD_ANGLE).min(1.0);
    let beyond = (angle - GOOD_ANGLE).max(0.0) / ANGLE_DEVIATION;
    let size = |camera: &Camera, ray: Vec3| {
        camera.focal.x / camera.size.x as f32 / ray.length().max(f32::MIN_POSITIVE)
    };
    let ratio = size(camera, a) / size(other, b);
    good * good * (-0.5 * beyond * beyond).exp() * ratio.min(1.0 / ratio)
}

/// Least and largest 1/depth in a camera's view.
fn range(camera: &Camera, points: &[Vec3]) -> [f32; 2] {
    let depth = |p: &Vec3| (camera.rotation * *p + camera.translation).z;
    let mut depths: Vec<f32> = points.iter().map(depth).filter(|d| *d > 0.0 && d.is_finite()).collect();
    depths.sort_by(f32::total_cmp);
    match depths.len() {
        0 => [0.0; 2],
        n => {
            let outliers = ((n as f32 * OUTLIERS) as usize).min((n - 1) / 2);
            [1.0 / (MARGINS[1] * depths[n - 1 - outliers]), 1.0 / (MARGINS[0] * depths[outliers])]
        }
    }
}
