//! The WGSL of the passes, put together from one source.

use super::uniform::{GEOMETRY_SLOT_NUMBERS, SLOT_NUMBERS};
use crate::kernel::wgsl::library;
use crate::math::ssim::TAPS;
use crate::math::wgsl::constant;
use crate::raster::soft::{MARGIN, TILE};
use crate::train::cpu::ERROR_UNITS;
use crate::train::params::{SIGMA_MIN, SIGMA_SOLID};
use std::fmt::Write;

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
/// Splats of a tile whose gradients are summed at once.
const TURNS: u32 = 32;

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
    /// Its whole source.
    pub(super) fn source(&self) -> String {
        let mut out = library();
        for (name, value) in [
            ("TILE", TILE),
            ("GROUP", GROUP),
            ("UPDATE_GROUP", UPDATE_GROUP),
            ("SCAN_ITEMS", SCAN_ITEMS),
            ("SORT_ITEMS", SORT_ITEMS),
            ("RADIX", RADIX),
            ("SORT_TALLY", RADIX * GROUP / 2),
            ("BATCH", BATCH),
            ("NEAREST", NEAREST),
            ("TURNS", TURNS),
            ("REACH", TAPS as u32 / 2),
            ("SLOT", SLOT_NUMBERS),
            ("GEOMETRY_SLOT", GEOMETRY_SLOT_NUMBERS),
        ] {
            let _ = writeln!(out, "const {name}: u32 = {value}u;");
        }
        constant(&mut out, "MARGIN", MARGIN);
        constant(&mut out, "HALF_TILE", (TILE - 1) as f32 * 0.5 + MARGIN);
        constant(&mut out, "SIGMA_MIN", SIGMA_MIN);
        constant(&mut out, "SIGMA_SOLID", SIGMA_SOLID);
        constant(&mut out, "ERROR_UNITS", ERROR_UNITS);
        out += include_str!("passes/step.wgsl");
        self.parts.iter().for_each(|part| out += part);
        out
    }
}
