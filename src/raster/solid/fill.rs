//! Which face every sample of a tile sees.

use super::bin::{Batch, Big, TILE_HEIGHT, TILE_WIDTH, Tiny, extent, samples_between};
use super::eye::GRID;
use crate::math::lanes::{LANES, Lanes, Work, dispatch};
use crate::math::real::Mask;

/// Samples that a block may reach beyond its tile on the right and below.
const RIM: usize = 3;
/// Places from one row of a tile to the next.
pub(super) const STRIDE: usize = TILE_WIDTH + RIM;
/// Half a sample on the grid: where its centre is.
const CENTER: i32 = GRID / 2;

/// What a sample of a tile sees: 1/z above, the complement of the face below, so that of two the larger is the
/// nearer, and at the same depth the face of the lower index. Zero is nothing.
pub(super) type Key = i64;

/// The samples of a tile and a rim that nobody reads.
pub(super) type Keys = [Key; STRIDE * (TILE_HEIGHT + RIM)];

/// A tile that sees nothing.
pub(super) const EMPTY: Keys = [0; STRIDE * (TILE_HEIGHT + RIM)];

/// The face a key stands for; [`super::NO_FACE`] for none.
#[inline(always)]
pub(super) fn face_of(key: Key) -> u32 {
    !(key as u32)
}

/// The 1/z a key stands for.
#[inline(always)]
pub(super) fn inverse_depth_of(key: Key) -> f32 {
    f32::from_bits((key >> 32) as u32)
}

#[inline(always)]
fn key(w: f32, face: u32) -> Key {
    (i64::from(w.to_bits()) << 32) | i64::from(!face)
}

/// Fills the keys of tile `tile`, at `column` and `row`, from all batches.
pub(super) fn fill(keys: &mut Keys, batches: &[Batch], tile: usize, column: u32, row: u32) {
    dispatch(Tile { keys, batches, tile, column: column as i32, row: row as i32 });
}

struct Tile<'a> {
    keys: &'a mut Keys,
    batches: &'a [Batch],
    tile: usize,
    column: i32,
    row: i32,
}

impl Work for Tile<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let corner = [self.column * TILE_WIDTH as i32, self.row * TILE_HEIGHT as i32];
        self.keys.fill(0);
        for batch in self.batches {
            let bin = &batch.bins[self.tile];
            for tiny in &bin.tiny {
                draw_tiny::<L>(self.keys, tiny);
            }
            for place in &bin.big {
                draw_big(self.keys, &batch.big[*place as usize], corner);
            }
        }
    }
}

/// 1 for an edge whose samples belong to the neighbour, 0 for one on the top or the left: the least value of
/// the edge function that is inside.
#[inline(always)]
fn least_inside(dx: i32, dy: i32) -> i32 {
    i32::from(!(dy < 0 || (dy == 0 && dx > 0)))
}

/// x and y of the samples of a block, units of the grid.
const LANE_X: [f32; LANES] = grid(1.0, 0.0);
const LANE_Y: [f32; LANES] = grid(0.0, 1.0);

const fn grid(x: f32, y: f32) -> [f32; LANES] {
    let mut out = [0.0; LANES];
    let mut i = 0;
    while i < LANES {
        out[i] = ((i % 4) as f32 * x + (i / 4) as f32 * y) * GRID as f32;
        i += 1;
    }
    out
}

/// Draws a tiny triangle in blocks of 4 x 4 samples. All numbers are whole and below 2^24 but for the depth.
#[inline(always)]
fn draw_tiny<L: Lanes>(keys: &mut Keys, tiny: &Tiny) {
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
    let ((left, right), (top, bottom)) = (extent([x0, x1, x2]), extent([y0, y1, y2]));
    let (first_x, last_x) = samples_between(left, right);
    let (first_y, last_y) = samples_between(top, bottom);
    let (first_x, last_x) = (first_x.max(0), last_x.min(TILE_WIDTH as i32 - 1));
    let (first_y, last_y) = (first_y.max(0), last_y.min(TILE_HEIGHT as i32 - 1));

    // Edge i lies opposite corner i.
    let edges = [(x1, y1, x2 - x1, y2 - y1), (x2, y2, x0 - x2, y0 - y2), (x0, y0, x1 - x0, y1 - y0)];
    let (lane_x, lane_y) = (L::load(&LANE_X), L::load(&LANE_Y));
    let per = 1.0 / area as f32;
    let (slope1, slope2) = (L::splat((w1 - w0) * per), L::splat((w2 - w0) * per));
    let (least_w, most_w) = (w0.min(w1).min(w2), w0.max(w1).max(w2));
    let mut at_y = first_y;
    while at_y <= last_y {
        let mut at_x = first_x;
        while at_x <= last_x {
            let (px, py) = (at_x * GRID + CENTER, at_y * GRID + CENTER);
            let value = |edge: usize| {
                let (x, y, dx, dy) = edges[edge];
                let here = L::splat((dx * (py - y) - dy * (px - x)) as f32);
                here + lane_y * L::splat(dx as f32) - lane_x * L::splat(dy as f32)
            };
            let inside = |edge: usize, value: L| {
                let (_, _, dx, dy) = edges[edge];
                L::splat(least_inside(dx, dy) as f32).le(value)
            };
            let (e0, e1, e2) = (value(0), value(1), value(2));
            let covered = inside(0, e0).and(inside(1, e1)).and(inside(2, e2));
            let mut bits = L::bits(covered);
            if bits != 0 {
                let w = L::splat(w0) + (e1 * slope1 + e2 * slope2);
                let w = w.max(L::splat(least_w)).min(L::splat(most_w));
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

/// An edge function along a row of samples: `start + step * x >= least` inside.
#[derive(Clone, Copy, Default)]
struct Edge {
    x: i64,
    y: i64,
    dx: i64,
    dy: i64,
    least: i64,
}

impl Edge {
    #[inline(always)]
    fn new(from: [i32; 2], to: [i32; 2]) -> Self {
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        let least = i64::from(least_inside(dx, dy));
        Self { x: from[0].into(), y: from[1].into(), dx: dx.into(), dy: dy.into(), least }
    }

    /// The value at the centre of a sample.
    #[inline(always)]
    fn at(&self, x: i64, y: i64) -> i64 {
        let center = |k: i64| k * i64::from(GRID) + i64::from(CENTER);
        self.dx * (center(y) - self.y) - self.dy * (center(x) - self.x)
    }

    /// The part of the samples `first..=last` of row `y` that is inside.
    #[inline(always)]
    fn narrow(&self, y: i64, first: i64, last: i64) -> (i64, i64) {
        let (short, step) = (self.least - self.at(first, y), -self.dy * i64::from(GRID));
        match step {
            0 if short > 0 => (first, first - 1),
            0 => (first, last),
            // Smallest k with step * k >= short.
            1.. if short > 0 => (first + (short + step - 1) / step, last),
            1.. => (first, last),
            // Largest k with -step * k <= -short.
            _ if short > 0 => (first, first - 1),
            _ => (first, last.min(first + short / step)),
        }
    }
}

/// Draws a triangle of any size within the guard band, row by row.
#[inline(always)]
fn draw_big(keys: &mut Keys, big: &Big, corner: [i32; 2]) {
    let at = &big.at;
    let point = |i: usize| [at.x[i], at.y[i]];
    let turn = |a: [i32; 2], b: [i32; 2], c: [i32; 2]| {
        let far = |p: i32, q: i32| i64::from(p) - i64::from(q);
        far(b[0], a[0]) * far(c[1], a[1]) - far(c[0], a[0]) * far(b[1], a[1])
    };
    let mut area = turn(point(0), point(1), point(2));
    let order = if area < 0 { [0, 2, 1] } else { [0, 1, 2] };
    area = area.abs();
    if area == 0 {
        return;
    }
    let [p0, p1, p2] = order.map(point);
    let [w0, w1, w2] = order.map(|i| f64::from(at.w[i]));
    let edges = [Edge::new(p1, p2), Edge::new(p2, p0), Edge::new(p0, p1)];
    let per = 1.0 / area as f64;
    let step = -(edges[1].dy as f64 * (w1 - w0) + edges[2].dy as f64 * (w2 - w0)) * per * f64::from(GRID);
    let least_w = at.w[0].min(at.w[1]).min(at.w[2]);
    let most_w = at.w[0].max(at.w[1]).max(at.w[2]);

    let ((left, right), (top, bottom)) = (extent(at.x), extent(at.y));
    let (first_x, last_x) = samples_between(left, right);
    let (first_y, last_y) = samples_between(top, bottom);
    let (first_x, last_x) = (first_x.max(corner[0]), last_x.min(corner[0] + TILE_WIDTH as i32 - 1));
    let (first_y, last_y) = (first_y.max(corner[1]), last_y.min(corner[1] + TILE_HEIGHT as i32 - 1));
    for row in first_y..=last_y {
        let y = i64::from(row);
        let (mut first, mut last) = (i64::from(first_x), i64::from(last_x));
        for edge in &edges {
            (first, last) = edge.narrow(y, first, last);
        }
        if first > last {
            continue;
        }
        let share = |edge: &Edge| edge.at(first, y) as f64 * per;
        let start = w0 + share(&edges[1]) * (w1 - w0) + share(&edges[2]) * (w2 - w0);
        let (start, step) = (start as f32, step as f32);
        let place = (row - corner[1]) as usize * STRIDE + (first as i32 - corner[0]) as usize;
        let span = &mut keys[place..place + (last - first) as usize + 1];
        for (i, here) in span.iter_mut().enumerate() {
            let w = (start + step * i as f32).max(least_w).min(most_w);
            *here = (*here).max(key(w, big.face));
        }
    }
}
