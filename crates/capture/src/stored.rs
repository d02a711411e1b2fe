//! State of a capture in its folder, from which the next run continues.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::{Path, PathBuf};
use trisplat_scene::{Error, Limits, Result, atomic::AtomicFile, input};

/// Name of the state folder.
pub(super) const WORK: &str = "capture";

/// List of the files of a capture, relative to its folder.
pub(super) const FILES: &str = "capture/files.json";

/// The photos of a capture and the key of their inputs.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StoredPhotos {
    /// Key of inputs and options.
    pub(super) key: String,
    /// In order of the video, or of names.
    pub(super) photos: Vec<StoredPhoto>,
    /// Each folder has a camera of its own.
    pub(super) by_folder: bool,
    /// EXIF focal length of the only camera, px.
    pub(super) focal_px: Option<f64>,
    /// Width and height of the only camera's photos.
    pub(super) size: Option<[u32; 2]>,
}

/// A photo of a capture.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StoredPhoto {
    /// Its path relative to the photo folder.
    pub(super) name: String,
    /// Its source file.
    pub(super) source: String,
    /// Whether it is a video frame.
    pub(super) frame: bool,
    /// Exposure from EXIF, stops.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) exposure_stops: Option<f64>,
}

/// State of the pose steps.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct StoredSteps {
    pub(super) features: StoredStep,
    pub(super) matches: StoredStep,
    pub(super) model: StoredStep,
}

/// A started step.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct StoredStep {
    /// Key of its inputs.
    pub(super) key: String,
    pub(super) done: bool,
    /// Its details in the report.
    pub(super) details: serde_json::Value,
}

impl StoredStep {
    /// True if it is finished for `key`.
    pub(super) fn is_done(&self, key: &str) -> bool {
        self.done && self.key == key
    }
}

/// Path of `name` in the state folder of `folder`.
pub(super) fn place(folder: &Path, name: &str) -> PathBuf {
    folder.join(WORK).join(name)
}

/// Reads one of these files; `None` if it is missing or from another version.
///
/// Errors: a file that cannot be read.
pub(super) fn read<T: DeserializeOwned>(path: &Path) -> Result<Option<T>> {
    if !path.exists() {
        return Ok(None);
    }
    let text = input::read_text(path, &Limits::DEFAULT)?;
    Ok(serde_json::from_str(&text).ok())
}

/// Writes one of these files.
pub(super) fn write<T: Serialize>(path: &Path, value: &T) -> Result<()> {
    let mut file = AtomicFile::create(path)?;
    let text = serde_json::to_string_pretty(value).unwrap_or_default();
    writeln!(file, "{text}").map_err(|e| Error::io(path, e))?;
    file.commit().map(drop)
}
