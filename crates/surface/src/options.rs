//! Options of surface extraction.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::Result;
use trisplat_scene::ranges::{self, OptionNaming};
use trisplat_teacher::ViewpointKind;

/// Cells along the longest side, unless asked for more; ...
const MAX_CELLS: u32 = 256;
/// ... and with few triangles.
const MIN_CELLS: u32 = 48;
/// Cells along it per root of the triangles that are to be left, ...
const CELLS_PER_SIDE: f64 = 1.3;
/// ... and, where the surface serves a scene, per root of the scene's triangles: time grows with
/// the square of the cells.
const CELLS_OF_SCENE: f64 = 6.0;

/// Options of surface extraction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct SurfaceOptions {
    /// Cells of the distance field along the longest side of what the cameras see, 8 or more; 256
    /// unless given, or as few as `--max-triangles` can show
    #[cfg_attr(feature = "cli", arg(long, value_name = "N"))]
    #[schemars(range(min = 8, max = 65_536))]
    pub resolution: Option<u32>,
    /// Side of a cell in units of the input, in place of `--resolution`
    #[cfg_attr(feature = "cli", arg(long, value_name = "SIDE", conflicts_with = "resolution"))]
    #[schemars(range(min = 1e-9, max = 1e9))]
    pub voxel: Option<f64>,
    /// Longest distance from the surface that counts, in cells; more smooths, less keeps thin
    /// things
    #[cfg_attr(feature = "cli", arg(long, default_value_t = SurfaceOptions::DEFAULT.truncation, value_name = "CELLS"))]
    #[schemars(range(min = 2.0, max = 64.0))]
    pub truncation: f64,
    /// Number of cameras that must have seen a place, 1 or more; all of them where there are fewer
    #[cfg_attr(feature = "cli", arg(long, default_value_t = SurfaceOptions::DEFAULT.min_views, value_name = "N"))]
    #[schemars(range(min = 1, max = 1_000_000))]
    pub min_views: u32,
    /// Drop connected pieces of fewer triangles, counted before `--max-triangles`
    #[cfg_attr(feature = "cli", arg(long, default_value_t = SurfaceOptions::DEFAULT.min_component, value_name = "N"))]
    #[schemars(range(max = 1_000_000_000))]
    pub min_component: u32,
    /// Simplify to about this many triangles; below a thousand, more may be left
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..)))]
    #[schemars(range(min = 1, max = 1_000_000_000))]
    pub max_triangles: Option<u32>,
    /// Count the shell of a trained soup, and the backdrop of a baked file, as part of the scene
    #[cfg_attr(feature = "cli", arg(long, default_value_t = SurfaceOptions::DEFAULT.shell, num_args = 0..=1, require_equals = true,
          default_missing_value = "true", action = clap::ArgAction::Set, value_name = "BOOL"))]
    pub shell: bool,
}

impl SurfaceOptions {
    /// 256 cells along the longest side, nothing simplified.
    pub const DEFAULT: Self = Self {
        resolution: None,
        voxel: None,
        truncation: 4.0,
        min_views: 2,
        min_component: 200,
        max_triangles: None,
        shell: false,
    };

    /// Cells along the longest side.
    ///
    /// Of a surface that is to have few triangles no more than these can show: what noise adds
    /// beyond costs triangles, and collapses of edges tear it.
    pub(super) fn cells(&self) -> u32 {
        let cells_of = |triangles: u32| (CELLS_PER_SIDE * f64::from(triangles).sqrt()) as u32;
        self.resolution.unwrap_or_else(|| {
            self.max_triangles.map_or(MAX_CELLS, cells_of).clamp(MIN_CELLS, MAX_CELLS)
        })
    }

    /// The same with no more cells than a scene of `triangles` can fill with detail.
    pub fn for_scene(&self, triangles: usize) -> Self {
        let filled = (CELLS_OF_SCENE * (triangles as f64).sqrt()) as u32;
        Self { resolution: Some(self.cells().min(filled.max(MIN_CELLS))), ..self.clone() }
    }

    /// Checks the ranges.
    pub fn validate(&self) -> Result<()> {
        // Surface nets need the distances of all corners of the cells that the surface runs
        // through.
        ranges::check(self, OptionNaming::Flag)?;
        ranges::check_finite("voxel", self.voxel)
    }
}

trisplat_scene::default!(SurfaceOptions);

// ---- What the making of a surface measured ------------------------------------------------------

/// Inputs of a surface, and its dropped components.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SurfaceDetails {
    /// Kind of chosen viewpoints; absent when the input has cameras.
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
    /// Triangles of pieces that were too small: below `min_component`, or worth fewer than 8 of
    /// `max_triangles`.
    pub small: u64,
    /// Small holes that were closed.
    pub holes: u64,
    /// Estimated error of simplification, units of the input; absent
    /// when nothing was simplified.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simplification_error: Option<f64>,
}

trisplat_scene::stage!(SurfaceDetails, "surface");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_of_few_triangles_has_a_surface_of_few_cells() {
        let fine = SurfaceOptions { resolution: Some(128), ..SurfaceOptions::DEFAULT };
        let cells = |triangles: usize| fine.for_scene(triangles).cells();
        assert_eq!([1, 60, 100, 300, 1000, 1_000_000].map(cells), [48, 48, 60, 103, 128, 128]);
        let coarse = SurfaceOptions { resolution: Some(20), ..SurfaceOptions::DEFAULT };
        assert_eq!(coarse.for_scene(60).cells(), 20, "never more than asked for");
    }
}
