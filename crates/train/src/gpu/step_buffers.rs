//! The buffers of one step on the card, and their capacity.

use super::limits::{BUCKET, Count, GROUP, RADIX, REMEDY, SCAN_ITEMS, SORT_ITEMS};
use super::uniform::{SLOT_NUMBERS, StepPlan};
use glam::UVec2;
use trisplat_gpu::{Gpu, storage};
use trisplat_raster::soft::tile_count;
use trisplat_scene::Result;
use wgpu::{Buffer, DeviceType};

/// Bindings that hold the slots of pairs, by far the largest of a step's buffers; the twin of
/// `slot_part` in `passes/slot_part.wgsl`.
pub(super) const SLOT_PARTS: u32 = 4;

/// The capacity of all buffers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct StepCapacity {
    pub(super) triangles: u32,
    pub(super) splats: u32,
    /// Pairs of splats and tiles.
    pub(super) pairs: u32,
    /// Layers of pixels with their own order.
    pub(super) layers: u32,
    /// Pixels of the photo and of the frame.
    pub(super) pixels: u32,
    pub(super) tiles: u32,
    pub(super) slot_numbers: u32,
    /// Depth planes are needed.
    pub(super) planes: bool,
    /// Bytes that one binding holds.
    pub(super) binding_bytes: u64,
    /// Depth, normals and distortion are needed.
    pub(super) geometry: bool,
}

impl StepCapacity {
    /// The needs of a plain step of `triangles`, for a photo of this size, with `spare` more splats
    /// than a 64th of the triangles.
    pub(super) fn new(triangles: u32, spare: u32, photo: UVec2) -> Self {
        Self {
            triangles,
            splats: triangles.saturating_add(triangles / 64).saturating_add(spare),
            pairs: 0,
            layers: 0,
            pixels: photo.element_product(),
            tiles: tile_count(photo).element_product(),
            slot_numbers: SLOT_NUMBERS,
            planes: false,
            binding_bytes: 0,
            geometry: false,
        }
    }

    /// The known needs of a step of `triangles`.
    pub(super) fn of(plan: &StepPlan, triangles: u32, spare: u32) -> Self {
        Self {
            slot_numbers: plan.slot_numbers(),
            planes: plan.by_pixel() || plan.options.geometry,
            geometry: plan.options.geometry,
            ..Self::new(triangles, spare, plan.camera.size)
        }
    }

    /// The needs of a picture of `triangles`, without gradients.
    pub(super) fn of_picture(plan: &StepPlan, triangles: u32, spare: u32) -> Self {
        Self { slot_numbers: 0, ..Self::of(plan, triangles, spare) }
    }

    /// Room for both.
    pub(super) fn union(self, other: Self) -> Self {
        Self {
            triangles: self.triangles.max(other.triangles),
            splats: self.splats.max(other.splats),
            pairs: self.pairs.max(other.pairs),
            layers: self.layers.max(other.layers),
            pixels: self.pixels.max(other.pixels),
            tiles: self.tiles.max(other.tiles),
            slot_numbers: self.slot_numbers.max(other.slot_numbers),
            planes: self.planes || other.planes,
            binding_bytes: self.binding_bytes.max(other.binding_bytes),
            geometry: self.geometry || other.geometry,
        }
    }

    /// Pairs whose slots are in one binding.
    pub(super) fn slot_pairs(&self) -> u32 {
        let slot = 4 * u64::from(self.slot_numbers.max(1));
        u32::try_from(self.binding_bytes / slot).unwrap_or(u32::MAX).max(1)
    }

    /// Bytes of part `part` of the slots; the last part has all the rest.
    fn slot_bytes(&self, part: u32) -> u64 {
        let before = self.slot_pairs().saturating_mul(part);
        let left = self.pairs.saturating_sub(before);
        let pairs = if part + 1 == SLOT_PARTS { left } else { left.min(self.slot_pairs()) };
        u64::from(pairs) * 4 * u64::from(self.slot_numbers)
    }

    /// Bytes of the pixels in front of every bucket of pairs that is not the first of its tile.
    fn checkpoint_bytes(&self) -> u64 {
        u64::from(self.pairs / BUCKET) * u64::from(16 * GROUP)
    }

    /// Bytes of everything together.
    pub(super) fn bytes(&self) -> u64 {
        let mut sum = 0;
        // Nothing is made, so nothing fails.
        let _ = self.buffers(|_, bytes| {
            sum += bytes;
            Ok(())
        });
        sum
    }

    /// All buffers, made by their names and bytes.
    fn buffers<B>(&self, mut make: impl FnMut(&str, u64) -> Result<B>) -> Result<StepBuffers<B>> {
        let of_splat = |bytes: u64| u64::from(self.splats) * bytes;
        let of_pair = |bytes: u64| u64::from(self.pairs) * bytes;
        let block = GROUP * SORT_ITEMS;
        let digits = (self.splats.div_ceil(block).max(self.pairs.div_ceil(block))) * RADIX;
        let longest = [self.triangles, self.splats, self.pixels].into_iter().max().unwrap_or(0);
        // A sort has its totals there.
        let scanned = longest.saturating_add(1).div_ceil(GROUP * SCAN_ITEMS).max(RADIX);
        let pixels = u64::from(self.pixels);
        let geometry = if self.geometry { pixels } else { 0 };
        let partial = [self.tiles, self.triangles.div_ceil(GROUP), self.pixels.div_ceil(GROUP)];
        let partial = u64::from(partial.into_iter().max().unwrap_or(0));
        Ok(StepBuffers {
            size: *self,
            splat_starts: make("first splats", 4 * u64::from(self.triangles) + 4)?,
            records: make("splats", of_splat(64))?,
            bounds: make("boxes of splats", of_splat(16))?,
            planes: make("depth planes", if self.planes { of_splat(32) } else { 0 })?,
            pieces: make("pieces of triangles", of_splat(4))?,
            depths: [make("depths", of_splat(4))?, make("sorted depths", of_splat(4))?],
            order: [make("order", of_splat(4))?, make("sorted order", of_splat(4))?],
            pair_starts: make("first pairs", of_splat(4) + 4)?,
            splat_sums: make("gradients of splats", of_splat(4 * u64::from(self.slot_numbers)))?,
            tiles: [make("tiles of pairs", of_pair(4))?, make("sorted tiles", of_pair(4))?],
            pairs: [make("pairs", of_pair(4))?, make("sorted pairs", of_pair(4))?],
            owners: make("splats of pairs", of_pair(8))?,
            layers: make("layers", 16 * u64::from(self.layers))?,
            histogram: make("digits", 4 * u64::from(digits))?,
            block_sums: make("sums of blocks", 4 * u64::from(scanned) + 4)?,
            slots: [
                make("gradients of pairs", self.slot_bytes(0))?,
                make("gradients of pairs", self.slot_bytes(1))?,
                make("gradients of pairs", self.slot_bytes(2))?,
                make("gradients of pairs", self.slot_bytes(3))?,
            ],
            frame: make(
                "frame",
                16 * pixels + if self.slot_numbers > 0 { self.checkpoint_bytes() } else { 0 },
            )?,
            geometry: make("depth and normals", 48 * geometry)?,
            d_geometry: make("gradients of depth and normals", 32 * geometry)?,
            slopes: make("slopes of the depth map", 32 * geometry)?,
            photo: make("photo", 4 * pixels)?,
            picture: make("picture", 32 * pixels)?,
            maps: make("derivatives of SSIM", 36 * pixels)?,
            d_frame: make("gradients of the picture", 16 * pixels)?,
            partial_sums: make("partial sums", 16 * partial)?,
            table: make(
                "table of tiles",
                12 * u64::from(self.tiles) + 4 + 4 * u64::from(self.pairs / BUCKET),
            )?,
            layer_starts: make("first layers", if self.planes { 4 * pixels + 4 } else { 0 })?,
            kept: make(
                "first layers of pixels",
                if self.planes && self.slot_numbers > 0 { 32 * pixels } else { 0 },
            )?,
            most: make("room", 16)?,
        })
    }
}

/// The buffers of one step.
#[derive(Debug)]
pub(super) struct StepBuffers<B = Buffer> {
    pub(super) size: StepCapacity,
    pub(super) splat_starts: B,
    pub(super) records: B,
    pub(super) bounds: B,
    pub(super) planes: B,
    pub(super) pieces: B,
    pub(super) depths: [B; 2],
    pub(super) order: [B; 2],
    pub(super) pair_starts: B,
    pub(super) splat_sums: B,
    pub(super) tiles: [B; 2],
    pub(super) pairs: [B; 2],
    pub(super) owners: B,
    pub(super) layers: B,
    pub(super) histogram: B,
    pub(super) block_sums: B,
    pub(super) slots: [B; SLOT_PARTS as usize],
    pub(super) frame: B,
    pub(super) geometry: B,
    pub(super) d_geometry: B,
    pub(super) slopes: B,
    pub(super) photo: B,
    pub(super) picture: B,
    pub(super) maps: B,
    pub(super) d_frame: B,
    pub(super) partial_sums: B,
    pub(super) table: B,
    pub(super) layer_starts: B,
    pub(super) kept: B,
    /// The capacity for splats, pairs and layers, as the card reads it.
    pub(super) most: B,
}

impl StepBuffers {
    /// Makes the buffers.
    ///
    /// # Errors
    ///
    /// More than the card has, or binds at once.
    pub(super) fn new(gpu: &Gpu, size: StepCapacity) -> Result<Self> {
        let buffers = size.buffers(|what, bytes| storage(gpu, what, bytes, REMEDY))?;
        let capacity = [size.splats, size.pairs, size.layers, 0];
        gpu.queue.write_buffer(&buffers.most, 0, bytemuck::cast_slice(&capacity));
        Ok(buffers)
    }
}

/// Limits on a card. None of them changes a bit of the result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GpuLimits {
    /// Steps that may be under way before the next one is recorded; 0 waits for each.
    pub ahead: usize,
    /// Bytes of a buffer that a pass has at once; more is split.
    pub binding_bytes: u64,
    /// Photos that stay on the card, bytes: 4 per pixel.
    pub photo_bytes: u64,
    /// First capacity for pairs of triangles and tiles, per triangle.
    pub pairs_per_triangle: u32,
    /// Minimum first capacity for pairs.
    pub min_pairs: u32,
    /// First capacity for triangles through the near plane, which are two splats each; a 64th of
    /// all triangles is added.
    pub near_plane_splats: u32,
}

/// Memory for photos on a card of its own, bytes: about 300 of 1.6 megapixels.
const DISCRETE_PHOTO_BYTES: u64 = 2 << 30;
/// Memory for photos on other cards, bytes: about 80 of 1.6 megapixels.
const SHARED_PHOTO_BYTES: u64 = 512 << 20;

impl GpuLimits {
    /// Scenes of small triangles need fewer, because not all are in view; scenes of large triangles
    /// are small, and their buffers grow.
    pub(super) const PAIRS_PER_TRIANGLE: u32 = 2;

    /// The limits for a card. No graphics API tells the memory of a card, so photos get an amount
    /// that every card of its kind can spare. When memory runs out, they are dropped first.
    pub fn of(gpu: &Gpu) -> Self {
        let limits = gpu.device.limits();
        Self {
            ahead: 2,
            binding_bytes: limits.max_storage_buffer_binding_size.min(limits.max_buffer_size),
            photo_bytes: match gpu.info.device_type {
                DeviceType::DiscreteGpu => DISCRETE_PHOTO_BYTES,
                // A CPU shares main memory, which holds the photos already.
                DeviceType::Cpu => 0,
                _ => SHARED_PHOTO_BYTES,
            },
            pairs_per_triangle: Self::PAIRS_PER_TRIANGLE,
            min_pairs: 1 << 18,
            near_plane_splats: GROUP,
        }
    }
}

/// The capacity that a step lacked, with a margin; such a step did nothing.
pub(super) fn missing_capacity(counts: &[u32]) -> Option<StepCapacity> {
    let enlarged = |count: Count| {
        let n = counts[count as usize];
        n.saturating_add(n / 4)
    };
    let more = StepCapacity {
        splats: enlarged(Count::WantedSplats),
        pairs: enlarged(Count::WantedPairs),
        layers: enlarged(Count::WantedLayers),
        ..StepCapacity::default()
    };
    (more != StepCapacity::default()).then_some(more)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slots_are_in_parts_that_can_be_bound() {
        let slot = 4 * u64::from(SLOT_NUMBERS);
        let size = |pairs| StepCapacity {
            pairs,
            binding_bytes: 10 * slot + 3,
            ..StepCapacity::new(100, 0, UVec2::ONE)
        };
        let pairs = |size: StepCapacity| {
            (0..SLOT_PARTS).map(|k| size.slot_bytes(k) / slot).collect::<Vec<_>>()
        };
        assert_eq!(pairs(size(0)), [0; 4]);
        assert_eq!(pairs(size(25)), [10, 10, 5, 0]);
        // Slots beyond all parts go to the last part, which then cannot be made.
        assert_eq!(pairs(size(45)), [10, 10, 10, 15]);
        // Blocks of splats and of pairs have the same number of counts.
        assert_eq!(size(25).bytes() - size(0).bytes(), 25 * (slot + 24));
    }
}
