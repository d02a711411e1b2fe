//! Whether photos can show a scene at all, before any time is spent on them.

use glam::{UVec2, Vec2, Vec3};
use std::path::Path;
use trisplat_dataset::{Dataset, View};
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::lists::median;
use trisplat_scene::{Error, Result, parallel};

/// Number of photos that are looked at.
const PHOTOS: usize = 8;
/// Standard deviation of a photo of one color, codes: JPEG and noise cause less.
const MAX_PLAIN: f64 = 2.0;
/// Distance between cameras in one place, as a share of the distance of what they see.
const ONE_PLACE: f32 = 1e-4;
/// Points on a photo's side at which its overlap with others is looked for.
const GRID: u32 = 5;
/// Distances at which overlap is looked for: these powers of two, in units of the distance between cameras.
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
    let others = |i: usize| (1..count).flat_map(move |by| [(i + by) % count, (i + count - by) % count]);
    let is_alone = |i: usize| !others(i).any(|other| overlap(&cameras[i], &cameras[other], distance));
    let alone = parallel::map(&cameras, |i, _| is_alone(i)).into_iter().filter(|alone| *alone).count();
    if 2 * alone > count {
        return refuse(format!(
            "{alone} of {count} photos show nothing that another photo shows too; take photos that overlap by half or more, or train \
             with `anyway`"
        ));
    }
    let step = dataset.views.len().div_ceil(PHOTOS).max(1);
    let views: Vec<&View> = dataset.views.iter().step_by(step).collect();
    for view in &views {
        if !is_plain(&view.photo.decode()?) {
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

/// Median distance of points from the first camera; without points, that of the cameras from the origin, where rounding is of that size.
fn distance_of_points(dataset: &Dataset) -> f32 {
    let eye = dataset.views.first().map_or(Vec3::ZERO, |view| view.camera.position());
    let distances = dataset.points.iter().map(|point| point.position.distance(eye)).collect();
    median(distances, f32::total_cmp).unwrap_or(eye.length() / 100.0)
}

/// Whether one camera frames something before another, at some distance.
fn overlap(one: &Camera, other: &Camera, unit: f32) -> bool {
    let grid = (0..GRID * GRID).map(|i| UVec2::new(i % GRID, i / GRID).as_vec2() + 0.5);
    let pixels = grid.map(|cell| cell / GRID as f32 * one.size.as_vec2());
    let rays = pixels.map(|pixel: Vec2| ((pixel - one.center) / one.focal).extend(1.0));
    let mut points = rays.flat_map(|ray| DISTANCES.map(move |power| ray * unit * f32::powi(2.0, power)));
    let to_world = one.rotation.transpose();
    points.any(|point| other.frames(to_world * point + one.position()))
}

/// Whether a photo has one color, where it shows something.
fn is_plain(photo: &RgbImage) -> bool {
    let is_seen = |i: usize| photo.alpha.as_ref().is_none_or(|alpha| alpha[i] > 0);
    let seen = photo.rgb.iter().enumerate().filter(|(i, _)| is_seen(*i)).map(|(_, rgb)| rgb.map(f64::from));
    let mut sums = [[0.0; 3]; 3];
    for rgb in seen {
        for (channel, value) in rgb.into_iter().enumerate() {
            sums[0][channel] += 1.0;
            sums[1][channel] += value;
            sums[2][channel] += value * value;
        }
    }
    (0..3).all(|channel| {
        let [count, sum, squares] = sums.map(|sum| sum[channel]);
        count == 0.0 || squares / count - (sum / count).powi(2) < MAX_PLAIN * MAX_PLAIN
    })
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

    #[test]
    fn a_photo_of_one_color_is_plain_whatever_its_mask_hides() {
        let size = UVec2::new(40, 1);
        let mut photo = RgbImage { size, rgb: (0..40).map(|i| [90 + i % 2, 9, 200]).collect(), alpha: None };
        assert!(is_plain(&photo));
        photo.rgb[3] = [255, 9, 200];
        assert!(!is_plain(&photo));
        photo.alpha = Some((0..40).map(|i| if i == 3 { 0 } else { 255 }).collect());
        assert!(is_plain(&photo));
    }
}
