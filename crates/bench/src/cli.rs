//! The command line of the program.

use crate::machine::{self, print_json};
use crate::{bake, cost, stress};
use clap::{Args, Parser, Subcommand};
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;
use trisplat_formats::ply;
use trisplat_scene::{Error, Result, ranges};
use trisplat_synthetic::{SyntheticOptions, soups};

/// Measures what trisplat costs and how exact it is, and makes samples.
#[derive(Debug, Parser)]
#[command(name = "trisplat-bench", version, max_term_width = 100, arg_required_else_help = true)]
struct BenchCli {
    /// Worker threads; 0 = one per core.
    #[arg(long, global = true, default_value_t = 0, value_name = "N")]
    threads: u16,
    #[command(subcommand)]
    command: BenchCommand,
}

#[derive(Debug, Subcommand)]
enum BenchCommand {
    /// Steps and triangles against CPU seconds and error on your photos, and the settings to use.
    Cost(Box<cost::CostArgs>),
    /// Errors of rasterisers, files and bakes on stretched scenes, checked against the promises.
    Stress(stress::StressArgs),
    /// Frames per second on a graphics card, checked against the CPU.
    #[cfg(feature = "gpu")]
    Fps(Box<crate::fps::FpsArgs>),
    /// Time and memory of `trisplat bake`, next to the floor and other tools.
    Bake(bake::BakeBenchArgs),
    /// Make a synthetic soup or data set.
    #[command(subcommand)]
    Sample(Sample),
    /// Print the cost of one command as JSON (used by `bake`).
    #[command(hide = true)]
    Measure {
        /// Program and arguments.
        #[arg(trailing_var_arg = true, allow_hyphen_values = true, required = true)]
        command: Vec<OsString>,
    },
    /// Read INPUT and write the number of bytes of LIKE (used by `bake`).
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

#[derive(Debug, Subcommand)]
enum Sample {
    /// Soup of balls, a ring, a chest, poles and a colour chart on a chequered stage under a dome.
    Studio {
        /// Number of triangles.
        #[arg(long, default_value_t = 8000, value_name = "N", value_parser = ranges::count)]
        triangles: usize,
        /// Seed of the random numbers; the same seed gives the same bytes.
        #[arg(long, default_value_t = 1, value_name = "N")]
        seed: u64,
        #[command(flatten)]
        to: To,
    },
    /// Soup of every degenerate triangle that a reader may accept.
    Degenerate(To),
    /// Posed photos of an analytic scene, in COLMAP's layout.
    Dataset {
        #[command(flatten)]
        to: To,
        #[command(flatten)]
        options: SyntheticOptions,
    },
}

/// Destination of a sample.
#[derive(Debug, Args)]
struct To {
    /// PLY file, or folder of photos, to write.
    #[arg(short, long, value_name = "PATH")]
    output: PathBuf,
    /// Replace what is there.
    #[arg(short, long)]
    force: bool,
}

/// Runs the program: one error on stderr and exit code 1 when it fails.
pub fn main() -> ExitCode {
    let cli = BenchCli::parse();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(cli.threads.into()).build_global();
    let pool = pool.map_err(|e| Error::invalid("--threads", cli.threads, e.to_string()));
    match pool.and_then(|()| run(&cli.command)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(command: &BenchCommand) -> Result<()> {
    match command {
        BenchCommand::Cost(args) => cost::run(args),
        BenchCommand::Stress(args) => stress::run(args),
        #[cfg(feature = "gpu")]
        BenchCommand::Fps(args) => crate::fps::run(args),
        BenchCommand::Bake(args) => bake::run(args),
        BenchCommand::Sample(sample) => make(sample),
        BenchCommand::Measure { command } => print_json(&machine::run_only_child(command)?),
        BenchCommand::Floor { input, like, output } => bake::floor(input, like, output),
    }
}

/// Writes a sample.
fn make(sample: &Sample) -> Result<()> {
    match sample {
        Sample::Studio { triangles, seed, to } => {
            let provenance = soups::provenance(&soups::studio_recipe(*triangles, *seed));
            write_soup(to, &soups::studio(*triangles, *seed), &provenance)
        }
        Sample::Degenerate(to) => {
            write_soup(to, &soups::degenerate(), &soups::provenance(soups::DEGENERATE_RECIPE))
        }
        Sample::Dataset { to, options } => {
            let holds =
                std::fs::read_dir(&to.output).is_ok_and(|mut entries| entries.next().is_some());
            check_new(to, holds)?;
            trisplat_synthetic::write(&to.output, options)
        }
    }
}

fn write_soup(
    to: &To,
    soup: &trisplat_scene::Soup,
    provenance: &trisplat_scene::Provenance,
) -> Result<()> {
    check_new(to, to.output.exists())?;
    let mut bytes = Vec::new();
    let written = ply::write_soup(&mut bytes, soup, provenance, &[]);
    written.and_then(|()| std::fs::write(&to.output, bytes)).map_err(|e| Error::io(&to.output, e))
}

fn check_new(to: &To, is_there: bool) -> Result<()> {
    let wants = "a path where nothing is, or --force";
    if is_there && !to.force {
        return Err(Error::invalid("--output", to.output.display(), wants));
    }
    Ok(())
}
