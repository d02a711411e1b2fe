//! The core of a part of a scene: what of the part stays when its neighbours are merged with it.

use super::params::Params;
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// A box of training space, and how many triangles a run may have in it. What is trained around it grows along, and stops when it is full.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Core {
    /// Lowest coordinates, inclusive; `None`: no lowest one.
    pub low: [Option<f32>; 3],
    /// Highest coordinates, exclusive; `None`: no highest one.
    pub high: [Option<f32>; 3],
    /// Never more triangles than this have their middle in the box.
    pub triangles: u64,
}

impl Core {
    /// Whether triangle `i` has its middle in the box.
    pub(super) fn holds(&self, params: &Params, i: usize) -> bool {
        let [a, b, c] = params.vertices[i];
        let middle: Vec3 = (a + b + c) / 3.0;
        (0..3).all(|k| {
            self.low[k].is_none_or(|low| middle[k] >= low) && self.high[k].is_none_or(|high| middle[k] < high)
        })
    }
}
