//! The up axis by the rows of the photos, which people hold level.

use glam::DVec3;
use trisplat_scene::Rng;
use trisplat_scene::camera::Camera;
use trisplat_scene::math::geometry::{scatter_matrix, symmetric_eigen};
use trisplat_scene::math::lists::median;

/// Number of directions tried before the best is refined.
const TRIES: u64 = 512;
/// Passes of the refinement.
const PASSES: usize = 12;
/// Larger tilts of a row (sine) count as this one, because some pictures are taken upright.
const MAX_TILT: f64 = 0.34;
/// Minimum variance of the photos' rows along the second of their three main directions: with less,
/// all rows are parallel, and up is any direction across them.
const MIN_SPREAD: f64 = 1e-3;
/// Maximum ratio of their standard deviations, least to second (tangent of 15°); above it up is
/// open too.
const MAX_TILT_PER_SPREAD: f64 = 0.27;
/// Rows are more level than columns, or the reverse, where their tilt is smaller by this factor.
const CLEARLY_LEVEL: f64 = 1.5;
/// Mean sine of the angle by which cameras look down, above which their photos' side is known.
const MIN_DOWN: f64 = 0.1;
/// Directions of a larger cosine (20°) are one.
const MAX_SAME: f64 = 0.94;

/// The up axis estimated from cameras alone.
pub(super) struct CameraUp {
    pub(super) up: DVec3,
    /// Median angle between rows and the horizontal, degrees.
    pub(super) tilt: f64,
    /// True when rows agree with more than one direction, for example when all look the same way.
    pub(super) is_open: bool,
    /// The direction by the other of rows and columns, if it is nearly as level.
    pub(super) other: Option<DVec3>,
}

/// From the rows of the photos, or from their columns where these are level: photos of a phone that
/// are stored on their side.
pub(super) fn from_cameras(cameras: &[Camera]) -> Option<CameraUp> {
    let by_rows = from_level_lines(cameras, 0)?;
    let by_columns = from_level_lines(cameras, 1).filter(|columns| !columns.is_open);
    let Some(by_columns) = by_columns else { return Some(by_rows) };
    let factor = if by_rows.is_open { 1.0 } else { CLEARLY_LEVEL };
    if factor * by_columns.tilt < by_rows.tilt {
        // Photos on their side were turned either way: only cameras that look down tell which.
        let ahead = cameras.iter().map(|camera| camera.rotation.row(2).as_dvec3());
        let down = -ahead.map(|ahead| ahead.dot(by_columns.up)).sum::<f64>();
        let is_unsure = down < MIN_DOWN * cameras.len() as f64;
        return Some(CameraUp { other: is_unsure.then_some(-by_columns.up), ..by_columns });
    }
    let is_doubtful = !by_rows.is_open
        && by_columns.tilt < CLEARLY_LEVEL * by_rows.tilt
        && by_columns.up.dot(by_rows.up).abs() < MAX_SAME;
    Some(CameraUp { other: is_doubtful.then_some(by_columns.up), ..by_rows })
}

/// From the rows (`axis` 0) or columns (1) of photos, which are taken to be level.
fn from_level_lines(cameras: &[Camera], axis: usize) -> Option<CameraUp> {
    // Rows of the rotation: right, down and ahead of each camera.
    let row = |i: usize| cameras.iter().map(move |c| c.rotation.row(i).as_dvec3());
    let lines: Vec<DVec3> = row(axis).collect();
    let mean_up = -row(1 - axis).sum::<DVec3>().normalize_or_zero();
    if lines.is_empty() {
        return None;
    }
    let (mut up, mut spread) = first_guess(&lines, mean_up);
    for _ in 0..PASSES {
        let tilts: Vec<f64> = lines.iter().map(|r| r.dot(up).abs()).collect();
        let scale = (1.5 * median(tilts.clone(), f64::total_cmp).unwrap_or(0.0)).max(1e-4);
        // Cauchy's weights: a picture taken with the camera on its side hardly counts.
        let weight = |tilt: &f64| 1.0 / (1.0 + (tilt / scale) * (tilt / scale));
        spread =
            symmetric_eigen(scatter_matrix(lines.iter().copied().zip(tilts.iter().map(weight))));
        up = spread[0].1;
    }
    let [least, middle, _] = spread.map(|(value, _)| value.max(0.0));
    let is_open = middle < MIN_SPREAD || least > MAX_TILT_PER_SPREAD * MAX_TILT_PER_SPREAD * middle;
    if is_open {
        // Of the directions at right angles to the rows, the one nearest to the columns.
        up = mean_up.reject_from_normalized(spread[2].1).normalize_or(up);
    }
    // Cameras that look straight down have their columns level, and the ground below them.
    let columns = -row(1).map(|down| down.dot(up)).sum::<f64>();
    let away = -row(2).map(|ahead| ahead.dot(up)).sum::<f64>();
    // A photo on its side was turned either way.
    let sign = if axis == 0 && columns.abs() > 0.1 * lines.len() as f64 { columns } else { away };
    let up = if sign < 0.0 { -up } else { up };
    let tilt = |r: &DVec3| libm::asin(r.dot(up).clamp(-1.0, 1.0)).abs().to_degrees();
    let tilt = median(lines.iter().map(tilt).collect(), f64::total_cmp)?;
    Some(CameraUp { up, tilt, is_open, other: None })
}

/// The direction with the least sum of limited tilts, and the spread of the rows.
fn first_guess(lines: &[DVec3], mean_up: DVec3) -> (DVec3, [(f64, DVec3); 3]) {
    let spread = symmetric_eigen(scatter_matrix(lines.iter().map(|r| (*r, 1.0))));
    let rng = Rng::new(0, "up axis", 0);
    let normal_to_pair = |i: u64| {
        let one = |k: u64| lines[(rng.bits(2 * i + k) % lines.len() as u64) as usize];
        let across = one(0).cross(one(1));
        (across.length() > 0.1).then(|| across.normalize())
    };
    let guesses = [Some(spread[0].1), (mean_up != DVec3::ZERO).then_some(mean_up)];
    let tilt = |up: &DVec3| lines.iter().map(|r| r.dot(*up).abs().min(MAX_TILT)).sum::<f64>();
    let best = guesses
        .into_iter()
        .chain((0..TRIES).map(normal_to_pair))
        .flatten()
        .map(|up| (tilt(&up), up));
    let best = best.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(spread[0].1, |(_, up)| up);
    (best, spread)
}
