//! What a capture has done so far, in its folder: the next run goes on from there.

use crate::atomic::AtomicFile;
use crate::error::{Error, Result};
use crate::input;
use crate::limits::Limits;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Folder of what a capture keeps for itself.
pub(super) const WORK: &str = "capture";

/// The photos of a capture, and what they were made of.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StoredPhotos {
    /// The inputs and options that they were made of.
    pub(super) key: String,
    /// In the order they were taken in, or that of their names.
    pub(super) photos: Vec<StoredPhoto>,
    /// Each folder has a camera of its own.
    pub(super) by_folder: bool,
    /// Focal length by the notes of the one camera, px.
    pub(super) focal_px: Option<f64>,
    /// Width and height of photos of the one camera.
    pub(super) size: Option<[u32; 2]>,
}

/// A photo of a capture.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StoredPhoto {
    /// Its path below the folder of photos.
    pub(super) name: String,
    /// The file it was made of.
    pub(super) source: String,
    /// A frame of a video.
    pub(super) frame: bool,
    /// Light let in, by its notes, in stops.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) exposure_stops: Option<f64>,
}

/// The steps that find poses.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct StoredSteps {
    pub(super) features: StoredStep,
    pub(super) matches: StoredStep,
    pub(super) model: StoredStep,
}

/// A step that was begun.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct StoredStep {
    /// What it was made of.
    pub(super) key: String,
    pub(super) done: bool,
    /// What it found, as its entry in the report.
    pub(super) details: serde_json::Value,
}

impl StoredStep {
    /// True when it is done for what `key` says.
    pub(super) fn is_done(&self, key: &str) -> bool {
        self.done && self.key == key
    }
}

/// The file `name` of the work folder of `folder`.
pub(super) fn place(folder: &Path, name: &str) -> PathBuf {
    folder.join(WORK).join(name)
}

/// Reads one of the files above; `None` when it is not there or of another version: then nothing is done.
pub(super) fn read<T: DeserializeOwned>(path: &Path) -> Option<T> {
    let text = input::read_text(path, &Limits::DEFAULT).ok()?;
    serde_json::from_str(&text).ok()
}

/// Writes one of the files above.
pub(super) fn write<T: Serialize>(path: &Path, value: &T) -> Result<()> {
    let mut file = AtomicFile::create(path)?;
    let text = serde_json::to_string_pretty(value).unwrap_or_default();
    writeln!(file, "{text}").map_err(|e| Error::io(path, e))?;
    file.commit().map(drop)
}
