//! A collider: a connected surface of few triangles, because the scene's own triangles overlap.
//!
//! Engines test a body against every triangle near it. A trained scene has many triangles, which cross each
//! other and leave gaps for a ball to fall through.

use super::details::SurfaceDetails;
use super::extract::surface;
use super::options::SurfaceOptions;
use trisplat_scene::{
    Error, ImportedScene, Limits, Result,
    camera::Camera,
    mesh::Mesh,
    ranges::{self, Called},
    report::{Outcome, StageDetails, StageProgress},
};

/// Whether a collider is made.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct CollisionOptions {
    /// Make a surface of few triangles to collide with: for Godot a node that it does not draw, for others a
    /// file OUT.collision.glb. It covers the view of the cameras of --dataset, or of the scene
    #[cfg_attr(feature = "cli", arg(long))]
    pub collision: bool,
    /// Most triangles of that surface
    #[cfg_attr(feature = "cli", arg(skip = CollisionOptions::DEFAULT.collision_triangles))]
    #[schemars(range(min = 1, max = 1_000_000_000))]
    pub collision_triangles: u32,
}

impl CollisionOptions {
    /// None.
    pub const DEFAULT: Self = Self { collision: false, collision_triangles: 4000 };

    /// Checks the range.
    pub fn validate(&self) -> Result<()> {
        ranges::check(self, Called::ByFlag)
    }
}

impl Default for CollisionOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// The collider; empty when there is none.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
pub struct CollisionDetails {
    /// How the surface was made.
    #[serde(flatten)]
    pub surface: SurfaceDetails,
}

impl StageDetails for CollisionDetails {
    const STAGE: &'static str = "collision";
}

/// Makes the surface of `scene` that `cameras` see, in the scene's frame. Without `cameras`, stored or chosen
/// ones are used.
///
/// Errors: too many blocks of the distance field; fewer triangles than a surface can have.
pub fn collision(
    found: &mut Option<Mesh>,
    scene: &ImportedScene,
    cameras: &[Camera],
    options: &CollisionOptions,
    details: &mut CollisionDetails,
    progress: &mut StageProgress<'_>,
) -> Result<Outcome<()>> {
    if !options.collision {
        return Ok(Outcome::Skipped("`collision` was not asked for"));
    }
    if found.is_some() {
        return Ok(Outcome::Skipped("there is something to collide with already"));
    }
    let how = SurfaceOptions { max_triangles: Some(options.collision_triangles), ..SurfaceOptions::DEFAULT }
        .for_scene(scene.scene.triangle_count());
    *found = surface(scene, cameras, &how, &Limits::DEFAULT, &mut details.surface, progress)
        .map_err(in_our_words)?;
    Ok(match found {
        Some(_) => Outcome::Changed(()),
        None => Outcome::Skipped("the cameras see no connected surface"),
    })
}

/// Names the option as this stage does.
fn in_our_words(error: Error) -> Error {
    match error {
        Error::Invalid { option, value, wants } if option == "max_triangles" => {
            Error::Invalid { option: "collision_triangles".into(), value, wants }
        }
        error => error,
    }
}
