//! The WGSL of the passes, put together from one source.

use crate::cpu::ERROR_UNITS;
use crate::params::{SIGMA_MIN, SIGMA_SOLID};
use crate::update::{SIZE_OF_ALL, SIZES};
use std::fmt::Write;
use trisplat_raster::kernel::wgsl_library;
use trisplat_raster::soft::{MARGIN, TILE};
use trisplat_scene::math::metric::TAPS;
use trisplat_scene::math::wgsl::constant;

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
pub(super) const RADIX: u32 = 1 << super::job::DIGIT_BITS;
/// Splats that a tile holds in workgroup memory while it draws.
const BATCH: u32 = 64;
/// Layers that a pixel takes at a time with its own order.
const NEAREST: u32 = 8;
/// Splats of a tile whose gradients are summed at once, and how many of their blocks of 4 x 4 pixels at most.
const PAIRS_AT_ONCE: u32 = 32;
const PAIR_BLOCKS: u32 = 128;
/// Pairs of a bucket: a workgroup sums their gradients.
pub(super) const BUCKET: u32 = 512;
// A bucket begins with a batch; an invocation loads an eighth of a pair; the blocks of one pair fit; a sort's totals have a digit each.
const _: () = assert!(
    BUCKET.is_multiple_of(BATCH) && 8 * PAIRS_AT_ONCE == GROUP && PAIR_BLOCKS >= 16 && RADIX == GROUP
);

/// A pass: its additional functions, and its code.
macro_rules! pass {
    ($name:literal $(, $part:literal)*) => {
        Pass { name: $name, parts: &[$(include_str!(concat!("passes/", $part, ".wgsl")),)* include_str!(concat!("passes/", $name, ".wgsl"))] }
    };
}
pub(super) use pass;

/// A pass in parts.
pub(super) struct Pass {
    pub(super) name: &'static str,
    pub(super) parts: &'static [&'static str],
}

impl Pass {
    /// Its whole source, after the constants of its `variant`.
    pub(super) fn source(&self, variant: &str) -> String {
        let mut out = wgsl_library() + variant;
        for (name, value) in [
            ("TILE", TILE),
            ("GROUP", GROUP),
            ("UPDATE_GROUP", UPDATE_GROUP),
            ("SCAN_ITEMS", SCAN_ITEMS),
            ("SORT_ITEMS", SORT_ITEMS),
            ("RADIX", RADIX),
            ("BATCH", BATCH),
            ("NEAREST", NEAREST),
            ("PAIRS_AT_ONCE", PAIRS_AT_ONCE),
            ("PAIR_BLOCKS", PAIR_BLOCKS),
            ("BUCKET", BUCKET),
            ("REACH", TAPS as u32 / 2),
        ] {
            let _ = writeln!(out, "const {name}: u32 = {value}u;");
        }
        constant(&mut out, "MARGIN", MARGIN);
        constant(&mut out, "HALF_TILE", (TILE - 1) as f32 * 0.5 + MARGIN);
        constant(&mut out, "HALF_BLOCK", 1.5 + MARGIN);
        constant(&mut out, "SIGMA_MIN", SIGMA_MIN);
        constant(&mut out, "SIGMA_SOLID", SIGMA_SOLID);
        constant(&mut out, "ERROR_UNITS", ERROR_UNITS);
        constant(&mut out, "LEAST_SIZE", SIZES[0]);
        constant(&mut out, "MOST_SIZE", SIZES[1]);
        constant(&mut out, "SIZE_OF_ALL", SIZE_OF_ALL);
        out += include_str!("passes/step.wgsl");
        self.parts.iter().for_each(|part| out += part);
        out
    }
}
