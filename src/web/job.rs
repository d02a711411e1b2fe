//! What can be asked for, as JSON. `web/trisplat.d.ts` says the same to those who ask.

use crate::camera::Viewpoint;
use serde::Deserialize;
use serde_json::{Map, Value};
use std::path::PathBuf;

/// One job. Files are named as the job's caller has put them there, or wants to find them.
#[derive(Debug, Deserialize)]
#[serde(tag = "command", rename_all = "lowercase", deny_unknown_fields)]
pub(super) enum Job {
    /// What a file holds.
    Info {
        /// The file.
        input: PathBuf,
    },
    /// A scene as it can be shown at once, baked as fast as can be.
    Look {
        /// The scene.
        input: PathBuf,
        /// The GLB to show.
        output: PathBuf,
        /// Options of the bake: which part of the scene, and how it is turned.
        #[serde(default)]
        options: Map<String, Value>,
    },
    /// A soft scene as it was trained, from one place.
    Picture {
        /// The scene.
        input: PathBuf,
        /// The PNG.
        output: PathBuf,
        /// Where from, in the frame of [`Job::Look`] with these options.
        view: Viewpoint,
        /// Options of the bake.
        #[serde(default)]
        options: Map<String, Value>,
        /// Width and height, px.
        size: [u32; 2],
        /// Behind the scene, sRGB from 0 to 1.
        #[serde(default)]
        background: [f32; 3],
    },
    /// The bake.
    Bake {
        /// What is baked; several are merged.
        inputs: Vec<PathBuf>,
        /// The file whose ending says the format; others come beside it.
        output: PathBuf,
        /// Options by the names of their fields, or whole groups by theirs.
        #[serde(default)]
        options: Map<String, Value>,
        /// A soft scene is trained solid first.
        #[serde(default)]
        harden: bool,
        /// Limit on the bytes of all files together.
        #[serde(default)]
        max_bytes: Option<u64>,
    },
}

impl Job {
    /// The first file that is read, for messages.
    pub(super) fn input(&self) -> Option<&PathBuf> {
        match self {
            Self::Info { input } | Self::Look { input, .. } | Self::Picture { input, .. } => Some(input),
            Self::Bake { inputs, .. } => inputs.first(),
        }
    }
}
