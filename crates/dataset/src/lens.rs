//! The lens of a real camera: a pinhole with radial and tangential distortion.

use glam::{DMat2, DVec2, UVec2};

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
    pub fn distort(&self, p: DVec2) -> DVec2 {
        let [p1, p2] = self.tangential;
        let r2 = p.length_squared();
        let twice = 2.0 * p.x * p.y;
        let tangential =
            DVec2::new(p1 * twice + p2 * (r2 + 2.0 * p.x * p.x), p2 * twice + p1 * (r2 + 2.0 * p.y * p.y));
        p * self.stretch(r2) + tangential
    }

    /// The `p` with the distorted position `q`, by Newton's method; `None` without one, or where the model
    /// has folded over.
    pub fn undistort(&self, q: DVec2) -> Option<DVec2> {
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
}
