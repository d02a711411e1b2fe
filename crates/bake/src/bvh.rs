//! Builds the hierarchy for picking and visibility, and puts the faces of every chunk in its leaf order, so
//! that primitive i of the hierarchy is face i of the file.

use super::chunk::cut;
use glam::Vec3A;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::cwbvh::node::CwBvhNode;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance};
use std::collections::VecDeque;
use trisplat_scene::parallel;
use trisplat_scene::{
    Asset, Chunk, Error, Result, Rng,
    bvh::{Bvh, Child, child},
    mesh::Mesh,
    report::{Outcome, StageDetails},
};

/// Whether a hierarchy is built.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BvhOptions {
    /// Also write a bounding volume hierarchy beside the output, for picking and visibility
    pub bvh: bool,
}

impl BvhOptions {
    /// No hierarchy, and no cost.
    pub const DEFAULT: Self = Self { bvh: false };
}

impl Default for BvhOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// The size of the hierarchy.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
pub struct BvhDetails {
    /// Nodes of the hierarchy, each with up to eight children.
    pub nodes: u64,
    /// Size of the nodes in bytes.
    pub bytes: u64,
}

impl StageDetails for BvhDetails {
    const STAGE: &'static str = "bvh";
}

/// Sets `asset.bvh` and puts the faces in its leaf order, each within its chunk. A scene in one chunk is
/// built in parts as well, which gives better trees in less time and memory than one build.
///
/// Errors: a position that is not finite.
pub fn bvh(asset: &mut Asset, options: &BvhOptions, details: &mut BvhDetails) -> Result<Outcome<()>> {
    if !options.bvh {
        return Ok(Outcome::Skipped("it was not asked for (`bvh`)"));
    }
    if asset.bvh.is_some() {
        return Ok(Outcome::Skipped("the scene has a hierarchy already"));
    }
    let faces = asset.scene_faces();
    if faces == 0 {
        return Ok(Outcome::Skipped("there are no faces"));
    }
    if let Some(v) = asset.mesh.positions.iter().position(|p| !p.is_finite()) {
        return Err(Error::invalid(
            format!("position {v}"),
            asset.mesh.positions[v],
            "finite numbers (prune first)",
        ));
    }
    if asset.chunks.is_empty() {
        asset.chunks = vec![Chunk { first: 0, count: asset.mesh.face_count() as u32 }];
    }
    // Rays should hit the scene, not the sphere behind it.
    let behind: Vec<Chunk> = asset.chunks.extract_if(.., |chunk| chunk.first as usize >= faces).collect();
    let rest = faces as u32..asset.mesh.face_count() as u32;
    let chunked = asset.chunks.len() > 1;
    let parts = if chunked {
        asset.chunks.clone()
    } else {
        let (mut order, parts) = cut(&asset.mesh, faces, PART_TRIANGLES);
        if parts.len() > 1 {
            order.extend(rest.clone());
            asset.mesh.select(&order);
        }
        parts
    };
    let Built { mut bvh, mut order, parts } = build(&asset.mesh, &parts);
    order.extend(rest);
    asset.mesh.select(&order);
    if chunked {
        asset.chunks = parts;
    } else {
        bvh.roots = vec![0; asset.chunks.len()];
    }
    asset.chunks.extend(behind);
    details.nodes = bvh.nodes.len() as u64;
    details.bytes = (bvh.nodes.len() * size_of::<CwBvhNode>()) as u64;
    asset.bvh = Some(bvh);
    Ok(Outcome::Changed(()))
}

/// Faces in a part when the scene has no chunks: a part and its build fit the cache of a core.
const PART_TRIANGLES: usize = 16_384;

/// A hierarchy and its faces.
pub(crate) struct Built {
    /// Its `roots` are those of `parts`.
    pub bvh: Bvh,
    /// The order of the faces that it refers to. `[F]`
    pub order: Vec<u32>,
    /// The parts in that order.
    pub parts: Vec<Chunk>,
}

/// The hierarchy over consecutive `parts` of the faces.
///
/// obvhs groups the faces, first within each part and then the parts; the boxes are computed here (`fit`).
pub(crate) fn build(mesh: &Mesh, parts: &[Chunk]) -> Built {
    let over_part = |_, part: &Chunk| {
        let boxes: Vec<Aabb> =
            (part.first..part.first + part.count).map(|f| face_box(mesh, f as usize)).collect();
        PartTree::over(&boxes, PART_BUILD)
    };
    let trees: Vec<PartTree> = parallel::map(parts, over_part);
    let top = PartTree::over(&trees.iter().map(|tree| tree.bounds).collect::<Vec<_>>(), TOP_BUILD);
    let mut built = Built { bvh: Bvh::default(), order: Vec::new(), parts: Vec::new() };
    let mut leaves = Vec::with_capacity(trees.len());
    for &i in &top.order {
        let (tree, part) = (&trees[i as usize], parts[i as usize]);
        let first = built.order.len() as u32;
        built.order.extend(tree.order.iter().map(|&face| part.first + face));
        built.parts.push(Chunk { first, count: part.count });
        leaves.push((tree, first));
    }
    let (nodes, roots) = join(&top, &leaves);
    built.bvh = Bvh { nodes, roots, face_count: built.order.len() as u32 };
    built
}

/// How parts are built: obvhs' `very_fast_build`, half the time of its next better tree (commit 1af8e42c).
const PART_BUILD: BvhBuildParams = BvhBuildParams::very_fast_build();
/// How the parts are joined: there are few, and every ray passes through them.
const TOP_BUILD: BvhBuildParams = BvhBuildParams {
    ploc_search_distance: PlocSearchDistance::VeryHigh,
    reinsertion_batch_ratio: 1.0,
    max_prims_per_leaf: 1,
    ..BvhBuildParams::very_fast_build()
};

fn face_box(mesh: &Mesh, face: usize) -> Aabb {
    let [a, b, c] = mesh.corners(face).map(Vec3A::from);
    Aabb::new(a.min(b).min(c), a.max(b).max(c))
}

/// A tree over some boxes.
struct PartTree {
    nodes: Vec<CwBvhNode>,
    /// The box of each primitive of the tree. `[boxes]`
    order: Vec<u32>,
    bounds: Aabb,
}

impl PartTree {
    /// Builds the tree: topology by obvhs on boxes moved to the unit cube, boxes by [`fit`].
    fn over(boxes: &[Aabb], params: BvhBuildParams) -> Self {
        let unit = to_unit_cube(boxes);
        let indices = (0..boxes.len() as u32).collect();
        let mut binary = PlocBuilder::new().build(
            params.ploc_search_distance,
            &unit,
            indices,
            params.sort_precision,
            params.search_depth_threshold,
        );
        ReinsertionOptimizer::default().run(&mut binary, params.reinsertion_batch_ratio, None);
        let wide = bvh2_to_cwbvh(&binary, params.max_prims_per_leaf.clamp(1, 3), true, false);
        let (mut nodes, order) = (wide.nodes, wide.primitive_indices);
        nodes.shrink_to_fit(); // obvhs allocates one node per face, six times more than it fills
        let bounds = fit(&mut nodes, |primitive| boxes[order[primitive as usize] as usize]);
        Self { nodes, order, bounds }
    }
}

/// The boxes in a cube of side 1, each enlarged by a small amount that differs from box to box.
///
/// In the cube no area over- or underflows at any scale of the scene. The enlargement, a thousandth of the
/// box, breaks ties. Among equal boxes obvhs would join one pair per pass, in quadratic time, into a tree as
/// deep as the number of boxes.
fn to_unit_cube(boxes: &[Aabb]) -> Vec<Aabb> {
    let all = boxes.iter().fold(Aabb::empty(), |all, b| all.union(b));
    let (origin, size) = (all.min.as_dvec3(), (all.max.as_dvec3() - all.min.as_dvec3()).max_element());
    let scale = if size > 0.0 { 1.0 / size } else { 0.0 };
    let place = |v: Vec3A| ((v.as_dvec3() - origin) * scale).as_vec3a();
    let rng = Rng::new(0, "bvh ties", 0);
    let grown = |(i, b): (usize, &Aabb)| {
        let (min, max, bits) = (place(b.min), place(b.max), rng.bits(i as u64));
        let most = 1e-3 * (max - min).max_element() + 1e-6;
        let by = |shift: u32| most * (1.0 / 1024.0) * ((bits >> shift) & 0x3ff) as f32;
        Aabb::new(min - Vec3A::new(by(0), by(10), by(20)), max + Vec3A::new(by(30), by(40), by(50)))
    };
    boxes.iter().enumerate().map(grown).collect()
}

/// Computes the boxes of all nodes from those of the primitives, bottom-up; returns the box of everything.
///
/// Grid lines are rounded outwards in f64, so rounding leaves nothing out.
fn fit(nodes: &mut [CwBvhNode], primitive_box: impl Fn(u32) -> Aabb) -> Aabb {
    let mut bounds = vec![Aabb::empty(); nodes.len()];
    for index in (0..nodes.len()).rev() {
        let children: [Aabb; 8] = std::array::from_fn(|slot| match child(&nodes[index], slot) {
            Ok(Child::Node(below)) => bounds[below as usize],
            Ok(Child::Faces(range)) => range.fold(Aabb::empty(), |all, p| all.union(&primitive_box(p))),
            Ok(Child::Empty) | Err(_) => Aabb::empty(),
        });
        bounds[index] = children.iter().fold(Aabb::empty(), |all, b| all.union(b));
        quantise(&mut nodes[index], &bounds[index], &children);
    }
    bounds.first().copied().unwrap_or(Aabb::empty())
}

/// Writes a node's grid and the children's boxes on it.
fn quantise(node: &mut CwBvhNode, all: &Aabb, children: &[Aabb; 8]) {
    node.p = all.min.into();
    for axis in 0..3 {
        let origin = f64::from(all.min[axis]);
        let (exponent, step) = grid_step(f64::from(all.max[axis]) - origin);
        node.e[axis] = exponent;
        for (slot, b) in children.iter().enumerate() {
            let (min, max) = if b.valid() {
                let lower = (f64::from(b.min[axis]) - origin) / step;
                let upper = (f64::from(b.max[axis]) - origin) / step;
                (lower as u8, (upper as u8).saturating_add(u8::from(upper > f64::from(upper as u8))))
            } else {
                (0, 0)
            };
            let (lower, upper) = match axis {
                0 => (&mut node.child_min_x, &mut node.child_max_x),
                1 => (&mut node.child_min_y, &mut node.child_max_y),
                _ => (&mut node.child_min_z, &mut node.child_max_z),
            };
            (lower[slot], upper[slot]) = (min, max);
        }
    }
}

/// The smallest power of two that reaches `extent` in 255 steps: as the exponent bits of an f32, and as a
/// number.
fn grid_step(extent: f64) -> (u8, f64) {
    let bits = (extent / 255.0).to_bits();
    let rounded_up = (bits >> 52) + u64::from(bits & ((1 << 52) - 1) != 0);
    let exponent = (rounded_up as i64 - 1023 + 127).clamp(1, 254) as u8;
    (exponent, f64::from_bits((u64::from(exponent) + 1023 - 127) << 52))
}

/// Joins all trees: leaf i of `top` becomes the root of tree i of `leaves`, each given with its first face.
/// Returns the nodes and the places of the roots.
fn join(top: &PartTree, leaves: &[(&PartTree, u32)]) -> (Vec<CwBvhNode>, Vec<u32>) {
    let total = top.nodes.len() + leaves.iter().map(|(tree, _)| tree.nodes.len()).sum::<usize>();
    let mut nodes = Vec::with_capacity(total);
    let mut roots = vec![0; leaves.len()];
    let mut queue = VecDeque::new(); // (node of top, its place in nodes)
    if let [only] = leaves {
        nodes.push(CwBvhNode::default());
        graft(&mut nodes, 0, *only);
    } else if let Some(root) = top.nodes.first() {
        nodes.push(*root);
        queue.push_back((0, 0));
    }
    while let Some((from, to)) = queue.pop_front() {
        let mut node: CwBvhNode = top.nodes[from];
        let children: Vec<(usize, Child)> = (0..8)
            .filter_map(|slot| child(&node, slot).ok().map(|c| (slot, c)))
            .filter(|(_, c)| *c != Child::Empty)
            .collect();
        let block = nodes.len();
        nodes.resize(block + children.len(), CwBvhNode::default());
        (node.child_base_idx, node.primitive_base_idx) = (block as u32, 0);
        for (place, (slot, child)) in (block..).zip(children) {
            node.imask |= 1 << slot;
            node.child_meta[slot] = 0b0010_0000 | (24 + slot as u8);
            match child {
                Child::Empty => {}
                Child::Node(below) => queue.push_back((below as usize, place)),
                Child::Faces(leaf) => {
                    roots[leaf.start as usize] = place as u32;
                    graft(&mut nodes, place, leaves[leaf.start as usize]);
                }
            }
        }
        nodes[to] = node;
    }
    (nodes, roots)
}

/// Puts the root of `tree` at `place` and its other nodes at the end.
fn graft(nodes: &mut Vec<CwBvhNode>, place: usize, (tree, first_face): (&PartTree, u32)) {
    let shift = nodes.len() as u32 - 1; // node 1 of the tree goes to the end
    let mut moved = tree.nodes.iter().map(|node| CwBvhNode {
        child_base_idx: node.child_base_idx + shift,
        primitive_base_idx: node.primitive_base_idx + first_face,
        ..*node
    });
    if let Some(root) = moved.next() {
        nodes[place] = root;
    }
    nodes.extend(moved);
}
