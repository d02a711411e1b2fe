//! The light of photos: at points that they track, or in cells beside a drawing.

use super::correction::{Rings, compared_size};
use crate::dataset::{Dataset, Point, View};
use glam::Vec2;
use std::sync::Arc;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::linear_of_srgb8;

/// Cells along each side of a picture.
const GRID: u32 = 16;
/// Range of compared codes: smaller ones are noise, larger ones may be saturated.
const COMPARED: std::ops::RangeInclusive<u8> = 8..=247;
/// Minimum share of compared pixels in a cell.
const MIN_SHARE: f32 = 0.5;
/// Minimum points that a photo tracks for an estimate.
pub(super) const MIN_POINTS: usize = 20;
/// Number of a light that belongs to no point.
const NO_POINT: u32 = u32::MAX;

/// The light of a photo at a place.
#[derive(Debug, Clone, Copy)]
pub struct Light {
    pub(super) point: u32,
    /// Its logarithm, per channel; beside a drawing, less that of the drawing.
    pub(super) log: [f32; 3],
    pub(super) weight: [f32; 3],
    /// Squared distance from the middle of the photo, 1 in its corners.
    pub(super) r2: f32,
}

impl Light {
    /// Light of a photo at the points that it tracks, in the size for comparing photos.
    pub fn of_photo(photo: &Arc<RgbImage>, points: &[(u32, Vec2)]) -> Vec<Self> {
        Self::at_points(&photo.clone().shared_at(compared_size(photo.size)), points)
    }

    /// The light of points, by their numbers and their places as shares of the width and height of
    /// `photo`. Masked, clipped and dark ones are left out.
    pub fn at_points(photo: &RgbImage, points: &[(u32, Vec2)]) -> Vec<Self> {
        let light = linear_of_srgb8();
        let rings = Rings::new(photo.size);
        let size = photo.size.as_vec2();
        let read = |(point, share): &(u32, Vec2)| {
            let place = (*share * size).clamp(Vec2::ZERO, size - 1.0);
            let i = (place.as_uvec2().y * photo.size.x + place.as_uvec2().x) as usize;
            let is_masked = photo.alpha.as_ref().is_some_and(|alpha| alpha[i] < 128);
            let useful = !is_masked && photo.rgb[i].iter().all(|code| COMPARED.contains(code));
            let log = photo.rgb[i].map(|code| light[usize::from(code)].ln());
            useful.then(|| Self { point: *point, log, weight: [1.0; 3], r2: rings.square(place) })
        };
        points.iter().filter_map(read).collect()
    }

    /// The light of cells beside that of a drawing of the same size, as a ratio of sums, which
    /// noise and small displacements hardly change.
    pub fn beside_drawing(photo: &RgbImage, drawn: &RgbImage) -> Vec<Self> {
        let size = photo.size;
        let rings = Rings::new(photo.size);
        let side = |i: u32, all: u32| (i * all / GRID, (i + 1) * all / GRID);
        let cell = |k: u32| {
            let (left, right) = side(k % GRID, size.x);
            let (top, bottom) = side(k / GRID, size.y);
            let pixels =
                (top..bottom).flat_map(|y| (left..right).map(move |x| (y * size.x + x) as usize));
            let r2 = rings.square(Vec2::new((left + right) as f32, (top + bottom) as f32) / 2.0);
            Self::of_cell(photo, drawn, pixels, r2)
        };
        (0..GRID * GRID).filter_map(cell).collect()
    }

    fn of_cell(
        photo: &RgbImage,
        drawn: &RgbImage,
        pixels: impl Iterator<Item = usize>,
        r2: f32,
    ) -> Option<Self> {
        let light = linear_of_srgb8();
        let mut sums = [[0.0f32; 2]; 3];
        let mut compared = [0.0f32; 3];
        let mut all = 0.0f32;
        for i in pixels {
            all += 1.0;
            if photo.alpha.as_ref().is_some_and(|alpha| alpha[i] < 128) {
                continue;
            }
            for c in 0..3 {
                let a = photo.rgb[i][c];
                let b = drawn.rgb[i][c];
                if COMPARED.contains(&a) && COMPARED.contains(&b) {
                    sums[c][0] += light[usize::from(a)];
                    sums[c][1] += light[usize::from(b)];
                    compared[c] += 1.0;
                }
            }
        }
        let counts = |c: usize| compared[c] > 0.0 && compared[c] >= MIN_SHARE * all;
        if !(0..3).any(counts) {
            return None;
        }
        let log = [0, 1, 2].map(|c| if counts(c) { (sums[c][0] / sums[c][1]).ln() } else { 0.0 });
        // An error of a code is a larger part of little light.
        let mean = |c: usize| (sums[c][0] * sums[c][1]).sqrt() / compared[c];
        let weight =
            [0, 1, 2].map(|c| if counts(c) { compared[c] / all * mean(c).powf(0.8) } else { 0.0 });
        Some(Self { point: NO_POINT, log, weight, r2 })
    }
}

/// The points that each training photo tracks, and their places as shares of its width and height;
/// `None` where too few photos track points to compare them.
pub fn compared_points(dataset: &Dataset) -> Option<Vec<Vec<(u32, Vec2)>>> {
    let photos = || dataset.train().filter(|view| !view.photo.is_drawn());
    let tracked = photos().filter(|view| view.tracked.len() >= MIN_POINTS).count();
    let is_enough = tracked > 0 && 10 * tracked >= 9 * photos().count();
    is_enough.then(|| dataset.train().map(|view| points_of(dataset, view)).collect())
}

/// The points that the photo of `view` tracks, but those that judge depth, with their places as
/// shares of its width and height.
pub fn points_of(dataset: &Dataset, view: &View) -> Vec<(u32, Vec2)> {
    let camera = &view.camera;
    let points = dataset.tracked(view).filter(|(i, _)| !Dataset::is_validation_point(*i));
    let place = |(i, point): (usize, &Point)| {
        Some((i as u32, camera.project(point.position)?.0 / camera.size.as_vec2()))
    };
    points.filter_map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::UVec2;

    #[test]
    fn clipped_and_masked_points_have_no_light() {
        let rgb = vec![[255; 3], [100, 2, 100], [100; 3], [50; 3]];
        let photo = RgbImage { size: UVec2::new(2, 2), rgb, alpha: Some(vec![255, 255, 0, 255]) };
        let places = [(0, [0.2, 0.2]), (1, [0.7, 0.2]), (2, [0.2, 0.7]), (3, [0.999, 1.0])];
        let lights = Light::at_points(&photo, &places.map(|(point, at)| (point, Vec2::from(at))));
        assert_eq!(lights.iter().map(|light| light.point).collect::<Vec<_>>(), [3]);
    }
}
