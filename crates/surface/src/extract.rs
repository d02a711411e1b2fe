//! The recipe: from a scene to its surface.

use super::blocks::blocks;
use super::components::{drop_small, drop_small_areas};
use super::details::SurfaceDetails;
use super::field::{Block, Field};
use super::fill::{Holes, fill};
use super::fuse::Fusion;
use super::grid::Grid;
use super::nets::nets;
use super::options::SurfaceOptions;
use super::picture::{DepthPicture, Observer};
use super::pictures::pictures;
use super::simplify::simplify;
use super::smooth::smooth;
use glam::Vec3;
use trisplat_scene::parallel;
use trisplat_scene::{ImportedScene, Limits, Result, camera::Camera, mesh::Mesh, report::StageProgress};
use trisplat_teacher::Viewpoints;

/// Rounds of smoothing before a surface is simplified.
const SMOOTHING: u32 = 8;
/// Share of the time that drawing takes.
const DRAWING: f64 = 0.5;
/// Pieces with less than this share of a part's area are crumbs.
const CRUMB: f64 = 0.1;

/// The part of a scene that a surface is made of. All of the scene is drawn, so that its pictures have no holes where the rest begins.
pub struct Part<'a> {
    /// Corners of a box around it.
    pub bounds: [Vec3; 2],
    /// Which faces of the surface belong to it. `[F]`
    pub keep: &'a dyn Fn(&Mesh) -> Vec<bool>,
}

/// The surface that `cameras`, in the frame of `scene`, see of it; without cameras those that it stores, or chosen ones: connected, with shared vertices, indices and a colour per vertex, in the
/// frame of the scene. Its fronts face the cameras. `None` when they see nothing. The same bits for any number of threads.
///
/// The shell of a soup is left out unless the options ask for it; a backdrop must have been taken out before.
///
/// Errors: options out of range; more blocks than `limits` permit in an array; fewer triangles than a surface can have.
pub fn surface(
    scene: &ImportedScene,
    cameras: &[Camera],
    options: &SurfaceOptions,
    limits: &Limits,
    details: &mut SurfaceDetails,
    progress: &mut StageProgress<'_>,
) -> Result<Option<Mesh>> {
    surface_of_part(scene, cameras, None, options, limits, details, progress)
}

/// The same, of a `part` of the scene: without crumbs, and with all holes closed.
///
/// Errors: as above.
pub fn surface_of_part(
    scene: &ImportedScene,
    cameras: &[Camera],
    part: Option<&Part<'_>>,
    options: &SurfaceOptions,
    limits: &Limits,
    details: &mut SurfaceDetails,
    progress: &mut StageProgress<'_>,
) -> Result<Option<Mesh>> {
    options.validate()?;
    let chosen = match cameras.is_empty() {
        true => Viewpoints::of(scene, 0),
        false => None,
    };
    let cameras = chosen.as_ref().map_or(cameras, |viewpoints| &viewpoints.cameras);
    if cameras.is_empty() {
        return Ok(None);
    }
    details.viewpoints = chosen.as_ref().map(|viewpoints| viewpoints.kind);
    let pictures = pictures(&scene.scene, options.shell, cameras, progress.part(0.0, DRAWING));
    let Some(grid) = Grid::over(&pictures, part.map(|part| part.bounds), options)? else { return Ok(None) };
    let field = fused(&pictures, grid, options, limits)?;
    drop(pictures);
    let mut mesh = nets(&field, &grid);
    (details.pictures, details.voxel) = (cameras.len() as u64, f64::from(grid.voxel));
    (details.blocks, details.extracted) = (field.blocks.len() as u64, mesh.face_count() as u64);
    drop(field);
    let (pieces, holes) = match part {
        Some(part) => {
            let keep = (part.keep)(&mesh);
            mesh.retain(|face| keep[face]);
            (drop_small_areas(&mut mesh, CRUMB), Holes::AllButTheWidest)
        }
        None => (drop_small(&mut mesh, options.min_component), Holes::Small),
    };
    (details.components, details.small) = (pieces.kept, pieces.dropped_faces);
    details.holes = fill(&mut mesh, holes);
    let fewer = options.max_triangles.map(|most| most as usize).filter(|most| mesh.face_count() > *most);
    if let Some(most) = fewer {
        // Noise that few triangles cannot show would only crease them.
        smooth(&mut mesh, SMOOTHING);
        if let Some(simplified) = simplify(&mut mesh, most)? {
            details.simplification_error = Some(simplified.error);
            details.components = simplified.pieces.kept;
            details.small += simplified.pieces.dropped_faces;
        }
    }
    progress.set(1, 1);
    Ok((mesh.face_count() > 0).then_some(mesh))
}

/// The distance field of what the pictures show.
fn fused(pictures: &[DepthPicture], grid: Grid, options: &SurfaceOptions, limits: &Limits) -> Result<Field> {
    let fusion = Fusion {
        grid,
        truncation: options.truncation as f32 * grid.voxel,
        min_views: options.min_views.min(pictures.len() as u32),
    };
    let numbers = blocks(pictures, &grid);
    let mut blocks: Vec<Block> = limits.zeroed("the distance field", numbers.len())?;
    let observers: Vec<Observer<'_>> = pictures.iter().map(Observer::new).collect();
    parallel::for_each_mut(&mut blocks, 1, |i, block| *block = fusion.block(numbers[i], &observers));
    Ok(Field { numbers, blocks })
}
