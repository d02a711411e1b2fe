//! The kind of a data set.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;

/// The kind of a data set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum DatasetKind {
    /// COLMAP's `cameras.bin`, `images.bin` and `points3D.bin`.
    #[serde(rename = "COLMAP model (binary)")]
    ColmapBinary,
    /// COLMAP's `cameras.txt`, `images.txt` and `points3D.txt`.
    #[serde(rename = "COLMAP model (text)")]
    ColmapText,
    /// `transforms.json` of nerfstudio, instant-ngp and Blender.
    #[serde(rename = "transforms.json")]
    Transforms,
    /// Drawn pictures of a scene instead of photos.
    #[serde(rename = "drawn pictures")]
    Drawn,
}

impl fmt::Display for DatasetKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            DatasetKind::ColmapBinary => "COLMAP model (binary)",
            DatasetKind::ColmapText => "COLMAP model (text)",
            DatasetKind::Transforms => "transforms.json",
            DatasetKind::Drawn => "drawn pictures",
        })
    }
}
