//! The viewpoints for drawing a scene.

use super::chosen::Search;
use super::stored;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::{ImportedScene, camera::Camera};

/// Where viewpoints come from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ViewpointKind {
    /// The cameras that the scene stores, and cameras between them.
    #[default]
    Stored,
    /// Chosen around an object.
    Around,
    /// Chosen inside a scene that has surroundings.
    Inside,
}

/// The viewpoints for a scene, in the frame of its file.
#[derive(Debug, Clone, PartialEq)]
pub struct Viewpoints {
    /// Where they come from.
    pub kind: ViewpointKind,
    /// One camera per picture.
    pub cameras: Vec<Camera>,
}

/// Cameras half way from each of `cameras` to its nearest neighbours that look the same way.
pub fn between(cameras: &[Camera]) -> Vec<Camera> {
    stored::between(cameras)
}

impl Viewpoints {
    /// Those of `scene`: all stored cameras, with others between them up to `max_bytes` of 8-bit pictures, or
    /// chosen ones. `None` without stored cameras and without visible triangles.
    pub fn of(scene: &ImportedScene, max_bytes: u64) -> Option<Self> {
        Self::from_sides(scene, max_bytes, false)
    }

    /// The same. Chosen cameras around an object look at it from all sides, from below too, unless the scene knows where up is.
    pub fn of_any_side(scene: &ImportedScene, max_bytes: u64) -> Option<Self> {
        Self::from_sides(scene, max_bytes, true)
    }

    fn from_sides(scene: &ImportedScene, max_bytes: u64, any_side: bool) -> Option<Self> {
        if scene.cameras.is_empty() {
            let chosen = Search::new(scene, any_side)?.viewpoints()?;
            let kind = if chosen.inside { ViewpointKind::Inside } else { ViewpointKind::Around };
            return Some(Self { kind, cameras: chosen.cameras });
        }
        Some(Self { kind: ViewpointKind::Stored, cameras: stored::viewpoints(&scene.cameras, max_bytes) })
    }
}
