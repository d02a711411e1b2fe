//! Frustum culling of whole chunks by their bounding boxes.

use super::layout::Aabb;
use glam::{DVec3, DVec4};
use trisplat_scene::camera::Camera;

/// The view pyramid of a camera, cut off at the near plane.
#[derive(Debug, Clone)]
pub(crate) struct Frustum {
    /// Inside: `plane.xyz · p + plane.w >= 0`.
    planes: [DVec4; 5],
}

impl Frustum {
    /// The view of `camera` beyond `near`.
    pub(crate) fn new(camera: &Camera, near: f32) -> Self {
        let axis = |row: usize| camera.rotation.row(row).as_dvec3().extend(camera.translation[row].into());
        let (x, y, z) = (axis(0), axis(1), axis(2));
        let (focal, center, size) =
            (camera.focal.as_dvec2(), camera.center.as_dvec2(), camera.size.as_dvec2());
        // 0 <= focal x / z + center <= size, times z.
        let planes = [
            x * focal.x + z * center.x,
            z * (size.x - center.x) - x * focal.x,
            y * focal.y + z * center.y,
            z * (size.y - center.y) - y * focal.y,
            z - DVec4::W * f64::from(near),
        ];
        Self { planes }
    }

    /// False only when the box is outside the view.
    pub(crate) fn sees(&self, bounds: &Aabb) -> bool {
        let (min, max) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
        self.planes.iter().all(|plane| {
            let normal = plane.truncate();
            let farthest = DVec3::select(normal.cmpge(DVec3::ZERO), max, min);
            // A box that touches the plane is kept, despite rounding.
            let slack = 1e-6 * (normal.abs().dot(farthest.abs()) + plane.w.abs());
            normal.dot(farthest) + plane.w >= -slack
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat3, UVec2, Vec2, Vec3};
    use trisplat_scene::Rng;

    #[test]
    fn no_box_with_a_visible_point_is_left_out() {
        let rng = Rng::new(5, "cull", 0);
        let draw = |i: u64, scale: f32| (rng.uniform_f64(i) as f32 - 0.5) * scale;
        let vec = |i: u64, scale: f32| Vec3::new(draw(i, scale), draw(i + 1, scale), draw(i + 2, scale));
        let base = Camera {
            rotation: Mat3::IDENTITY,
            translation: Vec3::ZERO,
            focal: Vec2::new(300.0, 310.0),
            center: Vec2::new(220.0, 100.0),
            size: UVec2::new(400, 260),
        };
        let (mut kept, mut dropped) = (0, 0);
        for k in 0..4000 {
            let camera = base.looking(vec(k * 100, 4.0), vec(k * 100 + 3, 4.0), Vec3::NEG_Y);
            let frustum = Frustum::new(&camera, 0.1);
            let (a, b) = (vec(k * 100 + 6, 6.0), vec(k * 100 + 9, 1.0));
            let bounds = Aabb { min: a.min(a + b), max: a.max(a + b) };
            let visible = (0..27u32).any(|i| {
                let at = Vec3::new((i % 3) as f32, (i / 3 % 3) as f32, (i / 9) as f32) / 2.0;
                let seen =
                    camera.rotation * (bounds.min + at * (bounds.max - bounds.min)) + camera.translation;
                let pixel = seen.truncate() / seen.z * camera.focal + camera.center;
                seen.z >= 0.1 && pixel.cmpge(Vec2::ZERO).all() && pixel.cmple(camera.size.as_vec2()).all()
            });
            let sees = frustum.sees(&bounds);
            assert!(sees || !visible, "{bounds:?} left out");
            kept += u32::from(sees);
            dropped += u32::from(!sees);
        }
        assert!(kept > 300 && dropped > 1500, "{kept} kept, {dropped} dropped");
        assert!(!Frustum::new(&base, 0.1).sees(&Aabb { min: Vec3::splat(-2.0), max: Vec3::splat(-1.0) }));
    }
}
