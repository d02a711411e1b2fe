//! Cameras on all sides of an object of Gaussians, whose pictures it fills.
//!
//! A long object looked at from around the middle of its Gaussians is a few pixels wide: edges and strings then blur over their
//! surroundings, and no triangle can be finer. So every picture is cut to what is seen, and is as large as allowed.

use super::survey::{camera, direction};
use glam::{UVec2, Vec2, Vec3};
use trisplat_raster::gaussian::{self, GaussianOptions};
use trisplat_scene::{Splats, camera::Camera};

/// Distances of the cameras from the middle, in radii of the object, in turn: parts hide each other differently from near and far.
const DISTANCES: [f32; 2] = [1.8, 3.0];
/// Share of the Gaussians on each side of an axis that may lie outside.
const OUTSIDE: f32 = 0.005;
/// Least opacity of a Gaussian that tells where the object is.
const LEAST_OPACITY: f32 = 0.1;
/// Width and height of the pictures that tell what is seen, px.
const SIDE: u32 = 160;
/// Share of what is seen that may be cut off on each side: floaters are.
const CUT_OFF: f32 = 5e-4;
/// What is left around it, as a share of the longer side.
const MARGIN: f32 = 0.03;
/// Least visible share of a picture.
const LEAST_SHOWN: f32 = 1e-4;

/// `count` cameras spread over all sides of `splats`, with pictures of `longer_px` that show all of it; fewer where nothing is seen.
pub(super) fn around(splats: &Splats, up: Vec3, count: usize, longer_px: u32) -> Vec<Camera> {
    let Some((middle, radius)) = extent(splats) else { return Vec::new() };
    let options = GaussianOptions::suited_to(splats, [0.0; 3]);
    let place = |i: usize| {
        let away = DISTANCES[i % DISTANCES.len()];
        let fov = 2.0 * (1.0 / away).asin().to_degrees();
        let wide = camera(middle + direction(i, count) * (away * radius), middle, up, fov, SIDE);
        let frame = gaussian::draw(splats, &wide, &options);
        filled(&wide, &frame.transmittance, longer_px)
    };
    (0..count).filter_map(place).collect()
}

/// The middle of nearly all visible Gaussians, and the radius of a ball around it that holds them; `None` without any.
fn extent(splats: &Splats) -> Option<(Vec3, f32)> {
    let visible = (0..splats.len()).filter(|i| splats.opacity[*i] >= LEAST_OPACITY);
    let places: Vec<Vec3> = visible.map(|i| splats.positions[i]).collect();
    let last = places.len().checked_sub(1)?;
    let outside = (last as f32 * OUTSIDE) as usize;
    let along = |axis: usize, rank: usize| {
        let mut values: Vec<f32> = places.iter().map(|place| place[axis]).collect();
        *values.select_nth_unstable_by(rank, f32::total_cmp).1
    };
    let corner = |rank: usize| Vec3::from([0, 1, 2].map(|axis| along(axis, rank)));
    let middle = corner(outside).midpoint(corner(last - outside));
    let mut distances: Vec<f32> = places.iter().map(|place| place.distance(middle)).collect();
    let radius = *distances.select_nth_unstable_by(last - outside, f32::total_cmp).1;
    (radius > 0.0 && radius.is_finite()).then_some((middle, radius))
}

/// The part of the picture of `wide`, open to `transmittance`, that shows something, `longer_px` long; `None` where it shows nothing.
fn filled(wide: &Camera, transmittance: &[f32], longer_px: u32) -> Option<Camera> {
    let side = wide.size.x as usize;
    let cover = |i: usize| 1.0 - transmittance[i];
    let columns: Vec<f32> = (0..side).map(|x| (0..side).map(|y| cover(y * side + x)).sum()).collect();
    let rows: Vec<f32> = (0..side).map(|y| (0..side).map(|x| cover(y * side + x)).sum()).collect();
    let seen: f32 = rows.iter().sum();
    if !(seen >= LEAST_SHOWN * transmittance.len() as f32) {
        return None;
    }
    let least = CUT_OFF * seen;
    let ([left, right], [top, bottom]) = (range(&columns, least), range(&rows, least));
    let margin = 1.0 + MARGIN * (right - left).max(bottom - top);
    let (low, high) = (Vec2::new(left, top) - margin, Vec2::new(right, bottom) + margin);
    let scale = longer_px as f32 / (high - low).max_element();
    let size = ((high - low) * scale).round().as_uvec2().max(UVec2::ONE);
    Some(Camera { focal: wide.focal * scale, center: (wide.center - low) * scale, size, ..*wide })
}

/// From where to where `sums` hold all but `least` on each side.
fn range(sums: &[f32], least: f32) -> [f32; 2] {
    [ahead(sums.iter(), least), sums.len() as f32 - ahead(sums.iter().rev(), least)]
}

/// How many of `sums` come to at most `least` together.
fn ahead<'a>(sums: impl Iterator<Item = &'a f32>, least: f32) -> f32 {
    let mut left = least;
    let within = sums.take_while(|sum| {
        left -= **sum;
        left >= 0.0
    });
    within.count() as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Quat;

    /// A long rod of Gaussians, most of them at one end, and one that floats far away.
    fn rod() -> Splats {
        let n = 2001;
        let along = |i: usize| if i.is_multiple_of(2) { i as f32 / 2000.0 * 4.0 } else { i as f32 / 2000.0 };
        let place = |i: usize| if i == 1000 { Vec3::splat(50.0) } else { Vec3::new(5.0, along(i), -3.0) };
        Splats {
            positions: (0..n).map(place).collect(),
            scales: vec![Vec3::splat(0.02); n],
            rotations: vec![Quat::IDENTITY; n],
            opacity: vec![0.95; n],
            sh: vec![[0.3; 3]; n],
            ..Splats::default()
        }
    }

    #[test]
    fn a_rod_fills_its_pictures_and_a_floater_does_not_count() {
        let splats = rod();
        let cameras = around(&splats, Vec3::Z, 40, 300);
        assert_eq!(cameras.len(), 40);
        for camera in &cameras {
            assert!(camera.size.max_element() == 300, "{}", camera.size);
            for end in [Vec3::new(5.0, 0.05, -3.0), Vec3::new(5.0, 3.95, -3.0)] {
                assert!(camera.frames(end), "{end} in the picture of {}", camera.position());
            }
        }
        // From the side it is long and thin.
        assert!(cameras.iter().any(|camera| camera.size.min_element() < 60));
    }

    #[test]
    fn nothing_is_seen_of_nothing() {
        assert!(around(&Splats::default(), Vec3::Y, 10, 300).is_empty());
        let faint = Splats { opacity: vec![0.01; 2001], ..rod() };
        assert!(around(&faint, Vec3::Y, 10, 300).is_empty());
    }
}
