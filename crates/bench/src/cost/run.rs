//! What `trisplat bench cost` is asked for, the training of its grid, and its report.

use super::advice::CostAdvice;
use super::cell::{CostCell, CostRun, compare};
use super::grid::Grid;
use crate::machine::Machine;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow::Continue;
use std::path::{Path, PathBuf};
use trisplat_dataset::{
    Dataset, DatasetOptions, ShrunkSize,
    synthetic::{self, SyntheticOptions},
};
use trisplat_job::{TrainJob, watched};
use trisplat_scene::{Error, Result, Seconds, process::cpu_secs};
use trisplat_train::TrainOptions;

/// What happens while the grid is measured.
#[derive(Debug)]
pub enum CostEvent<'a> {
    /// A training begins.
    Begins {
        /// Its steps.
        steps: u64,
        /// Its most triangles.
        max_triangles: u64,
        /// Its seed.
        seed: u64,
    },
    /// A cell has all its runs; its band is not known yet.
    Measured(&'a CostCell),
}

/// Trains the grid that `args` ask for.
///
/// Errors: lists that do not ascend; photos that cannot be read, or too few to leave some out.
pub fn run(args: &CostArgs, observer: &mut dyn FnMut(CostEvent<'_>)) -> Result<CostReport> {
    let grid = Grid::new(&args.steps, &args.max_triangles, args.budget.0)?;
    let folder = tempfile::tempdir().map_err(|e| Error::io("temporary folder", e))?;
    let (photos, name) = photos(args, folder.path())?;
    let cell = |steps, max_triangles| {
        let run = |seed| {
            observer(CostEvent::Begins { steps, max_triangles, seed });
            train(args, &photos, TrainOptions { steps, max_triangles, seed, ..TrainOptions::default() })
        };
        let cell = CostCell::new(steps, max_triangles, (0..args.seeds).map(run).collect::<Result<_>>()?);
        observer(CostEvent::Measured(&cell));
        Ok(cell)
    };
    let mut cells = grid.measure(cell)?;
    compare(&mut cells);
    let watched: Vec<String> = photos.test().map(|view| view.name.clone()).collect();
    let advice = CostAdvice::new(&cells, watched.len());
    Ok(CostReport {
        machine: Machine::here(),
        dataset: name,
        photo_size: ShrunkSize::of(photos.views.iter()),
        photos: photos.train().count() as u64,
        watched,
        budget: args.budget.0,
        advice: advice.ok_or_else(|| Error::invalid("budget", args.budget, "time for one training"))?,
        cells,
    })
}

/// Width of the synthetic photos, px: half of their height is above what the warm-up of training leaves as it is.
const WIDTH: u32 = 192;

/// The training photos, some of them watched, and the name of the data set.
fn photos(args: &CostArgs, folder: &Path) -> Result<(Dataset, String)> {
    let (path, name) = match &args.dataset {
        Some(path) => (path.clone(), path.display().to_string()),
        None => {
            let photos = folder.join("photos");
            synthetic::write(&photos, &SyntheticOptions { width: WIDTH, ..SyntheticOptions::default() })?;
            (photos, "synthetic".to_owned())
        }
    };
    Ok((watched::left_out(&Dataset::load(&path, &args.dataset_options)?)?, name))
}

/// Trains once, as the command `train` would.
fn train(args: &CostArgs, photos: &Dataset, options: TrainOptions) -> Result<CostRun> {
    let (seed, began) = (options.seed, cpu_secs());
    let mut job = TrainJob::new(photos.clone(), options);
    job.dataset_options = args.dataset_options.clone();
    let trained = job.run(&mut |_| Continue(()))?.trained;
    let quality = trained.quality();
    let of = |value: Option<f64>| value.unwrap_or(f64::NAN);
    Ok(CostRun {
        seed,
        cpu_seconds: cpu_secs() - began,
        triangles: trained.soup.len() as u64,
        psnr: of(quality.map(|quality| quality.psnr)),
        ssim: of(quality.map(|quality| quality.ssim)),
    })
}

/// What to measure.
#[derive(Debug, Clone, clap::Args)]
pub struct CostArgs {
    /// Posed photos; without them a synthetic scene is made, whose photos are exact.
    #[arg(value_name = "DATASET")]
    pub dataset: Option<PathBuf>,
    /// CPU time that the dearest training may take, as in 90s or 10m. All trainings together take about 20 times as long.
    #[arg(long, value_name = "TIME", default_value = "30s")]
    pub budget: Seconds,
    /// Steps to try, ascending [default: 250, 500, 1000, and so on].
    #[arg(long, value_name = "N,N", value_delimiter = ',', value_parser = clap::value_parser!(u64).range(8..=1_000_000_000))]
    pub steps: Vec<u64>,
    /// Most triangles to try, ascending [default: 3000, 10000, 30000, and so on].
    #[arg(long, value_name = "N,N", value_delimiter = ',', value_parser = clap::value_parser!(u64).range(8..=1_000_000_000))]
    pub max_triangles: Vec<u64>,
    /// Trainings of each, with seeds 0, 1, 2, and so on; one alone has no band of confidence.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=99))]
    pub seeds: u64,
    /// Print the report as JSON (schema: trisplat schema cost).
    #[arg(long)]
    pub json: bool,
    /// How the data set is read.
    #[command(flatten)]
    pub dataset_options: DatasetOptions,
}

/// What `trisplat bench cost --json` prints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "trisplat cost report")]
pub struct CostReport {
    /// Where it was measured.
    #[serde(flatten)]
    pub machine: Machine,
    /// The data set as given, or "synthetic".
    pub dataset: String,
    /// The size that the photos were shrunk to, "320x213"; absent where they were not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photo_size: Option<ShrunkSize>,
    /// Photos that were trained on.
    pub photos: u64,
    /// Photos of the training set that were left out, and measured with. Held-out photos are not looked at.
    pub watched: Vec<String>,
    /// CPU seconds that the dearest training was to take at most.
    pub budget: f64,
    /// The grid, in the order in which it was trained.
    pub cells: Vec<CostCell>,
    /// What it says.
    pub advice: CostAdvice,
}
