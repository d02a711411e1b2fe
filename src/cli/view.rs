//! `trisplat view FILE`: a window to fly through a scene.

use glam::{DVec3, UVec2, Vec3};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use trisplat_dataset::{Dataset, DatasetOptions, View};
use trisplat_formats as formats;
use trisplat_gpu::AdapterOptions;
use trisplat_job::{BakedScene, SceneRenderer};
use trisplat_scene::atomic::AtomicFile;
use trisplat_scene::camera::Camera;
use trisplat_scene::{Error, ImportedScene, Placement, Region, Result, Splats, frames};
use trisplat_view::window::{
    self, SceneFiles, SceneLoader, SoupSource, WindowOptions, WindowPhoto, WindowScene,
};

/// Scene and window.
#[derive(Debug, Clone, clap::Args)]
pub struct ViewArgs {
    /// Scene to show: .glb .gltf .obj .off .ply .pt; a soup is baked in memory. Gaussian splats
    /// (.ply .splat .spz .sog .glb) are drawn as triangles in motion, and as their trainers draw
    /// them in the look `soft` at rest.
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Data set whose cameras can be visited, with the photos beside or over the picture.
    #[arg(long, value_name = "DATASET")]
    pub dataset: Option<PathBuf>,
    /// Width and height of the window, px.
    #[arg(long, default_value = "1280x720", value_name = "WxH", value_parser = trisplat_scene::image::parse_size)]
    pub size: UVec2,
    /// Samples per pixel at edges (MSAA): 1 or 4.
    #[arg(long, default_value_t = 4, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4))]
    pub msaa: u32,
    /// Show pictures without waiting for the display, for the highest FPS.
    #[arg(long)]
    pub no_vsync: bool,
    /// Folder for the screenshots that F12 takes and the regions that Enter saves.
    #[arg(long, default_value = ".", value_name = "DIR")]
    pub screenshots: PathBuf,
    /// Graphics card.
    #[command(flatten, next_help_heading = "Graphics card")]
    pub adapter: AdapterOptions,
    /// Reading options of the data set.
    #[command(flatten, next_help_heading = "Data set")]
    pub dataset_options: DatasetOptions,
}

/// Opens the window; returns when it is closed.
pub fn run(args: &ViewArgs) -> Result<()> {
    if ![1, 4].contains(&args.msaa) {
        return Err(Error::invalid("--msaa", args.msaa, "1 or 4"));
    }
    // A misspelt name is reported before a window opens.
    for path in [Some(&args.file), args.dataset.as_ref()].into_iter().flatten() {
        std::fs::metadata(path).map_err(|e| Error::io(path, e))?;
    }
    let options = WindowOptions {
        size: args.size,
        background: args.dataset_options.background.to_f32(),
        msaa: args.msaa,
        vsync: !args.no_vsync,
        screenshots: args.screenshots.clone(),
        remedy: "`trisplat render` makes pictures without a window",
        adapter: args.adapter.clone(),
    };
    let files = SceneFiles { file: args.file.clone(), dataset: args.dataset.clone() };
    let how = args.dataset_options.clone();
    let folder = args.screenshots.clone();
    let load =
        move |files: &SceneFiles, progress: &dyn Fn(&str)| load(files, &how, &folder, progress);
    window::open(options, files, SceneLoader { load: Arc::new(load), follow: None })
}

/// Reads a scene and its photos with the options `how`; the user's files go to `folder`.
pub(super) fn load(
    files: &SceneFiles,
    how: &DatasetOptions,
    folder: &Path,
    progress: &dyn Fn(&str),
) -> Result<WindowScene> {
    progress("reading");
    // Triangles in place of Gaussians, until the camera rests and they are drawn themselves.
    let (loaded, splats) = formats::read_content(&files.file, &how.read_options(3))?.stand_in();
    let photos = match &files.dataset {
        Some(path) => {
            progress("reading the data set");
            let dataset = Dataset::load(path, how)?;
            PosedPhotos { views: dataset.views, origin: dataset.origin }
        }
        None => PosedPhotos::default(),
    };
    progress("baking");
    window_scene((loaded, splats), &photos, how, &files.file, folder)
}

/// Photos, and the world point that is the origin of their cameras.
#[derive(Debug, Clone, Default)]
pub(super) struct PosedPhotos {
    pub(super) views: Vec<View>,
    pub(super) origin: DVec3,
}

/// The content of a window for a scene of `file`, which may stand for Gaussians.
pub(super) fn window_scene(
    (loaded, splats): (ImportedScene, Option<Splats>),
    photos: &PosedPhotos,
    how: &DatasetOptions,
    file: &Path,
    folder: &Path,
) -> Result<WindowScene> {
    let background = how.background.to_f32();
    let baked = BakedScene::new(loaded)?;
    let photo = |view: &View| {
        let photo = view.photo.clone();
        let camera = baked.place(&view.camera, photos.origin);
        WindowPhoto { name: view.name.clone(), camera, load: Arc::new(move || photo.decode()) }
    };
    let photos = photos.views.iter().map(photo).collect();
    let BakedScene { asset, soup, bake_placement, .. } = baked;
    let source = soup.map(|soup| {
        let mut scene = match splats {
            Some(splats) => SceneRenderer::splats(splats, &Placement::IDENTITY, None, background),
            None => SceneRenderer::soft(soup, &Placement::IDENTITY, None, background),
        };
        let renderer = Arc::new(Mutex::new(move |camera: &Camera| {
            scene.color(&frames::to_world(camera, &bake_placement, DVec3::ZERO))
        }));
        SoupSource { renderer, rest: 0.0 }
    });
    let file = file.to_owned();
    let folder = folder.to_owned();
    let save_crop = Arc::new(move |region: &Region| save_crop(&file, &folder, region));
    let asset = Arc::new(asset);
    Ok(WindowScene {
        asset,
        up: Vec3::Y,
        photos,
        source,
        placement: bake_placement,
        save_crop,
        status: None,
    })
}

/// Writes the region as a config file of `trisplat bake` and says how to use it.
fn save_crop(file: &Path, folder: &Path, region: &Region) -> Result<String> {
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    // An earlier region stays.
    let named = |i: usize| {
        let mut name = file.file_stem().unwrap_or_default().to_owned();
        name.push(if i == 1 { ".crop.json".to_owned() } else { format!(".crop-{i}.json") });
        folder.join(name)
    };
    let path = (1..10_000).map(named).find(|path| !path.exists()).ok_or_else(|| {
        Error::invalid("screenshots", folder.display(), "a folder with fewer saved regions")
    })?;
    let text = format!("{:#}\n", serde_json::json!({ "crop": { "crop": [region] } }));
    AtomicFile::create(&path)?.commit_with(text)?;
    Ok(format!("saved {}: trisplat bake {} --config {0} ...", path.display(), file.display()))
}
