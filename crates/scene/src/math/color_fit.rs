//! The affine colour map between two pictures with the least error.
//!
//! The exposure and white balance of a held-out photo are unknown to the scene. After the map, with 12
//! numbers per picture, the remaining error is the scene's own. It is fitted on sRGB-encoded colours, because
//! errors are measured on them.

use glam::{DMat4, DVec3, DVec4};

/// Weight of the identity map, as a share of the picture's weight: it determines the directions that a
/// picture of few colours leaves open.
const RIDGE: f64 = 1e-6;

/// A map of sRGB-encoded colours, 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColorMap {
    /// Factors of red, green, blue and 1 for each channel.
    rows: [DVec4; 3],
}

impl ColorMap {
    /// The map that brings `from` closest to `to`, by least squares. Weights per pixel, 0 to 255, exclude
    /// masked pixels; `None` weights all equally. The pictures must have the same number of pixels.
    pub fn fit(from: &[[u8; 3]], to: &[[u8; 3]], weights: Option<&[u8]>) -> Self {
        assert_eq!(from.len(), to.len(), "pictures of different sizes");
        let mut matrix = DMat4::ZERO;
        let mut right = [DVec4::ZERO; 3];
        let mut all = 0.0;
        for (i, (from, to)) in from.iter().zip(to).enumerate() {
            let weight = weights.map_or(1.0, |weights| f64::from(weights[i]) / 255.0);
            let (x, y) = (encoded(*from).extend(1.0), encoded(*to));
            let weighted = weight * x;
            matrix += DMat4::from_cols(x.x * weighted, x.y * weighted, x.z * weighted, x.w * weighted);
            (0..3).for_each(|c| right[c] += y[c] * weighted);
            all += weight;
        }
        // Never zero: then the map changes nothing.
        let ridge = RIDGE * all.max(1.0);
        let inverse = (matrix + ridge * DMat4::IDENTITY).inverse();
        let same = [DVec4::X, DVec4::Y, DVec4::Z];
        Self { rows: [0, 1, 2].map(|c: usize| inverse * (right[c] + ridge * same[c])) }
    }

    /// A colour after the map, 0 to 1, not limited.
    pub fn color(&self, rgb: [u8; 3]) -> [f64; 3] {
        let x = encoded(rgb).extend(1.0);
        self.rows.map(|row| row.dot(x))
    }

    /// The colours of a picture after the map, rounded to 8 bits.
    pub fn of(&self, rgb: &[[u8; 3]]) -> Vec<[u8; 3]> {
        let mapped = |rgb: &[u8; 3]| self.color(*rgb).map(|c| (255.0 * c).round().clamp(0.0, 255.0) as u8);
        rgb.iter().map(mapped).collect()
    }
}

fn encoded(rgb: [u8; 3]) -> DVec3 {
    DVec3::from_array(rgb.map(f64::from)) / 255.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::metric::psnr;

    /// Colours of all kinds, none near black or white.
    fn colors() -> Vec<[u8; 3]> {
        (0..4096u32).map(|i| [60 + i % 97, 60 + i / 7 % 89, 60 + i / 31 % 101].map(|c| c as u8)).collect()
    }

    #[test]
    fn known_gains_and_offsets_are_undone() {
        let from = colors();
        let mix = |[r, g, b]: [u8; 3]| {
            let [r, g, b] = [r, g, b].map(f64::from);
            [1.2 * r - 0.05 * g + 4.0, 0.8 * g + 0.1 * b, 0.02 * r + 1.1 * b - 9.0].map(|c| c.round() as u8)
        };
        let to: Vec<[u8; 3]> = from.iter().map(|c| mix(*c)).collect();
        let map = ColorMap::fit(&from, &to, None);
        let want = [[1.2, -0.05, 0.0, 4.0 / 255.0], [0.0, 0.8, 0.1, 0.0], [0.02, 0.0, 1.1, -9.0 / 255.0]];
        for (row, want) in map.rows.iter().zip(want) {
            assert!((*row - DVec4::from_array(want)).abs().max_element() < 2e-3, "{row} {want:?}");
        }
        assert!(psnr(&from, &to, None) < 30.0);
        // What is left is how both were rounded.
        assert!(psnr(&map.of(&from), &to, None) > 55.0);
    }

    #[test]
    fn pixels_without_weight_do_not_count() {
        let from = colors();
        let mut to: Vec<[u8; 3]> = from.iter().map(|c| c.map(|c| c / 2)).collect();
        let mut weights = vec![255; from.len()];
        for i in (0..from.len()).step_by(3) {
            (to[i], weights[i]) = ([255, 0, 255], 0);
        }
        assert!(psnr(&ColorMap::fit(&from, &to, Some(&weights)).of(&from), &to, Some(&weights)) > 50.0);
        assert!(psnr(&ColorMap::fit(&from, &to, None).of(&from), &to, Some(&weights)) < 30.0);
    }

    #[test]
    fn one_colour_or_none_is_no_fault() {
        let map = ColorMap::fit(&[], &[], None);
        assert_eq!(map.of(&colors()), colors());
        let (from, to) = ([[100, 50, 20]; 9], [[90, 60, 20]; 9]);
        assert_eq!(ColorMap::fit(&from, &to, None).of(&from), to);
        assert_eq!(ColorMap::fit(&from, &to, Some(&[0; 9])).of(&from), from);
    }
}
