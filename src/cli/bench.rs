//! `trisplat bench …`: speed claims, made by the tool itself.

use super::Global;
use super::files;
use super::progress::{Progress, thousands};
use crate::bench::{bake, measure};
use crate::error::{Error, Result};
use std::ffi::OsString;
use std::path::PathBuf;

/// Which benchmark.
#[derive(Debug, clap::Args)]
pub struct BenchArgs {
    /// The benchmark.
    #[command(subcommand)]
    pub bench: Bench,
}

/// The benchmarks.
#[derive(Debug, clap::Subcommand)]
pub enum Bench {
    /// Time and memory of the bake, beside the floor and other tools.
    Bake(bake::BakeBenchArgs),
    /// Print the cost of one command as JSON (the other benchmarks run themselves through this).
    #[command(hide = true)]
    Measure {
        /// Program and arguments.
        #[arg(trailing_var_arg = true, allow_hyphen_values = true, required = true)]
        command: Vec<OsString>,
    },
    /// Read INPUT and write as many bytes as LIKE has: what no converter can beat.
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
pub fn run(args: &BenchArgs, global: &Global) -> Result<()> {
    match &args.bench {
        Bench::Bake(bake_args) => run_bake(bake_args, global),
        Bench::Measure { command } => print_json(&measure::run_only_child(command)?),
        Bench::Floor { input, like, output } => bake::floor(input, like, output),
    }
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

fn print_json(value: &impl serde::Serialize) -> Result<()> {
    files::print_json(value, &mut std::io::stdout().lock()).map_err(|e| Error::io("-", e))
}
