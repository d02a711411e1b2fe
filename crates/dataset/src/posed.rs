//! A data set in memory: posed photos of one scene and the sparse cloud of its points.

use super::kind::DatasetKind;
use super::options::Masks;
use super::photo::Photo;
use glam::{DVec3, UVec2, Vec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use trisplat_scene::{Error, Result, UpAxis, camera::Camera};

/// Posed photos of one scene.
#[derive(Debug, Clone)]
pub struct Dataset {
    /// Its folder or file, as given.
    pub path: PathBuf,
    /// What it was read as.
    pub kind: DatasetKind,
    /// All photos, sorted by name.
    pub views: Vec<View>,
    /// The sparse cloud; may be empty.
    pub points: Vec<Point>,
    /// The world point at (0, 0, 0) here: zero, unless the scene is too far from the origin for f32. world =
    /// origin + position.
    pub origin: DVec3,
    /// Repairs, omissions and oddities, one sentence each.
    pub warnings: Vec<String>,
}

/// A posed photo.
#[derive(Debug, Clone)]
pub struct View {
    /// Path below the folder of photos: "0001.jpg".
    pub name: String,
    /// Its pinhole camera, at the size of the decoded photo.
    pub camera: Camera,
    /// The photo, decoded on request.
    pub photo: Photo,
    /// Held out for evaluation, never trained on.
    pub test: bool,
}

impl View {
    /// The same view with only a part of its picture: of `size` px, with its upper left corner at `corner`.
    ///
    /// Errors: a part that is empty or outside the picture.
    pub fn cropped(&self, corner: UVec2, size: UVec2) -> Result<Self> {
        let whole = self.camera.size;
        let fits =
            |a: usize| size[a] > 0 && corner[a].checked_add(size[a]).is_some_and(|end| end <= whole[a]);
        if !fits(0) || !fits(1) {
            let part = format!("{}x{} px at {},{}", size.x, size.y, corner.x, corner.y);
            let wants = format!("a part of the {}x{} px of `{}`", whole.x, whole.y, self.name);
            return Err(Error::invalid("crop", part, wants));
        }
        let camera = Camera { center: self.camera.center - corner.as_vec2(), size, ..self.camera };
        Ok(Self { camera, photo: self.photo.cropped(corner, size), ..self.clone() })
    }
}

/// A point of the sparse cloud.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// World position minus the data set's origin.
    pub position: Vec3,
    /// sRGB-encoded colour.
    pub rgb: [u8; 3],
    /// Mean reprojection error that the file states, px.
    pub error: Option<f32>,
}

/// Reprojection errors, at the photos' full size.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Reprojection {
    /// Mean over all observations, px.
    pub mean_px: f64,
    /// Observations measured.
    pub observations: u64,
    /// Observations of points behind their camera; not in the mean.
    pub behind: u64,
}

impl Dataset {
    /// Number of photos, held-out ones included.
    pub fn len(&self) -> usize {
        self.views.len()
    }

    /// True without photos.
    pub fn is_empty(&self) -> bool {
        self.views.is_empty()
    }

    /// The training photos, in order of name.
    pub fn train(&self) -> impl Iterator<Item = &View> {
        self.views.iter().filter(|v| !v.test)
    }

    /// The held-out photos, in order of name.
    pub fn test(&self) -> impl Iterator<Item = &View> {
        self.views.iter().filter(|v| v.test)
    }

    /// What to do with masks when `asked` to: `auto` as it was decided.
    pub fn masks(&self, asked: Masks) -> Masks {
        let cut = || self.views.iter().any(|view| view.photo.mask.is_some() && view.photo.is_cut());
        match asked {
            Masks::Auto if cut() => Masks::Cut,
            Masks::Auto => Masks::Ignore,
            asked => asked,
        }
    }

    /// The world axis that usually points up in this kind of data set: -Y in COLMAP's models, which begin with an upright photo, +Z in
    /// `transforms.json`.
    pub fn up_axis(&self) -> UpAxis {
        match self.kind {
            DatasetKind::ColmapBinary | DatasetKind::ColmapText => UpAxis::NegY,
            DatasetKind::Transforms => UpAxis::Z,
            DatasetKind::Drawn => UpAxis::Y,
        }
    }
}
