//! Extends the distances to where nothing was observed, so that the surface closes there, smoothly
//! (after Davis et al. 2002, "Filling holes in complex surfaces using volumetric diffusion"). What
//! pictures look through was observed to be free: it stays open.

use crate::fill::border;
use crate::fuse::{DistanceField, VoxelBlock};
use crate::grid::{Grid, SAMPLES, SIDE, block, offset_of};
use crate::nets::nets;
use glam::{IVec3, Vec3};
use trisplat_scene::math::lists::Sets;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::{Limits, Result};

/// Cells from a border up to which the surface may be closed; twice as many close no more
/// (docs/benchmarks/surface.md).
const REACH: u32 = 4;
const AROUND: [IVec3; 6] = [IVec3::X, IVec3::NEG_X, IVec3::Y, IVec3::NEG_Y, IVec3::Z, IVec3::NEG_Z];

/// A sample that nothing observed.
struct Unobserved {
    block: usize,
    local: usize,
    at: IVec3,
}

/// The surface of `field`, closed where nothing was observed; `fuse` makes the block of a number.
///
/// # Errors
///
/// More blocks than `limits` permit in an array.
pub(super) fn closed_nets(
    field: &mut DistanceField,
    grid: &Grid,
    limits: &Limits,
    fuse: impl Fn(u64) -> VoxelBlock + Sync,
) -> Result<Mesh> {
    let (observed, _) = nets(field, grid);
    let borders = border(&observed);
    let places = borders.keys().map(|vertex| observed.positions[*vertex as usize]);
    extend(field, grid, places, limits, fuse)?;
    let (mut mesh, extended) = nets(field, grid);
    drop_open(&mut mesh, &extended);
    Ok(mesh)
}

/// Gives the unobserved samples near `places` a distance and a colour: layer by layer from the
/// observed ones, each the mean of the samples beside it that have some.
fn extend(
    field: &mut DistanceField,
    grid: &Grid,
    places: impl Iterator<Item = Vec3>,
    limits: &Limits,
    fuse: impl Fn(u64) -> VoxelBlock + Sync,
) -> Result<()> {
    let mut near: Vec<u64> =
        places.flat_map(|place| grid.blocks_near(place, REACH as f32)).collect();
    near.sort_unstable();
    near.dedup();
    add_missing(field, &near, limits, fuse)?;
    let mut left = unobserved(field, &near);
    for _ in 0..REACH {
        let layer = parallel::collect(left.len(), GRAIN, |i| mean_around(field, left[i].at));
        for (sample, found) in left.iter().zip(&layer) {
            if let Some((distance, color)) = *found {
                field.blocks[sample.block].extend(sample.local, distance, color);
            }
        }
        let without = left.into_iter().zip(&layer).filter(|(_, found)| found.is_none());
        left = without.map(|(sample, _)| sample).collect();
    }
    Ok(())
}

/// Adds the blocks of these numbers, ascending, that `field` has not.
fn add_missing(
    field: &mut DistanceField,
    numbers: &[u64],
    limits: &Limits,
    fuse: impl Fn(u64) -> VoxelBlock + Sync,
) -> Result<()> {
    let is_missing = |number: &u64| field.numbers.binary_search(number).is_err();
    let missing: Vec<u64> = numbers.iter().copied().filter(is_missing).collect();
    let mut all = [&field.numbers[..], &missing].concat();
    all.sort_unstable();
    let mut blocks: Vec<VoxelBlock> = limits.zeroed("the distance field", all.len())?;
    parallel::for_each_mut(&mut blocks, 1, |i, block| {
        let had = field.numbers.binary_search(&all[i]);
        *block = had.map_or_else(|_| fuse(all[i]), |had| field.blocks[had]);
    });
    *field = DistanceField { numbers: all, blocks };
    Ok(())
}

/// The unobserved samples of the blocks of these numbers.
fn unobserved(field: &DistanceField, numbers: &[u64]) -> Vec<Unobserved> {
    let of_block = |index: usize| {
        let first = block(field.numbers[index]) * SIDE;
        let distances = &field.blocks[index].distance;
        let is_unobserved = |local: &usize| distances[*local].is_nan();
        let sample = move |local| Unobserved { block: index, local, at: first + offset_of(local) };
        (0..SAMPLES).filter(is_unobserved).map(sample)
    };
    let found = |number: &u64| field.numbers.binary_search(number).ok();
    numbers.iter().filter_map(found).flat_map(of_block).collect()
}

/// The mean distance and linear colour of the samples beside one; `None` where none has any.
fn mean_around(field: &DistanceField, at: IVec3) -> Option<(f32, Vec3)> {
    let mut distance = 0.0;
    let mut color = Vec3::ZERO;
    let mut count = 0.0;
    for neighbor in AROUND.map(|step| at + step) {
        let found = field.distance(neighbor);
        if !found.is_nan() {
            distance += found;
            color += field.color(neighbor);
            count += 1.0;
        }
    }
    (count > 0.0).then(|| (distance / count, color / count))
}

// ---- What the surface gains ---------------------------------------------------------------------

/// Drops the pieces of the extended surface (faces with a vertex in `extended`) that end in the
/// open, or touch nothing that was observed: they close nothing.
fn drop_open(mesh: &mut Mesh, extended: &[bool]) {
    let mut pieces = Sets::new(mesh.vertex_count());
    let new_of = |vertices: [u32; 3]| vertices.into_iter().filter(|v| extended[*v as usize]);
    for face in 0..mesh.face_count() {
        let mut new = new_of(mesh.face(face));
        if let Some(first) = new.next() {
            new.for_each(|other| pieces.join(first, other));
        }
    }
    let mut is_open = vec![false; mesh.vertex_count()];
    let mut touches_observed = vec![false; mesh.vertex_count()];
    for (vertex, others) in border(mesh) {
        for vertex in others.into_iter().chain([vertex]) {
            is_open[pieces.first(vertex) as usize] = true;
        }
    }
    for vertices in (0..mesh.face_count()).map(|face| mesh.face(face)) {
        if vertices.iter().any(|vertex| !extended[*vertex as usize]) {
            new_of(vertices).for_each(|v| touches_observed[pieces.first(v) as usize] = true);
        }
    }
    let closes = |vertex: u32| {
        let piece = pieces.first(vertex) as usize;
        !is_open[piece] && touches_observed[piece]
    };
    let closes: Vec<bool> = (0..mesh.vertex_count() as u32).map(closes).collect();
    let stays: Vec<bool> = (0..mesh.face_count())
        .map(|face| new_of(mesh.face(face)).all(|vertex| closes[vertex as usize]))
        .collect();
    mesh.retain(|face| stays[face]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::number;
    use crate::options::SurfaceOptions;
    use trisplat_scene::mesh::Colors;

    const BLOCKS: i32 = 4;

    fn grid() -> Grid {
        let side = (BLOCKS * SIDE) as f32;
        let options = SurfaceOptions { voxel: Some(1.0), ..SurfaceOptions::DEFAULT };
        // A margin is added.
        let box_of_samples = [Vec3::ZERO, Vec3::splat(side / 1.2 - 0.1)];
        Grid::over(&[], Some(box_of_samples), &options).unwrap().unwrap()
    }

    /// Distances by their samples; NaN: not observed.
    fn field(distance: impl Fn(Vec3) -> f32) -> DistanceField {
        let block_at = |i: i32| IVec3::new(i, i / BLOCKS, i / (BLOCKS * BLOCKS)) % BLOCKS;
        let numbers: Vec<u64> = (0..BLOCKS.pow(3)).map(|i| number(block_at(i))).collect();
        let of_block = |of: &u64| {
            let mut made = VoxelBlock::UNOBSERVED;
            for local in 0..SAMPLES {
                let at = (block(*of) * SIDE + offset_of(local)).as_vec3();
                made.distance[local] = distance(at);
                made.rgb[local] = [200, 0, 0];
            }
            made
        };
        let blocks = numbers.iter().map(of_block).collect();
        DistanceField { numbers, blocks }
    }

    /// The surface as observed, and with what closes it.
    fn surfaces(mut field: DistanceField) -> [Mesh; 2] {
        let grid = grid();
        let (observed, _) = nets(&field, &grid);
        let unobserved = |_| VoxelBlock::UNOBSERVED;
        let closed = closed_nets(&mut field, &grid, &Limits::DEFAULT, unobserved).unwrap();
        [observed, closed]
    }

    /// Distance to a ball of 9 samples in the middle.
    fn ball(at: Vec3) -> f32 {
        at.distance(Vec3::splat(15.3)) - 9.0
    }

    #[test]
    fn what_nothing_observed_is_closed_smoothly_in_the_color_around_it() {
        let is_hole = |at: Vec3| at.z > 15.0 && (at - 15.0).truncate().length() < 3.0;
        let [observed, closed] =
            surfaces(field(|at| if is_hole(at) { f32::NAN } else { ball(at) }));
        assert!(!border(&observed).is_empty());
        assert!(border(&closed).is_empty());
        let origin = grid().origin;
        let error = |at: &Vec3| ball(*at - origin).abs();
        let worst = closed.positions.iter().map(error).fold(0.0, f32::max);
        assert!(worst < 1.0, "{worst} cells from the ball");
        let Colors::Vertex(colors) = &closed.colors else { panic!("colours of vertices") };
        assert!(colors.iter().all(|color| color[0] > 0.5 && color[1] == 0.0));
    }

    #[test]
    fn what_was_seen_to_be_free_and_what_ends_in_the_open_stay() {
        // Free along an axis through the ball, which becomes a ring.
        let free = |at: Vec3| (at - 15.3).truncate().length() < 2.0;
        let [observed, closed] = surfaces(field(|at| if free(at) { 1.0 } else { ball(at) }));
        assert_eq!(observed.face_count(), closed.face_count());
        let [observed, closed] =
            surfaces(field(|at| if at.x > 15.0 { f32::NAN } else { at.z - 15.3 }));
        assert!(!border(&observed).is_empty());
        assert_eq!(observed.face_count(), closed.face_count(), "a sheet does not grow");
    }
}
