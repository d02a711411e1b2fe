//! What a backdrop and a sky have in common.

/// Below this covered share of a picture, or unmasked share of a photo, the scene is an object without
/// background.
pub(super) const LEAST_COVERED: f64 = 0.8;
/// Radius of the sphere as a multiple of the distance of the farthest vertex or camera.
pub(super) const RADIUS_FACTOR: f32 = 1.2;
/// Most subdivisions of the octahedron: 8 · 4⁴ triangles.
pub(super) const MOST_SUBDIVISIONS: u32 = 4;
