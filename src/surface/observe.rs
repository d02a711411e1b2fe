//! Which pictures can see a block.

use super::picture::DepthPicture;
use glam::Vec3;

/// A picture and the sides of its pyramid of view.
#[derive(Debug)]
pub(super) struct Observer<'a> {
    pub(super) picture: &'a DepthPicture,
    /// Unit normals, inwards, of the four sides, in the camera's frame.
    sides: [Vec3; 4],
}

impl<'a> Observer<'a> {
    pub(super) fn new(picture: &'a DepthPicture) -> Self {
        let camera = &picture.camera;
        let low = -camera.center / camera.focal;
        let high = (camera.size.as_vec2() - camera.center) / camera.focal;
        let sides = [
            Vec3::new(1.0, 0.0, -low.x),
            Vec3::new(-1.0, 0.0, high.x),
            Vec3::new(0.0, 1.0, -low.y),
            Vec3::new(0.0, -1.0, high.y),
        ];
        Self { picture, sides: sides.map(Vec3::normalize) }
    }

    /// Whether some of a ball may be in view.
    pub(super) fn sees(&self, center: Vec3, radius: f32) -> bool {
        let center = self.picture.to_camera(center);
        center.z > -radius && self.sides.iter().all(|side| side.dot(center) > -radius)
    }
}
