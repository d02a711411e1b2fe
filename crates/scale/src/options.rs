//! How a scene is cut into blocks, declared once.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::{
    Error, Result,
    ranges::{self, Called},
};

/// How a scene is cut into blocks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", command(next_help_heading = "Blocks"))]
pub struct PlanOptions {
    /// Number of blocks; one is a plain run.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65536)))]
    #[schemars(range(min = 1, max = 65_536))]
    pub blocks: Option<u32>,
    /// Width of the margin around a block that is trained with it, as a share of the block's extent.
    #[cfg_attr(feature = "cli", arg(long, value_name = "SHARE", default_value_t = PlanOptions::DEFAULT.halo))]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub halo: f64,
    /// A block gets the photos that show it on at least this share of their pixels.
    #[cfg_attr(feature = "cli", arg(long, value_name = "SHARE", default_value_t = PlanOptions::DEFAULT.min_cover))]
    #[schemars(range(min = 0.0, max = 0.5))]
    pub min_cover: f64,
    /// Most photos per block, those that show most of it; 0: no limit.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = PlanOptions::DEFAULT.block_photos))]
    #[schemars(range(max = 1_000_000))]
    pub block_photos: u32,
    /// How often a block looks at each of its photos, as a share of how often a plain run does. 0: all blocks together draw
    /// 1.5 times the pixels of a plain run, which takes about as long, and no block looks more often than that run.
    #[cfg_attr(feature = "cli", arg(long, value_name = "SHARE", default_value_t = PlanOptions::DEFAULT.passes))]
    #[schemars(range(min = 0.0, max = 100.0))]
    pub passes: f64,
    /// Steps of the coarse scene, the first three fifths of the schedule; 0: three fifths of --steps.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = PlanOptions::DEFAULT.coarse_steps))]
    #[schemars(range(max = 1_000_000_000))]
    pub coarse_steps: u64,
    /// Triangles of the coarse scene; 0: half of --max-triangles.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = PlanOptions::DEFAULT.coarse_triangles))]
    #[schemars(range(max = 1_000_000_000))]
    pub coarse_triangles: u64,
}

impl PlanOptions {
    /// No number of blocks set.
    pub const DEFAULT: Self = Self {
        blocks: None,
        halo: 0.05,
        min_cover: 0.1,
        block_photos: 0,
        passes: 0.0,
        coarse_steps: 0,
        coarse_triangles: 0,
    };

    /// Checks ranges.
    pub fn validate(&self) -> Result<()> {
        ranges::check(self, Called::ByFlag)
    }

    /// Number of blocks.
    ///
    /// Errors: none is set.
    pub(super) fn count(&self) -> Result<usize> {
        let count = self.blocks.ok_or_else(|| Error::invalid("blocks", "not given", "a number of blocks"))?;
        Ok(count as usize)
    }
}

impl Default for PlanOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}
