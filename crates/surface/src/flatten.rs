//! Makes planes of drawn depths where photos show no texture: nothing tells triangles there how far
//! they are, so their depths are noise around the surface, which measured depths beside them share.

use crate::picture::{DepthPicture, UNKNOWN};
use glam::{IVec2, Mat3, Vec3};
use trisplat_scene::parallel::{self, GRAIN};

/// Cells to each side that make a plane.
const RADIUS: i32 = 5;
/// Largest difference of an sRGB code of cells of one colour.
const MAX_COLOR_DIFFERENCE: u8 = 16;
/// Minimum share of the cells of one colour, or there is texture.
const MIN_ALIKE: f32 = 0.7;
/// Largest share by which the depth of a cell differs from the plane that it makes.
const MAX_DIFFERENCE: f32 = 0.1;
/// Rounds of a fit, each with the cells near the plane of the round before.
const ROUNDS: u32 = 3;
/// Added to the sums of a fit, per cell², so that cells in a line have a plane.
const DAMPING: f32 = 1e-3;

/// The drawn depths of a picture at the cells of `measured`, the depths and colours of its photo,
/// which replace them where they are known.
struct Cells<'a> {
    /// 1/z and its weight: 1 drawn, more measured, 0 unknown.
    values: Vec<(f32, f32)>,
    measured: &'a DepthPicture,
    size: IVec2,
}

/// Flattens the drawn depths of `picture`.
pub(super) fn flatten(picture: &mut DepthPicture, measured: &DepthPicture) {
    let cells = Cells::new(picture, measured);
    let planes = parallel::collect(cells.values.len(), GRAIN / 64, |cell| cells.plane(cell));
    let ratio = measured.camera.focal / picture.camera.focal;
    for pixel in 0..picture.depth.len() {
        let place = picture.middle(pixel) * ratio;
        let Some(cell) = measured.pixel_at(place) else { continue };
        let Some(plane) = planes[cell] else { continue };
        let inverse = plane.dot((place - measured.middle(cell)).extend(1.0));
        // A pixel of another surface stays.
        if (picture.depth[pixel] * inverse - 1.0).abs() < 2.0 * MAX_DIFFERENCE {
            picture.depth[pixel] = inverse.recip();
        }
    }
}

impl<'a> Cells<'a> {
    fn new(picture: &DepthPicture, measured: &'a DepthPicture) -> Self {
        let ratio = picture.camera.focal / measured.camera.focal;
        let value = |cell: usize| {
            if measured.depth[cell] != UNKNOWN {
                return (measured.depth[cell].recip(), measured.weight);
            }
            let drawn = picture.depth[picture.nearest(measured.middle(cell) * ratio)];
            if drawn > 0.0 && drawn.is_finite() { (drawn.recip(), 1.0) } else { (0.0, 0.0) }
        };
        let values = (0..measured.depth.len()).map(value).collect();
        Self { values, measured, size: measured.camera.size.as_ivec2() }
    }

    /// 1/z around a cell whose depth is drawn, as its change per cell to the right and down and its
    /// value; `None` where photos show texture.
    ///
    /// 1/z of a plane is linear in the picture.
    fn plane(&self, cell: usize) -> Option<Vec3> {
        let (drawn, weight) = self.values[cell];
        if weight == 0.0 || self.measured.depth[cell] != UNKNOWN {
            return None;
        }
        let mut plane = Vec3::new(0.0, 0.0, drawn);
        for round in 0..ROUNDS {
            let max_difference = if round == 0 { 2.0 * MAX_DIFFERENCE } else { MAX_DIFFERENCE };
            let mut squares = Mat3::from_diagonal(Vec3::new(DAMPING, DAMPING, 0.0));
            let mut products = Vec3::ZERO;
            let mut count = 0;
            for (offset, other) in self.alike(cell) {
                let (inverse, weight) = self.values[other];
                let at = offset.as_vec2().extend(1.0);
                if weight > 0.0 && (inverse / plane.dot(at) - 1.0).abs() < max_difference {
                    let weighted = weight * at;
                    squares += Mat3::from_cols(weighted * at.x, weighted * at.y, weighted * at.z);
                    products += weighted * inverse;
                    count += 1;
                }
            }
            let side = (2 * RADIUS + 1) as f32;
            if (count as f32) < MIN_ALIKE * side * side {
                return None;
            }
            plane = squares.inverse() * products;
        }
        (plane.is_finite() && plane.z > 0.0).then_some(plane)
    }

    /// The cells of the colour of one around it, and how far they are.
    fn alike(&self, cell: usize) -> impl Iterator<Item = (IVec2, usize)> {
        let width = self.size.x;
        let at = IVec2::new(cell as i32 % width, cell as i32 / width);
        let low = (at - RADIUS).max(IVec2::ZERO);
        let high = (at + RADIUS).min(self.size - 1);
        let color = self.measured.rgb[cell];
        let is_alike = move |other: &usize| {
            let codes = self.measured.rgb[*other].into_iter().zip(color);
            codes.into_iter().all(|(a, b)| a.abs_diff(b) <= MAX_COLOR_DIFFERENCE)
        };
        let row = move |y: i32| (low.x..=high.x).map(move |x| IVec2::new(x, y));
        (low.y..=high.y)
            .flat_map(row)
            .map(move |place| (place - at, (place.y * width + place.x) as usize))
            .filter(move |(_, other)| is_alike(other))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::FREE;
    use trisplat_scene::Rng;
    use trisplat_scene::camera::Camera;

    const SIZE: [u32; 2] = [40, 30];

    fn picture(depth: Vec<f32>, color: impl Fn(usize) -> u8) -> DepthPicture {
        let camera = Camera::look_at(Vec3::ZERO, Vec3::Z, Vec3::NEG_Y, 0.8, SIZE);
        let rgb = (0..depth.len()).map(|cell| [color(cell); 3]).collect();
        DepthPicture { camera, depth, rgb, weight: 1.0 }
    }

    /// Depths measured in a photo of these colours.
    fn measured(depth: Vec<f32>, color: impl Fn(usize) -> u8) -> DepthPicture {
        DepthPicture { weight: 4.0, ..picture(depth, color) }
    }

    /// A slanted plane, drawn with 2% of noise.
    fn noisy() -> (Vec<f32>, Vec<f32>) {
        let rng = Rng::new(3, "flatten", 0);
        let plane = |cell: usize| (0.5 + 0.004 * (cell as u32 % SIZE[0]) as f32).recip();
        let exact: Vec<f32> = (0..1200).map(plane).collect();
        let noise = |cell: usize| exact[cell] * (1.0 + 0.04 * (rng.uniform(cell as u64) - 0.5));
        ((0..1200).map(noise).collect(), exact)
    }

    /// The mean share by which depths differ in the middle of the picture.
    fn error(depth: &[f32], exact: &[f32]) -> f32 {
        let inner = |cell: &usize| (8..32).contains(&(cell % 40)) && (8..22).contains(&(cell / 40));
        let errors = (0..1200).filter(inner).map(|cell| (depth[cell] / exact[cell] - 1.0).abs());
        let errors: Vec<f32> = errors.collect();
        errors.iter().sum::<f32>() / errors.len() as f32
    }

    #[test]
    fn without_texture_drawn_depths_become_planes() {
        let (drawn, exact) = noisy();
        let before = error(&drawn, &exact);
        let mut flat = picture(drawn.clone(), |_| 0);
        flatten(&mut flat, &measured(vec![UNKNOWN; 1200], |_| 200));
        let after = error(&flat.depth, &exact);
        assert!(after < 0.25 * before, "{before} {after}");

        // Some measured depths say more than drawn ones, which are all too far.
        let far: Vec<f32> = drawn.iter().map(|depth| 1.05 * depth).collect();
        let some = |cell: usize| if cell.is_multiple_of(3) { exact[cell] } else { UNKNOWN };
        let mut flat = picture(far.clone(), |_| 0);
        flatten(&mut flat, &measured((0..1200).map(some).collect(), |_| 200));
        let pulled =
            |cell: usize| if cell.is_multiple_of(3) { exact[cell] } else { flat.depth[cell] };
        let pulled: Vec<f32> = (0..1200).map(pulled).collect();
        assert!(error(&pulled, &exact) < 0.4 * error(&far, &exact));
    }

    #[test]
    fn texture_and_outlines_stay() {
        let (drawn, exact) = noisy();
        let mut textured = picture(drawn.clone(), |_| 0);
        let is_white = |cell: usize| (cell % 40 / 2 + cell / 80).is_multiple_of(2);
        let checks = |cell: usize| if is_white(cell) { 200 } else { 90 };
        flatten(&mut textured, &measured(vec![UNKNOWN; 1200], checks));
        assert_eq!(textured.depth, drawn);

        let step = |cell: usize| match cell % 40 {
            0..20 => drawn[cell],
            20..36 => 2.0 * drawn[cell],
            _ => FREE,
        };
        let before: Vec<f32> = (0..1200).map(step).collect();
        let mut outline = picture(before.clone(), |_| 0);
        flatten(&mut outline, &measured(vec![UNKNOWN; 1200], |_| 200));
        for (cell, depth) in outline.depth.iter().enumerate() {
            let wants = before[cell] / drawn[cell] * exact[cell];
            assert!(
                *depth == before[cell] || (depth / wants - 1.0).abs() < 0.04,
                "{cell}: {depth}"
            );
        }
    }
}
