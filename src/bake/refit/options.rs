//! Which colours are fitted, and how.

use crate::error::{Error, Result};

/// Which colours are fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum RefitColors {
    /// Whatever is best on held-out photos: one colour per triangle, three, or none
    Auto,
    /// One colour per triangle
    Flat,
    /// One colour per corner
    Corner,
    /// Colours stay as they are
    Off,
}

/// How colours are taken from the photos.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct RefitOptions {
    /// Which colours are fitted to the photos
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = RefitOptions::DEFAULT.refit, value_name = "WHICH"))]
    pub refit: RefitColors,
    /// λ: pulls corners towards their triangle's mean colour as strongly as this many more pixels of it would
    #[cfg_attr(feature = "cli", arg(long, default_value_t = RefitOptions::DEFAULT.refit_flatness, value_name = "PX"))]
    #[schemars(range(min = 0.0))]
    pub refit_flatness: f64,
    /// Passes over the photos
    #[cfg_attr(feature = "cli", arg(long, default_value_t = RefitOptions::DEFAULT.refit_passes, value_name = "N"))]
    pub refit_passes: u32,
}

impl RefitOptions {
    /// Chooses what is best; one pass.
    pub const DEFAULT: Self = Self { refit: RefitColors::Auto, refit_flatness: 4.0, refit_passes: 1 };

    pub(super) fn validate(&self) -> Result<()> {
        if !(self.refit_flatness >= 0.0 && self.refit_flatness.is_finite()) {
            return Err(Error::invalid("refit_flatness", self.refit_flatness, "0 or more"));
        }
        if self.refit_passes == 0 {
            return Err(Error::invalid("refit_passes", 0, "1 or more, or `refit` off"));
        }
        Ok(())
    }
}

impl Default for RefitOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}
