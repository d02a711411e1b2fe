//! The tiles that ellipses touch, by rows of tiles.

use super::ellipse::Ellipse;
use crate::soft::{MARGIN, TILE, tile_count};
use glam::UVec2;
use trisplat_scene::parallel;

/// Ellipses that one task bins.
const PER_TASK: usize = 8192;
const TILE_PX: f32 = TILE as f32;

/// An ellipse in a row of tiles.
#[derive(Debug, Clone, Copy)]
pub(super) struct Run {
    pub(super) ellipse: u32,
    /// First and last tile.
    first: u16,
    last: u16,
}

/// The ellipses of every row of tiles, front to back, in parts that follow each other.
#[derive(Debug)]
pub(super) struct Rows {
    /// `[parts][rows]`
    parts: Vec<Vec<Vec<Run>>>,
    pub(super) count: UVec2,
}

/// The ellipses of the tiles of one row, front to back.
#[derive(Debug)]
pub(super) struct RowTiles {
    starts: Vec<u32>,
    ellipses: Vec<u32>,
}

/// Sorts the ellipses into rows; `order` is front to back.
pub(super) fn bin(ellipses: &[Ellipse], order: &[u32], size: UVec2) -> Rows {
    let count = tile_count(size);
    let part = |ranks: &[u32]| {
        let mut rows = vec![Vec::new(); count.y as usize];
        for ellipse in ranks {
            add(&ellipses[*ellipse as usize], *ellipse, size, &mut rows);
        }
        rows
    };
    Rows { parts: parallel::map(order.chunks(PER_TASK), |_, ranks| part(ranks)), count }
}

/// Adds an ellipse to the rows that it touches.
fn add(ellipse: &Ellipse, index: u32, size: UVec2, rows: &mut [Vec<Run>]) {
    let half = ellipse.half_height() + MARGIN;
    let (top, bottom) = (ellipse.middle.y - half, ellipse.middle.y + half);
    let Some((first, last)) = tiles_between(top, bottom, size.y) else { return };
    for row in first..=last {
        // The centres of the row's first and last pixels, relative to the middle.
        let from = f32::from(row) * TILE_PX + 0.5 - ellipse.middle.y;
        let Some((left, right)) = extent(ellipse, from, from + TILE_PX - 1.0) else { continue };
        let (left, right) = (ellipse.middle.x + left - MARGIN, ellipse.middle.x + right + MARGIN);
        if let Some((first, last)) = tiles_between(left, right, size.x) {
            rows[usize::from(row)].push(Run { ellipse: index, first, last });
        }
    }
}

/// How far the part of an ellipse between two heights extends to the left and right of its middle, px.
fn extent(ellipse: &Ellipse, from: f32, to: f32) -> Option<(f32, f32)> {
    let Ellipse { along, shear, down, .. } = *ellipse;
    let (reach, half) = (ellipse.reach_squared(), ellipse.half_height());
    let (from, to) = (from.max(-half), to.min(half));
    if from > to + MARGIN {
        return None;
    }
    // The right end of a line is (√(reach - (down dy)²) - shear dy) / along, concave in dy and largest here.
    let widest = -half * shear / (shear * shear + down * down).sqrt();
    let end = |dy: f32| {
        let dy = dy.min(to).max(from);
        let width = (reach - (down * dy) * (down * dy)).max(0.0).sqrt();
        ((-width - shear * dy) / along, (width - shear * dy) / along)
    };
    Some((end(-widest).0, end(widest).1))
}

/// First and last tile with a pixel centre in [low, high].
fn tiles_between(low: f32, high: f32, size: u32) -> Option<(u16, u16)> {
    let first = (low - 0.5).ceil().max(0.0);
    let last = (high - 0.5).floor().min(size as f32 - 1.0);
    (first <= last).then(|| ((first / TILE_PX) as u16, (last / TILE_PX) as u16))
}

impl Rows {
    /// The ellipses of the tiles of row `row`.
    pub(super) fn tiles(&self, row: usize) -> RowTiles {
        let runs = || self.parts.iter().flat_map(|part| &part[row]);
        let mut starts = vec![0u32; self.count.x as usize + 1];
        for run in runs() {
            starts[usize::from(run.first)..=usize::from(run.last)].iter_mut().for_each(|count| *count += 1);
        }
        let mut sum = 0;
        for start in &mut starts {
            sum += std::mem::replace(start, sum);
        }
        let mut next = starts.clone();
        let mut ellipses = vec![0; sum as usize];
        for run in runs() {
            for place in &mut next[usize::from(run.first)..=usize::from(run.last)] {
                ellipses[*place as usize] = run.ellipse;
                *place += 1;
            }
        }
        RowTiles { starts, ellipses }
    }
}

impl RowTiles {
    /// The ellipses of a tile, front to back.
    pub(super) fn of(&self, tile: usize) -> &[u32] {
        &self.ellipses[self.starts[tile] as usize..self.starts[tile + 1] as usize]
    }
}
