//! Whether a training corrects the poses of its photos.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Whether poses are corrected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum PoseUse {
    /// Always, by at most three pixels.
    On,
    /// Never.
    #[default]
    Off,
}
