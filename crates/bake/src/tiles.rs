//! Tiles: the scene cut into pieces that a viewer loads as it approaches, each at several levels of
//! detail.
//!
//! ```text
//!        root               level k: 1/4^k of the triangles
//!      ┌──┬┴─┬──┐
//!      ▢  ▢  ▢  ▢           level k - 1: each replaced by the four below it
//!     ▢▢▢▢ …                level 0: all triangles
//! ```
//!
//! Levels are those of [`lod`](super::lod), made from the whole scene. So a triangle of a tile is
//! also in the tiles below it, and neighbours agree along their border. Space is cut by the
//! triangles of the finest level: twice into halves of equal count for each step down, so all tiles
//! hold about equal numbers. Triangles belong to the tile of their centroid.

use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::ranges::{self, OptionNaming};
use trisplat_scene::report::Outcome;
use trisplat_scene::{Asset, Result, Tile};

/// Maximum number of levels below the root: 4^12 tiles of the smallest size exceed 32-bit counts of
/// triangles.
const MAX_LEVELS: u32 = 12;

/// Options of cutting the scene into tiles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TilesOptions {
    /// Write 3D Tiles 1.1 that stream: OUT.tileset.json and a folder OUT.tiles of GLB files; -o
    /// OUT.tileset.json implies it
    pub tiles: bool,
    /// Maximum number of triangles in a tile, 1000 or more
    #[schemars(range(min = 1000, max = 1_000_000_000))]
    pub tile_triangles: u32,
}

impl TilesOptions {
    /// No tiles; their default size is the largest that 16-bit indices can address.
    pub const DEFAULT: Self = Self { tiles: false, tile_triangles: 21_845 };

    /// Checks the range.
    pub fn validate(&self) -> Result<()> {
        ranges::check(self, OptionNaming::Flag)
    }

    /// Shares of the triangles in the levels coarser than the finest, for a scene of `faces`
    /// triangles.
    pub fn shares(&self, faces: usize) -> Vec<f64> {
        let max_triangles = f64::from(self.tile_triangles);
        let fits = |levels: u32| faces as f64 / 4f64.powi(levels as i32) <= max_triangles;
        let levels = (0..MAX_LEVELS).find(|levels| fits(*levels)).unwrap_or(MAX_LEVELS);
        (1..=levels).map(|level| 0.25f64.powi(level as i32)).collect()
    }
}

trisplat_scene::default!(TilesOptions);

/// The tree of tiles.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TilesDetails {
    /// Tiles that hold triangles.
    pub tiles: u64,
    /// Levels, the root among them.
    pub levels: u64,
    /// Maximum number of triangles in a tile.
    pub most_triangles: u64,
}

trisplat_scene::stage!(TilesDetails, "tiles");

/// Cuts the scene and its levels into `asset.tiles`, and takes the levels out. A backdrop is a tile
/// of its own.
pub fn tiles(
    asset: &mut Asset,
    options: &TilesOptions,
    details: &mut TilesDetails,
) -> Result<Outcome<()>> {
    if !options.tiles {
        return Ok(Outcome::Skipped("`tiles` was not asked for"));
    }
    if asset.tiles.is_some() {
        return Ok(Outcome::Skipped("the scene has tiles already"));
    }
    let levels = std::mem::take(&mut asset.levels);
    let mut finest = asset.mesh.clone();
    finest.split_off(asset.scene_faces());
    let cells = TileCells::new(&centroids(&finest), 2 * levels.len() as u32);
    let meshes = std::iter::once(finest).chain(levels.into_iter().map(|level| level.mesh));
    let levels: Vec<Level> =
        meshes.enumerate().map(|(i, mesh)| Level::new(mesh, &cells, i as u32)).collect();
    let root = tile(&levels, levels.len() - 1, 0);
    details.levels = levels.len() as u64;
    root.visit(&mut |tile| {
        details.tiles += u64::from(tile.mesh.face_count() > 0);
        details.most_triangles = details.most_triangles.max(tile.mesh.face_count() as u64);
    });
    asset.tiles = Some(Box::new(root));
    Ok(Outcome::Changed(()))
}

/// A level, its faces sorted by the cell they are in, then by material.
struct Level {
    mesh: Mesh,
    /// Cell and index of every face.
    faces: Vec<(u64, u32)>,
}

impl Level {
    fn new(mesh: Mesh, cells: &TileCells, level: u32) -> Self {
        let cell = |(face, centroid)| (cells.of(centroid) >> (2 * level), face);
        let mut faces: Vec<(u64, u32)> = (0..).zip(centroids(&mesh)).map(cell).collect();
        faces
            .par_sort_unstable_by_key(|(cell, face)| (*cell, mesh.material(*face as usize), *face));
        Self { mesh, faces }
    }

    /// The part of the mesh in a cell, of each material in the order of the mesh, which an engine's
    /// caches like.
    fn part(&self, cell: u64) -> Mesh {
        let from = self.faces.partition_point(|(other, _)| *other < cell);
        let to = self.faces.partition_point(|(other, _)| *other <= cell);
        let faces: Vec<u32> = self.faces[from..to].iter().map(|(_, face)| *face).collect();
        self.mesh.part(&faces)
    }
}

/// The tile of a cell, and those below it; the finest level is 0.
fn tile(levels: &[Level], level: usize, cell: u64) -> Tile {
    let children: Vec<Tile> = match level {
        0 => Vec::new(),
        _ => (0..4)
            .map(|i| tile(levels, level - 1, 4 * cell + i))
            .filter(|tile| !tile.is_empty())
            .collect(),
    };
    // An enlarged triangle may have its centroid where the scene itself has none: no finer tile
    // would replace it.
    let mesh =
        if level > 0 && children.is_empty() { Mesh::default() } else { levels[level].part(cell) };
    // A coarser tile leaves out at least as much as the finer tiles that it replaces.
    let below = children.iter().map(|tile| tile.error).fold(0.0, f64::max);
    let error = if level == 0 { 0.0 } else { Tile::error_of(mesh.detail()).max(below) };
    Tile { mesh, error, children }
}

/// The middle of every face. `[F]`
fn centroids(mesh: &Mesh) -> Vec<[f32; 3]> {
    parallel::collect(mesh.face_count(), GRAIN, |face| mesh.centroid(face).to_array())
}

// ---- Cuts space repeatedly into halves of equal count: a complete k-d tree ----------------------

/// The cells of a complete binary tree of cuts. The number of a cell is the path to it, one bit for
/// each cut, with the first cut highest.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TileCells {
    /// Axis and place of every cut; the cuts below cut i are 2 i + 1 and 2 i + 2. Points at a cut
    /// or above it are in the upper half.
    cuts: Vec<(u8, f32)>,
    depth: u32,
}

impl TileCells {
    /// Cuts `depth` times, each cell at the median of its points along the axis of their largest
    /// extent.
    pub(super) fn new(points: &[[f32; 3]], depth: u32) -> Self {
        let mut cuts = vec![(0, f32::INFINITY); (1 << depth) - 1];
        let mut points = points.to_vec();
        cut(&mut points, 0, &mut cuts);
        Self { cuts, depth }
    }

    /// The cell of a point.
    pub(super) fn of(&self, point: [f32; 3]) -> u64 {
        let mut at = 0;
        let mut cell = 0;
        for _ in 0..self.depth {
            let (axis, place) = self.cuts[at];
            let upper = u64::from(point[usize::from(axis)] >= place);
            cell = 2 * cell + upper;
            at = 2 * at + 1 + upper as usize;
        }
        cell
    }
}

fn cut(points: &mut [[f32; 3]], at: usize, cuts: &mut [(u8, f32)]) {
    if at >= cuts.len() || points.is_empty() {
        return;
    }
    let extent = |axis: usize| {
        let values = points.iter().map(|point| point[axis]);
        values.clone().fold(f32::NEG_INFINITY, f32::max) - values.fold(f32::INFINITY, f32::min)
    };
    let axis = (1..3).fold(0, |best, axis| if extent(axis) > extent(best) { axis } else { best });
    let middle = points.len() / 2;
    points.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis]));
    let place = points[middle][axis];
    cuts[at] = (axis as u8, place);
    // Points in the middle that also lie at the cut belong to the upper half.
    points.sort_unstable_by_key(|point| point[axis] >= place);
    let (lower, upper) = points.split_at_mut(points.partition_point(|point| point[axis] < place));
    cut(lower, 2 * at + 1, cuts);
    cut(upper, 2 * at + 2, cuts);
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::Rng;

    #[test]
    fn cells_hold_equal_counts_of_points_that_lie_apart() {
        let rng = Rng::new(2, "cells", 0);
        let points: Vec<[f32; 3]> = (0..4096)
            .map(|i| [0, 1, 2].map(|k| rng.uniform(3 * i + k) * [5.0, 1.0, 0.1][k as usize]))
            .collect();
        let cells = TileCells::new(&points, 4);
        let mut counts = [0; 16];
        for point in &points {
            counts[cells.of(*point) as usize] += 1;
        }
        assert!(counts.iter().all(|count| (250..=262).contains(count)), "{counts:?}");
        // The order of the points does not matter.
        let backwards: Vec<[f32; 3]> = points.iter().rev().copied().collect();
        assert_eq!(TileCells::new(&backwards, 4), cells);
    }

    #[test]
    fn equal_points_and_no_points_have_cells_too() {
        assert_eq!(TileCells::new(&[], 6).of([1.0; 3]), 0);
        let cells = TileCells::new(&[[1.0, 2.0, 3.0]; 50], 6);
        assert_eq!(cells.of([1.0, 2.0, 3.0]), cells.of([1.0, 2.0, 3.0]));
        assert_eq!(TileCells::new(&[[1.0; 3]; 9], 0).of([7.0; 3]), 0);
    }
}
