//! The memory limits of the backend on a card.

use trisplat_gpu::Gpu;
use wgpu::DeviceType;

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
    pub pairs_each: u32,
    /// Least first capacity for pairs.
    pub pairs_least: u32,
    /// First capacity for triangles through the near plane, which are two splats each; a 64th of all
    /// triangles is added.
    pub spare_splats: u32,
}

/// Photos of 1.6 megapixels: about 300, and 80.
const PHOTO_BYTES: (u64, u64) = (2 << 30, 512 << 20);

impl GpuLimits {
    /// Scenes of small triangles need fewer, because not all are in view; scenes of large triangles are
    /// small, and their buffers grow.
    pub(super) const PAIRS_EACH: u32 = 2;

    /// The limits for a card. No graphics API tells the memory of a card, so photos get an amount that every
    /// card of its kind can spare. When memory runs out, they are dropped first.
    pub fn of(gpu: &Gpu) -> Self {
        let limits = gpu.device.limits();
        Self {
            ahead: 2,
            binding_bytes: limits.max_storage_buffer_binding_size.min(limits.max_buffer_size),
            photo_bytes: match gpu.info.device_type {
                DeviceType::DiscreteGpu => PHOTO_BYTES.0,
                // It shares main memory, which holds the photos already.
                DeviceType::Cpu => 0,
                _ => PHOTO_BYTES.1,
            },
            pairs_each: Self::PAIRS_EACH,
            pairs_least: 1 << 18,
            spare_splats: super::source::GROUP,
        }
    }
}
