//! The forward pass's results for a tile's pixels, for the frame and the backward pass.

use super::tile_grid::BLOCKS;
use trisplat_scene::math::lanes::LANES;

/// One channel of a tile: a number per pixel, block by block.
pub(super) type TileChannel = [[f32; LANES]; BLOCKS];

/// The pixels of a tile.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub(super) struct TilePixels {
    pub(super) transmittance: TileChannel,
    pub(super) rgb: [TileChannel; 3],
    /// Blocks with a pixel that has not terminated, one bit each.
    pub(super) alive: u32,
    /// Pixels that count for the importance of triangles, one bit each.
    pub(super) counted: [u16; BLOCKS],
    pub(super) geometry: Option<Box<TileGeometry>>,
}

/// Depth, normal and distortion of a tile's pixels.
#[derive(Debug, Clone)]
pub(super) struct TileGeometry {
    pub(super) depth: TileChannel,
    pub(super) median: TileChannel,
    pub(super) normal: [TileChannel; 3],
    pub(super) distortion: TileChannel,
    /// Mapped depth of the first layer: the others are relative to it, which only changes rounding.
    pub(super) anchor: TileChannel,
    /// Σ w, Σ w m, Σ w m².
    pub(super) sums: [TileChannel; 3],
}

/// A channel of zeros.
pub(super) const BLANK: TileChannel = [[0.0; LANES]; BLOCKS];

impl Default for TilePixels {
    fn default() -> Self {
        Self { transmittance: BLANK, rgb: [BLANK; 3], alive: 0, counted: [u16::MAX; BLOCKS], geometry: None }
    }
}

impl TileGeometry {
    pub(super) fn blank() -> Self {
        Self {
            depth: BLANK,
            median: BLANK,
            normal: [BLANK; 3],
            distortion: BLANK,
            anchor: BLANK,
            sums: [BLANK; 3],
        }
    }
}
