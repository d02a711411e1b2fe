//! The bounding volume hierarchy over an asset's faces: an eight-wide tree of 80-byte nodes (Ylitie,
//! Karras, Laine 2017), built by obvhs. Primitive i is face i of the mesh.

use glam::Vec3;
use obvhs::cwbvh::node::CwBvhNode;

/// A hierarchy over the faces of one mesh; primitive i is face i.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Bvh {
    /// Node 0 is the root.
    pub nodes: Vec<CwBvhNode>,
    /// For every run of faces (chunk) the node that holds it and nothing else.
    pub roots: Vec<u32>,
    /// Faces it was built for.
    pub face_count: u32,
}

/// Where a ray meets a face first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// The face.
    pub face: u32,
    /// Distance along the ray in lengths of its direction.
    pub t: f32,
    /// The point, world units.
    pub point: Vec3,
}
