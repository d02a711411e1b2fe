//! The bounding volume hierarchy over an asset's faces: an eight-wide tree of 80-byte nodes (Ylitie,
//! Karras, Laine 2017, *Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs*).
//!
//! A node stores the boxes of its children in 8 bits per axis on its own grid. The arithmetic here is f64 on exact
//! f32 inputs, so boxes enclose their contents at any scale, from denormals to 1e38.

use crate::error::{Error, Result};
use crate::mesh::Mesh;
use glam::{DVec3, Vec3};
use obvhs::cwbvh::node::CwBvhNode;
use std::ops::Range;

/// A hierarchy over the faces of one mesh. Primitive i is face i, and the faces below any node are
/// consecutive.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Bvh {
    /// Node 0 is the root; children come after their parents. Empty for no faces.
    pub nodes: Vec<CwBvhNode>,
    /// For every chunk of the asset, the node with exactly its faces.
    pub roots: Vec<u32>,
    /// Number of faces.
    pub face_count: u32,
}

/// The hit of a ray on a face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayHit {
    /// The face.
    pub face: u32,
    /// Distance in lengths of the ray's direction, 0 or more.
    pub t: f64,
}

/// The content of a node's slot.
#[derive(Debug, Clone, PartialEq)]
pub enum Child {
    /// Nothing.
    Empty,
    /// Another node.
    Node(u32),
    /// One to three faces.
    Faces(Range<u32>),
}

/// The content of slot 0..8 of a node; an error when the node's bits are invalid.
pub fn child(node: &CwBvhNode, slot: usize) -> Result<Child> {
    let (meta, is_node) = (node.child_meta[slot], node.imask >> slot & 1 == 1);
    let broken = || {
        let bits = format!("{meta:#010b}, imask {:#010b}", node.imask);
        Error::invalid(format!("bvh child {slot}"), bits, "an empty slot, a node or one to three faces")
    };
    if is_node {
        if meta != 0b0010_0000 | (24 + slot as u8) {
            return Err(broken());
        }
        let before = (node.imask & ((1 << slot) - 1)).count_ones();
        return Ok(Child::Node(node.child_base_idx.checked_add(before).ok_or_else(broken)?));
    }
    let count = match meta >> 5 {
        0b000 if meta == 0 => return Ok(Child::Empty),
        0b001 => 1,
        0b011 => 2,
        0b111 => 3,
        _ => return Err(broken()),
    };
    let first = node.primitive_base_idx.checked_add(u32::from(meta & 0b11111)).ok_or_else(broken)?;
    Ok(Child::Faces(first..first.checked_add(count).ok_or_else(broken)?))
}

/// The grid step of a node on each axis, a power of two.
pub fn steps(node: &CwBvhNode) -> [f64; 3] {
    node.e.map(|e| f64::from_bits((u64::from(e) + 1023 - 127) << 52))
}

/// The lower and upper grid lines of the children's boxes on each axis. `[3]`[8]
fn grid_lines(node: &CwBvhNode) -> [(&[u8; 8], &[u8; 8]); 3] {
    [
        (&node.child_min_x, &node.child_max_x),
        (&node.child_min_y, &node.child_max_y),
        (&node.child_min_z, &node.child_max_z),
    ]
}

/// A ray prepared for intersection tests.
struct PreparedRay {
    origin: DVec3,
    direction: DVec3,
    /// 1 / direction, and huge where that would be infinite.
    inverse: [f64; 3],
}

impl PreparedRay {
    /// None when a number is not finite or the direction is zero.
    fn new(origin: Vec3, direction: Vec3) -> Option<Self> {
        if !origin.is_finite() || !direction.is_finite() || direction == Vec3::ZERO {
            return None;
        }
        let (origin, direction) = (origin.as_dvec3(), direction.as_dvec3());
        let inverse = direction.to_array().map(|d| if d == 0.0 { 1e150 } else { 1.0 / d });
        Some(Self { origin, direction, inverse })
    }

    /// Distances at which the ray enters the boxes of a node's eight slots; infinite for misses.
    fn intersect_boxes(&self, node: &CwBvhNode) -> [f64; 8] {
        let (mut near, mut far) = ([0.0f64; 8], [f64::INFINITY; 8]);
        let steps = steps(node);
        for (axis, (lower, upper)) in grid_lines(node).into_iter().enumerate() {
            let inverse = self.inverse[axis];
            let (first, last) = if inverse < 0.0 { (upper, lower) } else { (lower, upper) };
            let scale = steps[axis] * inverse;
            let offset = (f64::from(node.p[axis]) - self.origin[axis]) * inverse;
            // Far above the rounding of these sums, far below a grid step: no box is missed.
            let slack = 1e-12 * (offset.abs() + 255.0 * scale.abs());
            for slot in 0..8 {
                near[slot] = near[slot].max(f64::from(first[slot]) * scale + (offset - slack));
                far[slot] = far[slot].min(f64::from(last[slot]) * scale + (offset + slack));
            }
        }
        std::array::from_fn(|slot| if near[slot] <= far[slot] { near[slot] } else { f64::INFINITY })
    }

    /// Distance to a triangle seen from either side (Möller and Trumbore 1997), edges included.
    fn intersect(&self, corners: [Vec3; 3]) -> Option<f64> {
        let [a, b, c] = corners.map(|v| v.as_dvec3());
        let (ab, ac, from_a) = (b - a, c - a, self.origin - a);
        let normal = self.direction.cross(ac);
        let inverse = 1.0 / ab.dot(normal);
        let u = from_a.dot(normal) * inverse;
        let q = from_a.cross(ab);
        let v = self.direction.dot(q) * inverse;
        let t = ac.dot(q) * inverse;
        // Parallel rays have an infinite or NaN u, which fails here.
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= 0.0 && t.is_finite()).then_some(t)
    }
}

impl Bvh {
    /// The first face of `mesh` that the ray from `origin` along `direction` hits, from either side; ties go
    /// to the lowest number. `mesh` must be the one of the hierarchy.
    pub fn cast(&self, mesh: &Mesh, origin: Vec3, direction: Vec3) -> Option<RayHit> {
        let ray = PreparedRay::new(origin, direction)?;
        let mut best: Option<RayHit> = None;
        let mut stack = Vec::with_capacity(64);
        if !self.nodes.is_empty() {
            stack.push((0.0, 0));
        }
        while let Some((near, index)) = stack.pop() {
            if best.is_some_and(|hit| near > hit.t) {
                continue;
            }
            let node: &CwBvhNode = &self.nodes[index as usize];
            let bottom = stack.len();
            for (slot, near) in ray.intersect_boxes(node).into_iter().enumerate() {
                if near > best.map_or(f64::MAX, |hit| hit.t) {
                    continue;
                }
                match child(node, slot) {
                    Ok(Child::Node(index)) => stack.push((near, index)),
                    Ok(Child::Faces(faces)) => best = nearest(&ray, mesh, faces, best),
                    Ok(Child::Empty) | Err(_) => {}
                }
            }
            stack[bottom..].sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(b.1.cmp(&a.1)));
        }
        best
    }

    /// Checks the tree without its mesh: every node and every face is reached once, children come after their
    /// parents, faces below a node are consecutive. Readers call it, so it trusts no number and allocates in
    /// proportion to the nodes.
    pub fn validate(&self) -> Result<()> {
        let wrong = |what: String, value: String, wants: &str| Err(Error::invalid(what, value, wants));
        let faces = self.face_count as usize;
        if faces.div_ceil(24) > self.nodes.len() || (faces == 0 && !self.nodes.is_empty()) {
            let count = format!("{} for {faces} faces", self.nodes.len());
            return wrong("bvh node count".into(), count, "1 to 24 faces per node");
        }
        let ranges = self.face_ranges()?;
        if ranges.first().is_some_and(|all| *all != (0..self.face_count)) {
            return wrong("bvh root".into(), format!("{:?}", ranges[0]), "all faces");
        }
        match self.roots.iter().find(|&&root| root as usize >= self.nodes.len()) {
            Some(root) => wrong("bvh chunk root".into(), root.to_string(), "a node"),
            None => Ok(()),
        }
    }

    /// The faces below every node, after checking that nodes form a tree and faces are consecutive. `[nodes]`
    pub fn face_ranges(&self) -> Result<Vec<Range<u32>>> {
        let at = |node: usize, e: Error| Error::invalid(format!("bvh node {node}"), e, "a valid tree");
        let wrong = |node: usize, value: String, wants: &str| {
            Err(Error::invalid(format!("bvh node {node}"), value, wants))
        };
        let mut ranges: Vec<Range<u32>> = vec![0..0; self.nodes.len()];
        let mut has_parent = vec![false; self.nodes.len()];
        for (index, node) in self.nodes.iter().enumerate().rev() {
            if !node.p.is_finite() || node.e.contains(&255) {
                return wrong(index, format!("at {}, exponents {:?}", node.p, node.e), "finite numbers");
            }
            let mut parts = Vec::with_capacity(8);
            for slot in 0..8 {
                match child(node, slot).map_err(|e| at(index, e))? {
                    Child::Empty => {}
                    Child::Faces(faces) => parts.push(faces),
                    Child::Node(below) => {
                        let below = below as usize;
                        if below <= index || below >= self.nodes.len() || has_parent[below] {
                            return wrong(index, format!("child {below}"), "a later node without a parent");
                        }
                        has_parent[below] = true;
                        parts.push(ranges[below].clone());
                    }
                }
            }
            parts.sort_unstable_by_key(|part| part.start);
            let (Some(first), Some(last)) = (parts.first(), parts.last()) else {
                return wrong(index, "empty".into(), "at least one child");
            };
            ranges[index] = first.start..last.end;
            if parts.windows(2).any(|two| two[0].end != two[1].start) {
                return wrong(index, format!("faces {parts:?}"), "consecutive faces, each once");
            }
        }
        match has_parent.iter().skip(1).position(|has| !has) {
            Some(orphan) => wrong(orphan + 1, "not below the root".into(), "a parent"),
            None => Ok(ranges),
        }
    }

    /// Checks the tree against its mesh: every face lies in the box of every slot above it.
    pub fn validate_with(&self, mesh: &Mesh) -> Result<()> {
        self.validate()?;
        if self.face_count as usize != mesh.face_count() {
            let wants = format!("{}, the faces of the mesh", mesh.face_count());
            return Err(Error::invalid("bvh face count", self.face_count, wants));
        }
        let ranges = self.face_ranges()?;
        for (index, node) in self.nodes.iter().enumerate() {
            for slot in 0..8 {
                let faces = match child(node, slot)? {
                    Child::Empty => 0..0,
                    Child::Faces(faces) => faces,
                    Child::Node(below) => ranges[below as usize].clone(),
                };
                let (min, max) = slot_box(node, slot);
                // f64 rounds a corner that is tiny relative to the node; `cast` allows for ten times that.
                let slack = 1e-13 * 255.0 * DVec3::from(steps(node));
                let inside = |v: Vec3| {
                    let v = v.as_dvec3();
                    v.cmpge(min - slack).all() && v.cmple(max + slack).all()
                };
                if let Some(face) =
                    faces.into_iter().find(|&f| !mesh.corners(f as usize).map(inside).iter().all(|&i| i))
                {
                    let corners = format!("{:?}", mesh.corners(face as usize));
                    let wants = format!("corners in the box of node {index} slot {slot}, {min} to {max}");
                    return Err(Error::invalid(format!("face {face}"), corners, wants));
                }
            }
        }
        Ok(())
    }
}

/// The box of a slot.
fn slot_box(node: &CwBvhNode, slot: usize) -> (DVec3, DVec3) {
    let (p, steps) = (node.p.as_dvec3(), DVec3::from(steps(node)));
    let [x, y, z] = grid_lines(node);
    let line = |x: u8, y: u8, z: u8| p + steps * DVec3::new(x.into(), y.into(), z.into());
    (line(x.0[slot], y.0[slot], z.0[slot]), line(x.1[slot], y.1[slot], z.1[slot]))
}

/// The nearer of `best` and the ray's hits among `faces`.
fn nearest(ray: &PreparedRay, mesh: &Mesh, faces: Range<u32>, mut best: Option<RayHit>) -> Option<RayHit> {
    for face in faces {
        if let Some(t) = ray.intersect(mesh.corners(face as usize))
            && best.is_none_or(|hit| t < hit.t || (t == hit.t && face < hit.face))
        {
            best = Some(RayHit { face, t });
        }
    }
    best
}
