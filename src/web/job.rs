//! The jobs, as JSON. `web/trisplat.d.ts` has the same types for callers.

use serde::Deserialize;
use serde_json::{Map, Value};
use std::path::PathBuf;
use trisplat_scene::camera::Viewpoint;

/// One job. Names of files are those of the caller.
#[derive(Debug, Deserialize)]
#[serde(tag = "command", rename_all = "lowercase", deny_unknown_fields)]
pub(super) enum Job {
    /// What a file holds.
    Info {
        /// The file.
        input: PathBuf,
    },
    /// A scene for immediate display, baked as fast as possible.
    Look {
        /// The scene.
        input: PathBuf,
        /// The GLB to show.
        output: PathBuf,
        /// Options of the bake: the part of the scene, and its rotation.
        #[serde(default)]
        options: Map<String, Value>,
    },
    /// A picture of a soft scene or of Gaussians as they were trained.
    Picture {
        /// The scene.
        input: PathBuf,
        /// The PNG.
        output: PathBuf,
        /// The viewpoint, in the frame of [`Job::Look`] with these options.
        view: Viewpoint,
        /// Options of the bake.
        #[serde(default)]
        options: Map<String, Value>,
        /// Width and height, px.
        size: [u32; 2],
        /// The background, sRGB from 0 to 1.
        #[serde(default)]
        background: [f32; 3],
    },
    /// The bake.
    Bake {
        /// The inputs; several are merged.
        inputs: Vec<PathBuf>,
        /// The output, whose ending decides the format; other files come beside it.
        output: PathBuf,
        /// Options by the names of their fields or groups.
        #[serde(default)]
        options: Map<String, Value>,
        /// Train a soft scene solid first.
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
