//! Options of a capture, declared once for the library, the flags and the schema.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Options for frames of videos and for poses.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[cfg_attr(feature = "cli", command(next_help_heading = "Capture"))]
#[serde(default, deny_unknown_fields)]
pub struct CaptureOptions {
    /// Most frames of each video; fewer if the camera moves little.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = 150, value_parser = clap::value_parser!(u32).range(2..=10_000)))]
    pub frames: u32,
    /// Pose program: a colmap, or a Python with pycolmap; by default the one in TRISPLAT_POSES, or the first that is
    /// installed.
    #[cfg_attr(feature = "cli", arg(long, value_name = "PROGRAM"))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub poses: Option<PathBuf>,
    /// How poses are reconstructed.
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t))]
    pub mapper: Mapper,
    /// A vocabulary tree of COLMAP. It chooses the pairs to compare if there are more than 150 photos.
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vocab_tree: Option<PathBuf>,
}

impl Default for CaptureOptions {
    fn default() -> Self {
        Self { frames: 150, poses: None, mapper: Mapper::default(), vocab_tree: None }
    }
}

/// How poses are reconstructed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Mapper {
    /// Photo by photo; if many stay without a pose, also all at once, and the better of the two.
    #[default]
    Auto,
    /// Photo by photo.
    Incremental,
    /// All at once (GLOMAP).
    Global,
}

impl Mapper {
    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Incremental => "incremental",
            Self::Global => "global",
        }
    }
}
