//! The compiled passes.

use super::limits::{BUCKET, GROUP, RADIX, SCAN_ITEMS, SORT_ITEMS, UPDATE_GROUP};
use super::uniform::StepPlan;
use crate::cpu::ERROR_UNITS;
use crate::params::{SIGMA_MIN, SIGMA_SOLID};
use crate::update::{SIZE_OF_ALL, SIZES};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::fmt::Write;
use trisplat_gpu::{Gpu, Kernel};
use trisplat_raster::kernel::wgsl_library;
use trisplat_raster::soft::{MARGIN, TILE};
use trisplat_scene::Result;
use trisplat_scene::math::metric::TAPS;
use trisplat_scene::math::wgsl::constant;

macro_rules! passes {
    ($($(#[$doc:meta])* $field:ident: $pass:expr,)*) => {
        /// A kernel for every file of the folder `passes` that is an entry point, but those over
        /// tiles.
        #[derive(Debug)]
        pub(super) struct Passes {
            $($(#[$doc])* pub(super) $field: Kernel,)*
        }

        impl Passes {
            /// Compiles them all.
            pub(super) fn new(gpu: &Gpu) -> Result<Self> {
                let kernel = |pass: PassSource| Kernel::new(gpu, pass.name, pass.source(""));
                Ok(Self { $($field: kernel($pass)?,)* })
            }
        }
    };
}

passes! {
    project: pass!("project", "params", "camera"),
    plan: pass!("plan", "tile_table"),
    scan_reduce: pass!("scan_reduce", "group_sum"),
    scan_sums: pass!("scan_sums", "exclusive_sum", "scan_run"),
    scan_apply: pass!("scan_apply", "exclusive_sum"),
    sort_count: pass!("sort_count"),
    sort_scan: pass!("sort_scan", "exclusive_sum", "scan_run"),
    sort_scatter: pass!("sort_scatter", "exclusive_sum"),
    bin: pass!("bin"),
    tile_starts: pass!("tile_starts", "tile_table"),
    resolve: pass!("resolve"),
    loss_ssim: pass!("loss_ssim", "photo", "group_sum"),
    loss_grad: pass!("loss_grad", "photo", "group_sum"),
    sum_partials: pass!("sum_partials", "group_sum"),
    normal_slopes: pass!("normal_slopes", "depth_map", "group_sum"),
    normal_grad: pass!("normal_grad", "depth_map"),
    gather: pass!("gather", "slot_part"),
    regularise: pass!("regularise", "params", "group_sum"),
    update: pass!("update", "params", "camera"),
}

/// The passes over tiles for one drawing mode, without branches of the others in their loops.
#[derive(Debug)]
pub(super) struct TilePasses {
    pub(super) forward: Kernel,
    pub(super) backward: Kernel,
}

impl TilePasses {
    fn new(gpu: &Gpu, plan: &StepPlan) -> Result<Self> {
        let forward = if !plan.by_pixel() {
            pass!("forward", "tile_table", "tile_batch", "shade", "layer_sums")
        } else {
            pass!(
                "forward_by_pixel",
                "tile_table",
                "tile_batch",
                "shade",
                "layer_sums",
                "pixel_grad",
                "behind",
                "layer_share"
            )
        };
        let backward = if !plan.by_pixel() {
            pass!(
                "backward",
                "tile_table",
                "shade",
                "pixel_grad",
                "behind",
                "layer_share",
                "slot_part",
                "put_slot",
                "splat_sums",
                "pair_sums"
            )
        } else {
            pass!(
                "backward_by_pixel",
                "tile_table",
                "shade",
                "pixel_grad",
                "slot_part",
                "put_slot",
                "splat_sums",
                "pair_sums"
            )
        };
        let kernel = |pass: PassSource| Kernel::new(gpu, pass.name, pass.source(&plan.constants()));
        Ok(Self { forward: kernel(forward)?, backward: kernel(backward)? })
    }
}

/// Compiled passes of all drawing modes so far.
#[derive(Debug, Default)]
pub(super) struct Variants(HashMap<(u32, bool, bool), TilePasses>);

impl Variants {
    /// The passes of `plan`, compiled at first use.
    pub(super) fn of(&mut self, gpu: &Gpu, plan: &StepPlan) -> Result<&TilePasses> {
        let variant = (plan.window(), plan.options.geometry, plan.by_pixel());
        Ok(match self.0.entry(variant) {
            Entry::Occupied(entry) => entry.into_mut(),
            Entry::Vacant(entry) => entry.insert(TilePasses::new(gpu, plan)?),
        })
    }
}

/// Splats that a tile holds in workgroup memory while it draws.
const BATCH: u32 = 64;
/// Layers that a pixel takes at a time with its own order.
const NEAREST: u32 = 8;
/// Splats of a tile whose gradients are summed at once.
const PAIRS_AT_ONCE: u32 = 32;
/// Maximum number of their blocks of 4 x 4 pixels.
const PAIR_BLOCKS: u32 = 128;
// A bucket begins with a batch; an invocation loads an eighth of a pair; the blocks of one pair
// fit; a sort's totals have a digit each.
const _: () = assert!(
    BUCKET.is_multiple_of(BATCH)
        && 8 * PAIRS_AT_ONCE == GROUP
        && PAIR_BLOCKS >= 16
        && RADIX == GROUP
);

/// A pass: its additional functions, and its code.
macro_rules! pass {
    ($name:literal $(, $part:literal)*) => {
        PassSource { name: $name, parts: &[$(include_str!(concat!("passes/", $part, ".wgsl")),)* include_str!(concat!("passes/", $name, ".wgsl"))] }
    };
}
pub(super) use pass;

/// A pass in parts.
pub(super) struct PassSource {
    pub(super) name: &'static str,
    pub(super) parts: &'static [&'static str],
}

impl PassSource {
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
        constant(&mut out, "MIN_SIZE", SIZES[0]);
        constant(&mut out, "MAX_SIZE", SIZES[1]);
        constant(&mut out, "SIZE_OF_ALL", SIZE_OF_ALL);
        out += include_str!("passes/step.wgsl");
        for part in self.parts {
            out += part;
        }
        out
    }
}
