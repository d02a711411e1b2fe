//! The lens of a real camera, a pinhole with radial and tangential distortion, and how its photos are undistorted.

use glam::{DMat2, DVec2, UVec2};
use trisplat_scene::image::RgbImage;

/// Intrinsics in f64: pixel = focal * distort(x / z, y / z) + center; pixel centres at +0.5.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// Image width and height, px.
    pub size: UVec2,
    /// Focal lengths, px.
    pub focal: DVec2,
    /// Principal point, px; anywhere.
    pub center: DVec2,
    /// How it bends straight lines.
    pub distortion: Distortion,
}

/// The model of OpenCV, COLMAP's OPENCV and nerfstudio, on coordinates (x, y) with r² = x² + y²:
///
/// ```text
/// x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + 2 p1 x y + p2 (r² + 2 x²)
/// y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + 2 p2 x y + p1 (r² + 2 y²)
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Distortion {
    /// k1, k2, k3, k4.
    pub radial: [f64; 4],
    /// p1, p2.
    pub tangential: [f64; 2],
}

impl Lens {
    /// The same lens for a photo resized to `size`.
    pub fn resized(&self, size: UVec2) -> Self {
        let ratio = size.as_dvec2() / self.size.as_dvec2();
        Self { size, focal: self.focal * ratio, center: self.center * ratio, distortion: self.distortion }
    }

    /// The pixel of a direction (x / z, y / z), px.
    pub fn project(&self, direction: DVec2) -> DVec2 {
        self.focal * self.distortion.distort(direction) + self.center
    }

    /// The direction (x / z, y / z) of a pixel; `None` where the model folds over (two directions reach one
    /// pixel).
    pub fn direction(&self, pixel: DVec2) -> Option<DVec2> {
        self.distortion.undistort((pixel - self.center) / self.focal)
    }
}

impl Distortion {
    /// True when straight lines stay straight.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// The distorted position of `p`.
    fn distort(&self, p: DVec2) -> DVec2 {
        let [p1, p2] = self.tangential;
        let r2 = p.length_squared();
        let twice = 2.0 * p.x * p.y;
        let tangential =
            DVec2::new(p1 * twice + p2 * (r2 + 2.0 * p.x * p.x), p2 * twice + p1 * (r2 + 2.0 * p.y * p.y));
        p * self.stretch(r2) + tangential
    }

    /// The `p` with the distorted position `q`, by Newton's method; `None` without one, or where the model
    /// has folded over.
    fn undistort(&self, q: DVec2) -> Option<DVec2> {
        let mut p = q;
        for _ in 0..64 {
            let slope = self.distort_slope(p);
            let determinant = slope.determinant();
            let unfolded = determinant > 1e-6;
            if !unfolded {
                return None;
            }
            let step = slope.inverse() * (q - self.distort(p));
            // A long step would jump over the fold of a strong barrel lens.
            p += step.clamp_length_max(0.2 + 0.5 * p.length());
            if step.length() <= 1e-12 * (1.0 + p.length()) {
                return Some(p);
            }
        }
        None
    }

    /// ∂distort/∂p.
    fn distort_slope(&self, p: DVec2) -> DMat2 {
        let [k1, k2, k3, k4] = self.radial;
        let [p1, p2] = self.tangential;
        let r2 = p.length_squared();
        let stretch = self.stretch(r2);
        let d_stretch = k1 + r2 * (2.0 * k2 + r2 * (3.0 * k3 + r2 * 4.0 * k4)); // by r²
        let across = 2.0 * (p.x * p.y * d_stretch + p1 * p.x + p2 * p.y);
        let xx = stretch + 2.0 * p.x * p.x * d_stretch + 2.0 * p1 * p.y + 6.0 * p2 * p.x;
        let yy = stretch + 2.0 * p.y * p.y * d_stretch + 6.0 * p1 * p.y + 2.0 * p2 * p.x;
        DMat2::from_cols_array(&[xx, across, across, yy])
    }

    /// The radial factor at r².
    fn stretch(&self, r2: f64) -> f64 {
        let [k1, k2, k3, k4] = self.radial;
        1.0 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
    }
}

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

    /// The phone camera of instant-ngp's fox, and stronger lenses both ways.
    const LENSES: [Distortion; 4] = [
        Distortion { radial: [0.0578421, -0.0805099, 0.0, 0.0], tangential: [-0.000980296, 0.00015575] },
        Distortion { radial: [-0.3, 0.1, -0.01, 0.0], tangential: [0.002, -0.001] },
        Distortion { radial: [0.2, 0.05, 0.0, 0.01], tangential: [0.0, 0.0] },
        Distortion { radial: [0.0; 4], tangential: [0.0; 2] },
    ];

    fn grid() -> impl Iterator<Item = DVec2> {
        (0..21 * 21).map(|i| DVec2::new(f64::from(i % 21) / 10.0 - 1.0, f64::from(i / 21) / 10.0 - 1.0) * 0.7)
    }

    #[test]
    fn undistort_inverts_distort() {
        for lens in LENSES {
            for p in grid() {
                let back = lens.undistort(lens.distort(p)).unwrap();
                assert!((back - p).length() < 1e-11, "{lens:?} {p}");
            }
        }
    }

    #[test]
    fn slope_is_the_derivative() {
        for lens in LENSES {
            for p in grid() {
                let h = 1e-6;
                for (axis, column) in [(DVec2::X, 0), (DVec2::Y, 1)] {
                    let numeric = (lens.distort(p + axis * h) - lens.distort(p - axis * h)) / (2.0 * h);
                    assert!((lens.distort_slope(p).col(column) - numeric).length() < 1e-8);
                }
            }
        }
    }

    #[test]
    fn a_folded_lens_says_so() {
        let fold = Distortion { radial: [-0.5, 0.0, 0.0, 0.0], tangential: [0.0; 2] };
        // r (1 - r²/2) is largest, 0.544, at r = 0.816: nothing lands beyond.
        assert!(fold.undistort(DVec2::new(0.54, 0.0)).is_some_and(|p| p.x < 0.817));
        assert_eq!(fold.undistort(DVec2::new(0.56, 0.0)), None);
        assert_eq!(fold.undistort(DVec2::splat(f64::NAN)), None);
    }

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
