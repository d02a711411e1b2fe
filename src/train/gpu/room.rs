//! Everything on the card that lives for one step only, and how much of it there is room for.

use super::scene::REMEDY;
use super::source::{GROUP, RADIX, SCAN_ITEMS, SORT_ITEMS};
use super::uniform::{SLOT_NUMBERS, StepPlan};
use crate::error::Result;
use crate::gpu::Gpu;
use crate::gpu::storage::storage;
use crate::raster::soft::{TILE, tile_count};
use glam::UVec2;
use wgpu::Buffer;

/// How much of everything there is room for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct RoomSize {
    pub(super) triangles: u32,
    pub(super) splats: u32,
    /// Pairs of splats and tiles.
    pub(super) pairs: u32,
    /// Layers of pixels that have an order of their own.
    pub(super) layers: u32,
    pub(super) frame_pixels: u32,
    pub(super) photo_pixels: u32,
    /// Tiles of the frame, or of the photo if it has more.
    pub(super) tiles: u32,
    pub(super) slot_numbers: u32,
    /// Depth planes are needed.
    pub(super) planes: bool,
    /// Depth, normals and distortion are needed.
    pub(super) geometry: bool,
}

impl RoomSize {
    /// What a plain step of `triangles` needs, for a frame and a photo of these sizes.
    pub(super) fn new(triangles: u32, frame: UVec2, photo: UVec2) -> Self {
        Self {
            triangles,
            splats: triangles.saturating_add(triangles / 64).saturating_add(GROUP),
            pairs: 0,
            layers: 0,
            frame_pixels: frame.element_product(),
            photo_pixels: photo.element_product(),
            tiles: tile_count(frame).element_product().max(tile_count(photo).element_product()),
            slot_numbers: SLOT_NUMBERS,
            planes: false,
            geometry: false,
        }
    }

    /// What a step of `triangles` needs, as far as it is known before it is made.
    pub(super) fn of(plan: &StepPlan, triangles: u32) -> Self {
        Self {
            slot_numbers: plan.slot_numbers(),
            planes: plan.by_pixel() || plan.options.geometry,
            geometry: plan.options.geometry,
            ..Self::new(triangles, plan.camera.size, plan.photo)
        }
    }

    /// Room for both.
    pub(super) fn union(self, other: Self) -> Self {
        Self {
            triangles: self.triangles.max(other.triangles),
            splats: self.splats.max(other.splats),
            pairs: self.pairs.max(other.pairs),
            layers: self.layers.max(other.layers),
            frame_pixels: self.frame_pixels.max(other.frame_pixels),
            photo_pixels: self.photo_pixels.max(other.photo_pixels),
            tiles: self.tiles.max(other.tiles),
            slot_numbers: self.slot_numbers.max(other.slot_numbers),
            planes: self.planes || other.planes,
            geometry: self.geometry || other.geometry,
        }
    }

    /// Bytes of everything together.
    pub(super) fn bytes(&self) -> u64 {
        self.buffers().iter().map(|(_, bytes)| bytes).sum()
    }

    /// Names and bytes of the buffers, in the order of the fields of [`Room`].
    fn buffers(&self) -> [(&'static str, u64); 26] {
        let many = |count: u32, bytes: u64| u64::from(count) * bytes;
        let if_needed = |needed: bool, bytes: u64| if needed { bytes } else { 0 };
        let slot = 4 * u64::from(self.slot_numbers);
        let block = GROUP * SORT_ITEMS;
        let digits = (self.splats.div_ceil(block).max(self.pairs.div_ceil(block))) * RADIX;
        let longest = [self.triangles, self.splats, digits, self.frame_pixels].into_iter().max().unwrap_or(0);
        let scanned = longest.saturating_add(1).div_ceil(GROUP * SCAN_ITEMS);
        let partial = [self.tiles, self.triangles.div_ceil(GROUP), self.frame_pixels.div_ceil(GROUP)];
        let by_frame = |bytes| if_needed(self.geometry, many(self.frame_pixels, bytes));
        [
            ("first splats", many(self.triangles, 4) + 4),
            ("splats", many(self.splats, 64)),
            ("boxes of splats", many(self.splats, 16)),
            ("depth planes", if_needed(self.planes, many(self.splats, 32))),
            ("pieces of triangles", many(self.splats, 4)),
            ("depths", many(self.splats, 4)),
            ("sorted depths", many(self.splats, 4)),
            ("order", many(self.splats, 4)),
            ("sorted order", many(self.splats, 4)),
            ("first pairs", many(self.splats, 4) + 4),
            ("gradients of splats", many(self.splats, slot)),
            ("tiles of pairs", many(self.pairs, 4)),
            ("sorted tiles", many(self.pairs, 4)),
            ("pairs", many(self.pairs, 4)),
            ("sorted pairs", many(self.pairs, 4)),
            ("splats of pairs", many(self.pairs, 4)),
            ("gradients of pairs", many(self.pairs, slot)),
            ("layers", many(self.layers, 16)),
            ("digits", many(digits, 4)),
            ("sums of blocks", many(scanned, 4) + 4),
            ("frame", many(self.frame_pixels, 16)),
            ("depth and normals", by_frame(48)),
            ("gradients of depth and normals", by_frame(32)),
            ("slopes of the depth map", by_frame(32)),
            ("photo and loss", many(self.photo_pixels, 4 + 32 + 36 + 16)),
            ("partial sums", partial.into_iter().map(|p| many(p, 16)).max().unwrap_or(0)),
        ]
    }
}

/// The buffers of one step.
#[derive(Debug)]
pub(super) struct Room {
    pub(super) size: RoomSize,
    pub(super) splat_starts: Buffer,
    pub(super) records: Buffer,
    pub(super) bounds: Buffer,
    pub(super) planes: Buffer,
    pub(super) pieces: Buffer,
    pub(super) depths: [Buffer; 2],
    pub(super) order: [Buffer; 2],
    pub(super) pair_starts: Buffer,
    pub(super) splat_sums: Buffer,
    pub(super) tiles: [Buffer; 2],
    pub(super) pairs: [Buffer; 2],
    pub(super) owners: Buffer,
    pub(super) slots: Buffer,
    pub(super) layers: Buffer,
    pub(super) histogram: Buffer,
    pub(super) block_sums: Buffer,
    pub(super) frame: Buffer,
    pub(super) geometry: Buffer,
    pub(super) d_geometry: Buffer,
    pub(super) slopes: Buffer,
    pub(super) photo: Buffer,
    pub(super) picture: Buffer,
    pub(super) maps: Buffer,
    pub(super) d_frame: Buffer,
    pub(super) partial_sums: Buffer,
    pub(super) tile_starts: Buffer,
    pub(super) tile_ends: Buffer,
    pub(super) layer_starts: Buffer,
    /// How many splats, pairs and layers there is room for, as the card reads it.
    pub(super) most: Buffer,
}

impl Room {
    /// Makes room.
    ///
    /// Errors: more than the card has, or binds at once.
    pub(super) fn new(gpu: &Gpu, size: RoomSize) -> Result<Self> {
        let mut sizes = size.buffers().into_iter();
        let mut next = || {
            let (what, bytes) = sizes.next().unwrap_or_default();
            storage(gpu, what, bytes, REMEDY)
        };
        let of = |what, count: u32, bytes: u64| storage(gpu, what, u64::from(count) * bytes, REMEDY);
        let room = Self {
            size,
            splat_starts: next()?,
            records: next()?,
            bounds: next()?,
            planes: next()?,
            pieces: next()?,
            depths: [next()?, next()?],
            order: [next()?, next()?],
            pair_starts: next()?,
            splat_sums: next()?,
            tiles: [next()?, next()?],
            pairs: [next()?, next()?],
            owners: next()?,
            slots: next()?,
            layers: next()?,
            histogram: next()?,
            block_sums: next()?,
            frame: next()?,
            geometry: next()?,
            d_geometry: next()?,
            slopes: next()?,
            photo: of("photo", size.photo_pixels, 4)?,
            picture: of("picture", size.photo_pixels, 32)?,
            maps: of("derivatives of SSIM", size.photo_pixels, 36)?,
            d_frame: of("gradients of the picture", size.photo_pixels, 16)?,
            partial_sums: storage(gpu, "partial sums", size.buffers()[25].1, REMEDY)?,
            tile_starts: of("first pairs of tiles", size.tiles + 1, 4)?,
            tile_ends: of("last pairs of tiles", size.tiles, 4)?,
            layer_starts: of("first layers", if size.planes { size.frame_pixels + 1 } else { 0 }, 4)?,
            most: storage(gpu, "room", 16, REMEDY)?,
        };
        let most = [size.splats, size.pairs, size.layers, TILE];
        gpu.queue.write_buffer(&room.most, 0, bytemuck::cast_slice(&most));
        Ok(room)
    }
}
