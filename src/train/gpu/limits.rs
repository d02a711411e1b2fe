//! What the backend takes of a card.

use crate::gpu::Gpu;
use wgpu::DeviceType;

/// What the backend takes of a card. None of it changes a bit of the result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GpuLimits {
    /// Steps that may be under way before the next one is recorded; 0 waits for each.
    pub ahead: usize,
    /// Bytes of a buffer that a pass has at once; more is split.
    pub binding_bytes: u64,
    /// Photos that stay on the card, bytes: 4 per pixel.
    pub photo_bytes: u64,
    /// Pairs of triangles and tiles there is room for at first, for each triangle.
    pub pairs_each: u32,
    /// Pairs there is room for at first, at least.
    pub pairs_least: u32,
    /// Triangles through the near plane, which are two splats each, there is room for at first; a 64th of all comes on top.
    pub spare_splats: u32,
}

/// Photos of 1.6 megapixels: about 300, and 80.
const PHOTO_BYTES: (u64, u64) = (2 << 30, 512 << 20);

impl GpuLimits {
    /// Scenes of small triangles have fewer, as not all are in view; those of large ones are small scenes, and grow into more.
    pub(super) const PAIRS_EACH: u32 = 2;

    /// Those for a card. No graphics API says how much memory a card has, so photos get what every card of its kind can spare; when
    /// memory ends, they go first.
    pub fn of(gpu: &Gpu) -> Self {
        let limits = gpu.device.limits();
        Self {
            ahead: 2,
            binding_bytes: limits.max_storage_buffer_binding_size.min(limits.max_buffer_size),
            photo_bytes: match gpu.info.device_type {
                DeviceType::DiscreteGpu => PHOTO_BYTES.0,
                // Its memory is that which holds the photos already.
                DeviceType::Cpu => 0,
                _ => PHOTO_BYTES.1,
            },
            pairs_each: Self::PAIRS_EACH,
            pairs_least: 1 << 18,
            spare_splats: super::source::GROUP,
        }
    }
}
