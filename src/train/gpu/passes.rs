//! The compiled passes.

use super::source::{Pass, pass};
use crate::error::Result;
use crate::gpu::Gpu;
use crate::gpu::compute::Kernel;

macro_rules! passes {
    ($($(#[$doc:meta])* $field:ident: $pass:expr,)*) => {
        /// A kernel for every file of the folder `passes` that is an entry point.
        #[derive(Debug)]
        pub(super) struct Passes {
            $($(#[$doc])* pub(super) $field: Kernel,)*
        }

        impl Passes {
            /// Compiles them all.
            pub(super) fn new(gpu: &Gpu) -> Result<Self> {
                let kernel = |pass: Pass| Kernel::new(gpu, pass.name, pass.source());
                Ok(Self { $($field: kernel($pass)?,)* })
            }
        }
    };
}

passes! {
    project: pass!("project", "params", "camera"),
    plan: pass!("plan"),
    scan_reduce: pass!("scan_reduce"),
    scan_sums: pass!("scan_sums", "exclusive_sum"),
    scan_apply: pass!("scan_apply", "exclusive_sum"),
    sort_count: pass!("sort_count"),
    sort_scatter: pass!("sort_scatter", "exclusive_sum"),
    bin: pass!("bin"),
    tile_starts: pass!("tile_starts"),
    forward: pass!("forward", "shade", "layer_sums"),
    forward_by_pixel: pass!("forward_by_pixel", "shade", "layer_sums", "pixel_grad", "behind"),
    resolve: pass!("resolve"),
    loss_ssim: pass!("loss_ssim", "photo", "group_sum"),
    loss_grad: pass!("loss_grad", "photo", "group_sum"),
    sum_partials: pass!("sum_partials", "group_sum"),
    normal_slopes: pass!("normal_slopes", "depth_map", "group_sum"),
    normal_grad: pass!("normal_grad", "depth_map"),
    backward: pass!("backward", "shade", "pixel_grad", "behind", "slot_part", "put_slot", "layer_grad"),
    backward_by_pixel: pass!("backward_by_pixel", "shade", "pixel_grad", "slot_part", "put_slot", "layer_grad"),
    gather: pass!("gather", "slot_part"),
    regularise: pass!("regularise", "params", "group_sum"),
    update: pass!("update", "params", "camera"),
}
