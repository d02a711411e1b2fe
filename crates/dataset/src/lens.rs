//! The lens of a real camera: pinhole, fisheye or 360°, with distortion; and how its photos become
//! those of a pinhole.

use glam::{DMat2, DMat3, DVec2, DVec3, UVec2};
use std::f64::consts::{PI, TAU};
use trisplat_scene::image::RgbImage;

/// Intrinsics in f64: pixel = focal * distort(flat(x, y, z)) + center; pixel centres at +0.5.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// Image width and height, px.
    pub size: UVec2,
    /// Focal lengths, px.
    pub focal: DVec2,
    /// Principal point, px; anywhere.
    pub center: DVec2,
    /// Distortion of straight lines.
    pub distortion: Distortion,
}

/// Projection of a direction (x, y, z) onto the plane, before distortion.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum LensProjection {
    /// (x / z, y / z).
    #[default]
    Perspective,
    /// The angle to the axis, rad, along (x, y).
    Fisheye,
    /// Longitude and latitude, rad: an equirectangular picture.
    Spherical,
}

/// The model of OpenCV, COLMAP, nerfstudio and Metashape, on flat coordinates (x, y) with r² = x² +
/// y²:
///
/// ```text
/// x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + 2 p1 x y + p2 (r² + 2 x²) + s1 r²
/// y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + 2 p2 x y + p1 (r² + 2 y²) + s2 r²
/// ```
///
/// and at last x' + skew y'.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Distortion {
    /// k1, k2, k3, k4.
    pub radial: [f64; 4],
    /// p1, p2.
    pub tangential: [f64; 2],
    /// s1, s2.
    pub prism: [f64; 2],
    /// Rows that are not at a right angle to columns.
    pub skew: f64,
    /// Projection that it distorts.
    pub projection: LensProjection,
    /// The widest angle to the axis that the photo shows, rad, where its corners are black.
    pub limit: Option<f64>,
}

impl LensProjection {
    /// The flat coordinates of a direction; `None` behind a perspective lens.
    fn flat(self, ray: DVec3) -> Option<DVec2> {
        let across = ray.truncate().length();
        match self {
            Self::Perspective => (ray.z > 0.0).then(|| ray.truncate() / ray.z),
            Self::Fisheye if across == 0.0 => Some(DVec2::ZERO),
            Self::Fisheye => Some(ray.truncate() * (across.atan2(ray.z) / across)),
            Self::Spherical => {
                Some(DVec2::new(ray.x.atan2(ray.z), ray.y.atan2(ray.x.hypot(ray.z))))
            }
        }
    }

    /// A direction of these flat coordinates.
    fn ray(self, flat: DVec2) -> DVec3 {
        match self {
            Self::Perspective => flat.extend(1.0),
            Self::Fisheye => {
                let angle = flat.length();
                (flat * if angle > 0.0 { angle.sin() / angle } else { 1.0 }).extend(angle.cos())
            }
            Self::Spherical => {
                let (east, north) = flat.x.sin_cos();
                let (down, level) = flat.y.sin_cos();
                DVec3::new(east * level, down, north * level)
            }
        }
    }
}

impl Lens {
    /// The same lens for a photo resized to `size`.
    pub fn resized(&self, size: UVec2) -> Self {
        let ratio = size.as_dvec2() / self.size.as_dvec2();
        Self {
            size,
            focal: self.focal * ratio,
            center: self.center * ratio,
            distortion: self.distortion,
        }
    }

    /// A lens that sees everything around it, in a picture twice as wide as high.
    pub fn spherical(size: UVec2) -> Self {
        let distortion =
            Distortion { projection: LensProjection::Spherical, ..Distortion::default() };
        Self {
            size,
            focal: size.as_dvec2() / DVec2::new(TAU, PI),
            center: size.as_dvec2() / 2.0,
            distortion,
        }
    }

    /// The pixel of a direction (x, y, z), px; `None` behind a perspective lens.
    pub fn pixel(&self, ray: DVec3) -> Option<DVec2> {
        Some(self.project(self.distortion.projection.flat(ray)?))
    }

    /// A direction (x, y, z) of a pixel; `None` where the model folds over.
    pub fn ray(&self, pixel: DVec2) -> Option<DVec3> {
        Some(self.distortion.projection.ray(self.direction(pixel)?))
    }

    /// True for a perspective lens whose distortion folds over inside the photo.
    pub(crate) fn folds(&self) -> bool {
        let is_flat = self.distortion.projection == LensProjection::Perspective;
        is_flat && inner_rectangle(self).is_none()
    }

    /// The pixel of flat coordinates, in a perspective lens (x / z, y / z); px.
    pub fn project(&self, direction: DVec2) -> DVec2 {
        self.focal * self.distortion.distort(direction) + self.center
    }

    /// The flat coordinates of a pixel; `None` where the model folds over (two directions reach one
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
        let tangential = DVec2::new(
            p1 * twice + p2 * (r2 + 2.0 * p.x * p.x),
            p2 * twice + p1 * (r2 + 2.0 * p.y * p.y),
        );
        let bent = p * self.stretch(r2) + tangential + r2 * DVec2::from(self.prism);
        DVec2::new(bent.x + self.skew * bent.y, bent.y)
    }

    /// The `p` with the distorted position `q`, by Newton's method; `None` without one, or where
    /// the model has folded over.
    pub(crate) fn undistort(&self, q: DVec2) -> Option<DVec2> {
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
        let s = self.skew;
        let [s1, s2] = self.prism;
        let xx = xx + 2.0 * s1 * p.x;
        let yx = across + 2.0 * s2 * p.x;
        let xy = across + 2.0 * s1 * p.y;
        let yy = yy + 2.0 * s2 * p.y;
        DMat2::from_cols_array(&[xx + s * yx, yx, xy + s * yy, yy])
    }

    /// The largest angle to the axis of a fisheye lens before the model folds over, rad.
    pub(crate) fn widest(&self) -> f64 {
        let bent = |angle: f64| angle * self.stretch(angle * angle);
        let step = PI / 720.0;
        let folds = |&k: &u32| bent(f64::from(k + 1) * step) <= bent(f64::from(k) * step);
        f64::from((0..720).find(folds).unwrap_or(720)) * step
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
    pub(crate) lens: Lens,
    /// The camera of the resampled photo.
    pub(crate) pinhole: Lens,
    /// From the axes of the lens to those of the pinhole.
    pub(crate) turn: DMat3,
}

impl Undistort {
    /// The plan for photos of a perspective `lens`. Fails with the reason when the model folds over
    /// inside the photo or leaves nothing of it.
    pub(crate) fn new(lens: &Lens) -> Result<Self, String> {
        let (low, high) = inner_rectangle(lens).ok_or(
            "the distortion folds over inside the photo, so its coefficients cannot be right; find the poses again with a simpler lens \
             (COLMAP's SIMPLE_RADIAL, or SIMPLE_PINHOLE), or with `trisplat capture`",
        )?;
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
        Ok(Self { lens: *lens, pinhole, turn: DMat3::IDENTITY })
    }

    /// The photo resampled bilinearly. If it is smaller than the lens's size, the result is smaller
    /// by the same factor.
    pub(crate) fn apply(&self, photo: &RgbImage) -> RgbImage {
        let ratio = photo.size.as_dvec2() / self.lens.size.as_dvec2();
        let size = (self.pinhole.size.as_dvec2() * ratio).round().as_uvec2().max(UVec2::ONE);
        let step = self.pinhole.size.as_dvec2() / size.as_dvec2();
        let to_lens = self.turn.transpose();
        let places = (0..size.y).flat_map(|y| (0..size.x).map(move |x| (x, y)));
        let sources = places.map(|(x, y)| {
            let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) * step;
            let direction = (pixel - self.pinhole.center) / self.pinhole.focal;
            // Outside of the lens's field of view the plan has no pixel.
            let place = self.lens.pixel(to_lens * direction.extend(1.0)).unwrap_or_default();
            Bilinear::at(place * ratio, photo.size)
        });
        match &photo.alpha {
            None => {
                RgbImage { size, rgb: sources.map(|s| s.blend(&photo.rgb)).collect(), alpha: None }
            }
            Some(alpha) => {
                let alpha: &[[u8; 1]] = bytemuck::cast_slice(alpha);
                let (rgb, alpha) =
                    sources.map(|s| (s.blend(&photo.rgb), s.blend(alpha)[0])).unzip();
                RgbImage { size, rgb, alpha: Some(alpha) }
            }
        }
    }
}

/// The largest upright rectangle whose pixels are all inside the photo, in the pixels of a pinhole
/// with the same focal lengths and principal point; at most twice the photo's size around that
/// point.
fn inner_rectangle(lens: &Lens) -> Option<(DVec2, DVec2)> {
    let size = lens.size.as_dvec2();
    let mut low = lens.center - size;
    let mut high = lens.center + size;
    let undistort = |pixel: DVec2| lens.direction(pixel).map(|d| lens.focal * d + lens.center);
    // The outermost pixel centres can still be sampled; their pixels reach half a pixel further.
    let first = DVec2::splat(0.5);
    let last = size - 0.5;
    for y in 0..lens.size.y {
        let y = f64::from(y) + 0.5;
        low.x = low.x.max(undistort(DVec2::new(first.x, y))?.x - 0.5);
        high.x = high.x.min(undistort(DVec2::new(last.x, y))?.x + 0.5);
    }
    for x in 0..lens.size.x {
        let x = f64::from(x) + 0.5;
        low.y = low.y.max(undistort(DVec2::new(x, first.y))?.y - 0.5);
        high.y = high.y.min(undistort(DVec2::new(x, last.y))?.y + 0.5);
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
        let x = cell.x as usize;
        let y = cell.y as usize;
        let width = size.x as usize;
        let right = usize::from(size.x > 1);
        let below = if size.y > 1 { size.x as usize } else { 0 };
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

    const NONE: Distortion = Distortion {
        radial: [0.0; 4],
        tangential: [0.0; 2],
        prism: [0.0; 2],
        skew: 0.0,
        projection: LensProjection::Perspective,
        limit: None,
    };
    /// The phone camera of instant-ngp's fox, and stronger lenses both ways.
    const LENSES: [Distortion; 4] = [
        Distortion {
            radial: [0.0578421, -0.0805099, 0.0, 0.0],
            tangential: [-0.000980296, 0.00015575],
            ..NONE
        },
        Distortion {
            radial: [-0.3, 0.1, -0.01, 0.0],
            tangential: [0.002, -0.001],
            prism: [0.003, -0.002],
            skew: 0.01,
            ..NONE
        },
        Distortion { radial: [0.2, 0.05, 0.0, 0.01], ..NONE },
        NONE,
    ];

    fn grid() -> impl Iterator<Item = DVec2> {
        (0..21 * 21).map(|i| {
            DVec2::new(f64::from(i % 21) / 10.0 - 1.0, f64::from(i / 21) / 10.0 - 1.0) * 0.7
        })
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
                    let numeric =
                        (lens.distort(p + axis * h) - lens.distort(p - axis * h)) / (2.0 * h);
                    assert!((lens.distort_slope(p).col(column) - numeric).length() < 1e-8);
                }
            }
        }
    }

    #[test]
    fn a_folded_lens_says_so() {
        let fold = Distortion { radial: [-0.5, 0.0, 0.0, 0.0], ..NONE };
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
            distortion: Distortion { radial, tangential: [0.001, -0.002], ..NONE },
        }
    }

    /// Colours that vary smoothly with the direction a pinhole looks in.
    fn colour(direction: DVec2) -> [u8; 3] {
        [direction.x, direction.y, direction.x * direction.y]
            .map(|c| (128.0 + 120.0 * c).round() as u8)
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
            let pinhole = plan.pinhole;
            assert_eq!(straight.size, pinhole.size);
            assert!(straight.alpha.as_ref().is_some_and(|a| a.iter().all(|&a| a == 255)));
            let width = pinhole.size.x;
            for (i, rgb) in straight.rgb.iter().enumerate() {
                let i = i as u32;
                let pixel = DVec2::new(f64::from(i % width) + 0.5, f64::from(i / width) + 0.5);
                let want = colour((pixel - pinhole.center) / pinhole.focal);
                // One code: both the photo's pixels and the result are rounded.
                assert!(
                    (0..3).all(|c| rgb[c].abs_diff(want[c]) <= 1),
                    "{radial:?} {pixel} {rgb:?} {want:?}"
                );
            }
        }
    }

    #[test]
    fn lens_rectangle_is_the_largest_inside() {
        for radial in [[-0.15, 0.02, 0.0, 0.0], [0.12, 0.01, 0.0, 0.0], [-0.1, 0.3, 0.0, 0.0]] {
            let lens = lens(radial);
            let pinhole = Undistort::new(&lens).unwrap().pinhole;
            let [w, h] = pinhole.size.as_dvec2().to_array();
            let mut slack = [f64::INFINITY; 2];
            for k in 0..=400 {
                let t = f64::from(k) / 400.0;
                let x = 0.5 + t * (w - 1.0);
                let y = 0.5 + t * (h - 1.0);
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
        assert_eq!(plan.pinhole, lens);
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
