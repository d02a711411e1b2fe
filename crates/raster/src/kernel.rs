//! The paper's formulas: pure functions, no buffers, no I/O. Each has a twin in WGSL beside it, for a graphics card.

pub mod adam;
pub mod clip;
pub mod composite;
pub mod loss;
pub mod normal;
pub mod sh;
pub mod splat;
mod ssim;
pub mod window;

use trisplat_scene::math::wgsl::{self, constant, constants};

/// The functions in WGSL, those of [`wgsl::library`], and all constants they need.
pub fn wgsl_library() -> String {
    let mut out = wgsl::library();
    constant(&mut out, "RATIO_FLOOR", window::RATIO_FLOOR);
    constant(&mut out, "MIN_COVERAGE", normal::MIN_COVERAGE);
    constant(&mut out, "SH_C0", sh::SH_C0);
    constant(&mut out, "SH_C1", sh::SH_C1);
    constants(&mut out, "SH_C2", &sh::SH_C2);
    constants(&mut out, "SH_C3", &sh::SH_C3);
    constant(&mut out, "BETA1", adam::BETA1);
    constant(&mut out, "BETA2", adam::BETA2);
    constant(&mut out, "EPS", adam::EPS);
    for part in [
        include_str!("kernel/window.wgsl"),
        include_str!("kernel/composite.wgsl"),
        include_str!("kernel/splat.wgsl"),
        include_str!("kernel/clip.wgsl"),
        include_str!("kernel/sh.wgsl"),
        include_str!("kernel/adam.wgsl"),
        include_str!("kernel/loss.wgsl"),
    ] {
        out += part;
    }
    out
}
