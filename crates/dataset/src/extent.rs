//! Positions beyond what is usual, or beyond what a float holds; and the origin of scenes far away.

use super::listing::{DatasetListing, ListedPhoto};
use glam::DVec3;
use trisplat_formats::far_origin;
use trisplat_scene::math::lists::median;
use trisplat_scene::{Error, Result};

/// Fewer poses have no usual distance.
const MIN_POSES: usize = 5;
/// Poses this many times as far from the middle as is usual are wrong.
const FAR: f64 = 100.0;
/// Largest distance from a camera to another one, or from the origin to a point.
pub(super) const MAX_DISTANCE: f64 = 1e15;

/// Leaves out photos that are far from all others and from the points: their poses are wrong.
pub(super) fn leave_out_far(listing: &mut DatasetListing) {
    let centers: Vec<DVec3> = listing.photos.iter().map(ListedPhoto::center).collect();
    let usual = |values: Vec<f64>| median(values, f64::total_cmp).unwrap_or(0.0);
    let middle =
        DVec3::from([0, 1, 2].map(|axis| usual(centers.iter().map(|c| c[axis]).collect())));
    let distances: Vec<f64> = centers.iter().map(|center| center.distance(middle)).collect();
    let mut scale = usual(distances.clone());
    let farthest = distances.iter().copied().fold(0.0, f64::max);
    if centers.len() < MIN_POSES || scale == 0.0 || farthest <= FAR * scale {
        return;
    }
    let points: Vec<f64> =
        listing.points.iter().map(|point| point.position.distance(middle)).collect();
    // Without points a walk beside a tripod looks the same.
    scale = if points.is_empty() { 10.0 * scale } else { scale.max(usual(points)) };
    let total = centers.len();
    let out: Vec<usize> = (0..total).filter(|&i| distances[i] > FAR * scale).collect();
    if let Some(&first) = out.first() {
        listing.warnings.push(format!(
            "{} of {total} photos left out: their poses are far outside (`{}`: {:.0} times as far as is usual)",
            out.len(),
            listing.photos[first].name,
            distances[first] / scale
        ));
    }
    let mut at = 0..;
    listing.photos.retain(|_| at.next().is_none_or(|i| !out.contains(&i)));
}

/// Refuse cameras so far apart that squares of distances are beyond what a float holds.
pub(super) fn check_extent(listing: &DatasetListing) -> Result<()> {
    let Some(first) = listing.photos.first().map(ListedPhoto::center) else { return Ok(()) };
    let distances =
        listing.photos.iter().map(|photo| (photo.center().distance(first), &photo.name));
    let Some((distance, name)) = distances.max_by(|a, b| a.0.total_cmp(&b.0)) else {
        return Ok(());
    };
    if distance <= MAX_DISTANCE {
        return Ok(());
    }
    let reason = format!(
        "its camera is {distance:.1e} units from that of `{}`, the limit is {MAX_DISTANCE:.0e}; give poses in meters or a unit like it",
        listing.photos[0].name
    );
    Err(Error::malformed(&listing.list, format!("photo `{name}`"), reason))
}

/// The origin to subtract from every position, from the middle of the cameras and the extent of
/// cameras and points.
pub(super) fn origin_of(listing: &DatasetListing) -> DVec3 {
    let centers: Vec<DVec3> = listing.photos.iter().map(ListedPhoto::center).collect();
    let count = centers.len().max(1) as f64;
    let middle = centers.iter().sum::<DVec3>() / count;
    let extent = (centers.iter().map(|c| c.distance_squared(middle)).sum::<f64>() / count).sqrt();
    let distances =
        listing.points.iter().map(|point| point.position.distance(middle) as f32).collect();
    far_origin(middle, extent.max(median(distances, f32::total_cmp).map_or(0.0, f64::from)))
}
