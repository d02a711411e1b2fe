//! The core of a part of a scene, which stays when the part is merged with its neighbours.

use super::params::Params;
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// A box of training space with its own limit of triangles. The surroundings grow with it, and stop when it
/// is full.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Core {
    /// Lowest coordinates, inclusive; `None`: unbounded.
    pub low: [Option<f32>; 3],
    /// Highest coordinates, exclusive; `None`: unbounded.
    pub high: [Option<f32>; 3],
    /// Most triangles with their middle in the box.
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
