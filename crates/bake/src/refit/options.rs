//! Options of fitted colours.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::Result;
use trisplat_scene::ranges::{self, OptionNaming};

/// Colours to fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum RefitColors {
    /// Whichever is best on held-out photos: one colour per triangle, three, or the scene's own
    Auto,
    /// One colour per triangle
    Flat,
    /// One colour per corner
    Corner,
    /// Colours do not change
    Off,
}

/// Options of colours from the photos.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RefitOptions {
    /// Colours to fit to the photos
    pub refit: RefitColors,
    /// λ: pull of corner colours towards their triangle's mean, equivalent to this many pixels
    #[schemars(range(min = 0.0, max = 1e9))]
    pub refit_flatness: f64,
    /// Passes over the photos
    #[schemars(range(min = 1, max = 1000))]
    pub refit_passes: u32,
}

impl RefitOptions {
    /// Chooses the best colours; one pass.
    pub const DEFAULT: Self =
        Self { refit: RefitColors::Auto, refit_flatness: 4.0, refit_passes: 1 };

    pub(super) fn validate(&self) -> Result<()> {
        ranges::check(self, OptionNaming::Flag)
    }
}

trisplat_scene::default!(RefitOptions);
