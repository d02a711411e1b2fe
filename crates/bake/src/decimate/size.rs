//! Without cameras: triangles are ranked by their size, and the remaining ones are enlarged to cover their
//! neighbourhood.

use glam::Vec3;
use rayon::prelude::*;
use std::collections::HashMap;
use trisplat_scene::{Rng, mesh::Mesh};

/// About how many kept triangles a neighbourhood holds.
const PER_CELL: u32 = 24;
/// Largest factor by which a triangle is enlarged.
const MOST_ENLARGED: f64 = 2.0;

/// All faces, sorted by opacity times area, largest first. Equal ones come in random order, because the order
/// of the file would clear whole corners of the scene. `[F]`
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

/// Scales the faces `kept` about their centroids, so that those of a neighbourhood have the area of all faces
/// there before. A mesh with shared vertices is left unchanged.
pub fn enlarge(mesh: &mut Mesh, kept: &[u32]) {
    if !mesh.indices.is_empty() {
        return;
    }
    let centroids: Vec<Vec3> = kept.iter().map(|&f| mesh.centroid(f as usize)).collect();
    let grid = CellGrid::new(&centroids);
    let all = grid.areas(mesh, 0..mesh.face_count());
    let left = grid.areas(mesh, kept.iter().map(|&f| f as usize));
    for (&f, centroid) in kept.iter().zip(&centroids) {
        let cell = grid.of(*centroid);
        let [all, left] = [&all, &left].map(|sums| sums.get(&cell).copied().unwrap_or(0.0));
        if left > 0.0 {
            let factor = (all / left).sqrt().clamp(1.0, MOST_ENLARGED) as f32;
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
    cell: f32,
}

impl CellGrid {
    fn new(points: &[Vec3]) -> Self {
        let at = |share: f64| ((points.len().max(1) - 1) as f64 * share) as usize;
        let extent = |a: usize, share: f64| {
            let mut along: Vec<f32> = points.iter().map(|p| p[a]).collect();
            if along.is_empty() { 0.0 } else { *along.select_nth_unstable_by(at(share), f32::total_cmp).1 }
        };
        let low = Vec3::from([0, 1, 2].map(|a| extent(a, 0.05)));
        let high = Vec3::from([0, 1, 2].map(|a| extent(a, 0.95)));
        // Triangles fill surfaces, not volumes.
        let size = (high - low).max_element().max(f32::MIN_POSITIVE);
        Self { origin: low, cell: size * (f64::from(PER_CELL) / points.len().max(1) as f64).sqrt() as f32 }
    }

    fn of(&self, point: Vec3) -> [i32; 3] {
        ((point - self.origin) / self.cell).floor().as_ivec3().to_array()
    }

    /// Area of some faces in every cell.
    fn areas(&self, mesh: &Mesh, faces: impl Iterator<Item = usize>) -> HashMap<[i32; 3], f64> {
        let mut sums = HashMap::new();
        faces.for_each(|f| *sums.entry(self.of(mesh.centroid(f))).or_default() += mesh.area(f));
        sums
    }
}
