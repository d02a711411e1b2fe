//! Trains the grid.

use super::advice::CostAdvice;
use super::args::CostArgs;
use super::cell::{CostCell, CostRun, compare};
use super::grid::Grid;
use super::report::CostReport;
use crate::machine::Machine;
use std::ops::ControlFlow::Continue;
use std::path::Path;
use trisplat_dataset::{
    Dataset, ShrunkSize,
    synthetic::{self, SyntheticOptions},
};
use trisplat_job::{TrainJob, watched};
use trisplat_scene::{Error, Result, process::cpu_secs};
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
