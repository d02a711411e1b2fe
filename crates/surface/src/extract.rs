//! The recipe: from a scene to its surface.

use crate::collider::collider;
use crate::extend::closed_nets;
use crate::fill::{Holes, drop_small, drop_small_areas, fill};
use crate::fuse::{DistanceField, Fusion, VoxelBlock};
use crate::grid::{Grid, blocks};
use crate::measured::add_measured;
use crate::options::{SurfaceDetails, SurfaceOptions};
use crate::picture::{DepthPicture, ViewFrustum, pictures};
use crate::simplify::{TooFewTriangles, simplify};
use crate::smooth::{smooth, smooth_border};
use glam::Vec3;
use trisplat_scene::camera::{Camera, PhotoDepths};
use trisplat_scene::mesh::Mesh;
use trisplat_scene::ranges::{self, OptionNaming};
use trisplat_scene::report::{Outcome, StageProgress};
use trisplat_scene::{Error, ImportedScene, Limits, Result, Scene, parallel};
use trisplat_teacher::Viewpoints;

/// Rounds of smoothing before a surface is simplified.
const SMOOTHING: u32 = 8;
/// Share of the time that drawing takes.
const DRAWING: f64 = 0.5;
/// Minimum share of a part's area that a connected component keeps; smaller ones are dropped.
const MIN_COMPONENT_AREA: f64 = 0.1;

/// Known facts about a scene beside its triangles.
#[derive(Debug, Clone, Copy, Default)]
pub struct Observations<'a> {
    /// Cameras in the frame of the scene; without them those that it stores are used, or chosen
    /// ones.
    pub cameras: &'a [Camera],
    /// Depths measured in photos, in the frame of the scene: they count more than the depths that
    /// the scene draws.
    pub depths: &'a [PhotoDepths],
}

/// The part of a scene that a surface is made of. All of the scene is drawn, so that its pictures
/// have no holes where the rest begins.
pub struct SurfacePart<'a> {
    /// Corners of a box around it.
    pub bounds: [Vec3; 2],
    /// Selects the faces of the surface that belong to it. `[F]`
    pub keep: &'a dyn Fn(&Mesh) -> Vec<bool>,
}

/// The surface that `cameras`, in the frame of `scene`, see of it; without cameras those that it
/// stores, or chosen ones: connected, with shared vertices, indices and a colour per vertex, in the
/// frame of the scene. Its fronts face the cameras. `None` when they see nothing. The same bits for
/// any number of threads.
///
/// The shell of a soup is left out unless the options ask for it; a backdrop must have been taken
/// out before.
///
/// # Errors
///
/// Options out of range; more blocks than `limits` permit in an array; fewer triangles than a
/// surface can have.
pub fn surface(
    scene: &ImportedScene,
    cameras: &[Camera],
    options: &SurfaceOptions,
    limits: &Limits,
    details: &mut SurfaceDetails,
    progress: &mut StageProgress<'_>,
) -> Result<Option<Mesh>> {
    let observations = Observations { cameras, depths: &[] };
    surface_of_part(scene, observations, None, options, limits, details, progress)
}

/// The same, of a `part` of the scene: without small components, and with all holes closed.
///
/// # Errors
///
/// As above.
pub fn surface_of_part(
    scene: &ImportedScene,
    observations: Observations<'_>,
    part: Option<&SurfacePart<'_>>,
    options: &SurfaceOptions,
    limits: &Limits,
    details: &mut SurfaceDetails,
    progress: &mut StageProgress<'_>,
) -> Result<Option<Mesh>> {
    extract(scene, observations, part, options, limits, details, progress)
        .map_err(|error| error.of_option("max_triangles"))
}

/// An error of [`extract`]: of the triangle limit, whose option the caller names, or any other.
enum ExtractError {
    Limit(TooFewTriangles),
    Other(Error),
}

impl From<Error> for ExtractError {
    fn from(error: Error) -> Self {
        Self::Other(error)
    }
}

impl ExtractError {
    /// The error, if `option` set the triangle limit.
    fn of_option(self, option: &str) -> Error {
        match self {
            Self::Limit(error) => error.of_option(option),
            Self::Other(error) => error,
        }
    }
}

fn extract(
    scene: &ImportedScene,
    observations: Observations<'_>,
    part: Option<&SurfacePart<'_>>,
    options: &SurfaceOptions,
    limits: &Limits,
    details: &mut SurfaceDetails,
    progress: &mut StageProgress<'_>,
) -> Result<Option<Mesh>, ExtractError> {
    options.validate()?;
    let Observations { cameras, depths } = observations;
    let viewpoints = if cameras.is_empty() { Viewpoints::of(scene, 0) } else { None };
    let cameras = viewpoints.as_ref().map_or(cameras, |viewpoints| &viewpoints.cameras);
    if cameras.is_empty() {
        return Ok(None);
    }
    details.viewpoints = viewpoints.as_ref().map(|viewpoints| viewpoints.kind);
    let mut pictures = pictures(&scene.scene, options.shell, cameras, progress.part(0.0, DRAWING));
    let Some(grid) = Grid::over(&pictures, part.map(|part| part.bounds), options)? else {
        return Ok(None);
    };
    add_measured(&mut pictures, depths);
    details.pictures = cameras.len() as u64;
    details.voxel = f64::from(grid.voxel);
    let mut mesh = seen_surface(&pictures, grid, options, limits, details)?;
    drop(pictures);
    details.extracted = mesh.face_count() as u64;
    let (pieces, holes) = match part {
        Some(part) => {
            let keep = (part.keep)(&mesh);
            mesh.retain(|face| keep[face]);
            (drop_small_areas(&mut mesh, MIN_COMPONENT_AREA), Holes::AllButTheWidest)
        }
        None => (drop_small(&mut mesh, options.min_component), Holes::Small),
    };
    details.components = pieces.remaining;
    details.small = pieces.dropped_faces;
    details.holes = fill(&mut mesh, holes);
    smooth_border(&mut mesh);
    let max_faces = options.max_triangles.map(|max_faces| max_faces as usize);
    if let Some(max_faces) = max_faces.filter(|max_faces| mesh.face_count() > *max_faces) {
        // Noise that few triangles cannot show would only crease them.
        smooth(&mut mesh, SMOOTHING);
        if let Some(simplified) = simplify(&mut mesh, max_faces).map_err(ExtractError::Limit)? {
            details.simplification_error = Some(simplified.error);
            details.components = simplified.pieces.remaining;
            details.small += simplified.pieces.dropped_faces;
        }
    }
    progress.set(1, 1);
    Ok((mesh.face_count() > 0).then_some(mesh))
}

/// The surface of what the pictures show.
fn seen_surface(
    pictures: &[DepthPicture],
    grid: Grid,
    options: &SurfaceOptions,
    limits: &Limits,
    details: &mut SurfaceDetails,
) -> Result<Mesh> {
    let fusion = Fusion {
        grid,
        truncation: options.truncation as f32 * grid.voxel,
        min_views: options.min_views.min(pictures.len() as u32),
    };
    let observers: Vec<ViewFrustum<'_>> = pictures.iter().map(ViewFrustum::new).collect();
    let numbers = blocks(pictures, &grid);
    let blocks: Vec<VoxelBlock> = limits.zeroed("the distance field", numbers.len())?;
    let mut field = DistanceField { numbers, blocks };
    let DistanceField { numbers, blocks } = &mut field;
    parallel::for_each_mut(blocks, 1, |i, block| *block = fusion.block(numbers[i], &observers));
    let mesh = closed_nets(&mut field, &grid, limits, |number| fusion.block(number, &observers))?;
    details.blocks = field.blocks.len() as u64;
    Ok(mesh)
}

// ---- A collider: a connected surface of few triangles, because the scene's own triangles overlap

/// Options of the collision mesh.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct CollisionOptions {
    /// Make a surface of few triangles to collide with: for Godot a node that it does not draw, for
    /// others a file OUT.collision.glb. Of a soup it covers the view of the cameras of --dataset,
    /// or of the scene; a mesh whose triangles share edges is simplified and stays closed
    #[cfg_attr(feature = "cli", arg(long))]
    pub collision: bool,
    /// Maximum number of triangles of that surface: 4000 of a soup, an eighth of a mesh whose
    /// triangles share edges, unless given
    #[cfg_attr(feature = "cli", arg(skip = CollisionOptions::DEFAULT.collision_triangles))]
    #[schemars(range(min = 1, max = 1_000_000_000))]
    pub collision_triangles: Option<u32>,
}

impl CollisionOptions {
    /// None.
    pub const DEFAULT: Self = Self { collision: false, collision_triangles: None };
    /// Maximum number of triangles of a soup's surface.
    const SOUP_TRIANGLES: u32 = 4000;

    /// Checks the range.
    pub fn validate(&self) -> Result<()> {
        ranges::check(self, OptionNaming::Flag)
    }
}

trisplat_scene::default!(CollisionOptions);

/// The collider; empty when there is none.
#[derive(
    Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema,
)]
pub struct CollisionDetails {
    /// Details of its surface.
    #[serde(flatten)]
    pub surface: SurfaceDetails,
}

trisplat_scene::stage!(CollisionDetails, "collision");

/// Makes the collider of `scene`, in its frame: a mesh whose triangles share edges is simplified;
/// of other scenes it is the surface that `cameras` see. Without `cameras`, stored or chosen ones
/// are used.
///
/// # Errors
///
/// Too many blocks of the distance field; fewer triangles than a surface can have.
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
    options.validate()?;
    if let Scene::Mesh(mesh) = &scene.scene {
        let most = options.collision_triangles.map(|most| most as usize);
        *found = collider(mesh, most, &mut details.surface)
            .map_err(|error| error.of_option("collision_triangles"))?;
        if found.is_some() {
            return Ok(Outcome::Changed(()));
        }
    }
    let most = options.collision_triangles.unwrap_or(CollisionOptions::SOUP_TRIANGLES);
    let how = SurfaceOptions { max_triangles: Some(most), ..SurfaceOptions::DEFAULT }
        .for_scene(scene.scene.triangle_count());
    let seen = Observations { cameras, depths: &[] };
    *found = extract(scene, seen, None, &how, &Limits::DEFAULT, &mut details.surface, progress)
        .map_err(|error| error.of_option("collision_triangles"))?;
    Ok(match found {
        Some(_) => Outcome::Changed(()),
        None => Outcome::Skipped("the cameras see no connected surface"),
    })
}
