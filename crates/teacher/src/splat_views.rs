//! Viewpoints for Gaussians that come without cameras: on all sides of an object, or in a
//! photographed place.
//!
//! A long object looked at from around the middle of its Gaussians is a few pixels wide: edges and
//! strings then blur over their surroundings, and no triangle can be finer. So every picture of an
//! object is cropped to its visible part, and is as large as allowed.
//!
//! Gaussians of a place are small and their depths agree where photos were taken from; seen from
//! elsewhere they are large, blurred and full of gaps. So places are tried, the best of them are
//! improved step by step, and the rest is left out.

use super::survey::{camera, direction};
use glam::{UVec2, Vec2, Vec3};
use trisplat_raster::gaussian::{self, GaussianOptions};
use trisplat_scene::camera::Camera;
use trisplat_scene::math::lists::{evenly_spaced, median};
use trisplat_scene::{Rng, Splats, sh0_from_rgb};

/// Distances of the cameras from the middle, in radii of the object, in turn: parts hide each other
/// differently from near and far.
const AWAY: [f32; 2] = [1.8, 3.0];
/// Share of the Gaussians on each side of an axis that may lie outside.
const OUTSIDE: f32 = 0.005;
/// Minimum opacity of a Gaussian that tells where the object is.
const MIN_OPACITY: f32 = 0.1;
/// Visible radius of a lone Gaussian, in standard deviations.
const REACH: f32 = 3.0;
/// Width and height of the pictures that find the visible part, px.
const WIDE_SIDE: u32 = 160;
/// Share of the visible part that is cropped on each side, for floaters.
const CUT_OFF: f32 = 5e-4;
/// Margin around the visible part, as a share of its longer side.
const MARGIN: f32 = 0.03;
/// Minimum visible share of a picture.
const MIN_SHOWN: f32 = 1e-4;

/// `count` cameras spread over all sides of `splats`, with pictures of `longer_px` that show all of
/// it; fewer where nothing is seen.
pub(super) fn around(splats: &Splats, up: Vec3, count: usize, longer_px: u32) -> Vec<Camera> {
    let Some((middle, radius)) = extent(splats) else { return Vec::new() };
    let options = GaussianOptions::suited_to(splats, [0.0; 3]);
    let place = |i: usize| {
        let away = AWAY[i % AWAY.len()];
        let fov = 2.0 * (1.0 / away).asin().to_degrees();
        let wide =
            camera(middle + direction(i, count) * (away * radius), middle, up, fov, WIDE_SIDE);
        let frame = gaussian::draw(splats, &wide, &options);
        cropped_camera(&wide, &frame.transmittance, longer_px)
    };
    (0..count).filter_map(place).collect()
}

/// The middle of nearly all visible Gaussians, and the radius of a ball around it that holds them;
/// `None` without any.
fn extent(splats: &Splats) -> Option<(Vec3, f32)> {
    let visible = || (0..splats.len()).filter(|i| splats.opacity[*i] >= MIN_OPACITY);
    let places: Vec<Vec3> = visible().map(|i| splats.positions[i]).collect();
    let last = places.len().checked_sub(1)?;
    let outside = (last as f32 * OUTSIDE) as usize;
    let along = |axis: usize, rank: usize| {
        let mut values: Vec<f32> = places.iter().map(|place| place[axis]).collect();
        *values.select_nth_unstable_by(rank, f32::total_cmp).1
    };
    let corner = |rank: usize| Vec3::from([0, 1, 2].map(|axis| along(axis, rank)));
    let middle = corner(outside).midpoint(corner(last - outside));
    let mut distances: Vec<f32> = places.iter().map(|place| place.distance(middle)).collect();
    let mut radius = *distances.select_nth_unstable_by(last - outside, f32::total_cmp).1;
    if radius == 0.0 {
        // All are in one place, and as large as they are themselves.
        radius = REACH * visible().map(|i| splats.scales[i].max_element()).fold(0.0, f32::max);
    }
    (radius > 0.0 && radius.is_finite()).then_some((middle, radius))
}

/// The part of the picture of `wide`, open to `transmittance`, that shows something, `longer_px`
/// long; `None` where it shows nothing.
fn cropped_camera(wide: &Camera, transmittance: &[f32], longer_px: u32) -> Option<Camera> {
    let side = wide.size.x as usize;
    let cover = |i: usize| 1.0 - transmittance[i];
    let columns: Vec<f32> =
        (0..side).map(|x| (0..side).map(|y| cover(y * side + x)).sum()).collect();
    let rows: Vec<f32> = (0..side).map(|y| (0..side).map(|x| cover(y * side + x)).sum()).collect();
    let covered: f32 = rows.iter().sum();
    if !(covered >= MIN_SHOWN * transmittance.len() as f32) {
        return None;
    }
    let cropped = CUT_OFF * covered;
    let [left, right] = range(&columns, cropped);
    let [top, bottom] = range(&rows, cropped);
    let margin = 1.0 + MARGIN * (right - left).max(bottom - top);
    let low = Vec2::new(left, top) - margin;
    let high = Vec2::new(right, bottom) + margin;
    let scale = longer_px as f32 / (high - low).max_element();
    let size = ((high - low) * scale).round().as_uvec2().max(UVec2::ONE);
    Some(Camera { focal: wide.focal * scale, center: (wide.center - low) * scale, size, ..*wide })
}

/// First and last place of `sums` with all but `cropped` on each side.
fn range(sums: &[f32], cropped: f32) -> [f32; 2] {
    [leading(sums.iter(), cropped), sums.len() as f32 - leading(sums.iter().rev(), cropped)]
}

/// Number of first `sums` that come to at most `limit` together.
fn leading<'a>(sums: impl Iterator<Item = &'a f32>, limit: f32) -> f32 {
    let mut left = limit;
    let within = sums.take_while(|sum| {
        left -= **sum;
        left >= 0.0
    });
    within.count() as f32
}

/// Field of view of the cameras, degrees.
const FOV: f32 = 50.0;
/// Width and height of the pictures that are judged, px.
const SIDE: u32 = 32;
/// Maximum number of Gaussians in these pictures.
const MAX_SAMPLES: usize = 100_000;
/// Number of first trial places.
const MAX_TRIALS: usize = 600;
/// Number of the best of these, which are improved.
const IMPROVED: usize = 160;
/// Rounds of improvement.
const ROUNDS: usize = 4;
/// Longest step of the first round, as a share of the distance to the target.
const FIRST_STEP: f32 = 0.4;
/// Minimum and maximum distance of a place from its target, in median distances of the Gaussians from their
/// middle.
const DISTANCES: [f32; 2] = [0.5, 4.0];
/// Cost of an open picture, in logarithms of blur.
const OPEN_COST: f32 = 15.0;
/// Largest blur of a view, in blurs of the best tenth.
const MAX_BLUR_RATIO: f32 = 16.0;
/// Median size of the Gaussians in the pictures, px: a little more than in the training photos.
const MEDIAN_PX: f32 = 4.0;
/// Limits of the width and height of the pictures, px.
const MIN_SIDE: f32 = 256.0;
const MAX_SIDE: f32 = 1600.0;
/// Distance from the middle at which Gaussians are behind an object, in radii of nearly everything.
const BEHIND: f32 = 1.1;
/// Minimum covered share of the corners of pictures from around, in surroundings.
const MIN_CORNER_COVER: f32 = 0.3;
/// Minimum covered share of a pixel that is measured.
const MIN_COVER: f32 = 0.1;
/// Minimum spread of depths, in logarithms.
const MIN_SPREAD: f32 = 1e-3;

/// A trial viewpoint.
#[derive(Debug, Clone, Copy)]
struct RatedViewpoint {
    camera: Camera,
    eye: Vec3,
    target: Vec3,
    /// Logarithm of the view's blur.
    cost: f32,
    /// The mean size of the Gaussians, radians.
    size: f32,
}

/// Cameras at the sharpest viewpoints of `splats`, at most [`IMPROVED`], the best first, with
/// pictures as sharp as the Gaussians. `unit` is the median distance of the Gaussians from their
/// middle.
pub(super) fn places(splats: &Splats, unit: f32, up: Vec3) -> Vec<Camera> {
    let mut probe = BlurProbe::new(splats);
    let rng = Rng::new(0, "photographed places", 0);
    let n = splats.len() as u64;
    let first = (0..MAX_TRIALS as u64).map(|i| {
        let target = splats.positions[(rng.bits(8 * i) % n) as usize];
        let share = rng.uniform(8 * i + 1);
        let distance = unit * DISTANCES[0] * (DISTANCES[1] / DISTANCES[0]).powf(share);
        (target + rng.on_sphere(4 * i + 1) * distance, target)
    });
    let mut places: Vec<RatedViewpoint> =
        first.map(|(eye, target)| probe.place(eye, target, up)).collect();
    places.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    places.truncate(IMPROVED);
    for round in 0..ROUNDS {
        let rng = Rng::new(0, "photographed steps", round as u64);
        let step = FIRST_STEP * 0.7f32.powi(round as i32);
        for (i, place) in places.iter_mut().enumerate() {
            let length = step * place.eye.distance(place.target);
            let shift = |k: u64| rng.on_sphere(4 * i as u64 + k) * length;
            let moved = probe.place(place.eye + shift(0), place.target + shift(2), up);
            if moved.cost < place.cost {
                *place = moved;
            }
        }
    }
    places.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let best = places.get(places.len() / 10).map_or(0.0, |place| place.cost);
    places.retain(|place| place.cost <= best + MAX_BLUR_RATIO.ln());
    let sizes = places.iter().map(|place| place.size).collect();
    let focal = MEDIAN_PX / median(sizes, f32::total_cmp).unwrap_or(1.0);
    let side = 2.0 * focal * (FOV.to_radians() / 2.0).tan();
    let side = UVec2::splat(side.clamp(MIN_SIDE, MAX_SIDE) as u32);
    places.iter().map(|place| place.camera.resized(side)).collect()
}

/// Measures the blur of views, by drawing depths and sizes of the Gaussians as colours.
struct BlurProbe {
    /// With the measured numbers as colours.
    splats: Splats,
    options: GaussianOptions,
}

/// Added to logarithms, so that no colour is negative.
const OFFSET: f32 = 24.0;
const MIN_LENGTH: f32 = 1e-9;

impl BlurProbe {
    fn new(splats: &Splats) -> Self {
        let chosen: Vec<usize> = evenly_spaced(splats.len(), MAX_SAMPLES).collect();
        let scale = (splats.len() as f32 / chosen.len().max(1) as f32).sqrt();
        let splats = colourless(splats, &chosen, scale);
        Self { options: GaussianOptions::suited_to(&splats, [0.0; 3]), splats }
    }

    fn place(&mut self, eye: Vec3, target: Vec3, up: Vec3) -> RatedViewpoint {
        let camera = camera(eye, target, up, FOV, SIDE);
        let (size, cost) = self.measure(&camera);
        RatedViewpoint { camera, eye, target, cost, size }
    }

    /// The mean size of the Gaussians, and the cost: the logarithm of size times mean spread of
    /// depths, and the cost of gaps.
    fn measure(&mut self, camera: &Camera) -> (f32, f32) {
        for i in 0..self.splats.len() {
            let depth = (camera.rotation * self.splats.positions[i] + camera.translation).z;
            let mut scales = self.splats.scales[i].to_array();
            scales.sort_by(f32::total_cmp);
            let code = |length: f32| length.max(MIN_LENGTH).ln() + OFFSET;
            let size = code(scales[1] / depth);
            let depth = code(depth);
            self.splats.sh[i] = [depth, depth * depth, size].map(sh0_from_rgb);
        }
        let frame = gaussian::draw(&self.splats, camera, &self.options);
        let mut covered = 0.0;
        let mut spread = 0.0;
        let mut size = 0.0;
        for (through, [depth, squared, own_size]) in frame.transmittance.iter().zip(&frame.rgb) {
            let cover = 1.0 - through;
            covered += cover;
            if cover > MIN_COVER {
                let mean = depth / cover;
                let mean_squared = squared / cover;
                spread += cover * (mean_squared - mean * mean).max(0.0).sqrt();
                size += own_size - cover * OFFSET;
            }
        }
        if !(covered > 0.0) {
            return (0.0, f32::MAX);
        }
        let size = size / covered;
        let spread = (spread / covered).max(MIN_SPREAD);
        (size.exp(), size + spread.ln() + OPEN_COST * (1.0 - covered / frame.rgb.len() as f32))
    }
}

/// The `chosen` splats without colours, `scale` times as large.
fn colourless(splats: &Splats, chosen: &[usize], scale: f32) -> Splats {
    Splats {
        positions: chosen.iter().map(|i| splats.positions[*i]).collect(),
        scales: chosen.iter().map(|i| splats.scales[*i] * scale).collect(),
        rotations: chosen.iter().map(|i| splats.rotations[*i]).collect(),
        opacity: chosen.iter().map(|i| splats.opacity[*i]).collect(),
        sh: vec![[0.0; 3]; chosen.len()],
        sh_degree: 0,
        filter: splats.filter,
    }
}

/// True if `splats` are surroundings: Gaussians behind the `reach` around their `middle` fill the
/// corners of the pictures of `cameras`, which look at everything within it.
pub(super) fn are_surroundings(
    splats: &Splats,
    cameras: &[Camera],
    middle: Vec3,
    reach: f32,
) -> bool {
    let behind = |i: &usize| splats.positions[*i].distance(middle) > BEHIND * reach;
    let behind: Vec<usize> = (0..splats.len()).filter(behind).collect();
    let splats = &colourless(splats, &behind, 1.0);
    let options = GaussianOptions::suited_to(splats, [0.0; 3]);
    let corner = |camera: &Camera| {
        let frame = gaussian::draw(splats, &camera.resized(UVec2::splat(SIDE)), &options);
        let outside = |i: usize| {
            let at =
                UVec2::new(i as u32 % SIDE, i as u32 / SIDE).as_vec2() - (SIDE as f32 - 1.0) / 2.0;
            at.length() > SIDE as f32 / 2.0
        };
        let open: Vec<f32> =
            (0..frame.rgb.len()).filter(|i| outside(*i)).map(|i| frame.transmittance[i]).collect();
        1.0 - open.iter().sum::<f32>() / open.len() as f32
    };
    let corners: Vec<f32> = cameras.iter().map(corner).collect();
    median(corners, f32::total_cmp).is_some_and(|cover| cover > MIN_CORNER_COVER)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Quat;

    /// A long rod of Gaussians, most of them at one end, and one that floats far away.
    fn rod() -> Splats {
        let n = 2001;
        let along = |i: usize| {
            if i.is_multiple_of(2) { i as f32 / 2000.0 * 4.0 } else { i as f32 / 2000.0 }
        };
        let place =
            |i: usize| if i == 1000 { Vec3::splat(50.0) } else { Vec3::new(5.0, along(i), -3.0) };
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
                assert!(camera.is_in_frustum(end), "{end} in the picture of {}", camera.position());
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

#[cfg(test)]
mod photographed_tests {
    use super::*;
    use glam::Quat;

    /// Small Gaussians on the walls of a room of side 2, and large ones `far` times as far away.
    fn room(far: f32) -> Splats {
        let rng = Rng::new(4, "room", 0);
        let n = 4000;
        let place = |i: u64| {
            let mut p =
                Vec3::new(rng.uniform(4 * i), rng.uniform(4 * i + 1), rng.uniform(4 * i + 2)) * 2.0
                    - 1.0;
            let axis = (rng.bits(4 * i + 3) % 3) as usize;
            p[axis] = p[axis].signum();
            // One Gaussian in fifty is large and far away.
            if i.is_multiple_of(50) { p * far } else { p }
        };
        let size = |i: u64| if i.is_multiple_of(50) { 0.3 * far } else { 0.06 };
        Splats {
            positions: (0..n).map(place).collect(),
            scales: (0..n).map(|i| Vec3::splat(size(i))).collect(),
            rotations: vec![Quat::IDENTITY; n as usize],
            opacity: vec![0.95; n as usize],
            sh: vec![[0.3; 3]; n as usize],
            ..Splats::default()
        }
    }

    #[test]
    fn places_see_small_gaussians_and_no_gaps() {
        let splats = room(20.0);
        let cameras = places(&splats, 1.2, Vec3::Y);
        assert!(cameras.len() > 40, "{}", cameras.len());
        let options = GaussianOptions::suited_to(&splats, [0.0; 3]);
        for camera in &cameras {
            let frame = gaussian::draw(&splats, &camera.resized(UVec2::splat(SIDE)), &options);
            let open = frame.transmittance.iter().sum::<f32>() / frame.rgb.len() as f32;
            assert!(
                open < 0.15 && camera.position().length() < 8.0,
                "{open} {}",
                camera.position()
            );
        }
        assert_eq!(cameras, places(&splats, 1.2, Vec3::Y));
    }

    #[test]
    fn a_thing_leaves_the_corners_of_pictures_open() {
        let around: Vec<Camera> = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::ONE.normalize()]
            .map(|eye| camera(eye * 6.0, Vec3::ZERO, Vec3::new(0.1, 0.9, 0.2), 45.0, SIDE))
            .to_vec();
        assert!(are_surroundings(&room(20.0), &around, Vec3::ZERO, 2.0));
        let mut thing = room(20.0);
        thing.retain(|i| !i.is_multiple_of(50));
        assert!(!are_surroundings(&thing, &around, Vec3::ZERO, 2.0));
        // Nor does one whose own rim reaches into the corners.
        for scale in &mut thing.scales {
            *scale *= 12.0;
        }
        assert!(!are_surroundings(&thing, &around, Vec3::ZERO, 2.0));
    }
}
