//! Whether a training begins with surfaces from stereo.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// When the first triangles lie on surfaces that stereo finds in the photos.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum StereoUse {
    /// Where measurements show a gain (docs/benchmarks/stereo.md): nowhere yet.
    #[default]
    Auto,
    /// Always.
    On,
    /// Never: one triangle of random direction per point.
    Off,
}
