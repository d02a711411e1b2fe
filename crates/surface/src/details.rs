//! What the making of a surface measured.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::report::StageDetails;
use trisplat_teacher::ViewpointKind;

/// What a surface was made of, and what was dropped.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SurfaceDetails {
    /// Where chosen cameras stood; absent when cameras were given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub viewpoints: Option<ViewpointKind>,
    /// Depth pictures that were drawn, one per camera.
    pub pictures: u64,
    /// Side of a cell, units of the input.
    pub voxel: f64,
    /// Blocks of 8x8x8 cells that hold something.
    pub blocks: u64,
    /// Triangles between the cells.
    pub extracted: u64,
    /// Connected pieces that are left.
    pub components: u64,
    /// Triangles of pieces that were too small: below `min_component`, or worth fewer than 8 of `max_triangles`.
    pub small: u64,
    /// Small holes that were closed.
    pub holes: u64,
    /// How far simplification moved the surface, units of the input, as it estimates it; absent when nothing was simplified.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simplification_error: Option<f64>,
}

impl StageDetails for SurfaceDetails {
    const STAGE: &'static str = "surface";
}
