//! The kernels in WGSL, for a graphics card, with the constants of their Rust twins. `tests/train_gpu` compares each
//! function with its twin.

use super::{adam, normal, sh, window};
use trisplat_scene::math::wgsl::{self, constant, constants};

/// The functions, those of [`wgsl::library`], and all constants they need.
pub fn library() -> String {
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
        include_str!("window.wgsl"),
        include_str!("composite.wgsl"),
        include_str!("splat.wgsl"),
        include_str!("clip.wgsl"),
        include_str!("sh.wgsl"),
        include_str!("adam.wgsl"),
        include_str!("loss.wgsl"),
    ] {
        out += part;
    }
    out
}
