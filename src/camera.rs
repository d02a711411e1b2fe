//! The pinhole camera.

use crate::error::{Error, Result};
use glam::{Mat3, UVec2, Vec2, Vec3};

/// Pinhole camera q = K (R v + t). +x right, +y down, +z forward (COLMAP); pixel centres at +0.5.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// World to camera rotation R.
    pub rotation: Mat3,
    /// World to camera translation t.
    pub translation: Vec3,
    /// Focal lengths, px.
    pub focal: Vec2,
    /// Principal point, px; anywhere.
    pub center: Vec2,
    /// Image width and height, px.
    pub size: UVec2,
}

impl Camera {
    /// The camera's place in the world: -R^T t.
    pub fn position(&self) -> Vec3 {
        -(self.rotation.transpose() * self.translation)
    }

    /// The same camera for an image resized to `size`.
    pub fn resized(&self, size: UVec2) -> Self {
        let ratio = size.as_vec2() / self.size.as_vec2();
        Self { focal: self.focal * ratio, center: self.center * ratio, size, ..*self }
    }

    /// Checks that everything is finite, the focal lengths are positive and the size is not zero.
    pub fn validate(&self) -> Result<()> {
        let finite = self.rotation.is_finite()
            && self.translation.is_finite()
            && self.focal.is_finite()
            && self.center.is_finite();
        if !finite || !(self.focal.min_element() > 0.0) || self.size.min_element() == 0 {
            return Err(Error::invalid("camera", format!("{self:?}"), "finite numbers, focal > 0, size > 0"));
        }
        Ok(())
    }
}
