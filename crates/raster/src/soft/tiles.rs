//! Tiles of 16x16 pixels and their blocks of 4x4, one pixel per lane: the splats that touch them,
//! and the results of the passes at their pixels.

use super::frame::Window;
use super::projected::{ProjectedTriangles, ScreenBox, SplatRecord};
use glam::UVec2;
use std::ops::Range;
use trisplat_scene::math::lanes::{LANES, Lanes, Work, dispatch};
use trisplat_scene::math::real::Mask;
use trisplat_scene::parallel;

/// Tile width and height, px.
pub const TILE: u32 = 16;
/// Blocks in a tile: equal to [`LANES`], so that all are tested at once.
pub(super) const BLOCKS: usize = LANES;

/// Margin of every test, px: larger than any rounding, so that a test never changes a pixel.
pub const MARGIN: f32 = 0.01;

/// x and y of the lanes in a block, px.
pub(super) const LANE_X: [f32; LANES] = grid(1.0, 0.0, 0.0);
pub(super) const LANE_Y: [f32; LANES] = grid(0.0, 1.0, 0.0);
/// x and y of the blocks' centres in a tile, px.
pub(super) const BLOCK_X: [f32; BLOCKS] = grid(4.0, 0.0, 2.0);
pub(super) const BLOCK_Y: [f32; BLOCKS] = grid(0.0, 4.0, 2.0);

/// `x` and `y` times the column and row of each lane in a block of 4x4, plus `offset`.
pub(crate) const fn grid(x: f32, y: f32, offset: f32) -> [f32; LANES] {
    let mut out = [0.0; LANES];
    let mut i = 0;
    while i < LANES {
        out[i] = (i % 4) as f32 * x + (i / 4) as f32 * y + offset;
        i += 1;
    }
    out
}

/// Tiles across and down a picture.
pub fn tile_count(size: UVec2) -> UVec2 {
    UVec2::new(size.x.div_ceil(TILE), size.y.div_ceil(TILE))
}

/// Tiles `from..=to` that hold a pixel centre in [lo, hi]; none when from > to.
#[inline(always)]
pub(super) fn tiles_between(lo: f32, hi: f32, size: f32) -> (u32, u32) {
    let first = (lo - 0.5 - MARGIN).ceil().max(0.0);
    let last = (hi - 0.5 + MARGIN).floor().min(size - 1.0);
    if first <= last { (first as u32 / TILE, last as u32 / TILE) } else { (1, 0) }
}

/// Top left pixel of block `block` of the tile at `corner`.
#[inline(always)]
pub(super) fn block_corner(corner: UVec2, block: usize) -> [f32; 2] {
    [(corner.x + 4 * (block as u32 % 4)) as f32, (corner.y + 4 * (block as u32 / 4)) as f32]
}

/// One bit for each pixel of the block that lies in the image.
#[inline(always)]
pub(super) fn inside(size: UVec2, corner: UVec2, block: usize) -> u16 {
    if corner.x + TILE <= size.x && corner.y + TILE <= size.y {
        return u16::MAX;
    }
    let mut bits = 0;
    for lane in 0..LANES {
        let (x, y) = pixel(corner, block, lane);
        bits |= u16::from(x < size.x && y < size.y) << lane;
    }
    bits
}

/// Column and row of a lane.
#[inline(always)]
pub(super) fn pixel(corner: UVec2, block: usize, lane: usize) -> (u32, u32) {
    let block = block as u32;
    let lane = lane as u32;
    (corner.x + 4 * (block % 4) + lane % 4, corner.y + 4 * (block / 4) + lane / 4)
}

/// One channel of a tile: a number per pixel, block by block.
pub(super) type TileChannel = [[f32; LANES]; BLOCKS];

/// The pixels of a tile.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub(super) struct TilePixels {
    pub(super) transmittance: TileChannel,
    pub(super) rgb: [TileChannel; 3],
    /// Blocks with a pixel that has not terminated, one bit each.
    pub(super) alive: u32,
    /// Pixels that count for the importance of triangles, one bit each.
    pub(super) counted: [u16; BLOCKS],
    pub(super) geometry: Option<Box<TileGeometry>>,
}

/// Depth, normal and distortion of a tile's pixels.
#[derive(Debug, Clone, Default)]
pub(super) struct TileGeometry {
    pub(super) depth: TileChannel,
    pub(super) median: TileChannel,
    pub(super) normal: [TileChannel; 3],
    pub(super) distortion: TileChannel,
    /// Mapped depth of the first layer: the others are relative to it, which only changes rounding.
    pub(super) anchor: TileChannel,
    /// Σ w, Σ w m, Σ w m².
    pub(super) sums: [TileChannel; 3],
}

impl Default for TilePixels {
    fn default() -> Self {
        let zero = TileChannel::default();
        Self {
            transmittance: zero,
            rgb: [zero; 3],
            alive: 0,
            counted: [u16::MAX; BLOCKS],
            geometry: None,
        }
    }
}

/// The tiles in which some pixel has not terminated.
#[derive(Debug)]
pub(super) struct OpenTiles {
    /// Image size, px.
    size: [f32; 2],
    /// Tiles across and down.
    count: UVec2,
    /// Open tiles above and left of each corner between tiles. `[(down + 1) * (across + 1)]`
    sums: Vec<u32>,
}

impl OpenTiles {
    /// All tiles open.
    pub(super) fn all(size: UVec2) -> Self {
        let count = tile_count(size);
        let mut out = Self { size: size.as_vec2().to_array(), count, sums: Vec::new() };
        out.sum(|_| true);
        out
    }

    /// Closes the tiles whose pixels have all terminated. `[down * across]`
    pub(super) fn close(&mut self, pixels: &[TilePixels]) {
        self.sum(|tile| pixels[tile].alive != 0);
    }

    fn sum(&mut self, open: impl Fn(usize) -> bool) {
        let across = self.count.x as usize;
        let down = self.count.y as usize;
        self.sums.clear();
        self.sums.resize((across + 1) * (down + 1), 0);
        for y in 0..down {
            let mut row = 0;
            for x in 0..across {
                row += u32::from(open(y * across + x));
                self.sums[(y + 1) * (across + 1) + x + 1] =
                    self.sums[y * (across + 1) + x + 1] + row;
            }
        }
    }

    /// True if any tile is open.
    pub(super) fn any(&self) -> bool {
        self.sums.last().is_some_and(|open| *open > 0)
    }

    /// Open tiles that a box touches.
    pub(super) fn count(&self, bounds: &ScreenBox) -> u32 {
        let (x0, x1) = tiles_between(bounds.lo[0], bounds.hi[0], self.size[0]);
        let (y0, y1) = tiles_between(bounds.lo[1], bounds.hi[1], self.size[1]);
        if x0 > x1 || y0 > y1 { 0 } else { self.count_within([x0, y0], [x1 + 1, y1 + 1]) }
    }

    fn count_within(&self, from: [u32; 2], to: [u32; 2]) -> u32 {
        let at = |x: u32, y: u32| self.sums[(y * (self.count.x + 1) + x) as usize];
        at(to[0], to[1]) + at(from[0], from[1]) - at(to[0], from[1]) - at(from[0], to[1])
    }
}

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

    /// Fills the lists with the pairs of some splats and open, or all, tiles.
    pub(super) fn bin(
        &mut self,
        splats: &ProjectedTriangles,
        range_of_splats: Range<usize>,
        size: UVec2,
        window: Window,
        open: Option<&OpenTiles>,
    ) {
        self.size = size;
        self.count = tile_count(size);
        self.ranges
            .resize_with(range_of_splats.len().div_ceil(SPLATS_PER_RANGE), BinnedRange::default);
        let count = self.count;
        let size = size.as_vec2().to_array();
        // Minimum distance of every edge above the floor where the splat is drawn.
        let slack = if matches!(window, Window::Coverage { .. }) { 0.5 } else { 0.0 };
        parallel::for_each(&mut self.ranges, |r, range| {
            range.pairs.clear();
            range.ends.clear();
            let from = range_of_splats.start + r * SPLATS_PER_RANGE;
            let to = (from + SPLATS_PER_RANGE).min(range_of_splats.end);
            let records = &splats.records[from..to];
            let bounds = &splats.bounds[from..to];
            dispatch(Emit { records, bounds, range, size, across: count.x, slack, open });
        });
        self.scatter(range_of_splats.start as u32, range_of_splats.len());
    }

    /// Fills the lists with kept pairs of the first splats.
    pub(super) fn restore(&mut self, kept: KeptPairs) {
        let splats = kept.0.ends.len();
        self.ranges.clear();
        self.ranges.push(kept.0);
        self.scatter(0, splats);
    }

    /// Moves the pairs to their tiles; the order within a tile is that of the splats; the first has
    /// rank `first`.
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
        let mut splat = first;
        let mut base = 0;
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
    /// Adds the drawn pairs of lists with the next splats; `on_pair` gets the entry of each kept
    /// pair.
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

/// Splits `values`, one per pair or none, by tile; `starts` as in [`Tiles::starts`].
pub(super) fn split_by_tile<'a, T>(mut values: &'a mut [T], starts: &[u32]) -> Vec<&'a mut [T]> {
    starts
        .windows(2)
        .map(|w| {
            let count = values.len().min((w[1] - w[0]) as usize);
            values.split_off_mut(..count).expect("as many are left")
        })
        .collect()
}

/// Counts and emits in one function, because two copies of these tests could differ in the last
/// bit.
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
    fn run<L: Lanes>(mut self) {
        let records = self.records;
        let bounds = self.bounds;
        for (record, bounds) in records.iter().zip(bounds) {
            if self.open.is_none_or(|open| open.count(bounds) > 0) {
                self.emit::<L>(record, bounds);
            }
            self.range.ends.push(self.range.pairs.len() as u32);
        }
    }
}

impl Emit<'_> {
    /// Emits the tiles a splat touches. A block is omitted if one of five separating axes (three
    /// edges, two of the box) shows a gap between the shrunk triangle and the box of the block's
    /// pixel centres: an exact test.
    #[inline(always)]
    fn emit<L: Lanes>(&mut self, record: &SplatRecord, bounds: &ScreenBox) {
        let floor = record.floor - self.slack;
        let (x0, x1) = tiles_between(bounds.lo[0], bounds.hi[0], self.size[0]);
        let (y0, y1) = tiles_between(bounds.lo[1], bounds.hi[1], self.size[1]);
        let block_x = L::load(&BLOCK_X);
        let block_y = L::load(&BLOCK_Y);
        let reaches = [
            reach(record.edge[0], -floor, block_x, block_y),
            reach(record.edge[1], -floor - record.shift, block_x, block_y),
            reach(record.edge[2], -floor, block_x, block_y),
        ];
        for ty in y0..=y1 {
            for tx in x0..=x1 {
                if self.open.is_some_and(|open| open.count_within([tx, ty], [tx + 1, ty + 1]) == 0)
                {
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
                    self.range.pairs.push((ty * self.across + tx, u32::from(blocks)));
                }
            }
        }
    }
}

/// Half the side of the box of a block's pixel centres, plus the margin.
const HALF: f32 = 1.5 + MARGIN;

/// For every block the largest ratio to one edge, plus `constant`, were the tile at the splat's
/// origin.
#[inline(always)]
fn reach<L: Lanes>([ex, ey]: [f32; 2], constant: f32, block_x: L, block_y: L) -> L {
    let constant = L::splat(HALF * (ex.abs() + ey.abs()) + constant);
    L::splat(ex).mul_add(block_x, L::splat(ey).mul_add(block_y, constant))
}

/// Flags the blocks of the tile at `offset` from the origin that are not wholly outside the edge.
#[inline(always)]
fn touches<L: Lanes>(reach: L, [ex, ey]: [f32; 2], offset: [f32; 2]) -> L::Mask {
    L::splat(0.0).le(reach + L::splat(ex * offset[0] + ey * offset[1]))
}

/// Flags the blocks that [lo, hi] overlaps along one axis.
#[inline(always)]
fn overlaps<L: Lanes>(block: L, lo: f32, hi: f32) -> L::Mask {
    L::splat(lo - HALF).le(block).and(block.le(L::splat(hi + HALF)))
}
