//! `trisplat render FILE -o DIR`: pictures of a soup or a mesh, from the photos' cameras or from a circle around it.

use super::Global;
use super::outputs::Outputs;
use super::pictures::Pictures;
use super::progress::Progress;
use crate::asset::{Placement, Provenance, UpAxis};
use crate::camera::Camera;
use crate::dataset::{Dataset, DatasetOptions, Split};
use crate::error::{Error, Result};
use crate::eval::steps;
use crate::formats;
use crate::framing::Surroundings;
use crate::framing::surroundings::up_of;
use crate::placed;
use crate::render::scene_renderer::{RenderMode, RenderOptions, SceneRenderer};
use crate::rng::Rng;
use crate::scene::{Loaded, Scene};
use crate::train::BackendOptions;
use crate::view::orbit;
use glam::{DVec3, UVec2};
use std::path::{Path, PathBuf};

/// What to draw, and from which cameras.
#[derive(Debug, clap::Args)]
pub struct RenderArgs {
    /// Trained soup (.ply .pt), drawn soft unless --as says otherwise, or mesh (.glb .gltf .obj .ply .off).
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// How it is drawn.
    #[command(flatten)]
    pub render: RenderOptions,
    /// Folder for the pictures; made when it is not there.
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Data set whose cameras are used: a folder of posed photos, or a transforms.json.
    #[arg(long, value_name = "DATASET")]
    pub dataset: Option<PathBuf>,
    /// Which photos' cameras.
    #[arg(long, value_enum, default_value_t, conflicts_with = "orbit")]
    pub split: Split,
    /// Draw N pictures on a circle instead, around the subject of the scene: it begins where the photos show it best; without a
    /// data set at the first viewpoint of the file.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub orbit: Option<u32>,
    /// Width of an orbit's pictures when no data set is given, px; the height is three quarters of it.
    #[arg(long, value_name = "PX", default_value_t = 960, value_parser = clap::value_parser!(u32).range(1..=16384))]
    pub width: u32,
    /// What the pictures show.
    #[arg(long, value_enum, default_value_t)]
    pub show: PictureKind,
    /// Share of the triangles that --show random-subset draws, of 1.
    #[arg(long, value_name = "SHARE", default_value_t = 0.1)]
    pub share: f64,
    /// Seed of the random subset.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Replace pictures that are there.
    #[arg(short, long)]
    pub force: bool,
    /// Where soft pictures are drawn.
    #[command(flatten, next_help_heading = "Backend")]
    pub backend_options: BackendOptions,
    /// How the data set is read.
    #[command(flatten)]
    pub dataset_options: DatasetOptions,
}

/// What a picture shows of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum PictureKind {
    /// Colour.
    #[default]
    Color,
    /// Expected depth, near bright.
    Depth,
    /// Normals in camera space.
    Normal,
    /// Number of layers of each pixel.
    Contributions,
    /// Colour of some triangles only, so that their shapes can be seen.
    RandomSubset,
}

/// Draws all pictures.
pub fn run(args: &RenderArgs, global: &Global) -> Result<()> {
    if !(0.0..=1.0).contains(&args.share) {
        return Err(Error::invalid("--share", args.share, "a number from 0 to 1"));
    }
    check_folder(&args.output)?;
    let loaded = formats::read(&args.file, &args.dataset_options.read_options(3))?;
    let loaded = solid_if_asked(args, loaded)?;
    let dataset = args.dataset.as_ref().map(|path| Dataset::load(path, &args.dataset_options)).transpose()?;
    let cameras = match (&dataset, args.orbit) {
        (_, Some(count)) => orbit_cameras(args, &loaded, dataset.as_ref(), count)?,
        (Some(dataset), None) => dataset_cameras(args, dataset)?,
        (None, None) => {
            let wants = "cameras to draw from: --orbit 24 for a circle around the scene, or --dataset for those of its photos";
            return Err(Error::invalid("cameras", "none", wants));
        }
    };
    let Loaded { scene, provenance, .. } = loaded;
    let mut renderer = renderer(args, scene, &provenance.placement, dataset.as_ref());
    cameras
        .iter()
        .try_for_each(|(_, camera)| renderer.validate(camera.size, &args.dataset_options.limits))?;
    let mut outputs = Outputs::new([args.file.as_path()], args.force).with_dataset(args.dataset.as_deref());
    dataset.as_ref().map_or(Ok(()), |dataset| outputs.spare_photos(dataset))?;
    let names = cameras.iter().map(|(name, _)| name.as_str());
    let pictures = Pictures::plan("--output", &args.output, names, &mut outputs)?;
    let progress = Progress::new(global);
    if matches!(args.show, PictureKind::Color | PictureKind::RandomSubset) {
        let (card, warnings) = renderer.draw_on(&args.backend_options)?;
        progress.drawing_on(card.as_deref(), &warnings);
    }
    for (i, (_, camera)) in cameras.iter().enumerate() {
        let picture = match args.show {
            PictureKind::Color | PictureKind::RandomSubset => renderer.color(camera),
            PictureKind::Depth => renderer.depth(camera),
            PictureKind::Normal => renderer.normal(camera),
            PictureKind::Contributions => renderer.contributions(camera)?,
        };
        pictures.save(i, &picture)?;
    }
    progress.done();
    progress.line(&format!("wrote {} pictures to {}", cameras.len(), args.output.display()));
    Ok(())
}

/// Refuses a name that was meant for a file, before a folder of that name is made.
fn check_folder(folder: &Path) -> Result<()> {
    let ends_as_file = folder.extension().is_some_and(|end| {
        let end = end.to_string_lossy();
        end.len() <= 5 && end.chars().all(|c| c.is_ascii_alphabetic())
    });
    let meant_for_a_file = ends_as_file && !folder.to_string_lossy().ends_with(['/', '\\']);
    if folder.is_file() || (meant_for_a_file && !folder.is_dir()) {
        let wants = "a folder for the pictures, such as pictures; a folder whose name ends like a file's is given with / behind";
        return Err(Error::invalid("output", folder.display(), wants));
    }
    Ok(())
}

/// What was read; a soup that is to be drawn solid is baked.
fn solid_if_asked(args: &RenderArgs, loaded: Loaded) -> Result<Loaded> {
    match (&loaded.scene, args.render.mode) {
        (Scene::Mesh(_), Some(RenderMode::Soft)) => Err(steps::no_soup(&args.file)),
        (Scene::Soup(_), Some(RenderMode::Solid)) => {
            let asset = steps::baked(loaded)?;
            Ok(Loaded {
                scene: Scene::Mesh(asset.mesh),
                provenance: asset.provenance,
                warnings: Vec::new(),
                cameras: Vec::new(),
            })
        }
        _ => Ok(loaded),
    }
}

/// The renderer of the scene, or of the random subset of it.
fn renderer(
    args: &RenderArgs,
    scene: Scene,
    placement: &Placement,
    dataset: Option<&Dataset>,
) -> SceneRenderer {
    let background = args.dataset_options.background.to_f32();
    let rng = Rng::new(args.seed, "random subset", 0);
    let kept = |i: usize| rng.uniform_f64(i as u64) < args.share;
    let subset = args.show == PictureKind::RandomSubset;
    match scene {
        Scene::Soup(mut soup) => {
            if subset {
                soup.retain(kept);
            }
            SceneRenderer::soft(soup, placement, dataset, background)
        }
        Scene::Mesh(mut mesh) => {
            if subset {
                mesh.retain(kept);
            }
            SceneRenderer::solid(mesh, placement, dataset, background, args.render.ssaa)
        }
    }
}

/// Names and cameras of the photos.
fn dataset_cameras(args: &RenderArgs, dataset: &Dataset) -> Result<Vec<(String, Camera)>> {
    let views = args.split.of(dataset);
    if views.is_empty() {
        let split = args.split.name();
        return Err(Error::invalid("--split", split, "a part that holds photos: train or all"));
    }
    Ok(views.iter().map(|v| (v.name.clone(), v.camera)).collect())
}

/// A circle around the subject of the scene. Cameras are in the world of the data set when there is one, else in the frame of the file.
fn orbit_cameras(
    args: &RenderArgs,
    loaded: &Loaded,
    dataset: Option<&Dataset>,
    count: u32,
) -> Result<Vec<(String, Camera)>> {
    let Provenance { placement, up, viewpoint, .. } = &loaded.provenance;
    let origin = dataset.map_or(DVec3::ZERO, |dataset| dataset.origin);
    let cameras: Vec<Camera> = match dataset {
        Some(dataset) => {
            dataset.views.iter().map(|v| placed::to_file(&v.camera, placement, origin)).collect()
        }
        None => loaded.cameras.clone(),
    };
    let size = match (dataset, cameras.first()) {
        (Some(_), Some(camera)) => camera.size,
        _ => UVec2::new(args.width, (args.width * 3 / 4).max(1)),
    };
    // In a file that says which of its axes points up, the photos' is no better.
    let axis = up.unwrap_or_default().vector().as_vec3();
    let up = if *up == Some(UpAxis::Y) { axis } else { up_of(&cameras, axis) };
    let surroundings = Surroundings::of(&loaded.scene, &loaded.provenance);
    let said = viewpoint.filter(|_| dataset.is_none());
    let viewpoint = said.or_else(|| surroundings.viewpoint(&cameras, up));
    let viewpoint = viewpoint.ok_or_else(|| {
        Error::invalid("--orbit", args.file.display(), "a scene with triangles that have an extent")
    })?;
    let room = surroundings.room(DVec3::from(viewpoint.target).as_vec3());
    let orbit =
        orbit::around_viewpoint(&viewpoint, up, room, size, count).into_iter().map(|camera| match dataset {
            Some(_) => placed::to_world(&camera, placement, origin),
            None => camera,
        });
    Ok(orbit.enumerate().map(|(i, camera)| (format!("orbit_{i:04}.png"), camera)).collect())
}
