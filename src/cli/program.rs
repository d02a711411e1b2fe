//! The program: its commands, and the run of one of them.

use super::inputs::Inputs;
#[cfg(not(feature = "view"))]
use super::missing;
use super::{
    Global, bake, bake_args, capture, eval, files::Stdout, flags, generated, info, make, merge, mesh,
    messages, numbers, out_of_memory, panics, plan, render, schema, settings_hint, short_help, signals,
    suggestions, train, train_args, validate, version::version,
};
#[cfg(feature = "view")]
use super::{train_view, view};
use clap::{ArgMatches, CommandFactory, FromArgMatches, Parser, Subcommand};
use std::process::ExitCode;
use trisplat_dataset::DatasetOptions;
use trisplat_formats::ReadOptions;
use trisplat_scene::{Error, Limits, Result};

/// Turns posed photographs into triangle scenes a game engine draws as they are.
#[derive(Debug, Parser)]
#[command(name = "trisplat", version = &*version().leak(), max_term_width = 100, arg_required_else_help = true)]
pub struct Cli {
    /// What is common to all commands.
    #[command(flatten)]
    pub global: Global,
    /// The command.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Make a scene from photos or a video, in one command: poses, training, a file for an engine, a page.
    Make(Box<make::MakeArgs>),
    /// Make a data set from photos or a video: finds the camera poses.
    Capture(capture::CaptureArgs),
    /// Turn a trained soup or a coloured mesh into a file an engine draws.
    Bake(Box<bake_args::BakeArgs>),
    /// Make one connected surface of a scene, to walk on and to collide with.
    Mesh(Box<mesh::MeshArgs>),
    /// Describe a file, and the scene that a bake would make of it.
    Info(info::InfoArgs),
    /// Check a file of trisplat or another tool for errors.
    Validate(validate::ValidateArgs),
    /// Train a soup of triangles on posed photos.
    Train(Box<train_args::TrainArgs>),
    /// Cut a scene that is too large for one run into blocks, to be trained one by one.
    Plan(Box<plan::PlanArgs>),
    /// Merge the trained blocks of a plan into one scene.
    Merge(Box<merge::MergeArgs>),
    /// Score a soup or mesh on photos that it was not trained on.
    Eval(Box<eval::EvalArgs>),
    /// Draw a soup or mesh from the photos' cameras, or from a circle around it.
    Render(Box<render::RenderArgs>),
    /// Fly through a scene in a window.
    #[cfg(feature = "view")]
    View(Box<view::ViewArgs>),
    /// Fly through a scene in a window (not in this build).
    #[cfg(not(feature = "view"))]
    View(missing::MissingArgs),
    /// Print a JSON Schema.
    Schema(schema::SchemaArgs),
    /// Print a completion script for a shell.
    Completions(generated::CompletionsArgs),
    /// Write manual pages.
    Man(generated::ManArgs),
}

/// Parses the arguments of this process and runs the command.
pub fn main() -> ExitCode {
    out_of_memory::end_in_good_order();
    signals::start();
    panics::report_once();
    let mut program = short_help::shorten(Cli::command());
    // Built first, so that flags of all commands are known behind a subcommand too.
    program.build();
    let arguments = numbers::written_out(&program, std::env::args_os());
    let matches = match program.try_get_matches_from_mut(arguments) {
        Ok(matches) => matches,
        Err(error) => {
            let words: Vec<String> =
                std::env::args_os().map(|word| word.to_string_lossy().into_owned()).collect();
            settings_hint::with_hint(suggestions::plausible(error), &words).exit()
        }
    };
    let cli = match Cli::from_arg_matches(&matches) {
        Ok(cli) => cli,
        Err(error) => error.exit(),
    };
    match panics::caught(|| run(cli, &matches)) {
        Ok(code) => code,
        Err(error) => {
            let command = flags::innermost(&program, &matches);
            messages::print(&format!("error: {}", flags::message(&error, command)));
            ExitCode::from(signals::exit_code().unwrap_or(1))
        }
    }
}

fn run(mut cli: Cli, matches: &ArgMatches) -> Result<ExitCode> {
    flags::check_finite(matches)?;
    let limits = cli.global.limits()?;
    start_threads(&cli.global, &limits)?;
    if let Some(options) = dataset_options(&mut cli.command) {
        (options.limits, options.allow_outside) = (limits, cli.global.allow_outside);
        // Even if a command does not use them.
        options.validate()?;
    }
    let typed = matches.subcommand().map_or(matches, |(_, typed)| typed);
    let out = &mut Stdout;
    let inputs = &Inputs::typed(typed, limits);
    match &cli.command {
        Command::Make(args) => return make::run(args, &cli.global, inputs),
        Command::Capture(args) => return capture::run(args, &cli.global, inputs),
        Command::Bake(args) => bake::run(args, typed, &cli.global, inputs),
        Command::Mesh(args) => return mesh::run(args, typed, &cli.global, inputs),
        #[cfg(feature = "view")]
        Command::Train(args) if args.view => return train_view::run(args, typed, &cli.global, inputs),
        #[cfg(not(feature = "view"))]
        Command::Train(args) if args.view => Err(missing::error("view")),
        Command::Train(args) => return train::run(args, typed, &cli.global, inputs, None),
        Command::Plan(args) => return plan::run(args, typed, &cli.global, inputs, out),
        Command::Merge(args) => merge::run(args, &cli.global, inputs),
        Command::Eval(args) => eval::run(args, &cli.global, inputs, out),
        Command::Render(args) => render::run(args, &cli.global, inputs),
        #[cfg(feature = "view")]
        Command::View(args) => view::run(args),
        #[cfg(not(feature = "view"))]
        Command::View(_) => Err(missing::error("view")),
        Command::Info(args) => info::run(args, out),
        Command::Validate(args) => {
            let options =
                ReadOptions { limits, allow_outside: cli.global.allow_outside, ..ReadOptions::default() };
            validate::run(args, &options, out)
        }
        Command::Schema(args) => schema::run(args),
        Command::Completions(args) => generated::completions(args, &mut Cli::command()),
        Command::Man(args) => generated::man(args, Cli::command()),
    }?;
    Ok(ExitCode::SUCCESS)
}

/// The options for reading data sets and scenes, with the limits and permissions of the global flags.
fn dataset_options(command: &mut Command) -> Option<&mut DatasetOptions> {
    match command {
        Command::Make(args) => Some(&mut args.dataset_options),
        Command::Bake(args) => Some(&mut args.dataset_options),
        Command::Mesh(args) => Some(&mut args.dataset_options),
        Command::Train(args) => Some(&mut args.dataset_options),
        Command::Plan(args) => Some(&mut args.dataset_options),
        Command::Eval(args) => Some(&mut args.dataset_options),
        Command::Render(args) => Some(&mut args.dataset_options),
        Command::Info(args) => Some(&mut args.dataset_options),
        #[cfg(feature = "view")]
        Command::View(args) => Some(&mut args.dataset_options),
        _ => None,
    }
}

/// Starts the worker threads, up to the limit: each takes memory, and more than a few per core only cost
/// time.
fn start_threads(global: &Global, limits: &Limits) -> Result<()> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    // Rayon takes the number from this variable if it is not told another one.
    let of_rayon = || std::env::var("RAYON_NUM_THREADS").ok()?.parse().ok().filter(|n| *n > 0);
    let wanted = match usize::from(global.threads) {
        0 => of_rayon().unwrap_or(cores),
        threads => threads,
    };
    let per_core = usize::try_from(limits.threads_per_core).unwrap_or(usize::MAX);
    let threads = wanted.min(cores.saturating_mul(per_core).max(1));
    if threads < wanted && !global.quiet {
        let limit = format!("--limit threads_per_core={}", wanted.div_ceil(cores));
        messages::print(&format!(
            "warning: {wanted} threads are more than {per_core} for each of {cores} cores: {threads} are used; if {wanted} are \
             wanted, give {limit}"
        ));
    }
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().map_err(|e| {
        Error::invalid("--threads", threads, format!("a number that the system can start ({e})"))
    })
}
