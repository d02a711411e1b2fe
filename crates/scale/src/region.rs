//! Boxes of the world whose sides may be open, and how a scene is cut into them: about as many
//! triangles in each, again and again across the longest extent.
//!
//! Space far outside of the photos' places is contracted (as in Barron et al. 2022,
//! *Mip-NeRF 360*, but along each axis separately, so that a cut stays a plane of the world). So a
//! distant horizon does not decide how a town is cut.

use glam::Vec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::math::lists::median;

/// Share of the points on either side that an extent ignores.
const OUTLIERS: f32 = 0.02;

/// A box whose sides may be open.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BlockRegion {
    /// Lowest coordinates, inclusive; null: no lowest one.
    pub low: [Option<f32>; 3],
    /// Highest coordinates, exclusive; null: no highest one.
    pub high: [Option<f32>; 3],
}

impl BlockRegion {
    /// All of space.
    pub(super) const EVERYWHERE: Self = Self { low: [None; 3], high: [None; 3] };

    /// True for a point inside.
    pub(super) fn contains(&self, point: Vec3) -> bool {
        (0..3).all(|a| {
            self.low[a].is_none_or(|low| point[a] >= low)
                && self.high[a].is_none_or(|high| point[a] < high)
        })
    }

    /// True if the box around a triangle reaches into this one.
    pub(super) fn touches(&self, corners: &[Vec3; 3]) -> bool {
        let low = corners[0].min(corners[1]).min(corners[2]);
        let high = corners[0].max(corners[1]).max(corners[2]);
        (0..3).all(|a| {
            self.low[a].is_none_or(|side| high[a] >= side)
                && self.high[a].is_none_or(|side| low[a] < side)
        })
    }

    /// Splits at `place` along an axis into the lower part and the upper.
    pub(super) fn split(&self, axis: usize, place: f32) -> [Self; 2] {
        let mut lower = *self;
        let mut upper = *self;
        lower.high[axis] = Some(place);
        upper.low[axis] = Some(place);
        [lower, upper]
    }

    /// The box with every side that is not open moved outwards.
    pub(super) fn grown(&self, by: Vec3) -> Self {
        let axes = [0, 1, 2];
        Self {
            low: axes.map(|a| self.low[a].map(|low| low - by[a])),
            high: axes.map(|a| self.high[a].map(|high| high + by[a])),
        }
    }
}

/// Extent of 90% of the points along each axis.
pub(super) fn extent(middles: &[Vec3]) -> Vec3 {
    Vec3::from([0, 1, 2].map(|a| {
        let mut along: Vec<f32> = middles.iter().map(|p| p[a]).collect();
        along.sort_unstable_by(f32::total_cmp);
        let skipped = along.len() / 20;
        if along.is_empty() { 0.0 } else { along[along.len() - 1 - skipped] - along[skipped] }
    }))
}

/// Space around the photos' places: distances inside keep their length, distances outside shrink.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ContractedSpace {
    center: Vec3,
    radius: f32,
}

impl ContractedSpace {
    /// Of cameras at `positions`.
    pub(super) fn of(positions: &[Vec3]) -> Self {
        let middle = |a: usize| {
            median(positions.iter().map(|p| p[a]).collect(), f32::total_cmp).unwrap_or(0.0)
        };
        let center = Vec3::new(middle(0), middle(1), middle(2));
        let reach = positions.iter().map(|p| (*p - center).abs().max_element()).fold(0.0, f32::max);
        Self { center, radius: if reach > 0.0 && reach.is_finite() { reach } else { 1.0 } }
    }

    /// A coordinate: unchanged within the radius, at most two radii from the centre outside.
    fn contracted(&self, coordinate: f32, axis: usize) -> f32 {
        let x = (coordinate - self.center[axis]) / self.radius;
        if x.abs() <= 1.0 { x } else { x.signum() * (2.0 - 1.0 / x.abs()) }
    }
}

/// Cuts space into `count` boxes that hold about as many of `points` each. Boxes that one cut made
/// follow each other: the first half of them, rounded up, is below the first cut.
pub(super) fn cut_space(
    points: &[Vec3],
    count: usize,
    around: &ContractedSpace,
) -> Vec<BlockRegion> {
    let mut boxes = Vec::with_capacity(count);
    cut_box(&mut points.to_vec(), BlockRegion::EVERYWHERE, count, around, &mut boxes);
    boxes
}

fn cut_box(
    points: &mut [Vec3],
    region: BlockRegion,
    count: usize,
    around: &ContractedSpace,
    out: &mut Vec<BlockRegion>,
) {
    if count <= 1 {
        out.push(region);
        return;
    }
    let [below, above] = halves(count);
    let (axis, place) = cut_place(points, below as f64 / count as f64, around);
    // Nothing depends on the order of the points but this: equal ones come together.
    points.sort_unstable_by(|a, b| a[axis].total_cmp(&b[axis]));
    let (low, high) = points.split_at_mut(points.partition_point(|p| p[axis] < place));
    let [lower, upper] = region.split(axis, place);
    cut_box(low, lower, below, around, out);
    cut_box(high, upper, above, around, out);
}

/// Numbers of blocks below and above a cut of `count`.
pub(super) fn halves(count: usize) -> [usize; 2] {
    [count.div_ceil(2), count / 2]
}

/// The axis along which the points reach farthest, and where on it `share` of them is below.
fn cut_place(points: &mut [Vec3], share: f64, around: &ContractedSpace) -> (usize, f32) {
    if points.is_empty() {
        return (0, 0.0);
    }
    let mut extent = |axis: usize| {
        points.sort_unstable_by(|a, b| a[axis].total_cmp(&b[axis]));
        let skipped = (points.len() as f32 * OUTLIERS) as usize;
        let [low, high] = [points[skipped], points[points.len() - 1 - skipped]]
            .map(|p| around.contracted(p[axis], axis));
        high - low
    };
    let extents = [0, 1, 2].map(&mut extent);
    let axis = (1..3).fold(0, |best, a| if extents[a] > extents[best] { a } else { best });
    let at = ((points.len() as f64 * share) as usize).min(points.len() - 1);
    points.sort_unstable_by(|a, b| a[axis].total_cmp(&b[axis]));
    (axis, points[at][axis])
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::Rng;

    fn town(count: u64) -> Vec<Vec3> {
        let rng = Rng::new(3, "cuts", 0);
        let at = |i: u64| {
            Vec3::new(
                100.0 * rng.uniform(3 * i),
                4.0 * rng.uniform(3 * i + 1),
                60.0 * rng.uniform(3 * i + 2),
            )
        };
        (0..count).map(at).collect()
    }

    #[test]
    fn every_point_is_in_one_box_and_boxes_are_alike() {
        let points = town(5000);
        let around = ContractedSpace::of(&points);
        for count in [1, 2, 3, 5, 8] {
            let boxes = cut_space(&points, count, &around);
            assert_eq!(boxes.len(), count);
            let counts: Vec<usize> =
                boxes.iter().map(|b| points.iter().filter(|p| b.contains(**p)).count()).collect();
            assert_eq!(counts.iter().sum::<usize>(), 5000);
            let share = 5000 / count;
            assert!(
                counts.iter().all(|n| n.abs_diff(share) <= 2 + share / 50),
                "{count}: {counts:?}"
            );
            for far in [Vec3::splat(1e9), Vec3::splat(-1e9), Vec3::new(1e9, 0.0, -1e9)] {
                assert_eq!(boxes.iter().filter(|b| b.contains(far)).count(), 1);
            }
        }
        let mut backwards = points.clone();
        backwards.reverse();
        assert_eq!(cut_space(&points, 7, &around), cut_space(&backwards, 7, &around));
    }

    #[test]
    fn a_far_horizon_does_not_say_which_way_a_town_is_cut() {
        let mut points = town(1000);
        let around = ContractedSpace::of(&points);
        assert!(cut_space(&points, 2, &around)[0].high[0].is_some());
        // A tower of clouds, four times as high as the town is long.
        points.extend((0..100).map(|i| Vec3::new(50.0, 4.0 * i as f32, 30.0)));
        assert!(cut_space(&points, 2, &around)[0].high[0].is_some());
    }

    #[test]
    fn without_points_there_are_boxes_all_the_same() {
        let around = ContractedSpace::of(&[]);
        assert_eq!(cut_space(&[], 4, &around).len(), 4);
        assert_eq!(
            cut_space(&[Vec3::ONE; 9], 3, &around).iter().filter(|b| b.contains(Vec3::ONE)).count(),
            1
        );
    }
}
