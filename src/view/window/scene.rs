//! What a window shows, and who loads it.

use crate::asset::Asset;
use crate::camera::Camera;
use crate::error::Result;
use crate::image::Pixels;
use crate::soup::Soup;
use glam::Vec3;
use std::sync::Arc;

/// What a window shows.
pub struct WindowScene {
    /// The triangles.
    pub asset: Asset,
    /// The axis of the asset that points up.
    pub up: Vec3,
    /// Posed photos, in the frame of the asset.
    pub photos: Vec<WindowPhoto>,
    /// The soup that it was baked from, if any.
    pub source: Option<SoupSource>,
}

/// A posed photo.
#[derive(Clone)]
pub struct WindowPhoto {
    /// Its name.
    pub name: String,
    /// Its camera, in the frame of the asset.
    pub camera: Camera,
    /// Decodes it; called on a thread of its own.
    pub load: Arc<dyn Fn() -> Result<Pixels> + Send + Sync>,
}

/// The soup behind an asset.
pub struct SoupSource {
    /// The soup as it was read.
    pub soup: Arc<Soup>,
    /// A point of the asset in the frame of the soup.
    pub to_soup: Arc<dyn Fn(Vec3) -> Vec3 + Send + Sync>,
    /// Draws it with the soft rasteriser for a camera in the frame of the asset; called on a thread of its own.
    pub renderer: SoftRenderer,
}

/// Draws what a camera sees.
pub type SoftRenderer = Box<dyn FnMut(&Camera) -> Pixels + Send>;

/// Loads what a window shows.
pub struct SceneLoader {
    /// Makes the scene and reports its progress; called on a thread of its own.
    #[allow(clippy::type_complexity, reason = "it is called once, here")]
    pub load: Box<dyn FnOnce(&dyn Fn(&str)) -> Result<WindowScene> + Send>,
    /// Adds the BVH that picking needs; called on a thread of its own once the scene is shown.
    pub add_bvh: fn(Asset) -> Result<Asset>,
}
