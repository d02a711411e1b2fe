//! What stereo measured.

use super::depth_map::DepthMap;
use crate::report::StageDetails;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Coverage and confidence of the depths.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StereoDetails {
    /// Photos compared.
    pub photos: u64,
    /// Pixels of all compared pictures.
    pub pixels: u64,
    /// Share of these with a depth.
    pub known: f64,
    /// Mean confidence of the depths, from 0 to 1.
    pub confidence: f64,
}

impl StageDetails for StereoDetails {
    const STAGE: &'static str = "stereo";
}

impl StereoDetails {
    /// Of these maps.
    pub fn of(maps: &[DepthMap]) -> Self {
        let pixels: usize = maps.iter().map(|map| map.depth.len()).sum();
        let known = |map: &DepthMap| (0..map.depth.len()).filter(|pixel| map.is_known(*pixel)).count();
        let known: usize = maps.iter().map(known).sum();
        let sum: f64 = maps.iter().flat_map(|map| &map.confidence).map(|c| f64::from(*c)).sum();
        Self {
            photos: maps.len() as u64,
            pixels: pixels as u64,
            known: known as f64 / pixels.max(1) as f64,
            confidence: sum / known.max(1) as f64,
        }
    }
}
