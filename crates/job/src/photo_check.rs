//! Refuses photos that cannot show a scene, before any time is spent on them.

use glam::{UVec2, Vec2, Vec3};
use std::path::Path;
use trisplat_bake::psnr_of_mean_color;
use trisplat_dataset::{Dataset, View};
use trisplat_scene::camera::Camera;
use trisplat_scene::math::lists::median;
use trisplat_scene::{Error, Result, parallel};

/// Number of photos that are looked at.
const PHOTOS: usize = 8;
/// PSNR of its mean color against a photo of one color, dB: JPEG and noise leave more.
const PLAIN_PSNR: f64 = 42.0;
/// Distance between cameras in one place, as a share of the distance of what they see.
const ONE_PLACE: f32 = 1e-4;
/// Points on a photo's side at which its overlap with others is looked for.
const GRID: u32 = 5;
/// Distances at which overlap is looked for: these powers of two, in units of the distance between
/// cameras.
const DISTANCES: std::ops::RangeInclusive<i32> = -2..=8;

/// Refuse the photos of `dataset`, which is at `path`, if no training can make a scene of them.
///
/// # Errors
/// Photos of one color, of one place, or without overlap; photos that cannot be decoded.
pub(super) fn check_photos(dataset: &Dataset, path: &Path) -> Result<()> {
    let refuse = |reason: String| Err(Error::unsupported(path, reason));
    let cameras: Vec<Camera> = dataset.views.iter().map(|view| view.camera).collect();
    let distance = distance_between(&cameras);
    if distance <= ONE_PLACE * distance_of_points(dataset) {
        return refuse(
            "all photos were taken from one place, which shows no depth; walk around what is to be captured, or train with `anyway`".into(),
        );
    }
    let count = cameras.len();
    // Neighbors first, which overlap most often.
    let others =
        |i: usize| (1..count).flat_map(move |by| [(i + by) % count, (i + count - by) % count]);
    let is_alone =
        |i: usize| !others(i).any(|other| overlap(&cameras[i], &cameras[other], distance));
    let alone =
        parallel::map(&cameras, |i, _| is_alone(i)).into_iter().filter(|alone| *alone).count();
    if 2 * alone > count {
        return refuse(format!(
            "{alone} of {count} photos show nothing that another photo shows too; take photos that overlap by half or more, or train \
             with `anyway`"
        ));
    }
    let step = dataset.views.len().div_ceil(PHOTOS).max(1);
    let views: Vec<&View> = dataset.views.iter().step_by(step).collect();
    for view in &views {
        if psnr_of_mean_color(&view.photo.decode()?) < PLAIN_PSNR {
            return Ok(());
        }
    }
    refuse("its photos have one color each, which shows no shape; take photos of something with texture, or train with `anyway`".into())
}

/// Largest distance of a camera from their middle.
fn distance_between(cameras: &[Camera]) -> f32 {
    let middle = cameras.iter().map(Camera::position).sum::<Vec3>() / cameras.len().max(1) as f32;
    cameras.iter().map(|camera| camera.position().distance(middle)).fold(0.0, f32::max)
}

/// Median distance of points from the first camera; without points, that of the cameras from the
/// origin, where rounding is of that size.
fn distance_of_points(dataset: &Dataset) -> f32 {
    let eye = dataset.views.first().map_or(Vec3::ZERO, |view| view.camera.position());
    let distances = dataset.points.iter().map(|point| point.position.distance(eye)).collect();
    median(distances, f32::total_cmp).unwrap_or(eye.length() / 100.0)
}

/// True if another camera has a point before `one` in its picture, at some distance.
fn overlap(one: &Camera, other: &Camera, unit: f32) -> bool {
    let grid = (0..GRID * GRID).map(|i| UVec2::new(i % GRID, i / GRID).as_vec2() + 0.5);
    let pixels = grid.map(|cell| cell / GRID as f32 * one.size.as_vec2());
    let rays = pixels.map(|pixel: Vec2| ((pixel - one.center) / one.focal).extend(1.0));
    let mut points =
        rays.flat_map(|ray| DISTANCES.map(move |power| ray * unit * f32::powi(2.0, power)));
    let to_world = one.rotation.transpose();
    points.any(|point| other.is_in_frustum(to_world * point + one.position()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(eye: [f32; 3], target: [f32; 3]) -> Camera {
        Camera::look_at(eye.into(), target.into(), Vec3::Y, 0.8, [64, 48])
    }

    #[test]
    fn cameras_back_to_back_share_nothing() {
        let [left, right] =
            [camera([-1.0, 0.0, 0.0], [-2.0, 0.0, 0.0]), camera([1.0, 0.0, 0.0], [2.0, 0.0, 0.0])];
        assert!(!overlap(&left, &right, 1.0) && !overlap(&right, &left, 1.0));
        let [left, right] =
            [camera([-1.0, 0.0, 0.0], [0.0, 0.0, 5.0]), camera([1.0, 0.0, 0.0], [0.0, 0.0, 5.0])];
        assert!(overlap(&left, &right, 1.0) && overlap(&right, &left, 1.0));
        assert_eq!(distance_between(&[left, right]), 1.0);
    }
}
