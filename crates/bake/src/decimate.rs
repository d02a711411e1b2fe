//! Decimation: which triangles to drop, and how the others cover the gaps.
//!
//! The importance of a triangle is the error of the picture without it: the squared differences
//! between its colour and the colour behind it, summed over the samples that it covers. It is
//! measured by rendering the scene without some of its triangles, chosen at random. Each of several
//! rounds drops the least important share, because triangles behind others may be gone in the next
//! round.
//!
//! Then the remaining triangles cover the gaps. In every round each tries to move one corner at
//! random, outwards or inwards and sideways. It keeps the move if the picture comes closer to that
//! of the whole scene.
//!
//! Without cameras only size decides: see [`rank_by_size`] and [`enlarge`].

use super::trial::with_moved_corner;
use compare::{Comparison, Round};
use glam::Vec3;
use rayon::prelude::*;
use std::collections::HashMap;
use trisplat_scene::Rng;
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::StageProgress;

mod compare;

/// Share of the triangles left after a round.
const ROUND_SHARE: f64 = 0.84;
/// Cameras that draw in a ranking round: the visible area of every triangle in all cameras is known
/// before.
const RANK_VIEWS: usize = 16;
/// Rounds in which every triangle tries one move. A third of the rounds with three moves each takes
/// two thirds of the time, and a scene of an eighth of the triangles loses 0.16 dB (few photos per
/// round; commit 0aeadf69). With half of the rounds such a scene loses up to 1 dB, one of half the
/// triangles up to 0.1 (commit 751a9c64).
const MOVE_ROUNDS: u32 = 16;
/// Cameras that draw in a round of moves. With 12, moves help those and harm most other pictures.
const MOVE_VIEWS: usize = 24;

/// Decimation by the cameras' pictures. One decimation serves all levels of a scene, because it
/// keeps the pictures of the whole scene.
pub struct Decimation<'a> {
    mesh: &'a Mesh,
    comparison: Comparison<'a>,
    /// Faces that are never dropped or moved; empty for none. `[F]`
    protected: &'a [bool],
}

impl<'a> Decimation<'a> {
    /// Of `mesh`, as `cameras` see it.
    pub fn new(mesh: &'a Mesh, cameras: &[Camera]) -> Self {
        Self { mesh, comparison: Comparison::new(mesh, cameras), protected: &[] }
    }

    /// The same, but some faces are never dropped or moved. `[F]`
    pub fn protecting(self, protected: &'a [bool]) -> Self {
        Self { protected, ..self }
    }

    fn is_protected(&self, face: u32) -> bool {
        self.protected.get(face as usize).copied().unwrap_or(false)
    }

    /// `faces`, all of them visible and in any order, ordered so that the first n of them are the n
    /// best to keep, for every n from `min_faces` on. `visible_px` is the visible area of every
    /// face of the mesh. `[F]`
    pub fn rank_by_importance(
        &mut self,
        visible_px: &[f32],
        faces: &[u32],
        min_faces: usize,
        mut progress: StageProgress<'_>,
    ) -> Vec<u32> {
        let mut kept = faces.to_vec();
        kept.sort_unstable();
        let mut dropped = Vec::new();
        // Rounds cost in proportion to the faces left.
        let all = faces.len().max(1);
        let to_drop = all - min_faces.clamp(1, all);
        for round in 0.. {
            progress.set(all - kept.len(), to_drop);
            let keep = ((kept.len() as f64 * ROUND_SHARE) as usize).max(min_faces);
            let round = Round { number: round, views: RANK_VIEWS };
            let mut importance = self.comparison.importance(&kept, visible_px, round);
            for (importance, face) in importance.iter_mut().zip(&kept) {
                if self.is_protected(*face) {
                    *importance = f64::INFINITY;
                }
            }
            let mut order: Vec<usize> = (0..kept.len()).collect();
            order
                .sort_unstable_by(|&a, &b| importance[b].total_cmp(&importance[a]).then(a.cmp(&b)));
            let sorted: Vec<u32> = order.iter().map(|&i| kept[i]).collect();
            let is_last = keep <= min_faces || keep >= sorted.len();
            dropped.extend(sorted[if is_last { 0 } else { keep }..].iter().rev());
            if is_last {
                break;
            }
            kept = sorted[..keep].to_vec();
            kept.sort_unstable();
        }
        dropped.reverse();
        dropped
    }

    /// Moves corners of `faces` where this brings pictures closer to those with all faces. A mesh
    /// with shared vertices is left unchanged.
    pub fn move_corners(&mut self, faces: &[u32], mut progress: StageProgress<'_>) -> MovedCorners {
        let mut kept = faces.to_vec();
        kept.sort_unstable();
        let mut corners: Vec<[Vec3; 3]> =
            kept.iter().map(|&f| self.mesh.corners(f as usize)).collect();
        let mut moves = 0;
        let rounds = if self.mesh.indices.is_empty() { MOVE_ROUNDS } else { 0 };
        for round in 0..rounds {
            progress.set(round as usize, rounds as usize);
            let moved = |(c, f): (&[Vec3; 3], &u32)| {
                if self.is_protected(*f) { *c } else { with_moved_corner(*c, *f, round) }
            };
            let moved: Vec<[Vec3; 3]> = corners.iter().zip(&kept).map(moved).collect();
            let round = Round { number: round, views: MOVE_VIEWS };
            let effects = self.comparison.effects_of_moving(&kept, &corners, &moved, round);
            for ((corners, moved), effect) in corners.iter_mut().zip(moved).zip(effects) {
                if effect.error_change < 0.0 {
                    *corners = moved;
                    moves += 1;
                }
            }
        }
        MovedCorners { faces: kept, corners, moves }
    }
}

/// The present corners of the faces.
#[derive(Debug, Clone, PartialEq)]
pub struct MovedCorners {
    faces: Vec<u32>,
    corners: Vec<[Vec3; 3]>,
    /// Number of moved corners.
    pub moves: u64,
}

impl MovedCorners {
    /// Moves the corners of the faces in `mesh`, that of the decimation or a copy of it.
    pub fn apply(&self, mesh: &mut Mesh) {
        if self.moves > 0 {
            for (&face, corners) in self.faces.iter().zip(&self.corners) {
                mesh.positions[3 * face as usize..3 * face as usize + 3].copy_from_slice(corners);
            }
        }
    }
}

// ---- Without cameras: the largest triangles stay, enlarged over the gaps ------------------------

/// About how many kept triangles a neighbourhood holds.
const PER_CELL: u32 = 24;
/// Largest factor by which a triangle is enlarged.
const MAX_ENLARGEMENT: f64 = 2.0;

/// All faces, sorted by opacity times area, largest first. Equal ones come in random order, because
/// the order of the file would clear whole corners of the scene. `[F]`
pub fn rank_by_size(mesh: &Mesh) -> Vec<u32> {
    let size = |f: usize| mesh.area(f) * f64::from(mesh.opacity.get(f).copied().unwrap_or(1.0));
    let sizes: Vec<f64> = (0..mesh.face_count()).map(size).collect();
    let mut order: Vec<u32> = (0..sizes.len() as u32).collect();
    let draw = Rng::new(0, "size", 0);
    order.par_sort_unstable_by(|&a, &b| {
        let at_random = || draw.bits(a.into()).cmp(&draw.bits(b.into()));
        sizes[b as usize].total_cmp(&sizes[a as usize]).then_with(at_random)
    });
    order
}

/// Scales the faces `kept` about their centroids, so that those of a neighbourhood have the area of
/// all faces there before. A mesh with shared vertices is left unchanged.
pub fn enlarge(mesh: &mut Mesh, kept: &[u32]) {
    if !mesh.indices.is_empty() {
        return;
    }
    let centroids: Vec<Vec3> = kept.iter().map(|&f| mesh.centroid(f as usize)).collect();
    let grid = CellGrid::new(&centroids);
    let all = grid.areas(mesh, 0..mesh.face_count());
    let left = grid.areas(mesh, kept.iter().map(|&f| f as usize));
    for (&f, centroid) in kept.iter().zip(&centroids) {
        let cell = grid.cell_of(*centroid);
        let [all, left] = [&all, &left].map(|sums| sums.get(&cell).copied().unwrap_or(0.0));
        if left > 0.0 {
            let factor = (all / left).sqrt().clamp(1.0, MAX_ENLARGEMENT) as f32;
            let enlarged = mesh.corners(f as usize).map(|v| centroid + (v - centroid) * factor);
            if enlarged.iter().all(|v| v.is_finite()) {
                mesh.positions[3 * f as usize..3 * f as usize + 3].copy_from_slice(&enlarged);
            }
        }
    }
}

/// Cubic cells of space that hold some dozen triangles each.
struct CellGrid {
    origin: Vec3,
    /// Edge of a cell.
    cell_size: f32,
}

impl CellGrid {
    fn new(points: &[Vec3]) -> Self {
        let at = |share: f64| ((points.len().max(1) - 1) as f64 * share) as usize;
        let extent = |a: usize, share: f64| {
            let mut along: Vec<f32> = points.iter().map(|p| p[a]).collect();
            if along.is_empty() {
                0.0
            } else {
                *along.select_nth_unstable_by(at(share), f32::total_cmp).1
            }
        };
        let low = Vec3::from([0, 1, 2].map(|a| extent(a, 0.05)));
        let high = Vec3::from([0, 1, 2].map(|a| extent(a, 0.95)));
        // Triangles fill surfaces, not volumes.
        let size = (high - low).max_element().max(f32::MIN_POSITIVE);
        Self {
            origin: low,
            cell_size: size * (f64::from(PER_CELL) / points.len().max(1) as f64).sqrt() as f32,
        }
    }

    fn cell_of(&self, point: Vec3) -> [i32; 3] {
        ((point - self.origin) / self.cell_size).floor().as_ivec3().to_array()
    }

    /// Area of some faces in every cell.
    fn areas(&self, mesh: &Mesh, faces: impl Iterator<Item = usize>) -> HashMap<[i32; 3], f64> {
        let mut sums = HashMap::new();
        for face in faces {
            *sums.entry(self.cell_of(mesh.centroid(face))).or_default() += mesh.area(face);
        }
        sums
    }
}
