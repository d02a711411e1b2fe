//! `trisplat bench …`: benchmarks of the tool.

use super::Global;
use super::bench_cost;
use super::counts::thousands;
use super::files;
use super::files::Stdout;
use super::inputs::Inputs;
use super::outputs::Outputs;
use super::progress::Progress;
use super::stress;
use std::ffi::OsString;
use std::path::PathBuf;
use trisplat_bench::{bake, cost, machine, measure, raster, stress::StressArgs};
#[cfg(feature = "gpu")]
use trisplat_bench::{card, fps};
use trisplat_scene::{Error, Result};

/// Which benchmark.
#[derive(Debug, clap::Args)]
pub struct BenchArgs {
    /// Replace files that are there; rows are added to a table without it.
    #[arg(short, long, global = true)]
    pub force: bool,
    /// The benchmark.
    #[command(subcommand)]
    pub bench: BenchCommand,
}

/// The benchmarks.
#[derive(Debug, clap::Subcommand)]
pub enum BenchCommand {
    /// Time and memory of the bake, next to the floor and other tools.
    Bake(bake::BakeBenchArgs),
    /// Frames per second at the paper's sizes, checked against the CPU.
    #[cfg(feature = "gpu")]
    Fps(Box<fps::FpsArgs>),
    /// Frames per second at the paper's sizes (not in this build).
    #[cfg(not(feature = "gpu"))]
    Fps(super::missing::MissingArgs),
    /// Steps per second of the training on a graphics card, by stages.
    #[cfg(feature = "gpu")]
    Card(Box<card::CardArgs>),
    /// Steps per second of the training on a graphics card (not in this build).
    #[cfg(not(feature = "gpu"))]
    Card(super::missing::MissingArgs),
    /// Steps and frames per second of the rasterisers on this CPU, and where the time goes.
    Raster(raster::RasterBenchArgs),
    /// Errors of rasterisers and files on stretched scenes, checked against the promises.
    Stress(StressArgs),
    /// Steps and triangles against CPU seconds and error on your photos, and the settings to use.
    Cost(Box<cost::CostArgs>),
    /// Print the cost of one command as JSON (used by the other benchmarks themselves).
    #[command(hide = true)]
    Measure {
        /// Program and arguments.
        #[arg(trailing_var_arg = true, allow_hyphen_values = true, required = true)]
        command: Vec<OsString>,
    },
    /// Read INPUT and write the number of bytes of LIKE: the least work of any converter.
    #[command(hide = true)]
    Floor {
        /// File to read.
        input: PathBuf,
        /// File whose size is written.
        like: PathBuf,
        /// File to write.
        output: PathBuf,
    },
}

/// Runs a benchmark; rows go to standard output.
pub fn run(args: &BenchArgs, global: &Global, inputs: &Inputs) -> Result<()> {
    guard(args, inputs)?;
    match &args.bench {
        BenchCommand::Bake(bake_args) => run_bake(bake_args, global),
        #[cfg(feature = "gpu")]
        BenchCommand::Fps(fps_args) => run_fps(fps_args, global),
        #[cfg(not(feature = "gpu"))]
        BenchCommand::Fps(_) => Err(super::missing::error("gpu")),
        #[cfg(feature = "gpu")]
        BenchCommand::Card(card_args) => run_card(card_args, global),
        #[cfg(not(feature = "gpu"))]
        BenchCommand::Card(_) => Err(super::missing::error("gpu")),
        BenchCommand::Raster(raster_args) => run_raster(raster_args, global),
        BenchCommand::Stress(stress_args) => stress::run(stress_args, global),
        BenchCommand::Cost(cost_args) => bench_cost::run(cost_args, global),
        BenchCommand::Measure { command } => print_json(&measure::run_only_child(command)?),
        BenchCommand::Floor { input, like, output } => bake::floor(input, like, output),
    }
}

/// Refuses tables and other files that must not be written, before anything is measured.
fn guard(args: &BenchArgs, inputs: &Inputs) -> Result<()> {
    let force = args.force;
    let mut outputs = Outputs::new(inputs, force);
    let csv = match &args.bench {
        BenchCommand::Bake(args) => &args.csv,
        #[cfg(feature = "gpu")]
        BenchCommand::Fps(args) => &args.csv,
        BenchCommand::Stress(args) if args.replay.is_none() => {
            // It is written only if a promise is broken, and may be that of an earlier run.
            outputs.replacing(force || stress::is_case(&args.worst));
            return outputs.plan("--worst", &args.worst);
        }
        BenchCommand::Floor { output, .. } => {
            outputs.replacing(true);
            return outputs.plan("OUTPUT", output);
        }
        _ => return Ok(()),
    };
    let Some(path) = csv else { return Ok(()) };
    outputs.replacing(force);
    outputs.append("--csv", path)?;
    machine::check_csv(path)
}

fn run_bake(args: &bake::BakeBenchArgs, global: &Global) -> Result<()> {
    let progress = Progress::new(global);
    progress.line("triangles   case             cpu s    wall s   peak MB   out MB   cpu/floor");
    let rows = bake::run(args, |row| {
        progress.line(&format!(
            "{:>10}  {:<15}{:>8.3}{:>10.3}{:>10.1}{:>9.1}{:>10.2}",
            thousands(row.triangles),
            row.case,
            row.cpu_seconds,
            row.wall_seconds,
            row.peak_bytes as f64 * 1e-6,
            row.output_bytes as f64 * 1e-6,
            row.cpu_over_floor,
        ));
    })?;
    progress.done();
    if args.json { print_json(&rows) } else { Ok(()) }
}

#[cfg(feature = "gpu")]
fn run_fps(args: &fps::FpsArgs, global: &Global) -> Result<()> {
    let progress = Progress::new(global);
    progress.line(
        "case                  triangles        size      FPS   median ms   p99 ms    gpu ms    cpu ms      drawn  B/tri  dB",
    );
    let rows = fps::run(args, |row| {
        let optional =
            |value: Option<f64>, digits: usize| value.map_or("-".to_owned(), |v| format!("{v:.digits$}"));
        progress.line(&format!(
            "{:<20}{:>11}{:>12}{:>9.1}{:>12.2}{:>9.2}{:>10}{:>10.1}{:>11}{:>7}{:>4.0}",
            row.case,
            thousands(row.triangles),
            format!("{}x{}", row.width, row.height),
            row.fps,
            row.cost.frame_ms,
            row.cost.frame_p99_ms,
            optional(row.cost.gpu_ms, 2),
            row.cost.cpu_ms,
            thousands(row.cost.drawn as u64),
            optional(row.bytes_per_triangle, 1),
            row.agreement.psnr,
        ));
    })?;
    progress.done();
    let mut adapters: Vec<&str> = rows.iter().map(|row| row.adapter.as_str()).collect();
    adapters.sort_unstable();
    adapters.dedup();
    adapters.iter().for_each(|adapter| progress.line(adapter));
    if args.json { print_json(&rows) } else { Ok(()) }
}

#[cfg(feature = "gpu")]
fn run_card(args: &card::CardArgs, global: &Global) -> Result<()> {
    use clap::ValueEnum as _;
    let progress = Progress::new(global);
    let rows = card::run(args, |row| {
        let cpu = row.cpu_backend_ms.map_or(String::new(), |ms| format!(", {ms:.1} with backend cpu"));
        progress.line(&format!(
            "{}, {} triangles, {}x{}: {:.2} steps/s, {:.1} CPU ms per step{cpu}; {} splats, {} pairs",
            row.preset.to_possible_value().as_ref().map_or("", |value| value.get_name()),
            thousands(row.triangles),
            row.size[0],
            row.size[1],
            row.steps_per_second,
            row.cpu_ms,
            thousands(row.splats),
            thousands(row.pairs),
        ));
        for stage in &row.stages {
            let bytes_per_second = stage.share * row.copy_bandwidth;
            progress.line(&format!(
                "{:<15}{:>10.3} ms{:>10.1} MB{:>10.1} GB/s{:>7.1}% of a copy",
                stage.name,
                stage.ms,
                1e-6 * stage.bytes as f64,
                1e-9 * bytes_per_second,
                100.0 * stage.share,
            ));
        }
    })?;
    progress.done();
    if let Some(row) = rows.first() {
        progress.line(&format!("a copy: {:.1} GB/s; {}", 1e-9 * row.copy_bandwidth, row.adapter));
    }
    if args.json { print_json(&rows) } else { Ok(()) }
}

fn run_raster(args: &raster::RasterBenchArgs, global: &Global) -> Result<()> {
    let progress = Progress::new(global);
    progress.line(
        "        threads  triangles   pixels     wall ms    cpu ms   per second   share of each part, %",
    );
    let rows = raster::run(args, |row| {
        let parts: Vec<String> =
            row.parts.iter().map(|p| format!("{} {:.0}", p.name, 100.0 * p.share)).collect();
        progress.line(&format!(
            "{:<6}{:>8}{:>11}{:>11}{:>11.2}{:>10.2}{:>11.1}   {}",
            row.rasteriser,
            row.threads,
            thousands(row.triangles),
            format!("{}x{}", row.size[0], row.size[1]),
            row.wall_ms,
            row.cpu_ms,
            row.per_second,
            parts.join(", "),
        ));
    })?;
    progress.done();
    if args.json { print_json(&rows) } else { Ok(()) }
}

fn print_json(value: &impl serde::Serialize) -> Result<()> {
    files::print_json(value, &mut Stdout).map_err(|e| Error::io("-", e))
}
