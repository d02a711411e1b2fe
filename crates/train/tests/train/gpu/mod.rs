//! Training on a graphics card against training on the CPU: function by function, step by step, run
//! by run. Without a card, software Vulkan serves (Debian: mesa-vulkan-drivers); without that too,
//! tests say so and pass, unless TRISPLAT_REQUIRE_GPU=1.

#![allow(clippy::print_stderr, reason = "a test that cannot judge says so")]

mod limits;
mod pictures;
mod runs;
mod scene;
mod steps;
mod twins;

use trisplat_gpu::{AdapterOptions, Gpu};

/// The card as one that binds no more than `bytes` at once.
fn small_card(bytes: u64) -> Option<Gpu> {
    let options = AdapterOptions::default();
    let adapter = card().and_then(|_| options.choose(&options.instance(None), None).ok())?;
    let mut limits = adapter.limits();
    limits.max_storage_buffer_binding_size = bytes;
    Some(Gpu::open_within(&adapter, limits).unwrap())
}

/// A card, or `None` after saying loudly that there is none.
fn card() -> Option<Gpu> {
    match Gpu::headless(&AdapterOptions::default()) {
        Ok(gpu) => Some(gpu),
        Err(why) => {
            let required = std::env::var("TRISPLAT_REQUIRE_GPU").is_ok_and(|v| v == "1");
            assert!(!required, "TRISPLAT_REQUIRE_GPU=1, but {why}");
            trisplat_fixtures::skip::skipped(&format!("no adapter: {why}"));
            None
        }
    }
}
