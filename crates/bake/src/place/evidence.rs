//! Known facts about a scene beside its triangles.

use glam::Vec3;
use trisplat_scene::camera::Camera;

/// Known facts about a scene, apart from its triangles, in its frame.
#[derive(Debug, Clone, Copy, Default)]
pub struct Evidence<'a> {
    /// Cameras that look at it.
    pub cameras: &'a [Camera],
    /// Points of the photos' reconstruction; may be empty.
    pub points: &'a [Vec3],
    /// The cameras were chosen for drawings, by the up axis that the scene was taken to have: they
    /// tell nothing of it.
    pub are_chosen: bool,
}
