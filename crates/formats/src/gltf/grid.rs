//! The 16-bit grid of one chunk, and its loss.
//!
//! ```text
//! position = scale * code + origin,   code in 0..=65535,   scale = extent / 65535 along each axis
//! ```
//!
//! There is never one grid for the whole scene, because triangles are small compared with the scene. Measured
//! on 500,000 synthetic triangles with a far shell, a global 14-bit grid (the usual default of optimisers)
//! flattens 20 % of them to zero area, a global 16-bit grid 0.6 %, chunks of 16 thousand triangles about 0.1
//! %.

use glam::{DVec3, I64Vec3, U16Vec3, Vec3};

/// The largest code.
const STEPS: f64 = u16::MAX as f64;

/// From codes to positions: the scale and translation of a chunk's node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PositionGrid {
    /// File units per step.
    pub(crate) scale: Vec3,
    /// Position of code 0.
    pub(crate) origin: Vec3,
    /// Steps per file unit.
    density: DVec3,
}

/// What quantisation costs.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct QuantizationLoss {
    /// Largest distance between a vertex and its place in an engine, in file units.
    pub(crate) worst: f32,
    /// Triangles with an area before and none after.
    pub(crate) collapsed: u64,
}

impl PositionGrid {
    /// The finest grid that covers the box from `min` to `max`; an axis without extent gets steps of 1.
    pub(crate) fn new(min: Vec3, max: Vec3) -> Self {
        let step = (max.as_dvec3() - min.as_dvec3()) / STEPS;
        // A step below the smallest normal number would be zero in an engine that flushes denormals.
        let scale = step.to_array().map(|s| if s > 0.0 { (s as f32).max(f32::MIN_POSITIVE) } else { 1.0 });
        let scale = Vec3::from(scale);
        Self { scale, origin: min, density: scale.as_dvec3().recip() }
    }

    /// The finest grid with the same steps along all axes that covers the box from `min` to `max`.
    pub(crate) fn even(min: Vec3, max: Vec3) -> Self {
        Self::new(min, min + Vec3::splat((max - min).max_element()))
    }

    /// The code nearest to `position`.
    pub(crate) fn code(&self, position: Vec3) -> U16Vec3 {
        let steps = (position.as_dvec3() - self.origin.as_dvec3()) * self.density;
        // The cast truncates and saturates at 0..=65535; `round` would be a library call on plain x86-64.
        (steps + 0.5).as_u16vec3()
    }

    /// The position of `code` in an engine's f32 arithmetic.
    pub(crate) fn position(&self, code: U16Vec3) -> Vec3 {
        self.scale * code.as_vec3() + self.origin
    }

    /// The loss of these triangles on the grid.
    pub(crate) fn loss(&self, triangles: impl Iterator<Item = [Vec3; 3]>) -> QuantizationLoss {
        let mut worst = 0.0f64;
        let mut collapsed = 0;
        for corners in triangles {
            let codes = corners.map(|p| self.code(p));
            for (p, code) in corners.into_iter().zip(codes) {
                worst = worst.max(p.as_dvec3().distance_squared(self.position(code).as_dvec3()));
            }
            collapsed += u64::from(is_flat(codes) && has_area(corners));
        }
        QuantizationLoss { worst: worst.sqrt() as f32, collapsed }
    }
}

impl QuantizationLoss {
    /// Largest permitted error of a grid, as a share of the median triangle's size (the root of its area).
    const OF_DETAIL: f64 = 1.0 / 16.0;
    /// One triangle in this many may be flattened.
    const ONE_IN: u64 = 200;

    /// Whether the loss is acceptable for a chunk of this many faces with the median size `detail`. If not,
    /// for example because one huge triangle stretches the grid, positions stay floats.
    pub(crate) fn is_allowed(&self, faces: usize, detail: f64) -> bool {
        f64::from(self.worst) <= Self::OF_DETAIL * detail && self.collapsed * Self::ONE_IN <= faces as u64
    }

    /// The combined loss of two sets of triangles.
    pub(crate) fn and(self, other: QuantizationLoss) -> QuantizationLoss {
        QuantizationLoss { worst: self.worst.max(other.worst), collapsed: self.collapsed + other.collapsed }
    }
}

fn is_flat(codes: [U16Vec3; 3]) -> bool {
    let [a, b, c] = codes.map(|code| code.as_i64vec3());
    (b - a).cross(c - a) == I64Vec3::ZERO
}

fn has_area(corners: [Vec3; 3]) -> bool {
    let [a, b, c] = corners.map(Vec3::as_dvec3);
    (b - a).cross(c - a) != DVec3::ZERO
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(min: [f32; 3], max: [f32; 3]) -> PositionGrid {
        PositionGrid::new(min.into(), max.into())
    }

    #[test]
    fn the_corners_of_the_box_get_the_first_and_last_code() {
        for (min, max) in [
            ([-1.0, 2.0, -3.0], [4.0, 2.5, 1e3]),
            ([1e30, -1e30, 0.0], [1.1e30, 1e30, f32::MIN_POSITIVE]),
            ([1000.0, 1000.0, 1000.0], [1000.0001, 1000.0002, 1000.0003]),
        ] {
            let grid = grid(min, max);
            assert_eq!(grid.code(min.into()), U16Vec3::ZERO);
            let last = grid.code(max.into());
            for axis in 0..3 {
                assert!(last[axis] == u16::MAX || grid.scale[axis] == f32::MIN_POSITIVE, "{min:?} {max:?}");
            }
        }
    }

    #[test]
    fn an_axis_without_extent_is_exact() {
        let grid = grid([1.0, 7.5, 3.0], [2.0, 7.5, 4.0]);
        let p = Vec3::new(1.5, 7.5, 3.25);
        assert_eq!(grid.position(grid.code(p)).y, 7.5);
        assert!(grid.scale.is_finite() && grid.scale.min_element() > 0.0);
    }

    #[test]
    fn a_vertex_moves_at_most_half_a_step_and_a_rounding() {
        let grid = grid([-8.0, -8.0, -8.0], [8.0, 4.0, 2.0]);
        for i in 0..1000u32 {
            let t = |k: u32| (i.wrapping_mul(k) % 1009) as f32 / 1009.0;
            let p = Vec3::new(-8.0 + 16.0 * t(7), -8.0 + 12.0 * t(13), -8.0 + 10.0 * t(29));
            let error = (grid.position(grid.code(p)) - p).abs();
            assert!((error - grid.scale * 0.5).max_element() < 1e-6, "{p} {error}");
        }
    }

    #[test]
    fn only_triangles_that_had_an_area_can_lose_it() {
        let grid = grid([0.0; 3], [65535.0; 3]);
        let tiny = [Vec3::new(10.1, 10.0, 10.0), Vec3::new(10.2, 10.0, 10.0), Vec3::new(10.1, 10.2, 10.0)];
        let line = [Vec3::ZERO, Vec3::ONE, Vec3::splat(2.0)];
        let large = [Vec3::ZERO, Vec3::X * 9.0, Vec3::Y * 9.0];
        let loss = grid.loss([tiny, line, large].into_iter());
        assert_eq!(loss.collapsed, 1);
        assert!((loss.worst - (0.2f32).hypot(0.0)).abs() < 0.03, "{}", loss.worst);
    }
}
