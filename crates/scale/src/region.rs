//! Boxes of the world, whose sides may be open: together the cores of all blocks are all of space, and no point is in two.

use glam::Vec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A box whose sides may be open.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Region {
    /// Lowest coordinates, inclusive; null: no lowest one.
    pub low: [Option<f32>; 3],
    /// Highest coordinates, exclusive; null: no highest one.
    pub high: [Option<f32>; 3],
}

impl Region {
    /// All of space.
    pub const EVERYWHERE: Self = Self { low: [None; 3], high: [None; 3] };

    /// Whether a point is inside.
    pub fn contains(&self, point: Vec3) -> bool {
        (0..3).all(|a| {
            self.low[a].is_none_or(|low| point[a] >= low) && self.high[a].is_none_or(|high| point[a] < high)
        })
    }

    /// Whether the box around a triangle reaches into this one.
    pub fn touches(&self, corners: &[Vec3; 3]) -> bool {
        let (low, high) =
            (corners[0].min(corners[1]).min(corners[2]), corners[0].max(corners[1]).max(corners[2]));
        (0..3).all(|a| {
            self.low[a].is_none_or(|side| high[a] >= side) && self.high[a].is_none_or(|side| low[a] < side)
        })
    }

    /// What is below `place` along an axis, and the rest.
    pub(super) fn cut(&self, axis: usize, place: f32) -> [Self; 2] {
        let (mut lower, mut upper) = (*self, *self);
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

/// Where a triangle is: in the region that holds the middle of its corners.
pub(crate) fn middle(corners: &[Vec3; 3]) -> Vec3 {
    (corners[0] + corners[1] + corners[2]) / 3.0
}
