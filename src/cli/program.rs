//! The program: its commands, and the run of one of them.

use super::inputs::Inputs;
use super::messages::{self, Stdout};
use super::{
    GlobalArgs, bake, capture, eval, flags, info, make, mesh, plan, render, schema, signals,
    suggestions, train, train_args,
};
#[cfg(feature = "view")]
use super::{train_view, view};
use clap::{ArgMatches, CommandFactory, FromArgMatches, Parser, Subcommand};
use std::ffi::OsString;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::sync::{Mutex, PoisonError};
use trisplat_dataset::DatasetOptions;
use trisplat_formats::ReadOptions;
use trisplat_scene::input::{is_guarded, panic_message};
use trisplat_scene::{Error, Limits, Result};

/// Turns photographs and Gaussian splats into triangle scenes a game engine draws as they are.
#[derive(Debug, Parser)]
#[command(name = "trisplat", version = &*version().leak(), max_term_width = 100, arg_required_else_help = true)]
pub struct Cli {
    /// Flags of all commands.
    #[command(flatten)]
    pub global: GlobalArgs,
    /// The command.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Make a scene from photos or a video, in one command: poses, training, a file for an engine,
    /// a page.
    Make(Box<make::MakeArgs>),
    /// Make a data set from photos or a video: finds the camera poses.
    Capture(capture::CaptureArgs),
    /// Turn a trained soup, Gaussian splats or a coloured mesh into a file an engine draws.
    Bake(Box<bake::BakeArgs>),
    /// Make one connected surface of a scene, to walk on and to collide with.
    Mesh(Box<mesh::MeshArgs>),
    /// Describe a file, and the scene that a bake would make of it.
    Info(info::InfoArgs),
    /// Check a file of trisplat or another tool for errors.
    Validate(info::ValidateArgs),
    /// Train a soup of triangles on posed photos.
    Train(Box<train_args::TrainArgs>),
    /// Cut a scene that is too large for one run into blocks, to be trained one by one.
    Plan(Box<plan::PlanArgs>),
    /// Merge the trained blocks of a plan into one scene.
    Merge(Box<plan::MergeArgs>),
    /// Score a soup or mesh on photos that it was not trained on.
    Eval(Box<eval::EvalArgs>),
    /// Draw a soup or mesh from the photos' cameras, or from a circle around it.
    Render(Box<render::RenderArgs>),
    /// Fly through a scene in a window.
    #[cfg(feature = "view")]
    View(Box<view::ViewArgs>),
    /// Fly through a scene in a window (not in this build).
    #[cfg(not(feature = "view"))]
    View(MissingArgs),
    /// Print a JSON Schema.
    Schema(schema::SchemaArgs),
    /// Print a completion script for a shell.
    Completions(schema::CompletionsArgs),
    /// Write manual pages, and replace older ones.
    Man(schema::ManArgs),
}

/// Parses the arguments of this process and runs the command.
pub fn main() -> ExitCode {
    signals::start();
    report_once();
    let mut program = suggestions::shorten(Cli::command());
    // Built first, so that flags of all commands are known behind a subcommand too.
    program.build();
    let arguments = flags::expand_numbers(&program, std::env::args_os());
    let matches = match program.try_get_matches_from_mut(arguments) {
        Ok(matches) => matches,
        Err(error) => {
            let words: Vec<String> =
                std::env::args_os().map(|word| word.to_string_lossy().into_owned()).collect();
            suggestions::with_hint(suggestions::plausible(error), &words).exit()
        }
    };
    let cli = match Cli::from_arg_matches(&matches) {
        Ok(cli) => cli,
        Err(error) => error.exit(),
    };
    match caught(|| run(cli, &matches)) {
        Ok(code) => code,
        Err(error) => {
            let command = flags::innermost(&program, &matches);
            let hint = suggestions::similar_file(&error)
                .or_else(|| suggestions::similar_setting(&error, command.get_name()))
                .unwrap_or_default();
            messages::print(&format!("error: {}{hint}", flags::message(&error, command)));
            ExitCode::from(signals::exit_code().unwrap_or(1))
        }
    }
}

fn run(mut cli: Cli, matches: &ArgMatches) -> Result<ExitCode> {
    flags::check_finite(matches)?;
    let limits = cli.global.limits()?;
    start_threads(&cli.global, &limits)?;
    if let Some(options) = dataset_options(&mut cli.command) {
        options.limits = limits;
        options.allow_outside = cli.global.allow_outside;
        // Even if a command does not use them.
        options.validate()?;
    }
    let typed = matches.subcommand().map_or(matches, |(_, typed)| typed);
    let out = &mut Stdout;
    let inputs = &Inputs::typed(typed, limits);
    match &cli.command {
        Command::Make(args) => return make::run(args, typed, &cli.global, inputs),
        Command::Capture(args) => return capture::run(args, &cli.global, inputs),
        Command::Bake(args) => bake::run(args, typed, &cli.global, inputs),
        Command::Mesh(args) => return mesh::run(args, typed, &cli.global, inputs),
        #[cfg(feature = "view")]
        Command::Train(args) if args.view => {
            return train_view::run(args, typed, &cli.global, inputs);
        }
        #[cfg(not(feature = "view"))]
        Command::Train(args) if args.view => Err(missing_feature("view")),
        Command::Train(args) => return train::run(args, typed, &cli.global, inputs, None),
        Command::Plan(args) => return plan::run(args, typed, &cli.global, inputs, out),
        Command::Merge(args) => plan::merge(args, &cli.global, inputs),
        Command::Eval(args) => eval::run(args, &cli.global, inputs, out),
        Command::Render(args) => render::run(args, &cli.global, inputs),
        #[cfg(feature = "view")]
        Command::View(args) => view::run(args),
        #[cfg(not(feature = "view"))]
        Command::View(_) => Err(missing_feature("view")),
        Command::Info(args) => info::run(args, out),
        Command::Validate(args) => {
            let options = ReadOptions {
                limits,
                allow_outside: cli.global.allow_outside,
                ..ReadOptions::default()
            };
            info::validate(args, &options, out)
        }
        Command::Schema(args) => schema::run(args),
        Command::Completions(args) => schema::completions(args, &mut Cli::command()),
        Command::Man(args) => schema::man(args, Cli::command()),
    }?;
    Ok(ExitCode::SUCCESS)
}

/// The options for reading data sets and scenes, with the limits and permissions of the global
/// flags.
fn dataset_options(command: &mut Command) -> Option<&mut DatasetOptions> {
    match command {
        Command::Make(args) => Some(&mut args.dataset_options),
        Command::Bake(args) => Some(&mut args.dataset_options),
        Command::Mesh(args) => Some(&mut args.dataset_options),
        Command::Train(args) => Some(&mut args.dataset_options),
        Command::Plan(args) => Some(&mut args.dataset_options),
        Command::Eval(args) => Some(&mut args.job.dataset_options),
        Command::Render(args) => Some(&mut args.job.dataset_options),
        Command::Info(args) => Some(&mut args.dataset_options),
        #[cfg(feature = "view")]
        Command::View(args) => Some(&mut args.dataset_options),
        _ => None,
    }
}

/// Starts the worker threads, up to the limit: each takes memory, and more than a few per core only
/// cost time.
fn start_threads(global: &GlobalArgs, limits: &Limits) -> Result<()> {
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

// ---- What `--version` says ----------------------------------------------------------------------

/// Version, commit of a release, and features: "0.1.0 (1a2b3c4d; gpu, view)".
///
/// Builds of releases and containers set `TRISPLAT_COMMIT`: asking git here would compile the
/// program again after every commit.
pub(super) fn version() -> String {
    let features = [("gpu", cfg!(feature = "gpu")), ("view", cfg!(feature = "view"))];
    let on: Vec<&str> = features.iter().filter(|(_, on)| *on).map(|(name, _)| *name).collect();
    let features = if on.is_empty() { "default features".to_owned() } else { on.join(", ") };
    let commit = option_env!("TRISPLAT_COMMIT").unwrap_or("built from source");
    format!("{} ({commit}; {features})", env!("CARGO_PKG_VERSION"))
}

// ---- Commands that this build lacks -------------------------------------------------------------

/// Any arguments; they are ignored.
#[derive(Debug, clap::Args)]
#[command(disable_help_flag = true)]
pub struct MissingArgs {
    /// The arguments of a build with the feature.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
    pub rest: Vec<OsString>,
}

/// The error of a command whose feature is missing.
pub fn missing_feature(feature: &'static str) -> Error {
    Error::MissingFeature(feature)
}

// ---- Panics: a fault of the program is one error, and unwinding removes its temporary files -----

/// Place of the last panic for [`caught`] to report.
static PLACE: Mutex<Option<String>> = Mutex::new(None);

/// From now on panics of this thread and its workers print nothing, because they become errors of
/// files or of [`caught`]. Panics of other threads print one line. Must be called from the main
/// thread.
pub(super) fn report_once() {
    let main = std::thread::current().id();
    // A requested backtrace is still printed.
    let whole = std::env::var_os("RUST_BACKTRACE").map(|_| std::panic::take_hook());
    std::panic::set_hook(Box::new(move |info| {
        if is_guarded() {
            return;
        }
        if let Some(print) = &whole {
            print(info);
        }
        let place = info
            .location()
            .map_or_else(String::new, |at| format!(" ({}:{})", at.file(), at.line()));
        if std::thread::current().id() == main || rayon::current_thread_index().is_some() {
            *PLACE.lock().unwrap_or_else(PoisonError::into_inner) = Some(place);
        } else {
            messages::print(&format!("warning: {}", fault(panic_message(info.payload()), &place)));
        }
    }));
}

/// The result of `run`; a panic becomes an error.
pub(super) fn caught<T>(run: impl FnOnce() -> Result<T>) -> Result<T> {
    catch_unwind(AssertUnwindSafe(run)).unwrap_or_else(|payload| {
        let place = PLACE.lock().unwrap_or_else(PoisonError::into_inner).take().unwrap_or_default();
        Err(Error::Incomplete(fault(panic_message(&*payload), &place)))
    })
}

fn fault(message: &str, place: &str) -> String {
    format!(
        "trisplat has a fault: {message}{place}; please report it with the command and its files"
    )
}
