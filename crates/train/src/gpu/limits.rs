//! Sizes that passes and buffers share, and places in the buffer of counts.

use trisplat_raster::soft::TILE;

/// Bits of a digit of the sorts.
pub(super) const DIGIT_BITS: u32 = 8;
/// Invocations of a workgroup.
pub(super) const GROUP: u32 = 256;
// Passes over tiles sum over a tile, the others over a group.
const _: () = assert!(GROUP == TILE * TILE);
/// Invocations of a workgroup of the update, which needs many registers.
pub(super) const UPDATE_GROUP: u32 = 64;
/// Numbers per invocation of a prefix sum.
pub(super) const SCAN_ITEMS: u32 = 8;
/// Keys per invocation of a sort.
pub(super) const SORT_ITEMS: u32 = 8;
/// Values of a digit.
pub(super) const RADIX: u32 = 1 << DIGIT_BITS;
/// Pairs of a bucket: a workgroup sums their gradients.
pub(super) const BUCKET: u32 = 512;

/// The remedy when a scene does not fit.
pub(super) const REMEDY: &str = "train on the CPU (`backend` cpu), or with fewer triangles (`max_triangles`) or smaller photos (`max_size`)";

/// Places in the buffer of counts; the twin of the constants in `passes/step.wgsl`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
#[allow(dead_code, reason = "some are read and written on the card only")]
pub(super) enum Count {
    Triangles1,
    Splats,
    Splats1,
    Pairs,
    Pixels1,
    Layers,
    WantedSplats,
    WantedPairs,
    WantedLayers,
    Touched,
    Dropped,
    LossL1,
    LossMse,
    LossSsim,
    LossGeometry,
    SumArea,
    PhotoTiles,
    SceneGroups,
    FrameGroups,
}

/// Counts in the buffer.
pub(super) const COUNTS: usize = Count::FrameGroups as usize + 1;
