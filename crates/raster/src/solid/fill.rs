//! Finds the nearest face at every sample of a tile; tiny triangles here, the others in `spans`.

use super::bins::{
    Batch, CENTER, TILE_HEIGHT, TILE_WIDTH, TinyTriangle, extent, least_inside, samples_between, tile_count,
};
use super::hidden::tile_size;
use super::keys::{STRIDE, SampleKeys, key};
use super::layers::TileLayers;
use super::projector::GRID;
use glam::UVec2;
use trisplat_scene::math::lanes::{LANES, Lanes, Work, dispatch};
use trisplat_scene::math::real::Mask;

/// Draws the bins of tile `tile`, of a picture of `size` samples, into its keys.
pub(super) fn fill(keys: &mut SampleKeys, batches: &[Batch], tile: usize, size: UVec2) {
    let across = tile_count(size).x;
    dispatch(FillTile { keys, batches, tile, column: tile as u32 % across, row: tile as u32 / across, size });
}

/// Draws into the keys of a tile.
pub(super) struct FillTile<'a> {
    pub(super) keys: &'a mut SampleKeys,
    pub(super) batches: &'a [Batch],
    pub(super) tile: usize,
    pub(super) column: u32,
    pub(super) row: u32,
    pub(super) size: UVec2,
}

impl Work for FillTile<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let corner = [(self.column as usize * TILE_WIDTH) as i32, (self.row as usize * TILE_HEIGHT) as i32];
        let mut layers = TileLayers::new(tile_size(self.size, self.column, self.row));
        for batch in self.batches {
            let bin = &batch.bins[self.tile];
            for tiny in &bin.tiny {
                draw_tiny::<L>(self.keys, tiny);
            }
            layers.draw::<L>(self.keys, batch, &bin.large, corner);
        }
    }
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

/// Draws a tiny triangle in blocks of 4 x 4 samples. All numbers except the depth are integers below 2^24.
#[inline(always)]
pub(super) fn draw_tiny<L: Lanes>(keys: &mut SampleKeys, tiny: &TinyTriangle) {
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
