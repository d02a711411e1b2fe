//! The window of `trisplat view`.
//!
//! ```text
//! events ──► App ──► Session (what is shown) ──► panel (its settings)
//!             │          ▲
//!             ▼          │ messages
//!           Screen     threads: loading, photos, soft drawing, screenshots
//! ```
//!
//! The window's thread only draws: longer work runs on other threads, which send messages.

mod app;
mod controls;
mod crop;
mod panel;
mod scene;
mod screen;
mod session;

pub use app::open;
pub use scene::{
    SceneChange, SceneFiles, SceneLoader, SoupSource, WindowOptions, WindowPhoto, WindowScene,
};
