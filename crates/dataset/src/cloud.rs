//! A random cloud of points in the cameras' views, for data sets without points.

use super::posed::{Point, View};
use glam::{Vec2, Vec3};
use trisplat_scene::{Rng, camera, math::median::median};

/// Attempts to place a point in a second camera's view, too.
const TRIES: u64 = 16;

/// `count` grey points inside the views' frusta, the same ones for the same seed.
///
/// Each is on a random ray of one camera, log-uniformly between 0.3 and 3 times the viewing distance, and if
/// possible inside another camera's frustum, because a point in only one photo has no certain place.
pub fn random(views: &[&View], count: usize, seed: u64) -> Vec<Point> {
    if views.is_empty() {
        return Vec::new();
    }
    let distance = looking_distance(views);
    let point = |index: usize| {
        let view = views[index % views.len()];
        let place =
            |attempt: u64| on_ray(view, distance, Rng::new(seed, "random cloud", attempt), index as u64);
        let shared = |at: &Vec3| views.iter().any(|other| !std::ptr::eq(*other, view) && sees(other, *at));
        let position = (0..TRIES).map(place).find(shared).unwrap_or_else(|| place(0));
        Point { position, rgb: [128; 3], error: None }
    };
    (0..count).map(point).collect()
}

/// A random point in front of one camera.
fn on_ray(view: &View, distance: f32, rng: Rng, index: u64) -> Vec3 {
    let camera = &view.camera;
    let draw = |k: u64| rng.uniform(3 * index + k);
    let pixel = Vec2::new(draw(0), draw(1)) * camera.size.as_vec2();
    let depth = distance * 0.3 * 10f32.powf(draw(2));
    let seen = ((pixel - camera.center) / camera.focal).extend(1.0) * depth;
    camera.rotation.transpose() * (seen - camera.translation)
}

/// True when a world point lands inside the photo.
fn sees(view: &View, at: Vec3) -> bool {
    let camera = &view.camera;
    let v = camera.rotation * at + camera.translation;
    let q = camera.focal * v.truncate() / v.z + camera.center;
    v.z > 0.0 && q.cmpge(Vec2::ZERO).all() && q.cmplt(camera.size.as_vec2()).all()
}

/// The viewing distance: the median distance of the cameras to their common focus; without one, twice the
/// spread of the cameras; 1 for a single place.
fn looking_distance(views: &[&View]) -> f32 {
    let count = views.len() as f32;
    let centers: Vec<Vec3> = views.iter().map(|v| v.camera.position()).collect();
    let middle = centers.iter().sum::<Vec3>() / count;
    let spread = (centers.iter().map(|c| c.distance_squared(middle)).sum::<f32>() / count).sqrt();
    let fallback = if spread > 0.0 { 2.0 * spread } else { 1.0 };
    let Some(focus) = camera::focus(views.iter().map(|v| &v.camera)) else { return fallback };
    let distances = centers.iter().map(|c| c.distance(focus)).collect();
    let usual = median(distances, f32::total_cmp).unwrap_or(0.0);
    if usual > 1e-3 * spread && usual > 0.0 { usual } else { fallback }
}
