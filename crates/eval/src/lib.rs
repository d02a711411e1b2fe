//! Scores of scenes on photos: `trisplat eval`.
//!
//! In: scenes and held-out photos. Out: pictures and scores.

mod render;

pub mod coverage;
pub mod evaluate;
pub mod steps;

pub use render::baked_scene::BakedScene;
pub use render::contact_sheet::{ContactSheet, is_shown};
pub use render::scene_renderer::{RenderMode, RenderOptions, SceneRenderer};
