//! Signed distances from what the pictures saw: positive before the surface, negative behind it.

use crate::grid::{Grid, SAMPLES, SIDE, block, offset_of, place};
use crate::picture::{DepthPicture, FREE, ViewFrustum};
use bytemuck::{Pod, Zeroable};
use glam::{IVec3, Vec3};
use std::sync::LazyLock;
use trisplat_scene::math::color::{linear_from_srgb, srgb8_from_linear};

/// Relative weight of rays that pass far before a surface: at outlines they pass near a surface
/// that they do not hit, and between unconnected triangles through one. With more, half of a
/// shining table is eaten away (docs/benchmarks/surface.md).
const PASSING: f32 = 0.02;
/// Distances behind a surface count fully up to this share of the truncation.
const BEHIND: f32 = 0.25;
/// Linear light of every code.
static LINEAR: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|code| linear_from_srgb(code as f32 / 255.0)));

/// Parameters of the fusion of distances.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fusion {
    pub(super) grid: Grid,
    /// Largest distance, units of the scene.
    pub(super) truncation: f32,
    /// Pictures that must have seen a sample.
    pub(super) min_views: u32,
}

/// Sums over the pictures, for one sample.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    distance: f32,
    weight: f32,
    views: u32,
    color: Vec3,
    color_weight: f32,
}

impl Fusion {
    /// The samples of the block of this number. Pictures are taken in their order, so the sums do
    /// not depend on threads.
    pub(super) fn block(&self, number: u64, observers: &[ViewFrustum<'_>]) -> VoxelBlock {
        let first = block(number) * SIDE;
        let side = self.grid.voxel * SIDE as f32;
        let center = self.grid.sample(first) + side / 2.0;
        let radius = side * 0.5 * 3f32.sqrt();
        let mut sums = [Sums::default(); SAMPLES];
        for observer in observers.iter().filter(|observer| observer.sees(center, radius)) {
            for (local, sums) in sums.iter_mut().enumerate() {
                self.observe(observer.picture, self.grid.sample(first + offset_of(local)), sums);
            }
        }
        self.finish(&sums)
    }

    /// Adds a picture's observation of a sample.
    fn observe(&self, picture: &DepthPicture, sample: Vec3, sums: &mut Sums) {
        let q = picture.to_camera(sample);
        let Some(observation) = picture.observe(q, self.truncation) else { return };
        let distance = if observation.depth == FREE {
            FREE
        } else {
            (observation.depth - q.z) * observation.slant
        };
        if distance < -self.truncation {
            return;
        }
        let weight = picture.weight * observation.weight * self.trust(distance);
        sums.distance += weight * distance.min(self.truncation);
        sums.weight += weight;
        sums.views += 1;
        if distance < self.truncation {
            let color = picture.rgb[observation.pixel].map(|code| LINEAR[usize::from(code)]);
            // On a slanted ray the colour is that of a place beside the sample.
            let weight = weight * observation.weight;
            sums.color += weight * Vec3::from(color);
            sums.color_weight += weight;
        }
    }

    /// Weight of a distance, from 0 to 1. A ray is free up to where it ends; it says less and
    /// less of what is behind, and little of a surface that it passes.
    fn trust(&self, distance: f32) -> f32 {
        if distance >= self.truncation {
            return PASSING;
        }
        // Behind an edge is soon free space again, which other rays see; depths that differ from
        // picture to picture must count alike.
        let trust = (1.0 + distance / self.truncation) / (1.0 - BEHIND);
        trust.min(1.0).powi(4)
    }

    fn finish(&self, sums: &[Sums; SAMPLES]) -> VoxelBlock {
        let mut block = VoxelBlock::UNOBSERVED;
        for (local, sums) in sums.iter().enumerate() {
            if sums.views >= self.min_views {
                block.distance[local] = sums.distance / sums.weight;
            }
            if sums.color_weight > 0.0 {
                block.rgb[local] =
                    (sums.color / sums.color_weight).to_array().map(srgb8_from_linear);
            }
        }
        block
    }
}

// ---- The distance field: blocks of samples ------------------------------------------------------

/// Samples of a block.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct VoxelBlock {
    /// Signed distance, units of the scene; NaN where nothing was observed.
    pub(super) distance: [f32; SAMPLES],
    /// sRGB codes.
    pub(super) rgb: [[u8; 3]; SAMPLES],
    /// A bit per sample whose distance was not observed, but extended from those beside it.
    extended: [u64; SAMPLES / 64],
}

impl VoxelBlock {
    pub(super) const UNOBSERVED: Self =
        Self { distance: [f32::NAN; SAMPLES], rgb: [[0; 3]; SAMPLES], extended: [0; SAMPLES / 64] };

    /// Gives an unobserved sample a distance and a linear colour.
    pub(super) fn extend(&mut self, local: usize, distance: f32, color: Vec3) {
        self.distance[local] = distance;
        self.rgb[local] = color.to_array().map(srgb8_from_linear);
        self.extended[local / 64] |= 1 << (local % 64);
    }
}

/// A sparse lattice of distances.
#[derive(Debug)]
pub(super) struct DistanceField {
    /// Numbers of the blocks, ascending.
    pub(super) numbers: Vec<u64>,
    /// One block for each number.
    pub(super) blocks: Vec<VoxelBlock>,
}

impl DistanceField {
    /// Index of a sample's block, and its place there.
    pub(super) fn find(&self, sample: IVec3) -> Option<(usize, usize)> {
        let (number, local) = place(sample)?;
        Some((self.numbers.binary_search(&number).ok()?, local))
    }

    /// Signed distance at a sample; NaN where nothing was observed.
    pub(super) fn distance(&self, sample: IVec3) -> f32 {
        self.find(sample).map_or(f32::NAN, |(block, local)| self.blocks[block].distance[local])
    }

    /// Linear colour at a sample with a distance.
    pub(super) fn color(&self, sample: IVec3) -> Vec3 {
        let code = self.find(sample).map_or([0; 3], |(block, local)| self.blocks[block].rgb[local]);
        Vec3::from(code.map(|code| LINEAR[usize::from(code)]))
    }

    /// True if a sample's distance was not observed, but extended.
    pub(super) fn is_extended(&self, sample: IVec3) -> bool {
        self.find(sample).is_some_and(|(block, local)| {
            self.blocks[block].extended[local / 64] >> (local % 64) & 1 == 1
        })
    }
}
