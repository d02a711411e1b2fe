//! Cuts the faces into compact runs, each its own mesh and node, so that engines can cull them. Cuts minimise
//! surface area times chunks.

use glam::{Vec3, Vec3A, Vec4};
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::{
    Asset, Chunk, Error, Result,
    mesh::Mesh,
    report::{Outcome, StageDetails},
};

/// Most faces of a chunk: 65,535 vertices when no corner is shared, the most that 16-bit indices can address
/// (65,535 itself restarts a primitive).
pub const MAX_CHUNK_TRIANGLES: u32 = 21_845;

/// How the scene is cut into nodes.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ChunkOptions {
    /// Most triangles in a chunk, at most 21845; each chunk is a mesh and node of its own, skipped when
    /// out of view (0 = one chunk)
    #[schemars(range(max = 21_845))]
    pub chunk_triangles: u32,
}

impl ChunkOptions {
    /// Small enough to be skipped often, large enough that a scene has hundreds of draws, not thousands.
    pub const DEFAULT: Self = Self { chunk_triangles: 16_384 };
    /// One chunk.
    pub const FAST: Self = Self { chunk_triangles: 0 };
}

impl Default for ChunkOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// How the scene was cut.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
pub struct ChunkDetails {
    /// Number of chunks.
    pub chunks: u64,
    /// Triangles per chunk on average, rounded down.
    pub mean_triangles: u64,
}

impl StageDetails for ChunkDetails {
    const STAGE: &'static str = "chunk";
}

/// Sets `asset.chunks` and puts the faces in their order. A scene of one chunk is left unchanged. A backdrop
/// becomes the last chunk, because its box surrounds everything and could never be culled.
///
/// Errors: `chunk_triangles` above [`MAX_CHUNK_TRIANGLES`].
pub fn chunk(asset: &mut Asset, options: &ChunkOptions, details: &mut ChunkDetails) -> Result<Outcome<()>> {
    if options.chunk_triangles > MAX_CHUNK_TRIANGLES {
        let wants = format!("at most {MAX_CHUNK_TRIANGLES}, the most that 16-bit indices reach");
        return Err(Error::invalid("chunk_triangles", options.chunk_triangles, wants));
    }
    let (faces, limit) = (asset.scene_faces(), options.chunk_triangles as usize);
    let backdrop = (faces < asset.mesh.face_count())
        .then(|| Chunk { first: faces as u32, count: (asset.mesh.face_count() - faces) as u32 });
    if asset.chunks.len() > 1 + usize::from(backdrop.is_some()) {
        return Ok(Outcome::Skipped("the scene is in chunks already"));
    }
    if limit == 0 || faces <= limit {
        asset.chunks = vec![Chunk { first: 0, count: faces as u32 }];
        asset.chunks.extend(backdrop);
        if by_page(asset) {
            details.count(asset);
            return Ok(Outcome::Changed(()));
        }
        return Ok(Outcome::Skipped(if limit == 0 {
            "one chunk was asked for"
        } else {
            "it fits one chunk"
        }));
    }
    let (mut order, chunks) = cut(&asset.mesh, faces, limit);
    order.extend(faces as u32..asset.mesh.face_count() as u32);
    asset.mesh.select(&order);
    asset.chunks = chunks;
    asset.chunks.extend(backdrop);
    by_page(asset);
    details.count(asset);
    asset.bvh = None; // the hierarchy was built for another order of faces
    Ok(Outcome::Changed(()))
}

impl ChunkDetails {
    /// Of the scene, without its backdrop.
    fn count(&mut self, asset: &Asset) {
        let faces = asset.scene_faces();
        let of_scene = asset.chunks.iter().filter(|chunk| (chunk.first as usize) < faces).count();
        self.chunks = of_scene as u64;
        self.mean_triangles = (faces / of_scene.max(1)) as u64;
    }
}

/// Cuts chunks so that all faces of one are on the same page of the texture; within it they keep their order. Returns whether it did.
pub(super) fn by_page(asset: &mut Asset) -> bool {
    let Some(texture) = asset.mesh.texture.as_ref().filter(|texture| !texture.page_of.is_empty()) else {
        return false;
    };
    let mut order: Vec<u32> = (0..asset.mesh.face_count() as u32).collect();
    let mut chunks = Vec::with_capacity(asset.chunks.len());
    for chunk in &asset.chunks {
        let run = &mut order[chunk.first as usize..][..chunk.count as usize];
        run.sort_by_key(|face| texture.page_of[*face as usize]);
        let mut first = chunk.first;
        for page in run.chunk_by(|a, b| texture.page_of[*a as usize] == texture.page_of[*b as usize]) {
            chunks.push(Chunk { first, count: page.len() as u32 });
            first += page.len() as u32;
        }
    }
    if chunks.len() == asset.chunks.len() {
        return false;
    }
    asset.mesh.select(&order);
    asset.chunks = chunks;
    asset.bvh = None;
    true
}

/// Cuts the first `faces` into runs of at most `limit`. Returns the order of faces and the runs in that
/// order; within a run, faces keep their order.
///
/// Top-down, each time at the plane (or size) where the two sides cost least:
///
/// ```text
/// cost = area(left) * chunks(left) + area(right) * chunks(right),   chunks(n) = ceil(n / limit)
/// ```
///
/// that is the surface area heuristic (MacDonald and Booth 1990), counting whole chunks, because an engine
/// draws or culls these. A cut along the fourth axis, size, separates triangles that are large for their
/// neighbourhood, so that the rest is compact.
pub(super) fn cut(mesh: &Mesh, faces: usize, limit: usize) -> (Vec<u32>, Vec<Chunk>) {
    let mut items = parallel::collect(faces, GRAIN, |face| Item::new(mesh, face));
    let counts = split(&mut items, limit);
    let mut chunks = Vec::with_capacity(counts.len());
    let mut first = 0;
    for count in counts {
        chunks.push(Chunk { first, count });
        first += count;
    }
    (items.iter().map(|item| item.face).collect(), chunks)
}

/// A face reduced to its box and size.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(16))]
struct Item {
    min: Vec3,
    face: u32,
    max: Vec3,
    /// Longest side of the box as the bits of an f32: monotone, and about logarithmic.
    level: f32,
}

impl Item {
    fn new(mesh: &Mesh, face: usize) -> Self {
        let [a, b, c] = mesh.corners(face);
        let (min, max) = (a.min(b).min(c), a.max(b).max(c));
        let level = (max - min).max_element().to_bits() as f32;
        Self { min, face: face as u32, max, level }
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
fn split(items: &mut [Item], limit: usize) -> Vec<u32> {
    if items.len() <= limit {
        items.sort_unstable_by_key(|item| item.face);
        return vec![items.len() as u32];
    }
    let middle = best_cut(items, limit).map_or(0, |cut| partition(items, |item| cut.is_left(item)));
    // No cut separates them (all in one place): cut off whole chunks.
    let middle = if middle == 0 { items.len().div_ceil(limit) / 2 * limit } else { middle };
    let (left, right) = items.split_at_mut(middle);
    let (mut counts, more) = rayon::join(|| split(left, limit), || split(right, limit));
    counts.extend(more);
    counts
}

/// Moves the items for which `is_left` to the front; returns how many.
fn partition(items: &mut [Item], is_left: impl Fn(&Item) -> bool) -> usize {
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
    fn around<'a>(items: impl Iterator<Item = &'a Item>) -> Self {
        let none = (Vec4::INFINITY, Vec4::NEG_INFINITY);
        let (lo, hi) = items.map(Item::place).fold(none, |(lo, hi), p| (lo.min(p), hi.max(p)));
        Self { origin: lo, scale: BINS as f32 / (hi - lo) }
    }

    /// The bin of an item on each axis. An axis without extent has one bin.
    fn bins(&self, item: &Item) -> [usize; 4] {
        // An infinite or NaN product saturates to a bin, so this cannot fail.
        ((item.place() - self.origin) * self.scale).to_array().map(|x| (x as u8 as usize).min(BINS - 1))
    }
}

/// A cut: bins up to and including `bin` on `axis` are left.
struct Cut {
    grid: BinGrid,
    axis: usize,
    bin: usize,
}

impl Cut {
    fn is_left(&self, item: &Item) -> bool {
        self.grid.bins(item)[self.axis] <= self.bin
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
        Self { min: self.min.min(other.min), max: self.max.max(other.max), count: self.count + other.count }
    }

    /// Area of the box times chunks in it.
    fn cost(&self, limit: usize) -> f64 {
        let d = (self.max - self.min).as_dvec3();
        (d.x * d.y + d.y * d.z + d.z * d.x) * self.count.div_ceil(limit) as f64
    }
}

/// The cheapest cut with something on both sides, if there is one.
fn best_cut(items: &[Item], limit: usize) -> Option<Cut> {
    let step = items.len().div_ceil(SAMPLE);
    let grid = BinGrid::around(items.iter().step_by(step));
    let bins = fill(items.iter().step_by(step), step, &grid);
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
            // Every chunk costs an engine a draw, so slices come last. Boxes without area all cost nothing,
            // so ties go to the most even cut.
            let slice = left.count.min(right.count) < few;
            let cost = (slice, left.cost(limit) + right.cost(limit), left.count.abs_diff(right.count));
            if left.count > 0 && right.count > 0 && cost < best {
                best = cost;
                cut = Some(Cut { grid, axis, bin });
            }
        }
    }
    cut
}

/// The bins of all axes, each item standing for `weight` of them.
fn fill<'a>(items: impl Iterator<Item = &'a Item>, weight: usize, grid: &BinGrid) -> [[BinBox; BINS]; 4] {
    let mut bins = [[BinBox::EMPTY; BINS]; 4];
    for item in items {
        let one = BinBox { min: item.min.into(), max: item.max.into(), count: weight };
        for (axis, bin) in grid.bins(item).into_iter().enumerate() {
            bins[axis][bin] = bins[axis][bin].union(one);
        }
    }
    bins
}
