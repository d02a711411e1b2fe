//! Projects, clips and bins faces, in rounds, so that memory grows with the picture and not with
//! the layers behind each other.
//!
//! The bins of all faces have no bound: 100,000 triangles that fill the picture are in every tile.
//! At a limit of pairs of triangles and tiles, the tiles are filled. Then triangles behind all
//! samples of a tile are omitted from the bins of the next round. The samples do not change,
//! because the nearest face wins in any order.

use super::projector::{GRID, GUARD, Projector, SnappedTriangle, clip, snap_group};
use glam::{UVec2, Vec3};
use std::ops::{Range, RangeInclusive};
use trisplat_scene::math::lanes::{LANES, Lanes, Work, dispatch};
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel;

/// Faces that are projected together.
const GROUP: usize = LANES;
/// Smallest number of faces in a batch.
const MIN_BATCH: usize = 4096;

/// Splits the faces into batches; [`bin`] fills their bins. The picture does not depend on the
/// number of batches.
pub(super) fn start(batches: &mut Vec<Batch>, mesh: &Mesh) {
    let faces = mesh.face_count();
    let count = (4 * parallel::threads()).min(faces.div_ceil(MIN_BATCH));
    let each = faces.div_ceil(count.max(1)).next_multiple_of(GROUP);
    batches.resize_with(count, Batch::default);
    for (i, batch) in batches.iter_mut().enumerate() {
        batch.left = (i * each).min(faces)..((i + 1) * each).min(faces);
    }
}

/// Empties the bins and fills them with the next faces, about `pairs` pairs of triangles and tiles,
/// without `hidden` ones. Returns true when no face is left.
pub(super) fn bin(
    batches: &mut [Batch],
    mesh: &Mesh,
    projector: &Projector,
    hidden: Option<&TileDepths>,
    pairs: usize,
) -> bool {
    let tiles = tile_count(projector.size);
    let pairs = pairs / batches.len().max(1);
    parallel::for_each(batches.iter_mut(), |_, batch| {
        batch.empty((tiles.x * tiles.y) as usize);
        dispatch(BinFaces { mesh, projector, batch, across: tiles.x as i32, hidden, pairs });
    });
    batches.iter().all(|batch| batch.left.is_empty())
}

/// Puts faces of a batch into its bins.
pub(super) struct BinFaces<'a> {
    pub(super) mesh: &'a Mesh,
    pub(super) projector: &'a Projector,
    pub(super) batch: &'a mut Batch,
    /// Tiles in a row.
    pub(super) across: i32,
    pub(super) hidden: Option<&'a TileDepths>,
    /// Number of pairs of triangles and tiles after which the rest must wait.
    pub(super) pairs: usize,
}

impl Work for BinFaces<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(mut self) {
        let mut group = FaceGroup::default();
        while !self.batch.left.is_empty() && self.batch.pairs <= self.pairs {
            let start = self.batch.left.start;
            let count = GROUP.min(self.batch.left.len());
            self.batch.left.start += count;
            group.load(self.mesh, start, count);
            group.project::<L>(self.projector);
            for lane in 0..count {
                let face = start + lane;
                match group.action[lane] {
                    Action::DRAW => self.insert(&group.snapped(lane), face as u32),
                    Action::CLIP => clip(self.projector, self.mesh.corners(face), |piece| {
                        self.insert(&piece, face as u32);
                    }),
                    _ => {}
                }
            }
        }
    }
}

/// The treatment of a face; a number, so that sixteen are decided at once.
struct Action;

impl Action {
    const SKIP: u32 = 0;
    const DRAW: u32 = 1;
    const CLIP: u32 = 2;
}

type FaceValues = [f32; GROUP];

/// Sixteen faces as a structure of arrays.
#[derive(Default)]
struct FaceGroup {
    /// Corner by corner, axis by axis.
    world: [[FaceValues; 3]; 3],
    x: [[i32; GROUP]; 3],
    y: [[i32; GROUP]; 3],
    w: [FaceValues; 3],
    action: [u32; GROUP],
}

impl FaceGroup {
    /// Loops instead of `map`, which is not inlined.
    #[inline(always)]
    fn load(&mut self, mesh: &Mesh, start: usize, count: usize) {
        if mesh.indices.is_empty() {
            let faces = mesh.positions[3 * start..3 * (start + count)].as_chunks::<3>().0;
            for (lane, corners) in faces.iter().enumerate() {
                self.put(lane, corners[0], corners[1], corners[2]);
            }
        } else {
            let faces = mesh.indices[3 * start..3 * (start + count)].as_chunks::<3>().0;
            for (lane, [a, b, c]) in faces.iter().enumerate() {
                let at = |v: u32| mesh.positions[v as usize];
                self.put(lane, at(*a), at(*b), at(*c));
            }
        }
    }

    #[inline(always)]
    fn put(&mut self, lane: usize, a: Vec3, b: Vec3, c: Vec3) {
        let lane = lane % GROUP;
        let [first, second, third] = &mut self.world;
        first[0][lane] = a.x;
        first[1][lane] = a.y;
        first[2][lane] = a.z;
        second[0][lane] = b.x;
        second[1][lane] = b.y;
        second[2][lane] = b.z;
        third[0][lane] = c.x;
        third[1][lane] = c.y;
        third[2][lane] = c.z;
    }

    #[inline(always)]
    fn project<L: Lanes>(&mut self, projector: &Projector) {
        // Corners in front of the near plane; box of the corners.
        let mut front = [0u32; GROUP];
        let mut low = [[f32::INFINITY; GROUP]; 2];
        let mut high = [[f32::NEG_INFINITY; GROUP]; 2];
        for corner in 0..3 {
            let world = &self.world[corner];
            let mut x = [0.0; GROUP];
            let mut y = [0.0; GROUP];
            for lane in 0..GROUP {
                let point = projector.to_camera([world[0][lane], world[1][lane], world[2][lane]]);
                let at = projector.project(point);
                front[lane] += u32::from(point[2] > projector.near);
                low[0][lane] = low[0][lane].min(at[0]);
                low[1][lane] = low[1][lane].min(at[1]);
                high[0][lane] = high[0][lane].max(at[0]);
                high[1][lane] = high[1][lane].max(at[1]);
                x[lane] = at[0];
                y[lane] = at[1];
                self.w[corner][lane] = at[2];
            }
            snap_group::<L>(&x, &mut self.x[corner]);
            snap_group::<L>(&y, &mut self.y[corner]);
        }
        let [right, bottom] = projector.size.as_vec2().to_array();
        for lane in 0..GROUP {
            let within = (low[0][lane] > -GUARD)
                & (low[1][lane] > -GUARD)
                & (high[0][lane] < GUARD)
                & (high[1][lane] < GUARD);
            // One sample more on every side: snapping may move a corner in.
            let outside = (high[0][lane] < -1.0)
                | (high[1][lane] < -1.0)
                | (low[0][lane] > right + 1.0)
                | (low[1][lane] > bottom + 1.0);
            let all = front[lane] == 3;
            let out = (front[lane] == 0) | (all & outside);
            let drawn = if all & within { Action::DRAW } else { Action::CLIP };
            self.action[lane] = if out { Action::SKIP } else { drawn };
        }
    }

    #[inline(always)]
    fn snapped(&self, lane: usize) -> SnappedTriangle {
        SnappedTriangle {
            x: [self.x[0][lane], self.x[1][lane], self.x[2][lane]],
            y: [self.y[0][lane], self.y[1][lane], self.y[2][lane]],
            w: [self.w[0][lane], self.w[1][lane], self.w[2][lane]],
        }
    }
}

impl BinFaces<'_> {
    #[inline(always)]
    fn insert(&mut self, at: &SnappedTriangle, face: u32) {
        if at.shows_back() && self.mesh.is_single_sided(face as usize) {
            return;
        }
        let (left, right) = extent(at.x);
        let (top, bottom) = extent(at.y);
        let size = self.projector.size.as_ivec2();
        let (x0, x1) = samples_between(at.x, 0, size.x - 1);
        let (y0, y1) = samples_between(at.y, 0, size.y - 1);
        if x0 > x1 || y0 > y1 {
            return;
        }
        let rows = y0 / TILE_HEIGHT as i32..=y1 / TILE_HEIGHT as i32;
        let columns = x0 / TILE_WIDTH as i32..=x1 / TILE_WIDTH as i32;
        let nearest = at.nearest();
        if self.hidden.is_some_and(|hidden| hidden.hides_all(&rows, nearest)) {
            return;
        }
        let tiny = right - left <= TINY && bottom - top <= TINY;
        if !tiny {
            self.batch.large.push(LargeTriangle { at: *at, face });
        }
        let index = self.batch.large.len() as u32;
        for row in rows {
            for column in columns.clone() {
                let tile = (row * self.across + column) as usize;
                if self.hidden.is_some_and(|hidden| hidden.hides(tile, nearest)) {
                    continue;
                }
                self.batch.pairs += 1;
                let bin = &mut self.batch.bins[tile];
                if tiny {
                    bin.tiny.push(TinyTriangle::new(at, face, column, row));
                } else {
                    bin.large.push(index - 1);
                }
            }
        }
    }
}

// ---- Tiles, the bins of faces in them, and the nearest face of every sample as one number -------

/// Width of a tile, samples.
pub(super) const TILE_WIDTH: usize = 64;
/// Height of a tile, samples.
pub(super) const TILE_HEIGHT: usize = 32;
/// Half a sample on the grid: the offset of its centre.
pub(super) const CENTER: i32 = GRID / 2;
/// Largest extent of a tiny triangle, units of the grid: single precision holds its edge functions
/// exactly.
pub(super) const TINY: i32 = 8 * GRID;

/// A tiny triangle; its corners are relative to the corner of its tile.
#[derive(Debug, Clone, Copy)]
pub(super) struct TinyTriangle {
    pub(super) x: [i16; 3],
    pub(super) y: [i16; 3],
    pub(super) w: [f32; 3],
    pub(super) face: u32,
}

impl TinyTriangle {
    /// For the tile at `column` and `row`.
    #[inline(always)]
    pub(super) fn new(at: &SnappedTriangle, face: u32, column: i32, row: i32) -> Self {
        let left = column * TILE_WIDTH as i32 * GRID;
        let top = row * TILE_HEIGHT as i32 * GRID;
        let x = [(at.x[0] - left) as i16, (at.x[1] - left) as i16, (at.x[2] - left) as i16];
        let y = [(at.y[0] - top) as i16, (at.y[1] - top) as i16, (at.y[2] - top) as i16];
        Self { x, y, w: at.w, face }
    }
}

/// A triangle that is not tiny.
#[derive(Debug, Clone, Copy)]
pub(super) struct LargeTriangle {
    pub(super) at: SnappedTriangle,
    pub(super) face: u32,
}

/// The triangles of a batch that touch a tile.
#[derive(Debug, Default)]
pub(super) struct TileBin {
    pub(super) tiny: Vec<TinyTriangle>,
    /// Indices into the batch's list.
    pub(super) large: Vec<u32>,
}

/// The triangles of a range of faces, up to the limit.
#[derive(Debug, Default)]
pub(super) struct Batch {
    /// One per tile, row by row.
    pub(super) bins: Vec<TileBin>,
    pub(super) large: Vec<LargeTriangle>,
    /// Pairs of triangles and tiles in the bins.
    pub(super) pairs: usize,
    /// Faces that are not in the bins yet.
    pub(super) left: Range<usize>,
}

impl Batch {
    /// Empties the batch, with a bin for each of `tiles` tiles.
    pub(super) fn empty(&mut self, tiles: usize) {
        self.large.clear();
        self.pairs = 0;
        self.bins.resize_with(tiles, TileBin::default);
        for bin in &mut self.bins {
            bin.tiny.clear();
            bin.large.clear();
        }
    }
}

/// Tiles across and down.
pub(super) fn tile_count(size: UVec2) -> UVec2 {
    UVec2::new(size.x.div_ceil(TILE_WIDTH as u32), size.y.div_ceil(TILE_HEIGHT as u32))
}

/// Samples `first..=last`, within `from..=to`, whose centres lie between values on the grid.
#[inline(always)]
pub(super) fn samples_between(values: [i32; 3], from: i32, to: i32) -> (i32, i32) {
    let (low, high) = extent(values);
    (((low + GRID / 2 - 1) >> 8).max(from), ((high - GRID / 2) >> 8).min(to))
}

/// Smallest and largest of three.
#[inline(always)]
pub(super) fn extent(values: [i32; 3]) -> (i32, i32) {
    (values[0].min(values[1]).min(values[2]), values[0].max(values[1]).max(values[2]))
}

/// The smallest value of an edge function that counts as inside (the top-left rule): 0 for a top or
/// left edge, 1 for the others, whose samples belong to the neighbour.
#[inline(always)]
pub(super) fn least_inside(dx: i32, dy: i32) -> i32 {
    i32::from(!(dy < 0 || (dy == 0 && dx > 0)))
}

/// The numbers of the lanes.
pub(super) const LANE: [f32; LANES] =
    [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];

/// Samples by which a block may extend beyond its tile on the right and below; enough to keep runs
/// of `spans` within the keys.
const RIM: usize = 3;
/// Keys from one row of a tile to the next.
pub(super) const STRIDE: usize = TILE_WIDTH + RIM;

/// The key of a sample: 1/z in the upper half, the complement of the face in the lower. The larger
/// key is nearer or, at the same depth, has the lower face index. Zero means empty; negative keys
/// lose to it.
pub(super) type SampleKey = i64;

/// The samples of a tile and a rim that is never read.
pub(super) type SampleKeys = [SampleKey; STRIDE * (TILE_HEIGHT + RIM)];

/// A tile that sees nothing.
pub(super) static EMPTY: SampleKeys = [0; STRIDE * (TILE_HEIGHT + RIM)];

/// The face of a key; `NO_FACE` for none.
#[inline(always)]
pub(super) fn face_of(key: SampleKey) -> u32 {
    !(key as u32)
}

/// The 1/z of a key.
#[inline(always)]
pub(super) fn inverse_depth_of(key: SampleKey) -> f32 {
    f32::from_bits((key >> 32) as u32)
}

/// The key of a face at a 1/z.
#[inline(always)]
pub(super) fn key(w: f32, face: u32) -> SampleKey {
    (i64::from(w.to_bits().cast_signed()) << 32) | i64::from(!face)
}

/// The least 1/z of a tile's samples: 0 if one is empty. `size` are the samples of the tile within
/// the picture.
pub(super) fn farthest(keys: &SampleKeys, size: UVec2) -> f32 {
    let rows = keys.chunks(STRIDE).take(size.y as usize);
    let minima = rows.map(|row| row[..size.x as usize].iter().copied().min().unwrap_or(0));
    inverse_depth_of(minima.min().unwrap_or(0))
}

/// Column and row of a tile.
pub(super) fn tile_place(size: UVec2, tile: usize) -> UVec2 {
    let across = tile_count(size).x;
    UVec2::new(tile as u32 % across, tile as u32 / across)
}

/// Samples of the tile at `place` that lie in a picture of `size` samples.
pub(super) fn tile_size(size: UVec2, place: UVec2) -> UVec2 {
    let tile = UVec2::new(TILE_WIDTH as u32, TILE_HEIGHT as u32);
    tile.min(size - place * tile)
}

/// The farthest depth of each tile's samples, as 1/z.
#[derive(Debug)]
pub(super) struct TileDepths {
    tiles: Vec<f32>,
    /// Minimum of each row of tiles.
    rows: Vec<f32>,
}

impl TileDepths {
    /// From the keys of all tiles, with `planes` for each; hidden means hidden in all planes.
    /// `[tiles * planes]`
    pub(super) fn new(keys: &[SampleKeys], planes: usize, size: UVec2) -> Self {
        let of_tile = |tile: usize, planes: &[SampleKeys]| {
            let size = tile_size(size, tile_place(size, tile));
            planes.iter().map(|keys| farthest(keys, size)).fold(f32::INFINITY, f32::min)
        };
        let tiles: Vec<f32> = parallel::map(keys.chunks(planes), of_tile);
        let minimum = |row: &[f32]| row.iter().copied().fold(f32::INFINITY, f32::min);
        let rows = tiles.chunks(tile_count(size).x as usize).map(minimum).collect();
        Self { tiles, rows }
    }

    /// True if a tile hides a triangle whose nearest corner has the 1/z `nearest`. An equal depth
    /// is not hidden, because the lower face index wins.
    #[inline(always)]
    pub(super) fn hides(&self, tile: usize, nearest: f32) -> bool {
        nearest < self.tiles[tile]
    }

    /// True if whole rows of tiles hide it.
    #[inline(always)]
    pub(super) fn hides_all(&self, rows: &RangeInclusive<i32>, nearest: f32) -> bool {
        self.rows[*rows.start() as usize..=*rows.end() as usize]
            .iter()
            .all(|depth| nearest < *depth)
    }
}
