//! `cost`: where training stops to pay. A grid of steps and triangles on the user's photos, from
//! short runs to those that take a budget, each with several seeds; photos of the training set that
//! are left out say how close each comes.

mod advice;
mod grid;

use crate::machine::{Machine, print_json};
use advice::advice;
use grid::{CostCell, CostGrid, CostRun, compare};
use serde::Serialize;
use std::ops::ControlFlow::Continue;
use std::path::PathBuf;
use trisplat_dataset::{Dataset, DatasetOptions, ShrunkSize};
use trisplat_job::TrainJob;
use trisplat_scene::process::cpu_secs;
use trisplat_scene::report::counted;
use trisplat_scene::{Error, Result, Seconds};
use trisplat_train::TrainOptions;

/// Measurement of the cost of quality.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct CostArgs {
    /// Posed photos.
    #[arg(value_name = "DATASET")]
    dataset: PathBuf,
    /// CPU time that the dearest training may take, as in 90s or 10m. All trainings together take
    /// about 20 times as long.
    #[arg(long, value_name = "TIME", default_value = "30s")]
    budget: Seconds,
    /// Steps to try, ascending [default: 250, 500, 1000, and so on].
    #[arg(long, value_name = "N,N", value_delimiter = ',', value_parser = clap::value_parser!(u64).range(8..=1_000_000_000))]
    steps: Vec<u64>,
    /// Maximum number of triangles to try, ascending [default: 3000, 10000, 30000, and so on].
    #[arg(long, value_name = "N,N", value_delimiter = ',', value_parser = clap::value_parser!(u64).range(8..=1_000_000_000))]
    max_triangles: Vec<u64>,
    /// Trainings of each, with seeds 0, 1, 2, and so on; one alone has no band of confidence.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=99))]
    seeds: u64,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
    /// Options for reading the data set.
    #[command(flatten)]
    dataset_options: DatasetOptions,
}

/// Report printed by `--json`.
#[derive(Debug, Serialize)]
struct CostReport {
    #[serde(flatten)]
    machine: Machine,
    dataset: PathBuf,
    /// The size that the photos were shrunk to, "320x213"; absent where they were not.
    photo_size: Option<ShrunkSize>,
    /// Photos that were trained on.
    photos: usize,
    /// Photos of the training set that were left out, and measured with. Held-out photos are not
    /// looked at.
    watched: Vec<String>,
    /// CPU seconds that the dearest training was to take at most.
    budget: f64,
    /// The grid, in the order in which it was trained.
    cells: Vec<CostCell>,
    /// Its text.
    advice: String,
}

/// Trains the grid that `args` ask for and prints it, cell by cell, and the settings to use.
///
/// # Errors
/// Lists that do not ascend; photos that cannot be read, or too few to leave some out.
pub(crate) fn run(args: &CostArgs) -> Result<()> {
    let grid = CostGrid::new(&args.steps, &args.max_triangles, args.budget.0)?;
    let photos = left_out(&Dataset::load(&args.dataset, &args.dataset_options)?)?;
    eprintln!("   steps  triangles     CPU s  PSNR dB    SSIM   of each seed");
    let cell = |steps, max_triangles| {
        let run = |seed| {
            train(
                args,
                &photos,
                TrainOptions { steps, max_triangles, seed, ..TrainOptions::default() },
            )
        };
        let cell =
            CostCell::new(steps, max_triangles, (0..args.seeds).map(run).collect::<Result<_>>()?);
        eprintln!("{}", line(&cell));
        Ok(cell)
    };
    let mut cells = grid.measure(cell)?;
    compare(&mut cells);
    let watched: Vec<String> = photos.test().map(|view| view.name.clone()).collect();
    let advice = advice(&cells, watched.len());
    let report = CostReport {
        machine: Machine::here(),
        dataset: args.dataset.clone(),
        photo_size: ShrunkSize::of(photos.views.iter()),
        photos: photos.train().count(),
        watched,
        budget: args.budget.0,
        advice: advice
            .ok_or_else(|| Error::invalid("budget", args.budget, "time for one training"))?,
        cells,
    };
    for line in summary(&report) {
        eprintln!("{line}");
    }
    if args.json { print_json(&report) } else { Ok(()) }
}

/// With fewer photos, none can be left out.
const MIN_PHOTOS: usize = 8;
/// One photo in this many is left out, at least the second number.
const LEFT_OUT_EVERY: usize = 6;
const MIN_LEFT_OUT: usize = 3;

/// The training photos of `photos`, some of them, spread evenly, held out: choices never use the
/// real held-out photos.
///
/// # Errors
///
/// Fewer than eight.
fn left_out(photos: &Dataset) -> Result<Dataset> {
    let count = photos.train().count();
    if count < MIN_PHOTOS {
        let wants = format!("{MIN_PHOTOS} photos or more, as some are left out of training");
        let has = format!("{} to train on", counted(count as u64, "photo"));
        return Err(Error::invalid("dataset", has, wants));
    }
    let kept = (count / LEFT_OUT_EVERY).max(MIN_LEFT_OUT);
    Ok(photos.leaving_out(|i| (0..kept).any(|k| (2 * k + 1) * count / (2 * kept) == i)))
}

/// Trains once, as the command `train` would.
fn train(args: &CostArgs, photos: &Dataset, options: TrainOptions) -> Result<CostRun> {
    let seed = options.seed;
    let began = cpu_secs();
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

/// A cell, without its band, which all cells decide.
fn line(cell: &CostCell) -> String {
    let each: Vec<String> = cell.runs.iter().map(|run| format!("{:.2}", run.psnr)).collect();
    let CostCell { steps, max_triangles, cpu_seconds, psnr, ssim, .. } = cell;
    format!(
        "{steps:>8}{max_triangles:>11}{cpu_seconds:>10.1}{psnr:>9.2}{ssim:>8.4}   {}",
        each.join(" ")
    )
}

/// Summary: the machine, the front with its bands, and the settings to use.
fn summary(report: &CostReport) -> Vec<String> {
    let size = ShrunkSize::suffix(report.photo_size);
    let watched = report.watched.len();
    let mut front: Vec<&CostCell> = report.cells.iter().filter(|cell| cell.on_front).collect();
    front.sort_by(|a, b| a.cpu_seconds.total_cmp(&b.cpu_seconds));
    let row = |cell: &&CostCell| {
        format!("   {:>8.1} CPU s  {} dB  {}", cell.cpu_seconds, cell.banded(), cell.options())
    };
    let photos = format!("{} photos trained on, {watched} watched{size}", report.photos);
    let mut lines = vec![format!("\n{photos}; nothing that costs no more comes closer than:")];
    lines.extend(front.iter().map(row));
    lines.push(report.advice.clone());
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_line_says_what_to_use() {
        let run = CostRun { seed: 0, cpu_seconds: 2.0, triangles: 90, psnr: 21.5, ssim: 0.8 };
        let mut cell =
            CostCell::new(500, 3000, vec![run.clone(), CostRun { seed: 1, psnr: 21.75, ..run }]);
        cell.psnr = 21.5;
        cell.psnr_band = Some(0.125);
        cell.on_front = true;
        assert_eq!(line(&cell), "     500       3000       2.0    21.50  0.8000   21.50 21.75");
        let report = CostReport {
            machine: Machine::default(),
            dataset: "photos".into(),
            photo_size: None,
            photos: 10,
            watched: vec!["a".into(), "b".into()],
            budget: 3.0,
            cells: vec![CostCell { on_front: false, ..cell.clone() }, cell],
            advice: "use it".into(),
        };
        let lines = summary(&report);
        assert_eq!(lines.len(), 3, "{lines:?}");
        assert!(lines[0].starts_with("\n10 photos trained on, 2 watched; "), "{}", lines[0]);
        assert_eq!(lines[1].trim(), "2.0 CPU s  21.50 ± 0.12 dB  --steps 500 --max-triangles 3000");
        assert_eq!(lines[2], "use it");
    }
}
