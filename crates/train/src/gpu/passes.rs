//! The compiled passes.

use super::source::{Pass, pass};
use super::uniform::StepPlan;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use trisplat_gpu::{Gpu, Kernel};
use trisplat_scene::Result;

macro_rules! passes {
    ($($(#[$doc:meta])* $field:ident: $pass:expr,)*) => {
        /// A kernel for every file of the folder `passes` that is an entry point, but those over tiles.
        #[derive(Debug)]
        pub(super) struct Passes {
            $($(#[$doc])* pub(super) $field: Kernel,)*
        }

        impl Passes {
            /// Compiles them all.
            pub(super) fn new(gpu: &Gpu) -> Result<Self> {
                let kernel = |pass: Pass| Kernel::new(gpu, pass.name, pass.source(""));
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

/// The passes over tiles for one way to draw: nothing of the other ways is in their loops.
#[derive(Debug)]
pub(super) struct TilePasses {
    pub(super) forward: Kernel,
    pub(super) backward: Kernel,
}

impl TilePasses {
    fn new(gpu: &Gpu, plan: &StepPlan) -> Result<Self> {
        let forward = match plan.by_pixel() {
            false => pass!("forward", "tile_table", "tile_batch", "shade", "layer_sums"),
            true => pass!(
                "forward_by_pixel",
                "tile_table",
                "tile_batch",
                "shade",
                "layer_sums",
                "pixel_grad",
                "behind",
                "layer_share"
            ),
        };
        let backward = match plan.by_pixel() {
            false => pass!(
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
            ),
            true => pass!(
                "backward_by_pixel",
                "tile_table",
                "shade",
                "pixel_grad",
                "slot_part",
                "put_slot",
                "splat_sums",
                "pair_sums"
            ),
        };
        let kernel = |pass: Pass| Kernel::new(gpu, pass.name, pass.source(&plan.constants()));
        Ok(Self { forward: kernel(forward)?, backward: kernel(backward)? })
    }
}

/// Those of all ways to draw so far.
#[derive(Debug, Default)]
pub(super) struct Variants(HashMap<(u32, bool, bool), TilePasses>);

impl Variants {
    /// Those of `plan`, compiled when they are needed first.
    pub(super) fn of(&mut self, gpu: &Gpu, plan: &StepPlan) -> Result<&TilePasses> {
        let variant = (plan.window(), plan.options.geometry, plan.by_pixel());
        Ok(match self.0.entry(variant) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => new.insert(TilePasses::new(gpu, plan)?),
        })
    }
}
