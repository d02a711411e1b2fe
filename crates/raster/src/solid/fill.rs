//! Finds the nearest face at every sample of a tile: tiny triangles sample by sample, others by the
//! exact ends of each row.
//!
//! Ordinary tiles are drawn without sorting, which would cost more than it saves. When the drawn
//! area shows that a tile is deep, the nearest triangles of a batch are drawn first, and triangles
//! behind all samples are dropped. So time grows with the visible layers.

use super::bin::{
    Batch, CENTER, LANE, LargeTriangle, STRIDE, SampleKeys, TILE_HEIGHT, TILE_WIDTH, TinyTriangle,
    extent, farthest, key, least_inside, samples_between, tile_place, tile_size,
};
use super::projector::GRID;
use crate::soft::grid;
use glam::UVec2;
use trisplat_scene::math::lanes::{LANES, Lanes, Work};
use trisplat_scene::math::real::Mask;

/// Draws the bins of a tile into its keys.
pub(super) struct FillTile<'a> {
    /// One, or one per plane.
    pub(super) keys: &'a mut [SampleKeys],
    pub(super) batches: &'a [Batch],
    /// The plane of each face, if there are planes.
    pub(super) plane_of: Option<&'a [u8]>,
    pub(super) tile: usize,
    /// Samples across and down the picture.
    pub(super) size: UVec2,
}

impl Work for FillTile<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let place = tile_place(self.size, self.tile);
        let corner = [place.x as i32 * TILE_WIDTH as i32, place.y as i32 * TILE_HEIGHT as i32];
        let mut layers = TileLayers { size: tile_size(self.size, place), area: 0 };
        for batch in self.batches {
            let bin = &batch.bins[self.tile];
            let Some(plane_of) = self.plane_of else {
                let keys = &mut self.keys[0];
                for tiny in &bin.tiny {
                    draw_tiny::<L>(keys, tiny);
                }
                layers.draw::<L>(keys, batch, &bin.large, corner);
                continue;
            };
            for tiny in &bin.tiny {
                draw_tiny::<L>(&mut self.keys[usize::from(plane_of[tiny.face as usize])], tiny);
            }
            for place in &bin.large {
                let large = &batch.large[*place as usize];
                let plane = usize::from(plane_of[large.face as usize]);
                draw_large::<L>(&mut self.keys[plane], large, corner);
            }
        }
    }
}

/// x and y of the samples of a block, units of the grid.
const LANE_X: [f32; LANES] = grid(GRID as f32, 0.0, 0.0);
const LANE_Y: [f32; LANES] = grid(0.0, GRID as f32, 0.0);

/// Draws a tiny triangle in blocks of 4 x 4 samples. All numbers except the depth are integers
/// below 2^24.
#[inline(always)]
fn draw_tiny<L: Lanes>(keys: &mut SampleKeys, tiny: &TinyTriangle) {
    let [x0, mut x1, mut x2] = [i32::from(tiny.x[0]), i32::from(tiny.x[1]), i32::from(tiny.x[2])];
    let [y0, mut y1, mut y2] = [i32::from(tiny.y[0]), i32::from(tiny.y[1]), i32::from(tiny.y[2])];
    let [w0, mut w1, mut w2] = tiny.w;
    let mut area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0);
    if area < 0 {
        (x1, x2, y1, y2, w1, w2) = (x2, x1, y2, y1, w2, w1);
        area = -area;
    }
    if area == 0 {
        return;
    }
    let (first_x, last_x) = samples_between([x0, x1, x2], 0, TILE_WIDTH as i32 - 1);
    let (first_y, last_y) = samples_between([y0, y1, y2], 0, TILE_HEIGHT as i32 - 1);

    // Edge i lies opposite corner i.
    let edges =
        [(x1, y1, x2 - x1, y2 - y1), (x2, y2, x0 - x2, y0 - y2), (x0, y0, x1 - x0, y1 - y0)];
    let lane_x = L::load(&LANE_X);
    let lane_y = L::load(&LANE_Y);
    let per = 1.0 / area as f32;
    let slope1 = L::splat((w1 - w0) * per);
    let slope2 = L::splat((w2 - w0) * per);
    let min_w = w0.min(w1).min(w2);
    let max_w = w0.max(w1).max(w2);
    let mut at_y = first_y;
    while at_y <= last_y {
        let mut at_x = first_x;
        while at_x <= last_x {
            let px = at_x * GRID + CENTER;
            let py = at_y * GRID + CENTER;
            let value = |edge: usize| {
                let (x, y, dx, dy) = edges[edge];
                let here = L::splat((dx * (py - y) - dy * (px - x)) as f32);
                here + lane_y * L::splat(dx as f32) - lane_x * L::splat(dy as f32)
            };
            let inside = |edge: usize, value: L| {
                let (_, _, dx, dy) = edges[edge];
                L::splat(least_inside(dx, dy) as f32).le(value)
            };
            let e0 = value(0);
            let e1 = value(1);
            let e2 = value(2);
            let covered = inside(0, e0).and(inside(1, e1)).and(inside(2, e2));
            let mut bits = L::bits(covered);
            if bits != 0 {
                let w = L::splat(w0) + (e1 * slope1 + e2 * slope2);
                let w = w.max(L::splat(min_w)).min(L::splat(max_w));
                let mut depths = [0.0; LANES];
                w.store(&mut depths);
                let start = at_y as usize * STRIDE + at_x as usize;
                while bits != 0 {
                    let lane = bits.trailing_zeros() as usize % LANES;
                    bits &= bits - 1;
                    let here = &mut keys[start + (lane / 4) * STRIDE + lane % 4];
                    *here = (*here).max(key(depths[lane], tiny.face));
                }
            }
            at_x += 4;
        }
        at_y += 4;
    }
}

/// Layers over the whole tile, by the boxes of its triangles, after which it counts as deep.
const DEEP: i64 = 24;
/// Minimum triangles of a batch for this search, and the number of nearest ones drawn first.
const NEAREST: usize = 16;

/// The drawing of a tile so far.
struct TileLayers {
    /// Samples of the tile that lie in the picture.
    size: UVec2,
    /// Area of the boxes of the triangles that were drawn, cut to the tile, in units of the grid.
    area: i64,
}

impl TileLayers {
    /// Draws triangles of a batch; `corner` is the first sample of the tile.
    #[inline(always)]
    fn draw<L: Lanes>(
        &mut self,
        keys: &mut SampleKeys,
        batch: &Batch,
        large: &[u32],
        corner: [i32; 2],
    ) {
        const TILE_AREA: i64 =
            (TILE_WIDTH as i64 * GRID as i64) * (TILE_HEIGHT as i64 * GRID as i64);
        for (i, place) in large.iter().enumerate() {
            if self.area > DEEP * TILE_AREA && large.len() - i > NEAREST {
                return self.draw_deep::<L>(keys, batch, &large[i..], corner);
            }
            let large = &batch.large[*place as usize];
            draw_large::<L>(keys, large, corner);
            self.area += area_in_tile(large, corner);
        }
    }

    /// Draws the nearest of some triangles, drops what is hidden then, and continues with twice as
    /// many.
    #[inline(always)]
    fn draw_deep<L: Lanes>(
        &self,
        keys: &mut SampleKeys,
        batch: &Batch,
        large: &[u32],
        corner: [i32; 2],
    ) {
        let nearest = |place: u32| batch.large[place as usize].at.nearest();
        let mut left: Vec<(f32, u32)> =
            large.iter().map(|place| (nearest(*place), *place)).collect();
        let mut count = NEAREST;
        loop {
            let hidden_from = farthest(keys, self.size);
            left.retain(|(nearest, _)| *nearest >= hidden_from);
            if left.is_empty() {
                return;
            }
            let first = count.min(left.len());
            // The order changes the time, not the picture: the nearest face always wins.
            left.select_nth_unstable_by(first - 1, |a, b| b.0.total_cmp(&a.0));
            for (_, place) in left.drain(..first) {
                draw_large::<L>(keys, &batch.large[place as usize], corner);
            }
            count *= 2;
        }
    }
}

/// The area of a triangle's box within the tile, in units of the grid.
#[inline(always)]
fn area_in_tile(large: &LargeTriangle, corner: [i32; 2]) -> i64 {
    let within = |values: [i32; 3], corner: i32, samples: usize| {
        let (low, high) = extent(values);
        let from = corner * GRID;
        let to = (corner + samples as i32) * GRID;
        i64::from((high.min(to) - low.max(from)).max(0))
    };
    within(large.at.x, corner[0], TILE_WIDTH) * within(large.at.y, corner[1], TILE_HEIGHT)
}

/// Rows whose ends are found together.
const ROWS: usize = 8;
/// An edge function of a big triangle. Its values at samples are integers below 2^53: f64 holds
/// them exactly.
#[derive(Clone, Copy)]
struct Edge {
    /// Value at the first sample.
    start: f64,
    /// Change from a sample to the next on its right.
    right: f64,
    /// Change from a sample to the next below it.
    down: f64,
    /// Smallest value inside.
    least: f64,
}

impl Edge {
    #[inline(always)]
    fn new(from: [i32; 2], to: [i32; 2], sample: [i32; 2]) -> Self {
        let dx = to[0] - from[0];
        let dy = to[1] - from[1];
        let off = |axis: usize| i64::from(sample[axis] * GRID + CENTER) - i64::from(from[axis]);
        let start = i64::from(dx) * off(1) - i64::from(dy) * off(0);
        Self {
            start: start as f64,
            right: -f64::from(dy) * f64::from(GRID),
            down: f64::from(dx) * f64::from(GRID),
            least: f64::from(least_inside(dx, dy)),
        }
    }

    /// Narrows the spans of some rows to the inside of this edge. Quotients are rounded, so the
    /// samples next to each end are tested. Plain loops over arrays: they become vector
    /// instructions.
    #[inline(always)]
    fn narrow(&self, row: i32, spans: &mut Spans) {
        let width = TILE_WIDTH as f64;
        let step = self.right;
        let mut short = [0.0; ROWS];
        for (r, short) in short.iter_mut().enumerate() {
            *short = self.least - (self.start + self.down * f64::from(row + r as i32));
        }
        if step > 0.0 {
            for (first, short) in spans.first.iter_mut().zip(&short) {
                let k = (short / step).ceil().max(0.0).min(width);
                let back = if (k - 1.0) * step >= *short { 1.0 } else { 0.0 };
                let on = if k * step < *short { 1.0 } else { 0.0 };
                *first = first.max(k - back + on);
            }
        } else if step < 0.0 {
            for (last, short) in spans.last.iter_mut().zip(&short) {
                let k = (short / step).floor().max(-1.0).min(width);
                let on = if (k + 1.0) * step >= *short { 1.0 } else { 0.0 };
                let back = if k * step < *short { 1.0 } else { 0.0 };
                *last = last.min(k + on - back);
            }
        } else {
            for (last, short) in spans.last.iter_mut().zip(&short) {
                *last = if *short > 0.0 { -1.0 } else { *last };
            }
        }
    }
}

/// The samples of some rows that are inside, relative to the triangle's first in the tile.
struct Spans {
    first: [f64; ROWS],
    last: [f64; ROWS],
}

/// A triangle in a tile.
struct TileTriangle {
    /// Edge i lies opposite corner i.
    edges: [Edge; 3],
    /// 1/z of the first corner, and its change per unit of the second and the third edge function.
    start: f64,
    second: f64,
    third: f64,
    /// Minimum and greatest 1/z of the corners.
    least: f32,
    most: f32,
    face: u32,
}

/// Draws a triangle where it covers the tile whose first sample is `corner`.
#[inline(always)]
fn draw_large<L: Lanes>(keys: &mut SampleKeys, large: &LargeTriangle, corner: [i32; 2]) {
    let [left, top] = corner;
    let (first_x, last_x) = samples_between(large.at.x, left, left + TILE_WIDTH as i32 - 1);
    let (first_y, last_y) = samples_between(large.at.y, top, top + TILE_HEIGHT as i32 - 1);
    let Some(triangle) = TileTriangle::new(large, [first_x, first_y]) else { return };
    let place = (first_y - corner[1]) as usize * STRIDE + (first_x - corner[0]) as usize;
    let width = last_x - first_x;
    let rows = last_y - first_y + 1;
    let mut row = 0;
    while row < rows {
        let mut spans = Spans { first: [0.0; ROWS], last: [f64::from(width); ROWS] };
        for edge in &triangle.edges {
            edge.narrow(row, &mut spans);
        }
        let count = (rows - row).min(ROWS as i32) as usize;
        triangle.fill::<L>(keys, place + row as usize * STRIDE, row, count, &spans);
        row += ROWS as i32;
    }
}

impl TileTriangle {
    /// The triangle seen from sample `start`; `None` when it has no area.
    #[inline(always)]
    fn new(large: &LargeTriangle, start: [i32; 2]) -> Option<Self> {
        let at = &large.at;
        let far = |p: i32, q: i32| i64::from(p) - i64::from(q);
        let area = far(at.x[1], at.x[0]) * far(at.y[2], at.y[0])
            - far(at.x[2], at.x[0]) * far(at.y[1], at.y[0]);
        if area == 0 {
            return None;
        }
        let [a, b, c] = if area < 0 { [0, 2, 1] } else { [0, 1, 2] };
        let edge = |from: usize, to: usize| {
            Edge::new([at.x[from], at.y[from]], [at.x[to], at.y[to]], start)
        };
        let per = 1.0 / area.abs() as f64;
        let first = f64::from(at.w[a]);
        Some(Self {
            edges: [edge(b, c), edge(c, a), edge(a, b)],
            start: first,
            second: (f64::from(at.w[b]) - first) * per,
            third: (f64::from(at.w[c]) - first) * per,
            least: at.w[0].min(at.w[1]).min(at.w[2]),
            most: at.nearest(),
            face: large.face,
        })
    }

    /// Fills `count` rows from `row` on; the first sample has the key at index `place`.
    #[inline(always)]
    fn fill<L: Lanes>(
        &self,
        keys: &mut SampleKeys,
        place: usize,
        row: i32,
        count: usize,
        spans: &Spans,
    ) {
        let mut starts = [0.0f32; ROWS];
        for (r, (start, first)) in starts.iter_mut().zip(&spans.first).enumerate() {
            let value = |e: &Edge| e.start + e.down * f64::from(row + r as i32) + e.right * first;
            let w = self.start
                + value(&self.edges[1]) * self.second
                + value(&self.edges[2]) * self.third;
            *start = w as f32;
        }
        let step = (self.edges[1].right * self.second + self.edges[2].right * self.third) as f32;
        let lane = L::load(&LANE);
        for (r, start) in starts.into_iter().enumerate().take(count) {
            let first = spans.first[r] as i32;
            let last = spans.last[r] as i32;
            let length = last - first + 1;
            let from = place + r * STRIDE + first.max(0) as usize;
            let mut done = 0;
            while done < length {
                let along = lane + L::splat(done as f32);
                let w = L::splat(start) + along * L::splat(step);
                let w = w.max(L::splat(self.least)).min(L::splat(self.most));
                // Beyond the end of the row: below everything, so that nothing changes there.
                let w = L::select(along.lt(L::splat(length as f32)), w, L::splat(-1.0));
                put(keys, from + done as usize, w, self.face);
                done += LANES as i32;
            }
        }
    }
}

/// Writes a face to sixteen samples from `place` on, if it is nearer there.
#[inline(always)]
fn put<L: Lanes>(keys: &mut SampleKeys, place: usize, w: L, face: u32) {
    let mut depths = [0.0; LANES];
    w.store(&mut depths);
    if let Some(run) = keys[place..].first_chunk_mut::<LANES>() {
        for (here, depth) in run.iter_mut().zip(depths) {
            *here = (*here).max(key(depth, face));
        }
    }
}
