//! The lattice that distances are kept on: where its samples lie, and which block holds which.

use crate::options::SurfaceOptions;
use crate::picture::DepthPicture;
use glam::{IVec3, Vec3};
use rayon::prelude::*;
use trisplat_scene::math::lists::median;
use trisplat_scene::{Error, Result, parallel};

/// Samples along a side of a block.
pub(super) const SIDE: i32 = 8;
/// Samples of a block.
pub(super) const SAMPLES: usize = (SIDE * SIDE * SIDE) as usize;
/// Points that the size of the scene is measured on.
const POINTS: usize = 200_000;
/// Points this many times as far from their camera as the median one are surroundings.
const FAR: f32 = 2.0;
/// The box is that between these quantiles of the others along each axis, ...
const INSIDE: f32 = 0.03;
/// ... grown on each side by this share of its longest side.
const MARGIN: f32 = 0.1;
/// Bits of a block's number along an axis.
const BITS: u32 = 21;

/// A lattice over a box of the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Grid {
    /// Position of sample (0, 0, 0).
    pub(super) origin: Vec3,
    /// Distance between samples.
    pub(super) voxel: f32,
    /// Blocks along each axis.
    blocks: IVec3,
}

impl Grid {
    /// Over a box, or over what `pictures` see, without what is seen far off by few of their
    /// pixels; `None` when they see nothing.
    ///
    /// # Errors
    ///
    /// Cells so small that a block has no number.
    pub(super) fn over(
        pictures: &[DepthPicture],
        bounds: Option<[Vec3; 2]>,
        options: &SurfaceOptions,
    ) -> Result<Option<Self>> {
        let bounds = bounds.map(|[low, high]| grown(low, high));
        let Some((low, high)) = bounds.or_else(|| extent(pictures)) else { return Ok(None) };
        let longest = (high - low).max_element();
        let voxel = options.voxel.map_or(longest / options.cells() as f32, |voxel| voxel as f32);
        if !(voxel > 0.0) {
            return Ok(None);
        }
        let blocks = ((high - low) / (voxel * SIDE as f32)).ceil().max(Vec3::ONE);
        if !(blocks.max_element() < (1 << BITS) as f32) {
            let wants = format!("a longer side: what the cameras see is {longest} wide");
            return Err(Error::invalid("voxel", voxel, wants));
        }
        Ok(Some(Self { origin: low, voxel, blocks: blocks.as_ivec3() }))
    }

    /// Position of a sample.
    pub(super) fn sample(&self, at: IVec3) -> Vec3 {
        self.origin + at.as_vec3() * self.voxel
    }

    /// The blocks that hold a sample nearer to `point` than `cells` along each axis.
    pub(super) fn blocks_near(&self, point: Vec3, cells: f32) -> impl Iterator<Item = u64> + use<> {
        let at = (point - self.origin) / (self.voxel * SIDE as f32);
        let reach = Vec3::splat(cells / SIDE as f32);
        let low = (at - reach).floor().as_ivec3().max(IVec3::ZERO);
        let high = (at + reach).floor().as_ivec3().min(self.blocks - 1);
        let run = |a: i32, b: i32| a..=b;
        run(low.z, high.z).flat_map(move |z| {
            run(low.y, high.y)
                .flat_map(move |y| run(low.x, high.x).map(move |x| number(IVec3::new(x, y, z))))
        })
    }
}

/// The number of a block; blocks in order of their numbers are in order of z, y, x.
pub(super) fn number(block: IVec3) -> u64 {
    block.x as u64 | (block.y as u64) << BITS | (block.z as u64) << (2 * BITS)
}

/// The block of a number.
pub(super) fn block(number: u64) -> IVec3 {
    let along = |axis: u32| (number >> (axis * BITS)) as i32 & ((1 << BITS) - 1);
    IVec3::new(along(0), along(1), along(2))
}

/// (block index, index in block) of a sample; `None` before the first block.
pub(super) fn place(sample: IVec3) -> Option<(u64, usize)> {
    let offset = sample & (SIDE - 1);
    let local = offset.x + SIDE * (offset.y + SIDE * offset.z);
    (sample.min_element() >= 0).then(|| (number(sample >> SIDE.ilog2() as i32), local as usize))
}

/// The offset of a sample from the first of its block, by its index in the block.
pub(super) fn offset_of(local: usize) -> IVec3 {
    let local = local as i32;
    IVec3::new(local % SIDE, local / SIDE % SIDE, local / (SIDE * SIDE))
}

/// The box around most of what is seen near by.
fn extent(pictures: &[DepthPicture]) -> Option<(Vec3, Vec3)> {
    let pixels: usize = pictures.iter().map(|picture| picture.depth.len()).sum();
    let step = (pixels / POINTS).max(1) | 1;
    let of_picture = |picture: &DepthPicture| -> Vec<(f32, Vec3)> {
        let depth_and_point = |pixel: usize| Some((picture.depth[pixel], picture.point(pixel)?));
        (0..picture.depth.len()).step_by(step).filter_map(depth_and_point).collect()
    };
    let observations: Vec<(f32, Vec3)> = pictures.iter().flat_map(of_picture).collect();
    let far = FAR * median(observations.iter().map(|(depth, _)| *depth).collect(), f32::total_cmp)?;
    let points: Vec<Vec3> =
        observations.into_iter().filter(|(depth, _)| *depth <= far).map(|(_, p)| p).collect();
    let last = points.len().checked_sub(1)?;
    let mut low = Vec3::ZERO;
    let mut high = Vec3::ZERO;
    for axis in 0..3 {
        let mut along: Vec<f32> = points.iter().map(|p| p[axis]).collect();
        along.sort_unstable_by(f32::total_cmp);
        low[axis] = along[(last as f32 * INSIDE) as usize];
        high[axis] = along[(last as f32 * (1.0 - INSIDE)) as usize];
    }
    Some(grown(low, high))
}

/// The box with a margin.
fn grown(low: Vec3, high: Vec3) -> (Vec3, Vec3) {
    let margin = Vec3::splat((high - low).max_element() * MARGIN);
    (low - margin, high + margin)
}

// ---- Which blocks of the lattice a surface runs through -----------------------------------------

/// Samples this near to a point of the surface, in cells, are needed: a cell that the surface runs
/// through has corners up to one cell from it, and pixels lie up to one cell apart.
const REACH: f32 = 2.0;

/// The numbers of the blocks near what `pictures` see, in ascending order.
pub(super) fn blocks(pictures: &[DepthPicture], grid: &Grid) -> Vec<u64> {
    let of_picture = |picture: &DepthPicture| {
        let mut numbers = Vec::new();
        let mut last = [u64::MAX; 8];
        for pixel in 0..picture.depth.len() {
            let Some(point) = picture.point(pixel) else { continue };
            // Neighbouring pixels mostly need the same blocks.
            for (number, last) in grid.blocks_near(point, REACH).zip(&mut last) {
                if *last != number {
                    *last = number;
                    numbers.push(number);
                }
            }
        }
        numbers.sort_unstable();
        numbers.dedup();
        numbers
    };
    let mut all: Vec<u64> = parallel::map(pictures, |_, picture| of_picture(picture)).concat();
    all.par_sort_unstable();
    all.dedup();
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_and_samples_have_their_numbers() {
        for at in [IVec3::ZERO, IVec3::new(7, 8, 9), IVec3::new(1000, 3, 16_000_000)] {
            let (of, local) = place(at).unwrap();
            assert_eq!(block(of) * SIDE + offset_of(local), at);
        }
        assert_eq!(place(IVec3::new(0, -1, 0)), None);
    }

    #[test]
    fn blocks_near_a_point_hold_the_samples_around_it() {
        let grid = Grid { origin: Vec3::splat(-1.0), voxel: 0.1, blocks: IVec3::splat(4) };
        let near: Vec<IVec3> =
            grid.blocks_near(Vec3::new(-0.25, -0.6, -0.6), 2.0).map(block).collect();
        assert_eq!(near, [IVec3::ZERO, IVec3::X]);
        assert_eq!(grid.blocks_near(Vec3::splat(99.0), 2.0).count(), 0, "outside");
    }
}
