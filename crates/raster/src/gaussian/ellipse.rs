//! Gaussians on the screen: ellipses with an opacity, a colour and a depth.

use super::options::{GaussianOptions, LOG2_CUTOFF, VIEW_GUARD};
use crate::kernel::sh;
use crate::soft::MARGIN;
use crate::soft::sort::{DepthKey, by_depth};
use glam::{Mat3, Vec2, Vec3};
use trisplat_scene::parallel;
use trisplat_scene::{Splats, camera::Camera, math::vec::V3};

/// Gaussians that one task projects.
const PER_TASK: usize = 4096;

/// A Gaussian on the screen. At (dx, dy) px from its middle, its alpha is 2 to the power of
/// `level - (along dx + shear dy)² - (down dy)²`: a sum of squares, which stays exact where the coefficients of the inverse
/// covariance cancel, as for long and thin ones.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ellipse {
    pub(super) middle: Vec2,
    pub(super) along: f32,
    pub(super) shear: f32,
    pub(super) down: f32,
    /// Logarithm of the opacity to base 2.
    pub(super) level: f32,
    pub(super) rgb: [f32; 3],
    /// Depth of the middle, > 0.
    pub(super) depth: f32,
    /// Which Gaussian of the scene it is.
    pub(super) gaussian: u32,
}

impl Ellipse {
    /// Square of the radius, in the units of the squares above, within which it is drawn.
    pub(super) fn reach_squared(&self) -> f32 {
        self.level - LOG2_CUTOFF
    }

    /// Half of its height, px.
    pub(super) fn half_height(&self) -> f32 {
        self.reach_squared().max(0.0).sqrt() / self.down
    }
}

/// What all Gaussians of a picture share.
struct Projector<'a> {
    splats: &'a Splats,
    camera: &'a Camera,
    near: f32,
    /// Largest tangents at which the Jacobian is taken.
    guard: Vec2,
}

/// All Gaussians that may be seen, in the order of the scene.
pub(super) fn all(splats: &Splats, camera: &Camera, options: &GaussianOptions) -> Vec<Ellipse> {
    let guard = camera.size.as_vec2() / camera.focal * (0.5 * VIEW_GUARD);
    let projector = Projector { splats, camera, near: options.near, guard };
    let tasks: Vec<Vec<Ellipse>> = parallel::map((0..splats.len()).step_by(PER_TASK), |_, first| {
        let some = first..(first + PER_TASK).min(splats.len());
        some.filter_map(|i| projector.project(i)).collect()
    });
    tasks.concat()
}

/// Indices of the ellipses by depth, nearest first; equal depths in the order of the scene.
pub(super) fn front_to_back(ellipses: &[Ellipse]) -> Vec<u32> {
    let key = |(i, ellipse): (usize, &Ellipse)| DepthKey { depth: ellipse.depth.to_bits(), index: i as u32 };
    let mut keys: Vec<DepthKey> = ellipses.iter().enumerate().map(key).collect();
    by_depth(&mut keys, &mut Vec::new());
    keys.iter().map(|key| key.index).collect()
}

impl Projector<'_> {
    /// One Gaussian; `None` when it is too near, too faint, or beside the picture.
    fn project(&self, i: usize) -> Option<Ellipse> {
        let (splats, camera) = (self.splats, self.camera);
        let at = camera.rotation * splats.positions[i] + camera.translation;
        if !(at.z >= self.near) {
            return None;
        }
        let tangent = at.truncate() / at.z;
        let [first, second] = self.axes_on_screen(i, tangent, at.z);
        let (xx, yy, xy) = (first.length_squared(), second.length_squared(), first.dot(second));
        let blur = splats.filter.variance;
        // |a × b|² + blur (a² + b²) + blur²: the determinant without the cancellation of xx yy - xy².
        let sharp = first.cross(second).length_squared();
        let determinant = sharp + blur * (xx + yy) + blur * blur;
        let (xx, yy) = (xx + blur, yy + blur);
        let kept = if splats.filter.keeps_light { (sharp / determinant).sqrt() } else { 1.0 };
        let half_log2_e = std::f32::consts::LOG2_E * 0.5;
        let ellipse = Ellipse {
            middle: tangent * camera.focal + camera.center,
            along: (half_log2_e * yy / determinant).sqrt(),
            shear: -xy * (half_log2_e / (yy * determinant)).sqrt(),
            down: (half_log2_e / yy).sqrt(),
            level: (splats.opacity[i] * kept).log2(),
            rgb: [0.0; 3],
            depth: at.z,
            gaussian: i as u32,
        };
        let reach = ellipse.reach_squared();
        if !(reach >= 0.0 && ellipse.along.is_finite() && ellipse.shear.is_finite() && ellipse.down > 0.0) {
            return None;
        }
        let half = Vec2::new((reach * xx / half_log2_e).sqrt(), ellipse.half_height()) + MARGIN;
        let (low, high) = (ellipse.middle - half, ellipse.middle + half);
        let size = camera.size.as_vec2();
        let seen = high.x >= 0.0 && high.y >= 0.0 && low.x <= size.x && low.y <= size.y;
        seen.then(|| Ellipse { rgb: self.color(i, at), ..ellipse })
    }

    /// The two rows of J W R S, whose products are the covariance on the screen.
    fn axes_on_screen(&self, i: usize, tangent: Vec2, depth: f32) -> [Vec3; 2] {
        let t = tangent.clamp(-self.guard, self.guard);
        let per_depth = self.camera.focal / depth;
        let jacobian = [
            Vec3::new(per_depth.x, 0.0, -per_depth.x * t.x),
            Vec3::new(0.0, per_depth.y, -per_depth.y * t.y),
        ];
        let own_axes = Mat3::from_quat(self.splats.rotations[i]);
        jacobian.map(|row| {
            let world = self.camera.rotation.transpose() * row;
            own_axes.transpose() * world * self.splats.scales[i]
        })
    }

    /// Its colour towards the camera, not clamped above. `at` is its middle in camera space.
    fn color(&self, i: usize, at: Vec3) -> [f32; 3] {
        let k = self.splats.sh_count();
        let towards = (self.camera.rotation.transpose() * at).normalize_or(Vec3::Z);
        let basis = sh::basis(self.splats.sh_degree, V3::new(towards.x, towards.y, towards.z));
        let mut rgb = Vec3::splat(0.5);
        for (coefficient, basis) in self.splats.sh[i * k..(i + 1) * k].iter().zip(basis) {
            rgb += Vec3::from(*coefficient) * basis;
        }
        rgb.max(Vec3::ZERO).to_array()
    }
}
