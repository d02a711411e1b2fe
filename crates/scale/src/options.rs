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
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65536), conflicts_with = "block_triangles"))]
    #[schemars(range(min = 1, max = 65_536))]
    pub blocks: Option<u32>,
    /// Triangles per block, about; the number of blocks follows from --max-triangles.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..)))]
    #[schemars(range(min = 1, max = 1_000_000_000))]
    pub block_triangles: Option<u64>,
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
        block_triangles: None,
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

    /// Number of blocks for a scene of `max_triangles`.
    ///
    /// Errors: neither option is set; more than 65,536.
    pub fn count(&self, max_triangles: u64) -> Result<usize> {
        let count = match (self.blocks, self.block_triangles) {
            (Some(blocks), _) => u64::from(blocks),
            (None, Some(triangles)) => max_triangles.div_ceil(triangles.max(1)),
            (None, None) => {
                let wants = "a number of blocks, or `block_triangles`";
                return Err(Error::invalid("blocks", "not given", wants));
            }
        };
        match (1..=65_536).contains(&count) {
            true => Ok(count as usize),
            false => Err(Error::invalid("block_triangles", count, "at most 65536 blocks")),
        }
    }
}

impl Default for PlanOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}
