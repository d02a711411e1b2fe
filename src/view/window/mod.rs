//! The window of `trisplat view`.
//!
//! ```text
//! events ──► App ──► Session (what is shown) ──► panel (what can be chosen)
//!             │          ▲
//!             ▼          │ messages
//!           Screen     threads: loading, photos, soft drawing, picking, screenshots
//! ```
//!
//! The window's thread only draws: whatever takes longer runs beside it and sends a message.

mod app;
mod background;
pub mod controls;
mod panel;
mod pick;
mod screen;
mod session;

use crate::asset::Asset;
use crate::camera::Camera;
use crate::error::Result;
use crate::gpu::AdapterOptions;
use crate::image::Pixels;
use crate::soup::Soup;
use glam::{UVec2, Vec3};
use std::path::PathBuf;
use std::sync::Arc;

/// What a window shows.
pub struct Scene {
    /// What is drawn.
    pub asset: Asset,
    /// The axis of the asset that points up.
    pub up: Vec3,
    /// Posed photos, in the frame of the asset.
    pub photos: Vec<Photo>,
    /// The soup it was baked from, when it was.
    pub source: Option<Source>,
}

/// A posed photo.
#[derive(Clone)]
pub struct Photo {
    /// Its name.
    pub name: String,
    /// What took it, in the frame of the asset.
    pub camera: Camera,
    /// Decodes it; called on a thread of its own.
    pub load: Arc<dyn Fn() -> Result<Pixels> + Send + Sync>,
}

/// The soup behind an asset.
pub struct Source {
    /// The soup as it was read.
    pub soup: Arc<Soup>,
    /// A point of the asset in the frame of the soup.
    pub to_soup: Arc<dyn Fn(Vec3) -> Vec3 + Send + Sync>,
    /// Draws it softly for a camera in the frame of the asset; called on a thread of its own.
    pub paint: Painter,
}

/// Draws for a camera.
pub type Painter = Box<dyn FnMut(&Camera) -> Pixels + Send>;

/// How a window is filled.
pub struct Loader {
    /// Makes the scene, telling what it is at; called on a thread of its own.
    #[allow(clippy::type_complexity, reason = "it is called once, here")]
    pub load: Box<dyn FnOnce(&dyn Fn(&str)) -> Result<Scene> + Send>,
    /// Adds the hierarchy that picking needs; called on a thread of its own once the scene is shown.
    pub index: fn(Asset) -> Result<Asset>,
}

/// How a window looks.
#[derive(Debug, Clone)]
pub struct WindowOptions {
    /// What is written above it.
    pub title: String,
    /// Width and height at first, px.
    pub size: UVec2,
    /// sRGB-encoded colour where nothing is.
    pub background: [f32; 3],
    /// Samples of edges, 1 or 4.
    pub msaa: u32,
    /// Wait for the screen to be ready for a picture.
    pub vsync: bool,
    /// Folder for screenshots.
    pub shots: PathBuf,
    /// Which card draws.
    pub adapter: AdapterOptions,
}

/// Opens a window and returns when it is closed.
///
/// Errors: no display, no card, the scene cannot be loaded, the card is lost.
pub fn open(options: WindowOptions, loader: Loader) -> Result<()> {
    app::run(options, loader)
}
