//! The framing of a scene: its subject, its first viewpoint, and the far shell that closes it.

mod candidates;
mod enclosure;
mod subject;
mod viewpoint;

pub use enclosure::{SceneEnclosure, far_shell, mean_up, ray_triangle_distance};
pub use subject::Subject;
pub use viewpoint::{ViewpointInput, orbit, viewpoint};

/// A lens of 100 pixels for tests.
#[cfg(test)]
const LENS: trisplat_scene::camera::Camera = trisplat_scene::camera::Camera {
    rotation: glam::Mat3::IDENTITY,
    translation: glam::Vec3::ZERO,
    focal: glam::Vec2::splat(100.0),
    center: glam::Vec2::splat(50.0),
    size: glam::UVec2::splat(100),
};
