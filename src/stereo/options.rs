//! Options of stereo, declared once: the library's struct, the flags and the config file.

use crate::error::{Error, Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How depths are estimated from posed photos.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", command(next_help_heading = "Stereo"))]
pub struct StereoOptions {
    /// Longer side of the compared pictures, px; larger photos are shrunk to it.
    #[cfg_attr(feature = "cli", arg(long, value_name = "PX", default_value_t = StereoOptions::default().stereo_size))]
    pub stereo_size: u32,
    /// Number of photos compared with each photo, 1 to 8.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = StereoOptions::default().neighbors))]
    pub neighbors: u32,
    /// Other photos that must agree with a depth, 1 to 8.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = StereoOptions::default().min_agreeing))]
    pub min_agreeing: u32,
    /// Largest difference between two depths that agree, as a share of the depth.
    #[cfg_attr(feature = "cli", arg(long, value_name = "SHARE", default_value_t = StereoOptions::default().depth_tolerance))]
    pub depth_tolerance: f32,
    /// Least confidence of a depth that is kept, 0 to 1.
    #[cfg_attr(feature = "cli", arg(long, value_name = "SHARE", default_value_t = StereoOptions::default().min_confidence))]
    pub min_confidence: f32,
    /// Seed of every random choice; the same seed gives the same bits on any number of threads.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = 0))]
    pub stereo_seed: u64,
}

impl Default for StereoOptions {
    fn default() -> Self {
        Self {
            stereo_size: 320,
            neighbors: 5,
            min_agreeing: 2,
            depth_tolerance: 0.01,
            min_confidence: 0.5,
            stereo_seed: 0,
        }
    }
}

/// Most photos compared with one photo.
pub(super) const MOST_NEIGHBORS: usize = 8;
/// Sides of the compared pictures, px.
const SIDES: std::ops::RangeInclusive<u32> = 32..=4096;

impl StereoOptions {
    /// Checks every number.
    pub fn validate(&self) -> Result<()> {
        let range =
            |option: &str, value: u32, wants: std::ops::RangeInclusive<u32>| match wants.contains(&value) {
                true => Ok(()),
                false => Err(Error::invalid(
                    option,
                    value,
                    format!("a number from {} to {}", wants.start(), wants.end()),
                )),
            };
        range("stereo_size", self.stereo_size, SIDES)?;
        range("neighbors", self.neighbors, 1..=MOST_NEIGHBORS as u32)?;
        range("min_agreeing", self.min_agreeing, 1..=MOST_NEIGHBORS as u32)?;
        if !(0.0..1.0).contains(&self.min_confidence) {
            return Err(Error::invalid(
                "min_confidence",
                self.min_confidence,
                "a number from 0 to less than 1",
            ));
        }
        match self.depth_tolerance > 0.0 && self.depth_tolerance <= 0.2 {
            true => Ok(()),
            false => {
                Err(Error::invalid("depth_tolerance", self.depth_tolerance, "a share above 0, at most 0.2"))
            }
        }
    }
}
