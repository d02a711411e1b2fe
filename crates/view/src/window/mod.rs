//! The window of `trisplat view`.
//!
//! ```text
//! events ──► App ──► Session (what is shown) ──► panel (its settings)
//!             │          ▲
//!             ▼          │ messages
//!           Screen     threads: loading, photos, soft drawing, picking, screenshots
//! ```
//!
//! The window's thread only draws: longer work runs on other threads, which send messages.

mod app;
mod background;
pub mod controls;
mod crop;
mod help;
mod options;
mod panel;
mod pick;
mod reduced;
mod scene;
mod screen;
mod session;

pub use app::open;
pub use options::WindowOptions;
pub use scene::{
    CropSaver, SceneChange, SceneFiles, SceneFollower, SceneLoader, SoftRenderer, SoupSource, WindowPhoto,
    WindowScene,
};
