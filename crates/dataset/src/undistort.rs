//! A photo of a real lens, resampled to that of a pinhole camera.
//!
//! The pinhole keeps the focal lengths and is cropped to the largest upright rectangle that the photo
//! fills completely, so there is no border to mask.

use super::lens::{Distortion, Lens};
use glam::{DVec2, UVec2};
use trisplat_scene::image::RgbImage;

/// The resampling for photos of one lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Undistort {
    lens: Lens,
    pinhole: Lens,
}

impl Undistort {
    /// The plan for photos of `lens`. Fails with the reason when the model folds over inside the photo
    /// or leaves nothing of it.
    pub(crate) fn new(lens: &Lens) -> Result<Self, String> {
        let (low, high) = inner_rectangle(lens)
            .ok_or("the distortion folds over inside the photo: its coefficients cannot be right")?;
        let size = (high - low).floor();
        let visible = size.min_element() >= 1.0;
        if !visible {
            return Err("the distortion leaves nothing of the photo".into());
        }
        let pinhole = Lens {
            size: size.as_uvec2(),
            focal: lens.focal,
            center: lens.center - low,
            distortion: Distortion::default(),
        };
        Ok(Self { lens: *lens, pinhole })
    }

    /// The camera of the resampled photo.
    pub(crate) fn pinhole(&self) -> Lens {
        self.pinhole
    }

    /// The photo resampled bilinearly. If it is smaller than the lens's size, the result is smaller by the
    /// same factor.
    pub(crate) fn apply(&self, photo: &RgbImage) -> RgbImage {
        let ratio = photo.size.as_dvec2() / self.lens.size.as_dvec2();
        let size = (self.pinhole.size.as_dvec2() * ratio).round().as_uvec2().max(UVec2::ONE);
        let step = self.pinhole.size.as_dvec2() / size.as_dvec2();
        let places = (0..size.y).flat_map(|y| (0..size.x).map(move |x| (x, y)));
        let sources = places.map(|(x, y)| {
            let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) * step;
            let direction = (pixel - self.pinhole.center) / self.pinhole.focal;
            Bilinear::at(self.lens.project(direction) * ratio, photo.size)
        });
        match &photo.alpha {
            None => RgbImage { size, rgb: sources.map(|s| s.blend(&photo.rgb)).collect(), alpha: None },
            Some(alpha) => {
                let alpha: &[[u8; 1]] = bytemuck::cast_slice(alpha);
                let (rgb, alpha) = sources.map(|s| (s.blend(&photo.rgb), s.blend(alpha)[0])).unzip();
                RgbImage { size, rgb, alpha: Some(alpha) }
            }
        }
    }
}

/// The largest upright rectangle whose pixels are all inside the photo, in the pixels of a pinhole with
/// the same focal lengths and principal point; at most twice the photo's size around that point.
fn inner_rectangle(lens: &Lens) -> Option<(DVec2, DVec2)> {
    let size = lens.size.as_dvec2();
    let (mut low, mut high) = (lens.center - size, lens.center + size);
    let undistorted = |pixel: DVec2| lens.direction(pixel).map(|d| lens.focal * d + lens.center);
    // The outermost pixel centres can still be sampled; their pixels reach half a pixel further.
    let (first, last) = (DVec2::splat(0.5), size - 0.5);
    for y in 0..lens.size.y {
        let y = f64::from(y) + 0.5;
        low.x = low.x.max(undistorted(DVec2::new(first.x, y))?.x - 0.5);
        high.x = high.x.min(undistorted(DVec2::new(last.x, y))?.x + 0.5);
    }
    for x in 0..lens.size.x {
        let x = f64::from(x) + 0.5;
        low.y = low.y.max(undistorted(DVec2::new(x, first.y))?.y - 0.5);
        high.y = high.y.min(undistorted(DVec2::new(x, last.y))?.y + 0.5);
    }
    Some((low, high))
}

/// Bilinear interpolation: four neighbouring pixels and their weights, in 1/256.
struct Bilinear {
    at: [usize; 4],
    weight: [u32; 4],
}

impl Bilinear {
    /// At a place in a picture, px; beyond the outermost centres the nearest pixel is used.
    fn at(place: DVec2, size: UVec2) -> Self {
        let last = (size - 1).as_dvec2();
        let place = (place - 0.5).clamp(DVec2::ZERO, last);
        let cell = place.floor().min((last - 1.0).max(DVec2::ZERO));
        let [fx, fy] = ((place - cell) * 256.0).round().as_uvec2().to_array();
        let (x, y) = (cell.x as usize, cell.y as usize);
        let (width, right, below) =
            (size.x as usize, usize::from(size.x > 1), if size.y > 1 { size.x as usize } else { 0 });
        let corner = y * width + x;
        Self {
            at: [corner, corner + right, corner + below, corner + below + right],
            weight: [(256 - fx) * (256 - fy), fx * (256 - fy), (256 - fx) * fy, fx * fy],
        }
    }

    fn blend<const C: usize>(&self, pixels: &[[u8; C]]) -> [u8; C] {
        std::array::from_fn(|c| {
            let sum: u32 = (0..4).map(|k| self.weight[k] * u32::from(pixels[self.at[k]][c])).sum();
            ((sum + (1 << 15)) >> 16) as u8
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens(radial: [f64; 4]) -> Lens {
        Lens {
            size: UVec2::new(200, 150),
            focal: DVec2::new(180.0, 175.0),
            center: DVec2::new(103.5, 71.25),
            distortion: Distortion { radial, tangential: [0.001, -0.002] },
        }
    }

    /// Colours that vary smoothly with the direction a pinhole looks in.
    fn colour(direction: DVec2) -> [u8; 3] {
        [direction.x, direction.y, direction.x * direction.y].map(|c| (128.0 + 120.0 * c).round() as u8)
    }

    #[test]
    fn undistorted_pixels_show_what_the_pinhole_sees() {
        for radial in [[-0.15, 0.02, 0.0, 0.0], [0.12, 0.01, 0.0, 0.0], [-0.1, 0.3, 0.0, 0.0]] {
            let lens = lens(radial);
            let pixel = |i: u32| DVec2::new(f64::from(i % 200) + 0.5, f64::from(i / 200) + 0.5);
            let rgb = (0..200 * 150).map(|i| colour(lens.direction(pixel(i)).unwrap())).collect();
            let photo = RgbImage { size: lens.size, rgb, alpha: Some(vec![255; 200 * 150]) };
            let plan = Undistort::new(&lens).unwrap();
            let straight = plan.apply(&photo);
            let pinhole = plan.pinhole();
            assert_eq!(straight.size, pinhole.size);
            assert!(straight.alpha.as_ref().is_some_and(|a| a.iter().all(|&a| a == 255)));
            let width = pinhole.size.x;
            for (i, rgb) in straight.rgb.iter().enumerate() {
                let i = i as u32;
                let pixel = DVec2::new(f64::from(i % width) + 0.5, f64::from(i / width) + 0.5);
                let want = colour((pixel - pinhole.center) / pinhole.focal);
                // One code: both the photo's pixels and the result are rounded.
                assert!((0..3).all(|c| rgb[c].abs_diff(want[c]) <= 1), "{radial:?} {pixel} {rgb:?} {want:?}");
            }
        }
    }

    #[test]
    fn every_sampled_place_is_inside_and_no_larger_rectangle_would_be() {
        for radial in [[-0.15, 0.02, 0.0, 0.0], [0.12, 0.01, 0.0, 0.0], [-0.1, 0.3, 0.0, 0.0]] {
            let lens = lens(radial);
            let pinhole = Undistort::new(&lens).unwrap().pinhole();
            let [w, h] = pinhole.size.as_dvec2().to_array();
            let mut slack = [f64::INFINITY; 2];
            for k in 0..=400 {
                let t = f64::from(k) / 400.0;
                let (x, y) = (0.5 + t * (w - 1.0), 0.5 + t * (h - 1.0));
                for edge in [(x, 0.5), (x, h - 0.5), (0.5, y), (w - 0.5, y)] {
                    let place = lens.project((DVec2::from(edge) - pinhole.center) / pinhole.focal);
                    let margin = (place - 0.5).min(lens.size.as_dvec2() - 0.5 - place);
                    assert!(margin.min_element() > -1e-3, "{radial:?} {place}");
                    slack = [slack[0].min(margin.x), slack[1].min(margin.y)];
                }
            }
            assert!(slack[0] < 1.0 && slack[1] < 1.0, "{slack:?}");
        }
    }

    #[test]
    fn a_lens_without_distortion_changes_nothing() {
        let lens = Lens { distortion: Distortion::default(), ..lens([0.0; 4]) };
        let plan = Undistort::new(&lens).unwrap();
        assert_eq!(plan.pinhole(), lens);
        let rgb = (0..200 * 150).map(|i| [(i % 251) as u8, (i % 13) as u8, 9]).collect();
        let photo = RgbImage { size: lens.size, rgb, alpha: None };
        assert_eq!(plan.apply(&photo), photo);
    }

    #[test]
    fn a_photo_that_was_read_smaller_shows_the_same_smaller() {
        let lens = lens([-0.1, 0.3, 0.0, 0.0]);
        let pixel = |i: u32| DVec2::new(f64::from(i % 200) + 0.5, f64::from(i / 200) + 0.5);
        let rgb = (0..200 * 150).map(|i| colour(lens.direction(pixel(i)).unwrap())).collect();
        let photo = RgbImage { size: lens.size, rgb, alpha: None };
        let plan = Undistort::new(&lens).unwrap();
        let small = plan.apply(&photo.downscaled(lens.size / 2));
        let whole = plan.apply(&photo).downscaled(small.size);
        for (a, b) in small.rgb.iter().zip(&whole.rgb) {
            assert!((0..3).all(|c| a[c].abs_diff(b[c]) <= 2), "{a:?} {b:?}");
        }
    }

    #[test]
    fn impossible_coefficients_are_refused() {
        assert!(Undistort::new(&lens([-2.0, 0.0, 0.0, 0.0])).unwrap_err().contains("folds over"));
    }
}
