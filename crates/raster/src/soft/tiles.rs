//! Bins splats into the tiles they touch, and in each tile the 4x4-pixel blocks.

use super::open_tiles::OpenTiles;
use super::options::Window;
use super::splats::{ScreenBox, SplatRecord, Splats};
use super::tile_grid::{BLOCK_X, BLOCK_Y, MARGIN, TILE, tile_count, tiles_between};
use glam::UVec2;
use std::ops::Range;
use trisplat_scene::math::lanes::{Lanes, Work, dispatch};
use trisplat_scene::math::real::Mask;
use trisplat_scene::parallel;

/// Splats that one task bins.
const SPLATS_PER_RANGE: usize = 2048;
/// A splat in a tile: one (splat, tile) pair.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct TileEntry {
    /// Index of the splat in depth order.
    pub(super) splat: u32,
    /// Blocks that it may touch; after the forward pass, blocks where it was drawn.
    pub(super) blocks: u32,
}

#[derive(Debug, Default)]
struct BinnedRange {
    /// (tile, blocks) of every pair, splat by splat.
    pairs: Vec<(u32, u32)>,
    /// Number of pairs up to and including each splat.
    ends: Vec<u32>,
}

/// The pairs of splats and tiles.
#[derive(Debug, Default)]
pub(super) struct Tiles {
    /// Image size, px.
    pub(super) size: UVec2,
    /// Tiles across and down.
    pub(super) count: UVec2,
    /// First entry of every tile, and the end. `[tiles + 1]`
    pub(super) starts: Vec<u32>,
    /// Tile by tile, front to back.
    pub(super) entries: Vec<TileEntry>,
    /// First pair of every splat, and the end. `[splats + 1]`
    pub(super) pairs: Vec<u32>,
    /// Entry of every pair.
    pub(super) entry_of_pair: Vec<u32>,
    ranges: Vec<BinnedRange>,
}

impl Tiles {
    /// Number of tiles.
    pub(super) fn len(&self) -> usize {
        (self.count.x * self.count.y) as usize
    }

    /// The entries of a tile, front to back.
    pub(super) fn entries_of(&self, tile: usize) -> &[TileEntry] {
        &self.entries[self.starts[tile] as usize..self.starts[tile + 1] as usize]
    }

    /// The entries of the splat of index `rank` in depth order.
    #[inline]
    pub(super) fn entries_of_splat(&self, rank: u32) -> &[u32] {
        let rank = rank as usize;
        &self.entry_of_pair[self.pairs[rank] as usize..self.pairs[rank + 1] as usize]
    }

    /// Top left pixel of a tile.
    pub(super) fn corner(&self, tile: usize) -> UVec2 {
        UVec2::new(tile as u32 % self.count.x, tile as u32 / self.count.x) * TILE
    }

    /// Fills the lists with the pairs of all splats.
    pub(super) fn bin(&mut self, splats: &Splats, size: UVec2, window: Window) {
        self.bin_some(splats, 0..splats.len(), size, window, None);
    }

    /// Fills the lists with the pairs of some splats and open, or all, tiles.
    pub(super) fn bin_some(
        &mut self,
        splats: &Splats,
        some: Range<usize>,
        size: UVec2,
        window: Window,
        open: Option<&OpenTiles>,
    ) {
        self.size = size;
        self.count = tile_count(size);
        self.ranges.resize_with(some.len().div_ceil(SPLATS_PER_RANGE), BinnedRange::default);
        let (count, size) = (self.count, size.as_vec2().to_array());
        // Where the splat is drawn, every edge is at least this far above the floor.
        let slack = if matches!(window, Window::Coverage { .. }) { 0.5 } else { 0.0 };
        parallel::for_each(&mut self.ranges, |r, range| {
            range.pairs.clear();
            range.ends.clear();
            let from = some.start + r * SPLATS_PER_RANGE;
            let to = (from + SPLATS_PER_RANGE).min(some.end);
            let (records, bounds) = (&splats.records[from..to], &splats.bounds[from..to]);
            dispatch(Emit { records, bounds, range, size, across: count.x, slack, open });
        });
        self.scatter(some.start as u32, some.len());
    }

    /// Fills the lists with kept pairs of the first splats.
    pub(super) fn restore(&mut self, kept: KeptPairs) {
        let splats = kept.0.ends.len();
        self.ranges.clear();
        self.ranges.push(kept.0);
        self.scatter(0, splats);
    }

    /// Moves the pairs to their tiles; the order within a tile is that of the splats; the first has rank
    /// `first`.
    fn scatter(&mut self, first: u32, splats: usize) {
        self.starts.clear();
        self.starts.resize(self.len() + 1, 0);
        let mut total = 0;
        for range in &self.ranges {
            total += range.pairs.len();
            for (tile, _) in &range.pairs {
                self.starts[*tile as usize + 1] += 1;
            }
        }
        for tile in 0..self.len() {
            self.starts[tile + 1] += self.starts[tile];
        }
        self.entries.resize(total, TileEntry::default());
        self.entry_of_pair.resize(total, 0);
        self.pairs.clear();
        self.pairs.reserve(splats + 1);
        self.pairs.push(0);
        let mut next = self.starts.clone();
        let (mut splat, mut base) = (first, 0);
        for range in &self.ranges {
            let mut from = 0;
            for end in &range.ends {
                for pair in from..*end {
                    let (tile, blocks) = range.pairs[pair as usize];
                    let to = &mut next[tile as usize];
                    self.entries[*to as usize] = TileEntry { splat, blocks };
                    self.entry_of_pair[(base + pair) as usize] = *to;
                    *to += 1;
                }
                from = *end;
                splat += 1;
                self.pairs.push(base + from);
            }
            base += from;
        }
    }
}

/// The drawn pairs of several lists, splat by splat.
#[derive(Debug, Default)]
pub(super) struct KeptPairs(BinnedRange);

impl KeptPairs {
    /// Adds the drawn pairs of lists with the next splats; `on_pair` gets the entry of each kept pair.
    pub(super) fn add(&mut self, tiles: &Tiles, mut on_pair: impl FnMut(usize)) {
        let Self(kept) = self;
        let mut tile_of_entry = vec![0; tiles.entries.len()];
        for (tile, ends) in tiles.starts.windows(2).enumerate() {
            tile_of_entry[ends[0] as usize..ends[1] as usize].fill(tile as u32);
        }
        for pairs in tiles.pairs.windows(2) {
            for &entry in &tiles.entry_of_pair[pairs[0] as usize..pairs[1] as usize] {
                let blocks = tiles.entries[entry as usize].blocks;
                if blocks != 0 {
                    kept.pairs.push((tile_of_entry[entry as usize], blocks));
                    on_pair(entry as usize);
                }
            }
            kept.ends.push(kept.pairs.len() as u32);
        }
    }

    /// Adds undrawn splats, up to `splats` in all.
    pub(super) fn add_undrawn(&mut self, splats: usize) {
        self.0.ends.resize(splats, self.0.pairs.len() as u32);
    }
}

/// Splits `values`, one per pair, by tile; `starts` as in [`Tiles::starts`].
pub(super) fn split_by_tile<'a, T>(mut values: &'a mut [T], starts: &[u32]) -> Vec<&'a mut [T]> {
    starts
        .windows(2)
        .map(|w| {
            let (head, tail) = std::mem::take(&mut values).split_at_mut((w[1] - w[0]) as usize);
            values = tail;
            head
        })
        .collect()
}

/// Counts and emits in one function, because two copies of these tests could differ in the last bit.
struct Emit<'a> {
    records: &'a [SplatRecord],
    bounds: &'a [ScreenBox],
    range: &'a mut BinnedRange,
    size: [f32; 2],
    across: u32,
    slack: f32,
    open: Option<&'a OpenTiles>,
}

impl Work for Emit<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { size, across, slack, .. } = self;
        for (record, bounds) in self.records.iter().zip(self.bounds) {
            if self.open.is_none_or(|open| open.count(bounds) > 0) {
                emit::<L>(record, bounds, (size, across, slack), self.open, &mut self.range.pairs);
            }
            self.range.ends.push(self.range.pairs.len() as u32);
        }
    }
}

/// Emits the tiles a splat touches. A block is omitted if one of five separating axes (three edges, two of
/// the box) shows a gap between the shrunk triangle and the box of the block's pixel centres: an exact test.
#[inline(always)]
fn emit<L: Lanes>(
    record: &SplatRecord,
    bounds: &ScreenBox,
    (size, across, slack): ([f32; 2], u32, f32),
    open: Option<&OpenTiles>,
    out: &mut Vec<(u32, u32)>,
) {
    let floor = record.floor - slack;
    let (x0, x1) = tiles_between(bounds.lo[0], bounds.hi[0], size[0]);
    let (y0, y1) = tiles_between(bounds.lo[1], bounds.hi[1], size[1]);
    let (block_x, block_y) = (L::load(&BLOCK_X), L::load(&BLOCK_Y));
    let reaches = [
        reach(record.edge[0], -floor, block_x, block_y),
        reach(record.edge[1], -floor - record.shift, block_x, block_y),
        reach(record.edge[2], -floor, block_x, block_y),
    ];
    for ty in y0..=y1 {
        for tx in x0..=x1 {
            if open.is_some_and(|open| !open.is_open(tx, ty)) {
                continue;
            }
            let corner = [(tx * TILE) as f32, (ty * TILE) as f32];
            let offset = [corner[0] - record.origin[0], corner[1] - record.origin[1]];
            let all = touches(reaches[0], record.edge[0], offset)
                .and(touches(reaches[1], record.edge[1], offset))
                .and(touches(reaches[2], record.edge[2], offset))
                .and(overlaps(block_x, bounds.lo[0] - corner[0], bounds.hi[0] - corner[0]))
                .and(overlaps(block_y, bounds.lo[1] - corner[1], bounds.hi[1] - corner[1]));
            let blocks = L::bits(all);
            if blocks != 0 {
                out.push((ty * across + tx, u32::from(blocks)));
            }
        }
    }
}

/// Half the side of the box of a block's pixel centres, plus the margin.
const HALF: f32 = 1.5 + MARGIN;

/// For every block the largest ratio to one edge, plus `constant`, were the tile at the splat's origin.
#[inline(always)]
fn reach<L: Lanes>([ex, ey]: [f32; 2], constant: f32, block_x: L, block_y: L) -> L {
    let constant = L::splat(HALF * (ex.abs() + ey.abs()) + constant);
    L::splat(ex).mul_add(block_x, L::splat(ey).mul_add(block_y, constant))
}

/// Whether each block of the tile at `offset` from the origin is not wholly outside the edge.
#[inline(always)]
fn touches<L: Lanes>(reach: L, [ex, ey]: [f32; 2], offset: [f32; 2]) -> L::Mask {
    L::splat(0.0).le(reach + L::splat(ex * offset[0] + ey * offset[1]))
}

/// Whether [lo, hi] overlaps the blocks along one axis.
#[inline(always)]
fn overlaps<L: Lanes>(block: L, lo: f32, hi: f32) -> L::Mask {
    L::splat(lo - HALF).le(block).and(block.le(L::splat(hi + HALF)))
}
