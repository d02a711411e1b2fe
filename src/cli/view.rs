//! `trisplat view FILE`: a window to fly through a scene.

use crate::asset::{Asset, Placement, UpAxis};
use crate::bake::{self, bvh, bvh::BvhOptions, options::BakeOptions, options::Preset};
use crate::bench::fidelity::Painter;
use crate::camera::Camera;
use crate::dataset::{Dataset, DatasetOptions};
use crate::error::{Error, Result};
use crate::formats::{self, ReadOptions};
use crate::gpu::AdapterOptions;
use crate::report::Report;
use crate::scene::{Loaded, Scene as Read};
use crate::soup::Soup;
use crate::view::placed;
use crate::view::window::{self, Loader, Photo, Scene, Source, WindowOptions};
use glam::{DVec3, UVec2, Vec3};
use std::path::PathBuf;
use std::sync::Arc;

/// What to look at, and how.
#[derive(Debug, Clone, clap::Args)]
pub struct ViewArgs {
    /// Scene to show: .glb .gltf .obj .off .ply .pt; a soup is baked in memory.
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Data set whose cameras can be jumped to, with the photos beside or over the picture.
    #[arg(long, value_name = "DATASET")]
    pub dataset: Option<PathBuf>,
    /// Width and height of the window, px.
    #[arg(long, default_value = "1280x720", value_name = "WxH", value_parser = parse_size)]
    pub size: UVec2,
    /// Samples of edges: 1 or 4 a pixel.
    #[arg(long, default_value_t = 4, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4))]
    pub msaa: u32,
    /// Show pictures as soon as they are drawn, for the largest FPS.
    #[arg(long)]
    pub no_vsync: bool,
    /// Folder for the screenshots that F12 takes.
    #[arg(long, default_value = ".", value_name = "DIR")]
    pub shots: PathBuf,
    /// Which graphics card draws.
    #[command(flatten, next_help_heading = "Graphics card")]
    pub adapter: AdapterOptions,
    /// How the data set is read.
    #[command(flatten, next_help_heading = "Data set")]
    pub dataset_options: DatasetOptions,
}

/// 1280x720 as a size.
pub(super) fn parse_size(text: &str) -> std::result::Result<UVec2, String> {
    let parsed =
        text.split_once(['x', 'X']).and_then(|(w, h)| Some(UVec2::new(w.parse().ok()?, h.parse().ok()?)));
    parsed.filter(|s| s.min_element() > 0).ok_or_else(|| "wants WIDTHxHEIGHT, such as 1280x720".into())
}

/// Opens the window; returns when it is closed.
pub fn run(args: &ViewArgs) -> Result<()> {
    if ![1, 4].contains(&args.msaa) {
        return Err(Error::invalid("--msaa", args.msaa, "1 or 4"));
    }
    // A misspelt name is told before a window opens.
    for path in [Some(&args.file), args.dataset.as_ref()].into_iter().flatten() {
        std::fs::metadata(path).map_err(|e| Error::io(path, e))?;
    }
    let name = args.file.file_name().unwrap_or(args.file.as_os_str()).to_string_lossy().into_owned();
    let options = WindowOptions {
        title: format!("{name} – trisplat"),
        size: args.size,
        background: args.dataset_options.background.to_f32(),
        msaa: args.msaa,
        vsync: !args.no_vsync,
        shots: args.shots.clone(),
        adapter: args.adapter.clone(),
    };
    let args = args.clone();
    let load = Box::new(move |say: &dyn Fn(&str)| load(&args, say));
    window::open(options, Loader { load, index })
}

fn load(args: &ViewArgs, say: &dyn Fn(&str)) -> Result<Scene> {
    say("reading");
    let loaded = formats::read(&args.file, &ReadOptions { sh_degree: 3 })?;
    let dataset = match &args.dataset {
        Some(path) => {
            say("reading the data set");
            Some(Dataset::load(path, &args.dataset_options)?)
        }
        None => None,
    };
    say("baking");
    let background = args.dataset_options.background.to_f32();
    let baked = baked(loaded)?;
    let photos = dataset.map_or(Vec::new(), |dataset| {
        let photo = |view: &crate::dataset::View| {
            let photo = view.photo.clone();
            let camera = baked.place(&view.camera, dataset.origin);
            Photo { name: view.name.clone(), camera, load: Arc::new(move || photo.decode()) }
        };
        dataset.views.iter().map(photo).collect()
    });
    let Baked { asset, soup, step, .. } = baked;
    let source = soup.map(|soup| {
        let mut painter = Painter::alone(soup.clone(), background);
        let paint =
            Box::new(move |camera: &Camera| painter.color(&placed::to_world(camera, &step, DVec3::ZERO)));
        Source { soup: Arc::new(soup), to_soup: Arc::new(move |v: Vec3| step.to_world(v)), paint }
    });
    Ok(Scene { asset, up: Vec3::Y, photos, source })
}

/// A scene made ready to be drawn.
pub(super) struct Baked {
    pub(super) asset: Asset,
    /// What was read, when it was a soup.
    pub(super) soup: Option<Soup>,
    /// How the file had been placed in its source's world.
    pub(super) first: Placement,
    /// How the bake placed the asset in the file's frame.
    pub(super) step: Placement,
}

impl Baked {
    /// A camera of the source's world, whose point `origin` is its zero, in the frame of the asset.
    pub(super) fn place(&self, camera: &Camera, origin: DVec3) -> Camera {
        placed::to_file(&placed::to_file(camera, &self.first, origin), &self.step, DVec3::ZERO)
    }
}

/// What an engine would draw of a file: Y-up, in chunks, in order.
pub(super) fn baked(loaded: Loaded) -> Result<Baked> {
    let first = loaded.provenance.placement;
    let is_y_up = loaded.provenance.up.unwrap_or_default() == UpAxis::Y;
    let soup = match &loaded.scene {
        Read::Soup(soup) => Some(soup.clone()),
        Read::Mesh(_) => None,
    };
    let options = BakeOptions::preset(Preset::Default);
    let asset = bake::bake(vec![loaded], &options, &mut Report::new("view"), &mut ())?;
    let step = if is_y_up { Placement::IDENTITY } else { asset.provenance.placement };
    Ok(Baked { asset, soup, first, step })
}

/// Adds the hierarchy that picking needs.
fn index(mut asset: Asset) -> Result<Asset> {
    bvh::bvh(&mut asset, &BvhOptions { bvh: true }, &mut bake::Details::new())?;
    Ok(asset)
}
