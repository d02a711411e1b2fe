//! The recipe of `trisplat mesh`: from a scene to one connected surface, ready for a file.

use super::chunk::by_material;
use super::crop::{CropOptions, SubjectVolume, crop, faces_within};
use super::place::evidence::Evidence;
use super::place::{PlaceOptions, place};
use super::surroundings::take_shell;
use super::texture::{TextureOptions, texture};
use super::viewpoint::viewpoint;
use super::views::Views;
use crate::place::placement_of;
use crate::solid::{ColorDetails, color};
use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_formats::output::OutputOptions;
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::{Outcome, Report, StageObserver, generator};
use trisplat_scene::{
    Asset, Chunk, Error, ImportedScene, Limits, Placement, Provenance, Result, Scene, frames,
};
use trisplat_surface::{
    Observations, SurfaceDetails, SurfaceOptions, SurfacePart, surface_of_part,
};

/// The options of the stages.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct MeshOptions {
    /// Region of the scene to keep.
    #[cfg_attr(feature = "cli", command(flatten, next_help_heading = "Crop: keep a region"))]
    pub crop: CropOptions,
    /// Options of the surface.
    #[cfg_attr(
        feature = "cli",
        command(flatten, next_help_heading = "Surface: one connected mesh")
    )]
    pub surface: SurfaceOptions,
    /// Options of the texture.
    #[cfg_attr(
        feature = "cli",
        command(flatten, next_help_heading = "Texture: detail of the photos")
    )]
    pub texture: TextureOptions,
    /// The frame of the output.
    #[cfg_attr(
        feature = "cli",
        command(flatten, next_help_heading = "Place: the frame of the output")
    )]
    pub place: PlaceOptions,
    /// The files written.
    #[cfg_attr(feature = "cli", command(flatten, next_help_heading = "Output"))]
    pub output: OutputOptions,
}

impl MeshOptions {
    /// Checks the ranges that need no scene.
    pub fn validate(&self) -> Result<()> {
        self.surface.validate()?;
        self.output.validate()?;
        self.texture.validate()?;
        self.place.validate()
    }

    /// Refuses a texture when no photos are given.
    pub fn check_photos(&self, has_photos: bool) -> Result<()> {
        let wants = "photos: give the data set after the scene, as in trisplat mesh scene.ply photos --texture -o room.glb";
        if self.texture.is_wanted() && !has_photos {
            Err(Error::invalid("texture", "given without photos", wants))
        } else {
            Ok(())
        }
    }
}

/// The upright surface of `scene` that the cameras of `views` see; without `views`, stored or
/// chosen cameras are used. `limits` bound the memory of the distance field.
///
/// # Errors
///
/// Options out of range, nothing to be seen, no surface left.
pub fn mesh(
    mut scene: ImportedScene,
    mut views: Option<&mut Views>,
    options: &MeshOptions,
    limits: &Limits,
    report: &mut Report,
    observer: StageObserver<'_>,
) -> Result<Asset> {
    options.validate()?;
    report.warnings.append(&mut scene.warnings);
    if let Some(views) = views.as_deref_mut() {
        views.transform(&scene.provenance.placement);
        views.show_part(options.crop.is_cropped());
    }
    let cameras = views.as_deref().map_or(&[][..], Views::cameras);
    let scene_cameras = if cameras.is_empty() { scene.cameras.clone() } else { cameras.to_vec() };
    let backdrop = take_surroundings(&mut scene, &scene_cameras, options)?;
    // The subject is cut from the surface: a scene that is cut first has pictures that are torn
    // along its triangles.
    let whole = options.crop.is_subject().then(|| scene.clone());
    let (scene, volume) = cropped(scene, &scene_cameras, options, report, observer)?;
    let is_kept = volume.map(|volume| {
        let scene_cameras = &scene_cameras;
        let crop = &options.crop;
        move |mesh: &Mesh| faces_within(mesh, &volume, scene_cameras, crop)
    });
    let bounds = || scene.scene.bounds(scene.scene.triangle_count());
    let part =
        is_kept.as_ref().and_then(|is_kept| Some(SurfacePart { bounds: bounds()?, keep: is_kept }));
    let scene = whole.unwrap_or(scene);
    let placement = &scene.provenance.placement;
    let depths = views.as_deref().map_or_else(Vec::new, |views| views.depths(placement));
    let surface_options = beside_backdrop(&options.surface, backdrop.face_count());
    let (mut surface_mesh, _) = report.long_stage(
        observer,
        Mesh::default(),
        // First the scene for the surface.
        |mesh| if mesh.face_count() == 0 { scene.scene.counts() } else { Mesh::counts(mesh) },
        |mesh, details: &mut SurfaceDetails, progress| {
            let part = part.as_ref();
            let options = &surface_options;
            let observations = Observations { cameras, depths: &depths };
            let found =
                surface_of_part(&scene, observations, part, options, limits, details, progress)?;
            *mesh = found.ok_or(Error::EmptySurface)?;
            Ok(Outcome::Changed(()))
        },
    )?;

    let backdrop_faces = backdrop.face_count() as u32;
    surface_mesh.append(backdrop)?;
    let (surface_mesh, texture_details) =
        report.long_stage(observer, surface_mesh, Mesh::counts, |mesh, details, progress| {
            texture(mesh, views.as_deref_mut(), None, &options.texture, details, progress)
        })?;
    report.warnings.extend(texture_details.warning());

    let provenance = Provenance { backdrop_faces, ..scene.provenance };
    let points = views.as_deref().map_or(&[][..], Views::points);
    let evidence = Evidence { cameras: &scene_cameras, points, are_chosen: false };
    package(surface_mesh, provenance, evidence, options, report, observer)
}

/// Options of a surface beside a backdrop, which takes at most half of its limit of triangles.
fn beside_backdrop(options: &SurfaceOptions, backdrop_faces: usize) -> SurfaceOptions {
    let rest = |total: u32| total - (backdrop_faces as u32).min(total / 2);
    SurfaceOptions { max_triangles: options.max_triangles.map(rest), ..options.clone() }
}

/// The surface in the frame of its file. `evidence` is in the frame of the scene.
fn package(
    mesh: Mesh,
    mut provenance: Provenance,
    evidence: Evidence<'_>,
    options: &MeshOptions,
    report: &mut Report,
    observer: StageObserver<'_>,
) -> Result<Asset> {
    let is_subject = options.crop.is_subject();
    let options = &options.place;
    let mut placement = Placement::IDENTITY;
    let (mesh, place_details) = report.stage(observer, mesh, Mesh::counts, |mesh, details| {
        placement = placement_of(is_subject, mesh, &provenance, evidence, options, details);
        place(mesh, &mut provenance, placement, details)
    })?;
    report.warnings.extend(place_details.warning());
    provenance.generator = Some(generator());
    let cameras = evidence.cameras.iter();
    let cameras = cameras.map(|camera| frames::to_file(camera, &placement, DVec3::ZERO));
    let cameras: Vec<Camera> = cameras.collect();
    let mut asset = Asset { provenance, ..Asset::from(mesh) };
    asset.chunks = scene_and_backdrop(&asset);
    by_material(&mut asset);
    let (asset, _) = report.stage(observer, asset, Asset::counts, |asset, details| {
        Ok(viewpoint(asset, &cameras, details))
    })?;
    Ok(asset)
}

/// Takes the surroundings out of the scene, if they are no part of the surface. A surface that
/// shows photos gets their background, too; a cropped part gets none.
fn take_surroundings(
    scene: &mut ImportedScene,
    cameras: &[Camera],
    options: &MeshOptions,
) -> Result<Mesh> {
    if options.surface.shell {
        return Ok(Mesh::default());
    }
    let is_wanted = options.texture.is_wanted() && !options.crop.is_cropped();
    let backdrop = if is_wanted { take_behind(scene, cameras)? } else { Mesh::default() };
    scene.take_backdrop();
    Ok(backdrop)
}

/// No chunk holds faces of both a scene and its backdrop.
fn scene_and_backdrop(asset: &Asset) -> Vec<Chunk> {
    let scene = asset.scene_faces() as u32;
    let all = asset.mesh.face_count() as u32;
    let both = [Chunk { first: 0, count: scene }, Chunk { first: scene, count: all - scene }];
    both.into_iter().filter(|chunk| chunk.count > 0).collect()
}

/// The region of the scene to keep, and the volume of its subject, if only that is kept.
fn cropped(
    scene: ImportedScene,
    cameras: &[Camera],
    options: &MeshOptions,
    report: &mut Report,
    observer: StageObserver<'_>,
) -> Result<(ImportedScene, Option<SubjectVolume>)> {
    let mut volume = None;
    let (scene, _) = report.stage(observer, scene, ImportedScene::counts, |scene, details| {
        let up = scene.provenance.up;
        let (outcome, found) = crop(&mut scene.scene, cameras, up, &options.crop, details)?;
        volume = found;
        Ok(outcome)
    })?;
    Ok((scene, volume))
}

/// Takes the shell or backdrop, which must look like its photos, out of the scene. Empty when there
/// is none, or when it is the whole scene.
fn take_behind(scene: &mut ImportedScene, cameras: &[Camera]) -> Result<Mesh> {
    if let Some(backdrop) = scene.take_backdrop() {
        return Ok(backdrop);
    }
    if scene.scene.shell_count() == scene.scene.triangle_count() {
        return Ok(Mesh::default());
    }
    let mut shell = match &mut scene.scene {
        Scene::Soup(soup) => color(soup.take_shell(), &mut ColorDetails::default())?,
        Scene::Mesh(mesh) => mesh.take_shell(),
    };
    shell.shell = vec![true; shell.face_count()];
    Ok(take_shell(&mut shell, cameras))
}
