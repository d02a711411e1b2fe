//! Cuts of faces into compact runs.

use glam::{Vec3, Vec3A, Vec4};
use trisplat_scene::Chunk;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel::{self, GRAIN};

/// Cuts the first `faces` into runs of at most `limit`. Returns the order of faces and the runs in
/// that order; within a run, faces keep their order.
///
/// Top-down, each time at the plane (or size) where the two sides cost least:
///
/// ```text
/// cost = area(left) * chunks(left) + area(right) * chunks(right),   chunks(n) = ceil(n / limit)
/// ```
///
/// that is the surface area heuristic (MacDonald and Booth 1990), counting whole chunks, because an
/// engine draws or culls these. A cut along the fourth axis, size, separates triangles that are
/// large for their neighbourhood, so that the rest is compact.
pub(crate) fn cut(mesh: &Mesh, faces: usize, limit: usize) -> (Vec<u32>, Vec<Chunk>) {
    let parts = if faces > TREE_SAMPLE {
        CutTree::new(mesh, faces, limit).parts(mesh, faces)
    } else {
        vec![(0..faces as u32).collect()]
    };
    // Parts that fit are chunks; the tree knows counts only by its sample.
    let parts = parallel::map(parts, |_, part: Vec<u32>| {
        if part.len() <= limit {
            (vec![part.len() as u32], part)
        } else {
            let mut items: Vec<FaceItem> =
                parallel::collect(part.len(), GRAIN, |i| FaceItem::new(mesh, part[i]));
            let counts = split(&mut items, limit);
            (counts, items.iter().map(|item| item.face).collect())
        }
    });
    let mut chunks = Vec::new();
    let mut first = 0;
    for count in parts.iter().flat_map(|(counts, _)| counts) {
        chunks.push(Chunk { first, count: *count });
        first += count;
    }
    (parts.into_iter().flat_map(|(_, part)| part).collect(), chunks)
}

/// Cuts chosen by a sample of the faces, for scenes of more faces than that: then each face is
/// looked at once, not once per level.
struct CutTree {
    nodes: Vec<CutNode>,
    depth: usize,
    parts: usize,
}

/// A cut and its sides, or a part, whose sides are itself.
#[derive(Clone, Copy)]
struct CutNode {
    cut: Cut,
    /// Nodes to the left and right.
    sides: [u32; 2],
    /// Number of the part.
    part: u32,
}

/// Faces that the tree is chosen by, evenly picked.
const TREE_SAMPLE: usize = 1 << 17;
/// By the sample a part holds at most this share of a chunk, so that hardly any turns out too
/// large.
const TREE_FILL: f64 = 0.95;
/// Number of items that descend the tree at once.
const DESCENTS: usize = 8;

impl CutTree {
    fn new(mesh: &Mesh, faces: usize, limit: usize) -> Self {
        let step = faces.div_ceil(TREE_SAMPLE);
        let mut sample = parallel::collect(faces.div_ceil(step), GRAIN, |i| {
            FaceItem::new(mesh, (i * step) as u32)
        });
        let mut tree = Self { nodes: Vec::new(), depth: 0, parts: 0 };
        let filled = ((TREE_FILL * limit as f64) as usize).max(1);
        tree.grow(&mut sample, step, filled, 0);
        tree
    }

    /// Adds the nodes of a sample; returns the first one's number. Each item stands for `weight`
    /// faces.
    fn grow(&mut self, sample: &mut [FaceItem], weight: usize, limit: usize, depth: usize) -> u32 {
        let at = self.nodes.len() as u32;
        self.depth = self.depth.max(depth);
        self.nodes.push(CutNode { cut: Cut::NONE, sides: [at; 2], part: self.parts as u32 });
        let fits = sample.len() * weight <= limit;
        let Some(cut) = (!fits).then(|| best_cut(sample, weight, limit)).flatten() else {
            self.parts += 1;
            return at;
        };
        let middle = partition(sample, |item| cut.is_left(item.place().to_array()));
        let (left, right) = sample.split_at_mut(middle);
        let sides = [left, right].map(|side| self.grow(side, weight, limit, depth + 1));
        self.nodes[at as usize] = CutNode { cut, sides, part: 0 };
        at
    }

    /// The parts that items at these places are in. Every item takes as many steps, several at
    /// once: a single one would wait for the memory and the comparison of each.
    fn parts_of(&self, places: [[f32; 4]; DESCENTS]) -> [u32; DESCENTS] {
        let mut at = [0; DESCENTS];
        for _ in 0..self.depth {
            for (at, place) in at.iter_mut().zip(&places) {
                let node = &self.nodes[*at as usize];
                *at = node.sides[usize::from(!node.cut.is_left(*place))];
            }
        }
        at.map(|at| self.nodes[at as usize].part)
    }

    /// The faces of every part that has any, in their order.
    fn parts(&self, mesh: &Mesh, faces: usize) -> Vec<Vec<u32>> {
        let place =
            |face: usize| FaceItem::new(mesh, face.min(faces - 1) as u32).place().to_array();
        let of = parallel::collect(faces.div_ceil(DESCENTS), GRAIN / DESCENTS, |block| {
            self.parts_of(std::array::from_fn(|i| place(block * DESCENTS + i)))
        });
        let mut parts = vec![Vec::new(); self.parts];
        for (face, part) in (0..faces as u32).zip(of.as_flattened()) {
            parts[*part as usize].push(face);
        }
        parts.retain(|part| !part.is_empty());
        parts
    }
}

/// A face reduced to its box and size.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(16))]
struct FaceItem {
    min: Vec3,
    face: u32,
    max: Vec3,
    /// Longest side of the box as the bits of an f32: monotone, and about logarithmic.
    level: f32,
}

impl FaceItem {
    fn new(mesh: &Mesh, face: u32) -> Self {
        let [a, b, c] = mesh.corners(face as usize);
        let min = a.min(b).min(c);
        let max = a.max(b).max(c);
        let level = (max - min).max_element().to_bits() as f32;
        Self { min, face, max, level }
    }

    /// Its place on the axes x, y, z and size.
    fn place(&self) -> Vec4 {
        (0.5 * self.min + 0.5 * self.max).extend(self.level)
    }
}

/// Candidate cuts on each axis are the borders between this many bins.
const BINS: usize = 32;
/// A cut is chosen by about this many of the items, evenly picked; more do not make chunks better.
const SAMPLE: usize = 1 << 14;

/// Sorts the items into parts; returns the number of items in each part, in order.
fn split(items: &mut [FaceItem], limit: usize) -> Vec<u32> {
    if items.len() <= limit {
        items.sort_unstable_by_key(|item| item.face);
        return vec![items.len() as u32];
    }
    let middle = best_cut(items, 1, limit)
        .map_or(0, |cut| partition(items, |item| cut.is_left(item.place().to_array())));
    // No cut separates them (all in one place): cut off whole chunks.
    let middle = if middle == 0 { items.len().div_ceil(limit) / 2 * limit } else { middle };
    let (left, right) = items.split_at_mut(middle);
    let (mut counts, more) = rayon::join(|| split(left, limit), || split(right, limit));
    counts.extend(more);
    counts
}

/// Moves the items for which `is_left` to the front; returns how many.
fn partition(items: &mut [FaceItem], is_left: impl Fn(&FaceItem) -> bool) -> usize {
    let mut middle = 0;
    for i in 0..items.len() {
        if is_left(&items[i]) {
            items.swap(i, middle);
            middle += 1;
        }
    }
    middle
}

/// The bins of all four axes between the least and the largest place.
#[derive(Debug, Clone, Copy)]
struct BinGrid {
    origin: Vec4,
    scale: Vec4,
}

impl BinGrid {
    fn around<'a>(items: impl Iterator<Item = &'a FaceItem>) -> Self {
        let none = (Vec4::INFINITY, Vec4::NEG_INFINITY);
        let (lo, hi) = items.map(FaceItem::place).fold(none, |(lo, hi), p| (lo.min(p), hi.max(p)));
        Self { origin: lo, scale: BINS as f32 / (hi - lo) }
    }

    /// The bin of a place on an axis. An axis without extent has one bin.
    fn bin(&self, place: Vec4, axis: usize) -> usize {
        // An infinite or NaN product saturates to a bin, so this cannot fail.
        (((place[axis] - self.origin[axis]) * self.scale[axis]) as u8 as usize).min(BINS - 1)
    }
}

/// A cut on an axis: items before the end of a bin are on the left.
#[derive(Debug, Clone, Copy)]
struct Cut {
    axis: usize,
    origin: f32,
    scale: f32,
    /// Index of the bin plus one.
    end: f32,
}

impl Cut {
    /// Placeholder of a part, which is not cut.
    const NONE: Self = Self { axis: 0, origin: 0.0, scale: 0.0, end: 0.0 };

    /// After this bin of a grid, which is not its last.
    fn after(bin: usize, axis: usize, grid: &BinGrid) -> Self {
        Self { axis, origin: grid.origin[axis], scale: grid.scale[axis], end: (bin + 1) as f32 }
    }

    /// True if a place is in the bin or one before; NaN is in the first.
    fn is_left(&self, place: [f32; 4]) -> bool {
        let bins = (place[self.axis] - self.origin) * self.scale;
        bins < self.end || bins.is_nan()
    }
}

/// The contents of one or more bins.
#[derive(Debug, Clone, Copy)]
struct BinBox {
    min: Vec3A,
    max: Vec3A,
    count: usize,
}

impl BinBox {
    const EMPTY: Self = Self { min: Vec3A::INFINITY, max: Vec3A::NEG_INFINITY, count: 0 };

    fn union(self, other: Self) -> Self {
        Self {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
            count: self.count + other.count,
        }
    }

    /// Area of the box times chunks in it.
    fn cost(&self, limit: usize) -> f64 {
        let d = (self.max - self.min).as_dvec3();
        (d.x * d.y + d.y * d.z + d.z * d.x) * self.count.div_ceil(limit) as f64
    }
}

/// The cheapest cut with something on both sides, if there is one; each item stands for `weight`
/// faces.
fn best_cut(items: &[FaceItem], weight: usize, limit: usize) -> Option<Cut> {
    let step = items.len().div_ceil(SAMPLE);
    let grid = BinGrid::around(items.iter().step_by(step));
    let bins = fill(items.iter().step_by(step), weight * step, &grid);
    let few = (limit / 4).max(1);
    let mut best = (true, f64::INFINITY, usize::MAX);
    let mut cut = None;
    for (axis, bins) in bins.iter().enumerate() {
        let mut from_right = [BinBox::EMPTY; BINS];
        let mut right = BinBox::EMPTY;
        for bin in (1..BINS).rev() {
            right = right.union(bins[bin]);
            from_right[bin] = right;
        }
        let mut left = BinBox::EMPTY;
        for bin in 0..BINS - 1 {
            left = left.union(bins[bin]);
            let right = from_right[bin + 1];
            // Every chunk costs an engine a draw, so slices come last. Boxes without area all cost
            // nothing, so ties go to the most even cut.
            let slice = left.count.min(right.count) < few;
            let cost =
                (slice, left.cost(limit) + right.cost(limit), left.count.abs_diff(right.count));
            if left.count > 0 && right.count > 0 && cost < best {
                best = cost;
                cut = Some(Cut::after(bin, axis, &grid));
            }
        }
    }
    cut
}

/// The bins of all axes, each item standing for `weight` of them.
fn fill<'a>(
    items: impl Iterator<Item = &'a FaceItem>,
    weight: usize,
    grid: &BinGrid,
) -> [[BinBox; BINS]; 4] {
    let mut bins = [[BinBox::EMPTY; BINS]; 4];
    for item in items {
        let one = BinBox { min: item.min.into(), max: item.max.into(), count: weight };
        let place = item.place();
        for (axis, bins) in bins.iter_mut().enumerate() {
            let bin = &mut bins[grid.bin(place, axis)];
            *bin = bin.union(one);
        }
    }
    bins
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::Rng;
    use trisplat_scene::mesh::Colors;

    /// Triangles of many sizes, denser in the middle.
    fn scene(count: usize) -> Mesh {
        let rng = Rng::new(4, "cut", 0);
        let at = |i: usize, k: usize| rng.uniform((i * 8 + k) as u64) - 0.5;
        let triangle = |i: usize| {
            let middle = Vec3::new(at(i, 0), at(i, 1), at(i, 2)).map(|x| 8.0 * x * x * x);
            let size = (8.0 * at(i, 3)).exp2() * 0.01;
            [0, 1, 2].map(|k| middle + size * Vec3::new(at(i, 4 + k), at(i, 5 + k), at(i, 4)))
        };
        let positions = (0..count).flat_map(triangle).collect();
        Mesh { positions, colors: Colors::Face(vec![[0.5; 3]; count]), ..Mesh::default() }
    }

    /// Area of all boxes times the faces in them.
    fn cost(mesh: &Mesh, order: &[u32], chunks: &[Chunk]) -> f64 {
        let of = |chunk: &Chunk| {
            let faces = &order[chunk.first as usize..][..chunk.count as usize];
            let items = faces.iter().map(|face| FaceItem::new(mesh, *face));
            let one =
                |item: FaceItem| BinBox { min: item.min.into(), max: item.max.into(), count: 1 };
            items.map(one).fold(BinBox::EMPTY, BinBox::union).cost(1)
        };
        chunks.iter().map(of).sum()
    }

    #[test]
    fn chunk_tree_of_a_sample_cuts_as_well_as_of_all_faces() {
        let faces = TREE_SAMPLE + 30_001;
        let mesh = scene(faces);
        let limit = 4000;
        let (order, chunks) = cut(&mesh, faces, limit);
        let mut every = order.clone();
        every.sort_unstable();
        assert!(every.iter().copied().eq(0..faces as u32), "every face once");
        assert!(chunks.iter().all(|chunk| (1..=limit as u32).contains(&chunk.count)));
        for chunk in &chunks {
            assert!(
                order[chunk.first as usize..][..chunk.count as usize].is_sorted(),
                "faces keep their order"
            );
        }
        let mut items: Vec<FaceItem> =
            (0..faces as u32).map(|face| FaceItem::new(&mesh, face)).collect();
        let counts = split(&mut items, limit);
        let starts = counts.iter().scan(0, |first, count| {
            *first += count;
            Some(Chunk { first: *first - count, count: *count })
        });
        let exact: Vec<u32> = items.iter().map(|item| item.face).collect();
        let by_sample = cost(&mesh, &order, &chunks);
        let by_all = cost(&mesh, &exact, &starts.collect::<Vec<_>>());
        assert!(by_sample < 1.1 * by_all, "{by_sample} and {by_all}");
        assert!(
            chunks.len() * 10 < counts.len() * 12,
            "{} and {} chunks",
            chunks.len(),
            counts.len()
        );
    }

    #[test]
    fn every_face_of_a_large_scene_may_be_a_chunk() {
        let faces = TREE_SAMPLE + 1;
        let (order, chunks) = cut(&scene(faces), faces, 1);
        assert!(
            order.len() == faces
                && chunks.len() == faces
                && chunks.iter().all(|chunk| chunk.count == 1)
        );
    }
}
