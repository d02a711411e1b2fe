//! Draws a scene from the held-out photos' cameras and says what that cost: the hidden command `bench draw`, which
//! `bench cost` runs, so that drawing has a process of its own too.

use crate::dataset::{Dataset, DatasetOptions, View};
use crate::error::{Error, Result};
use crate::formats::{self, ReadOptions};
use crate::process::cpu_secs;
use crate::raster::soft::{SoftOptions, Sort};
use crate::render::scene_renderer::SceneRenderer;
use crate::scene::{Loaded, Scene};
use crate::train::eval::SOLID_SAMPLES;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// How a scene is drawn.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, clap::Args)]
pub(super) struct DrawSettings {
    /// Samples per pixel along each axis of solid drawings: 1, 2 or 4.
    #[arg(long, value_name = "N", default_value_t = DrawSettings::default().ssaa)]
    pub(super) ssaa: u32,
    /// Blend the layers of a pixel by their depth there.
    #[arg(long, num_args = 1, action = clap::ArgAction::Set, default_value_t = DrawSettings::default().sort_per_pixel)]
    pub(super) sort_per_pixel: bool,
    /// Smallest opacity times window that is drawn.
    #[arg(long, default_value_t = DrawSettings::default().cutoff)]
    pub(super) cutoff: f32,
    /// A pixel ends with the layer that brings its transmittance below this.
    #[arg(long, default_value_t = DrawSettings::default().min_transmittance)]
    pub(super) min_transmittance: f32,
}

impl Default for DrawSettings {
    fn default() -> Self {
        let SoftOptions { sort, cutoff, min_transmittance, .. } = SoftOptions::default();
        Self { ssaa: SOLID_SAMPLES, sort_per_pixel: sort == Sort::Pixel, cutoff, min_transmittance }
    }
}

impl DrawSettings {
    /// As little as possible left out of a soft drawing: the exact answer.
    pub(super) const EXACT: Self =
        Self { ssaa: 4, sort_per_pixel: true, cutoff: 1e-6, min_transmittance: 0.0 };

    /// A renderer of what was read.
    pub(super) fn renderer(&self, loaded: Loaded, dataset: &Dataset, background: [f32; 3]) -> SceneRenderer {
        let Loaded { scene, provenance, .. } = loaded;
        let placement = &provenance.placement;
        match scene {
            Scene::Mesh(mesh) => SceneRenderer::solid(mesh, placement, Some(dataset), background, self.ssaa),
            Scene::Soup(soup) => {
                let mut renderer = SceneRenderer::soft(soup, placement, Some(dataset), background);
                if let Some(options) = renderer.soft_options() {
                    options.sort = if self.sort_per_pixel { Sort::Pixel } else { Sort::Tile };
                    (options.cutoff, options.min_transmittance) = (self.cutoff, self.min_transmittance);
                }
                renderer
            }
        }
    }
}

/// What to draw, and how often.
#[derive(Debug, Clone, clap::Args)]
pub struct DrawArgs {
    /// Soup, drawn soft, or mesh, drawn solid.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// The photos whose cameras are used.
    #[arg(value_name = "DATASET")]
    dataset: PathBuf,
    /// Where the figures go, as JSON.
    #[arg(long, value_name = "FILE")]
    figures: PathBuf,
    /// Draw all pictures again and again for as long as this, seconds; once at least.
    #[arg(long, default_value_t = 0.0, value_name = "SECS")]
    seconds: f64,
    /// How it is drawn.
    #[command(flatten)]
    settings: DrawSettings,
    /// How the data set is read.
    #[command(flatten)]
    pub dataset_options: DatasetOptions,
}

/// What the drawing itself cost, without starting and reading.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct DrawFigures {
    /// User and system seconds of a picture.
    pub(super) cpu_seconds: f64,
    /// Seconds of a picture.
    pub(super) wall_seconds: f64,
}

/// Draws every held-out picture, once to warm up and then for some time, and writes the mean cost of one.
///
/// Errors: files that cannot be read, no held-out photos, an unsupported number of samples.
pub fn draw(args: &DrawArgs) -> Result<()> {
    let dataset = Dataset::load(&args.dataset, &args.dataset_options)?;
    let views: Vec<&View> = dataset.test().collect();
    let loaded = formats::read(&args.file, &ReadOptions::with_degree(3))?;
    let mut renderer = args.settings.renderer(loaded, &dataset, args.dataset_options.background.to_f32());
    views.iter().try_for_each(|view| renderer.validate(view.camera.size, &args.dataset_options.limits))?;
    let mut round = || views.iter().for_each(|view| drop(renderer.color(&view.camera)));
    round();
    let (clock, before) = (Instant::now(), cpu_secs());
    let mut rounds = 0;
    while rounds == 0 || clock.elapsed().as_secs_f64() < args.seconds {
        round();
        rounds += 1;
    }
    let pictures = (rounds * views.len()).max(1) as f64;
    let figures = DrawFigures {
        cpu_seconds: (cpu_secs() - before) / pictures,
        wall_seconds: clock.elapsed().as_secs_f64() / pictures,
    };
    let text = serde_json::to_vec(&figures).unwrap_or_default();
    std::fs::write(&args.figures, text).map_err(|e| Error::io(&args.figures, e))
}

impl DrawFigures {
    /// What [`draw`] left.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read(path).map_err(|e| Error::io(path, e))?;
        serde_json::from_slice(&text).map_err(|e| Error::malformed(path, "figures", e.to_string()))
    }
}
