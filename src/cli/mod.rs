//! The command line. Thin: options and work live in the library, this folder parses and prints.
//!
//! Exit codes: 0 done, 1 failed (one error on stderr), 2 wrong usage.

#![allow(clippy::print_stderr, reason = "the command line is what prints")]

pub mod bake;
pub mod bench;
pub mod completions;
pub mod eval;
pub mod files;
pub mod flags;
pub mod info;
pub mod info_dataset;
pub mod layers;
#[cfg(not(all(feature = "gpu", feature = "view")))]
pub mod missing;
pub mod progress;
pub mod render;
mod resume;
pub mod sample;
pub mod schema;
pub mod train;
pub mod train_args;
mod train_curve;
pub mod train_progress;
pub mod validate;
#[cfg(feature = "view")]
pub mod view;

use crate::error::Result;
use clap::{ArgMatches, CommandFactory, FromArgMatches, Parser, Subcommand};
use std::process::ExitCode;

/// Turns posed photographs into triangle scenes a game engine draws as they are.
#[derive(Debug, Parser)]
#[command(name = "trisplat", version, max_term_width = 100, arg_required_else_help = true)]
pub struct Cli {
    /// What is common to all commands.
    #[command(flatten)]
    pub global: Global,
    /// The command.
    #[command(subcommand)]
    pub command: Command,
}

/// Flags every command takes.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Everywhere")]
pub struct Global {
    /// Print errors only.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Print every figure of every stage.
    #[arg(short, long, global = true)]
    pub verbose: bool,
    /// Worker threads; 0 = one a core. The output is the same bytes for any number.
    #[arg(long, global = true, default_value_t = 0, value_name = "N")]
    pub threads: usize,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Turn a trained soup or a coloured mesh into a file an engine draws.
    Bake(Box<bake::BakeArgs>),
    /// Tell what a file holds and what a bake would make of it.
    Info(info::InfoArgs),
    /// Look for faults in a file, ours or another's.
    Validate(validate::ValidateArgs),
    /// Make a soup from nothing, to try things on.
    Sample(sample::SampleArgs),
    /// Turn posed photos into a soup of triangles.
    Train(Box<train_args::TrainArgs>),
    /// Measure how close a soup or mesh comes to photos it was not trained on.
    Eval(Box<eval::EvalArgs>),
    /// Draw a soup or mesh as the photos' cameras see it, or from a circle around it.
    Render(Box<render::RenderArgs>),
    /// Fly through a scene in a window.
    #[cfg(feature = "view")]
    View(Box<view::ViewArgs>),
    /// Fly through a scene in a window (not in this build).
    #[cfg(not(feature = "view"))]
    View(missing::MissingArgs),
    /// Measure what commands cost.
    Bench(bench::BenchArgs),
    /// Print a JSON Schema.
    Schema(schema::SchemaArgs),
    /// Print a completion script for a shell.
    Completions(completions::CompletionsArgs),
}

/// Parses the arguments of this process and runs the command.
pub fn main() -> ExitCode {
    let mut program = Cli::command();
    let matches = program.get_matches_mut();
    let cli = match Cli::from_arg_matches(&matches) {
        Ok(cli) => cli,
        Err(error) => error.exit(),
    };
    match run(&cli, &matches) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", flags::message(&error, flags::innermost(&program, &matches)));
            ExitCode::from(1)
        }
    }
}

fn run(cli: &Cli, matches: &ArgMatches) -> Result<()> {
    // Fails only when a pool exists already, which means that somebody chose the number before us.
    let _ = rayon::ThreadPoolBuilder::new().num_threads(cli.global.threads).build_global();
    let typed = matches.subcommand().map_or(matches, |(_, typed)| typed);
    match &cli.command {
        Command::Bake(args) => bake::run(args, typed, &cli.global),
        Command::Train(args) => train::run(args, typed, &cli.global),
        Command::Eval(args) => eval::run(args, &cli.global),
        Command::Render(args) => render::run(args, &cli.global),
        #[cfg(feature = "view")]
        Command::View(args) => view::run(args),
        #[cfg(not(feature = "view"))]
        Command::View(_) => Err(missing::error("view")),
        Command::Bench(args) => bench::run(args, &cli.global),
        Command::Info(args) => info::run(args, &mut std::io::stdout().lock()),
        Command::Validate(args) => validate::run(args, &mut std::io::stdout().lock()),
        Command::Sample(args) => sample::run(args),
        Command::Schema(args) => schema::run(args),
        Command::Completions(args) => completions::run(args),
    }
}
