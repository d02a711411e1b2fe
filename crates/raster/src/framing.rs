//! The framing of a scene: its subject, its first viewpoint, and the far shell that closes it.

mod subject;
mod surroundings;
mod viewpoint;

pub use subject::Subject;
pub use surroundings::{Surroundings, far_shell, hit, up_of};
pub use viewpoint::{Scenery, orbit, viewpoint};

/// A lens of 100 pixels for tests.
#[cfg(test)]
const LENS: trisplat_scene::camera::Camera = trisplat_scene::camera::Camera {
    rotation: glam::Mat3::IDENTITY,
    translation: glam::Vec3::ZERO,
    focal: glam::Vec2::splat(100.0),
    center: glam::Vec2::splat(50.0),
    size: glam::UVec2::splat(100),
};
