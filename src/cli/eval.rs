//! `trisplat eval SOUP DATASET`: PSNR, SSIM and FLIP against the photos.

use super::Global;
use super::files;
use super::progress::Progress;
use super::render::{prepare_folder, save_picture};
use crate::bench::fidelity::{self, Fidelity, Painter, Score};
use crate::dataset::{Dataset, DatasetOptions, Split};
use crate::error::{Error, Result};
use crate::formats::{self, ReadOptions};
use std::path::PathBuf;

/// What to compare.
#[derive(Debug, clap::Args)]
pub struct EvalArgs {
    /// Trained soup: .ply .pt.
    #[arg(value_name = "SOUP")]
    pub soup: PathBuf,
    /// Folder of posed photos, or a transforms.json.
    #[arg(value_name = "DATASET")]
    pub dataset: PathBuf,
    /// Which photos.
    #[arg(long, value_enum, default_value_t)]
    pub split: Split,
    /// Write the drawings into this folder, as PNG files named like the photos.
    #[arg(long, value_name = "DIR")]
    pub save_renders: Option<PathBuf>,
    /// Write all scores as JSON.
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Replace files that are there.
    #[arg(short, long)]
    pub force: bool,
    /// How the data set is read.
    #[command(flatten)]
    pub dataset_options: DatasetOptions,
}

/// Draws, measures, prints one line a photo and the mean.
pub fn run(args: &EvalArgs, global: &Global) -> Result<()> {
    if let Some(report) = args.report.as_deref().filter(|p| p.exists() && !args.force) {
        return Err(files::is_there("--report", report));
    }
    let dataset = Dataset::load(&args.dataset, &args.dataset_options)?;
    let views = args.split.of(&dataset);
    if views.is_empty() {
        let split = args.split.name();
        return Err(Error::invalid("--split", split, "a part that holds photos: train or all"));
    }
    if let Some(folder) = &args.save_renders {
        prepare_folder(folder, views.iter().map(|v| v.name.as_str()), args.force)?;
    }
    let loaded = formats::read(&args.soup, &ReadOptions { sh_degree: 3 })?;
    let mut warnings = [dataset.warnings.clone(), loaded.warnings.clone()].concat();
    let (soup, provenance) = fidelity::soup_of(&args.soup, loaded)?;
    let triangles = soup.len() as u64;
    let background = args.dataset_options.background.to_f32();
    let mut painter = Painter::new(soup, &provenance.placement, &dataset, background);

    let progress = Progress::new(global);
    let width = views.iter().map(|v| v.name.len()).max().unwrap_or(0).max(4);
    let photo_bytes = u64::from(args.dataset_options.photo_memory_mib) << 20;
    let (images, draw_secs) = fidelity::judge(&mut painter, &views, photo_bytes, |view, drawn, image| {
        progress.line(&row(&view.name, width, &image.score));
        match &args.save_renders {
            Some(folder) => save_picture(folder, &view.name, drawn),
            None => Ok(()),
        }
    })?;
    if views.iter().any(|view| view.photo.mask.is_some()) {
        warnings.push("masked pixels were left out of the scores".into());
    }
    let split = args.split.name();
    let report = Fidelity::new(&args.soup, &args.dataset, split, images);
    let report = Fidelity { triangles, draw_secs, warnings, ..report };
    progress.done();
    for warning in &report.warnings {
        progress.line(&format!("warning: {warning}"));
    }
    let count = report.images.len();
    progress.line(&format!("{}   ({count} photos)", row("mean", width, &report.mean)));
    args.report.as_deref().map_or(Ok(()), |path| files::save_json(&report, path))
}

fn row(name: &str, width: usize, score: &Score) -> String {
    format!("{name:<width$}  PSNR {:7.3} dB  SSIM {:.4}  FLIP {:.4}", score.psnr, score.ssim, score.flip)
}
