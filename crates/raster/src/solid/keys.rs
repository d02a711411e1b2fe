//! The nearest face and its depth at every sample of a tile, as one number.

use super::bins::{TILE_HEIGHT, TILE_WIDTH};

/// Samples by which a block may extend beyond its tile on the right and below; enough to keep runs of `spans`
/// within the keys.
const RIM: usize = 3;
/// Keys from one row of a tile to the next.
pub(super) const STRIDE: usize = TILE_WIDTH + RIM;

/// The key of a sample: 1/z in the upper half, the complement of the face in the lower. The larger key is
/// nearer or, at the same depth, has the lower face index. Zero means empty; negative keys lose to it.
pub(super) type SampleKey = i64;

/// The samples of a tile and a rim that is never read.
pub(super) type SampleKeys = [SampleKey; STRIDE * (TILE_HEIGHT + RIM)];

/// A tile that sees nothing.
pub(super) static EMPTY: SampleKeys = [0; STRIDE * (TILE_HEIGHT + RIM)];

/// The face of a key; `NO_FACE` for none.
#[inline(always)]
pub(super) fn face_of(key: SampleKey) -> u32 {
    !(key as u32)
}

/// The 1/z of a key.
#[inline(always)]
pub(super) fn inverse_depth_of(key: SampleKey) -> f32 {
    f32::from_bits((key >> 32) as u32)
}

/// The key of a face at a 1/z.
#[inline(always)]
pub(super) fn key(w: f32, face: u32) -> SampleKey {
    (i64::from(w.to_bits().cast_signed()) << 32) | i64::from(!face)
}
