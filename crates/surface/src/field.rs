//! The distance field: blocks of samples.

use super::grid::{SAMPLES, place};
use bytemuck::{Pod, Zeroable};
use glam::{IVec3, Vec3};
use trisplat_scene::math::color::linear_from_srgb;

/// Samples of a block.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Block {
    /// Signed distance, units of the scene; NaN where nothing was observed.
    pub(super) distance: [f32; SAMPLES],
    /// sRGB codes.
    pub(super) rgb: [[u8; 3]; SAMPLES],
}

impl Block {
    pub(super) const UNOBSERVED: Self = Self { distance: [f32::NAN; SAMPLES], rgb: [[0; 3]; SAMPLES] };
}

/// A sparse lattice of distances.
#[derive(Debug)]
pub(super) struct Field {
    /// Numbers of the blocks, ascending.
    pub(super) numbers: Vec<u64>,
    /// One block for each number.
    pub(super) blocks: Vec<Block>,
}

impl Field {
    /// Where a sample is: the index of its block and its place there.
    pub(super) fn find(&self, sample: IVec3) -> Option<(usize, usize)> {
        let (number, local) = place(sample)?;
        Some((self.numbers.binary_search(&number).ok()?, local))
    }

    /// Signed distance at a sample; NaN where nothing was observed.
    pub(super) fn distance(&self, sample: IVec3) -> f32 {
        self.find(sample).map_or(f32::NAN, |(block, local)| self.blocks[block].distance[local])
    }

    /// Linear colour at a sample that was observed.
    pub(super) fn color(&self, sample: IVec3) -> Vec3 {
        let code = self.find(sample).map_or([0; 3], |(block, local)| self.blocks[block].rgb[local]);
        Vec3::from(code.map(|code| linear_from_srgb(f32::from(code) / 255.0)))
    }
}
