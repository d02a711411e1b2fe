//! Draws triangles of any size within the guard band: the ends of each row exactly, then the row between them.

use super::bins::{CENTER, LargeTriangle, TILE_HEIGHT, TILE_WIDTH, extent, least_inside, samples_between};
use super::keys::{STRIDE, SampleKeys, key};
use super::projector::GRID;
use trisplat_scene::math::lanes::{LANES, Lanes};

/// Rows whose ends are found together.
const ROWS: usize = 8;
/// An edge function of a big triangle. Its values at samples are integers below 2^53: f64 holds them exactly.
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
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        let off = |axis: usize| i64::from(sample[axis] * GRID + CENTER) - i64::from(from[axis]);
        let start = i64::from(dx) * off(1) - i64::from(dy) * off(0);
        Self {
            start: start as f64,
            right: -f64::from(dy) * f64::from(GRID),
            down: f64::from(dx) * f64::from(GRID),
            least: f64::from(least_inside(dx, dy)),
        }
    }

    /// Narrows the spans of some rows to the inside of this edge. Quotients are rounded, so the samples next
    /// to each end are tested. Plain loops over arrays: they become vector instructions.
    #[inline(always)]
    fn narrow(&self, row: i32, spans: &mut Spans) {
        let (most, step) = (TILE_WIDTH as f64, self.right);
        let mut short = [0.0; ROWS];
        for (r, short) in short.iter_mut().enumerate() {
            *short = self.least - (self.start + self.down * f64::from(row + r as i32));
        }
        if step > 0.0 {
            for (first, short) in spans.first.iter_mut().zip(&short) {
                let k = (short / step).ceil().max(0.0).min(most);
                let back = if (k - 1.0) * step >= *short { 1.0 } else { 0.0 };
                let on = if k * step < *short { 1.0 } else { 0.0 };
                *first = first.max(k - back + on);
            }
        } else if step < 0.0 {
            for (last, short) in spans.last.iter_mut().zip(&short) {
                let k = (short / step).floor().max(-1.0).min(most);
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
    /// Least and greatest 1/z of the corners.
    least: f32,
    most: f32,
    face: u32,
}

/// Draws a triangle where it covers the tile whose first sample is `corner`.
#[inline(always)]
pub(super) fn draw_large<L: Lanes>(keys: &mut SampleKeys, large: &LargeTriangle, corner: [i32; 2]) {
    let at = &large.at;
    let ((left, right), (top, bottom)) = (extent(at.x), extent(at.y));
    let (first_x, last_x) = samples_between(left, right);
    let (first_y, last_y) = samples_between(top, bottom);
    let (first_x, last_x) = (first_x.max(corner[0]), last_x.min(corner[0] + TILE_WIDTH as i32 - 1));
    let (first_y, last_y) = (first_y.max(corner[1]), last_y.min(corner[1] + TILE_HEIGHT as i32 - 1));
    let Some(triangle) = TileTriangle::new(large, [first_x, first_y]) else { return };
    let place = (first_y - corner[1]) as usize * STRIDE + (first_x - corner[0]) as usize;
    let (width, rows) = (last_x - first_x, last_y - first_y + 1);
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
        let area =
            far(at.x[1], at.x[0]) * far(at.y[2], at.y[0]) - far(at.x[2], at.x[0]) * far(at.y[1], at.y[0]);
        if area == 0 {
            return None;
        }
        let [a, b, c] = if area < 0 { [0, 2, 1] } else { [0, 1, 2] };
        let edge = |from: usize, to: usize| Edge::new([at.x[from], at.y[from]], [at.x[to], at.y[to]], start);
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
    fn fill<L: Lanes>(&self, keys: &mut SampleKeys, place: usize, row: i32, count: usize, spans: &Spans) {
        let mut starts = [0.0f32; ROWS];
        for (r, (start, first)) in starts.iter_mut().zip(&spans.first).enumerate() {
            let value = |e: &Edge| e.start + e.down * f64::from(row + r as i32) + e.right * first;
            let w = self.start + value(&self.edges[1]) * self.second + value(&self.edges[2]) * self.third;
            *start = w as f32;
        }
        let step = (self.edges[1].right * self.second + self.edges[2].right * self.third) as f32;
        let mut lane = [0.0; LANES];
        for (i, lane) in lane.iter_mut().enumerate() {
            *lane = i as f32;
        }
        let lane = L::load(&lane);
        for (r, start) in starts.into_iter().enumerate().take(count) {
            let (first, last) = (spans.first[r] as i32, spans.last[r] as i32);
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
