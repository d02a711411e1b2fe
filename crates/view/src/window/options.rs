//! Options of the window.

use glam::UVec2;
use std::path::PathBuf;
use trisplat_gpu::AdapterOptions;

/// How a window looks.
#[derive(Debug, Clone)]
pub struct WindowOptions {
    /// Initial width and height, px.
    pub size: UVec2,
    /// sRGB-encoded background colour.
    pub background: [f32; 3],
    /// Samples per pixel at edges (MSAA): 1 or 4.
    pub msaa: u32,
    /// Frames per second to hold while something moves; `None` to draw every pixel always.
    pub fps: Option<f64>,
    /// Show pictures at the vertical blank of the screen.
    pub vsync: bool,
    /// Folder for screenshots.
    pub screenshots: PathBuf,
    /// The remedy when no window can be opened.
    pub remedy: &'static str,
    /// Which graphics card draws.
    pub adapter: AdapterOptions,
}
