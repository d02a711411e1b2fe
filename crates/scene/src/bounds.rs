//! The box around a scene.

use glam::Vec3;

/// An axis-aligned box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Lowest corner.
    pub min: Vec3,
    /// Highest corner.
    pub max: Vec3,
}

impl Bounds {
    /// The box around `points`; one without extent at the origin if there are none.
    pub fn of(points: impl IntoIterator<Item = Vec3>) -> Self {
        let [min, max] =
            crate::math::geometry::bounds(points.into_iter()).unwrap_or([Vec3::ZERO; 2]);
        Self { min, max }
    }

    /// The middle of the box.
    pub fn center(&self) -> Vec3 {
        (self.min + self.max) / 2.0
    }

    /// Radius of the sphere around the box.
    pub fn radius(&self) -> f32 {
        self.min.distance(self.max) / 2.0
    }
}
