//! Posed photos in: COLMAP models and `transforms.json` files become cameras, lazily decoded photos
//! and a sparse cloud of points.

pub mod cloud;
mod colmap;
mod colmap_binary;
mod colmap_text;
pub mod describe;
mod found;
pub mod lens;
pub mod options;
pub mod photo;
pub mod photos;
mod point_ply;
mod split;
pub mod synthetic;
pub mod synthetic_scene;
mod transforms;
pub mod undistort;

pub use describe::{Description, describe};
pub use options::{Background, DatasetOptions, Masks};
pub use photo::Photo;
pub use photos::Photos;
pub use split::Split;

use crate::camera::Camera;
use crate::error::Result;
use glam::{DVec3, Vec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Posed photos of one scene.
#[derive(Debug, Clone)]
pub struct Dataset {
    /// The folder or file it was read from, as given.
    pub path: PathBuf,
    /// What it was read as: "COLMAP binary model".
    pub kind: &'static str,
    /// All photos, sorted by name.
    pub views: Vec<View>,
    /// The sparse cloud; may be empty.
    pub points: Vec<Point>,
    /// The world point that became (0, 0, 0) here: zero, unless the scene lies so far from the origin
    /// that f32 would lose its detail. world = origin + position.
    pub origin: DVec3,
    /// How well cameras and points fit each other, where the data set tells which photo shows which
    /// point.
    pub reprojection: Option<Reprojection>,
    /// Things that were mended, skipped or are odd, one sentence each.
    pub warnings: Vec<String>,
}

/// A posed photo.
#[derive(Debug, Clone)]
pub struct View {
    /// Path below the folder of photos: "0001.jpg".
    pub name: String,
    /// The pinhole that took it, at the size the photo is delivered in.
    pub camera: Camera,
    /// The photo; nothing is decoded before it is asked for.
    pub photo: Photo,
    /// Held out: judged on, never trained on.
    pub test: bool,
}

/// A point of the sparse cloud.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// World position less the data set's origin.
    pub position: Vec3,
    /// sRGB-encoded colour.
    pub rgb: [u8; 3],
    /// Mean reprojection error that the file states, px.
    pub error: Option<f32>,
}

/// The distance between where points were seen and where the cameras put them, in the photos' full size.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Reprojection {
    /// Mean over all sightings, px.
    pub mean_px: f64,
    /// Sightings measured.
    pub sightings: u64,
    /// Sightings of points behind the camera that claims to see them; not in the mean.
    pub behind: u64,
}

impl Dataset {
    /// Reads a data set: a folder with a COLMAP model or a `transforms.json`, or such a file itself.
    /// A folder with both is read as COLMAP.
    ///
    /// Photos are opened as far as their header. Fails when a photo is missing or broken, unless
    /// `skip_broken` says to go on without it.
    pub fn load(path: &Path, options: &DatasetOptions) -> Result<Self> {
        let found = found::find(path, options)?;
        found::finish(path, found, options)
    }

    /// The photos to train on, in order of name.
    pub fn train(&self) -> impl Iterator<Item = &View> {
        self.views.iter().filter(|v| !v.test)
    }

    /// The held-out photos, in order of name.
    pub fn test(&self) -> impl Iterator<Item = &View> {
        self.views.iter().filter(|v| v.test)
    }
}
