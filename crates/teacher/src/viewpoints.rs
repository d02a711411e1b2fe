//! The viewpoints for drawing a scene.

use super::chosen::{Chosen, PICTURES, Search};
use super::stored;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::{ImportedScene, Splats, camera::Camera};

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
        match scene.cameras.is_empty() {
            true => Some(Self::of_chosen(Search::new(scene, false)?.viewpoints(PICTURES)?)),
            false => {
                let cameras = stored::viewpoints(&scene.cameras, max_bytes);
                Some(Self { kind: ViewpointKind::Stored, cameras })
            }
        }
    }

    /// Those of Gaussians, the most telling first: all `stored` cameras, or chosen ones; `stand_in` has triangles in the place of the Gaussians.
    /// Around an object `count` cameras are chosen, which look at it from all sides, from below too, and have pictures of `longer_px` that it
    /// fills. `None` where nothing is seen.
    pub fn of_splats(
        splats: &Splats,
        stand_in: &ImportedScene,
        stored: &[Camera],
        (count, longer_px): (usize, u32),
    ) -> Option<Self> {
        match stored.is_empty() {
            true => Some(Self::of_chosen(Search::new(stand_in, true)?.of_splats(splats, count, longer_px)?)),
            false => Some(Self { kind: ViewpointKind::Stored, cameras: stored.to_vec() }),
        }
    }

    fn of_chosen(chosen: Chosen) -> Self {
        let kind = if chosen.inside { ViewpointKind::Inside } else { ViewpointKind::Around };
        Self { kind, cameras: chosen.cameras }
    }
}
