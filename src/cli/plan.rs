//! A scene in blocks: `trisplat plan DATASET -o CITY`, `trisplat train --block`, `trisplat merge`.

use super::bake::ByteSize;
use super::flags::OptionSources;
use super::inputs::Inputs;
use super::messages::{self, many};
use super::outputs::Outputs;
use super::train_args::{BlockAddress, TrainArgs, check_ply};
use super::train_progress::TrainProgress;
use super::{GlobalArgs, signals};
use clap::ArgMatches;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_formats::{self as formats, ReadOptions};
use trisplat_job::{Event, TrainPart};
use trisplat_scale::{
    Blocks, Expected, Manifest, NAME, PlanOptions, Planner, Task, check, find_coarse, keep_coarse,
    status, unnamed,
};
use trisplat_scene::atomic::AtomicFile;
use trisplat_scene::report::counted;
use trisplat_scene::{Error, ImportedScene, Result};
use trisplat_train::{
    BackendOptions, PREVIEW_PREFIX, Preview, TrainInputs, TrainOptions, TrainOutputs, checkpoint,
};

/// Data set and blocks of a plan.
#[derive(Debug, clap::Args)]
pub struct PlanArgs {
    /// Folder of posed photos (COLMAP model or transforms.json).
    #[arg(value_name = "DATASET", required_unless_present = "status")]
    pub dataset: Option<PathBuf>,
    /// Folder to make for the plan: manifest.json, and the soups that blocks start from. Results of
    /// blocks go there, too.
    #[arg(short, long, value_name = "CITY", required_unless_present = "status")]
    pub output: Option<PathBuf>,
    /// Replace an existing plan.
    #[arg(short, long)]
    pub force: bool,
    /// Print the progress of the blocks of the plan in this folder, and plan nothing.
    #[arg(long, value_name = "CITY", conflicts_with_all = ["dataset", "output"])]
    pub status: Option<PathBuf>,
    /// Refuse a plan in which a block is expected to take more memory than this, as in 8GB.
    #[arg(long, value_name = "SIZE")]
    pub memory: Option<ByteSize>,
    /// Write a checkpoint of the coarse scene every N steps; 0: only when stopped with Ctrl-C or
    /// SIGTERM. The same command continues from it.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u64).range(0..=1_000_000_000))]
    pub checkpoint_every: u64,
    /// JSON file with training options of the blocks; --set and flags override it.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Set any training option of the blocks by its key, as in densify.every=500; may be given
    /// often.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
    /// The blocks.
    #[command(flatten)]
    pub plan: PlanOptions,
    /// The device that trains the coarse scene.
    #[command(flatten, next_help_heading = "Backend")]
    pub backend_options: BackendOptions,
    /// The photos.
    #[command(flatten)]
    pub dataset_options: DatasetOptions,
    /// The training: steps and triangles are those of the whole scene.
    #[command(flatten)]
    pub options: TrainOptions,
}

/// Plans, or prints the progress of a plan.
pub fn run(
    args: &PlanArgs,
    matches: &ArgMatches,
    global: &GlobalArgs,
    inputs: &Inputs,
    out: &mut dyn Write,
) -> Result<ExitCode> {
    match (&args.status, &args.dataset, &args.output) {
        (Some(city), ..) => print_status(args, city, out).map(|()| ExitCode::SUCCESS),
        (None, Some(dataset), Some(city)) => make(args, matches, (dataset, city), global, inputs),
        _ => Err(Error::invalid("plan", "nothing", "a data set and --output, or --status")),
    }
}

/// Makes the plan of `path` in the folder `city`.
fn make(
    args: &PlanArgs,
    matches: &ArgMatches,
    (path, city): (&Path, &Path),
    global: &GlobalArgs,
    inputs: &Inputs,
) -> Result<ExitCode> {
    let sources = OptionSources { matches, sets: &args.sets, config: args.config.as_deref() };
    let whole =
        sources.resolve(&args.options, &args.dataset_options.limits, TrainOptions::preset)?.options;
    whole.validate()?;
    let max_bytes = args.memory.map(|size| size.0);
    check(&args.plan, &whole, max_bytes)?;
    let mut files = Outputs::new(inputs, args.force);
    files.make_folder(city)?;
    let path_of_plan = city.join(NAME);
    // If the manifest exists, so do all files of the plan.
    files.reserve("--output", &path_of_plan)?;
    let dataset = Dataset::load(path, &args.dataset_options)?;
    files.forbid_overwriting_photos(&dataset)?;
    let planner = Planner {
        dataset: &dataset,
        dataset_options: &args.dataset_options,
        options: &args.plan,
        whole: &whole,
    };
    planner.address(city)?;
    let photos = planner.photos()?;
    let coarse = match planner.coarse_options()? {
        None => None,
        Some(options) => {
            let name = planner.coarse_name(&options, &photos)?;
            match coarse_scene(args, &dataset, &options, &city.join(&name), global)? {
                Some(coarse) => Some(coarse),
                None => return Ok(signals::ended()),
            }
        }
    };
    let coarse = coarse.as_ref().map(|(path, scene)| (path.as_path(), scene));
    let mut file = files.take(&path_of_plan)?;
    let manifest = planner.plan(&mut file, photos, coarse, max_bytes)?;
    files.recheck()?;
    manifest.write(file)?;
    if !global.quiet {
        for warning in &dataset.warnings {
            messages::print(&format!("warning: {warning}"));
        }
        let asked = args
            .plan
            .blocks
            .filter(|asked| coarse.is_some() && *asked as usize > manifest.blocks.len());
        if let Some(asked) = asked {
            let left_out = asked as usize - manifest.blocks.len();
            messages::print(&format!(
                "note: {left_out} of {asked} blocks are left out: no photo shows them"
            ));
        }
        messages::print(&summary(&manifest, city));
    }
    Ok(ExitCode::SUCCESS)
}

/// The coarse scene begun as `path`, trained unless it exists, and its file; `None` when the
/// training was stopped.
fn coarse_scene(
    args: &PlanArgs,
    dataset: &Dataset,
    options: &(TrainOptions, u64),
    path: &Path,
    global: &GlobalArgs,
) -> Result<Option<(PathBuf, ImportedScene)>> {
    let limits = args.dataset_options.limits;
    let made = match find_coarse(path, &limits) {
        Some(made) => made,
        None => match train_coarse(args, dataset, options, path, global)? {
            Some(made) => made,
            None => return Ok(None),
        },
    };
    // With the exact bits that every block will read.
    let how = ReadOptions { sh_degree: 3, limits, ..ReadOptions::default() };
    let scene = formats::read(&made, &how)?;
    Ok(Some((made, scene)))
}

/// Trains the coarse scene, or goes on with it; returns its file, or `None` when it was stopped.
fn train_coarse(
    args: &PlanArgs,
    dataset: &Dataset,
    (options, until): &(TrainOptions, u64),
    path: &Path,
    global: &GlobalArgs,
) -> Result<Option<PathBuf>> {
    let point = path.with_extension("checkpoint");
    let outputs = TrainOutputs {
        checkpoint: Some(point.clone()),
        checkpoint_every: args.checkpoint_every,
        ..TrainOutputs::default()
    };
    let resume = point.is_file().then(|| checkpoint::read(&point)).transpose()?;
    let run = TrainInputs::new(dataset, options).with_dataset_options(&args.dataset_options);
    let run = TrainInputs { outputs, resume, until_step: Some(*until), ..run };
    let run = run.start_on(&args.backend_options)?;
    let mut bar = TrainProgress::new(global, *until, run.steps(), None, run.curve())?;
    bar.line("training the coarse scene");
    bar.announce(run.card.as_deref(), &run.warnings);
    let trained =
        unnamed(run.finish(&mut |event| bar.show(Event::of_training(TrainPart::Scene, event)))?);
    if bar.is_stopped("the coarse scene", &trained)? {
        return Ok(None);
    }
    let made = keep_coarse(path, &trained)?;
    let _ = std::fs::remove_file(&point);
    bar.line(&format!("wrote {}: {:.1} CPU s", made.display(), trained.cpu_secs));
    Ok(Some(made))
}

fn summary(manifest: &Manifest, city: &Path) -> String {
    let blocks = &manifest.blocks;
    let most =
        |of: &dyn Fn(&Expected) -> f64| blocks.iter().map(|b| of(&b.expected)).fold(0.0, f64::max);
    let photos: usize = blocks.iter().map(|block| block.photos.len()).sum();
    format!(
        "wrote {}: {}, {:.1} of them per photo; a block takes about {:.0} CPU s and {:.1} GB at most, all together {:.0} CPU s",
        city.join(NAME).display(),
        many(blocks.len() as u64, "block"),
        photos as f64 / manifest.photos.len().max(1) as f64,
        most(&|expected| expected.cpu_secs),
        most(&|expected| expected.bytes as f64) / 1e9,
        blocks.iter().map(|b| b.expected.cpu_secs).sum::<f64>(),
    )
}

/// One row per block, and how many are done.
fn print_status(args: &PlanArgs, city: &Path, out: &mut dyn Write) -> Result<()> {
    let (manifest, folder) = Manifest::read(city, &args.dataset_options.limits)?;
    let mut done = 0;
    let all = many(manifest.blocks.len() as u64, "block");
    let mut text = String::from("block  state    photos  steps  expected CPU s\n");
    for (i, block) in manifest.blocks.iter().enumerate() {
        let state = status(&folder, block, i);
        done += usize::from(state == "done");
        let photos = block.photos.len();
        let steps = block.steps - block.first_step;
        let expected = block.expected.cpu_secs;
        text += &format!("{i:>5}  {state:<7}  {photos:>6}  {steps:>5}  {expected:>14.0}\n");
    }
    text += &format!("{done} of {all} done\n");
    out.write_all(text.as_bytes()).map_err(|e| Error::io("-", e))
}

// ---- `trisplat merge CITY -o OUT.ply`: one scene of the blocks of a plan ------------------------

/// Plan to merge.
#[derive(Debug, clap::Args)]
pub struct MergeArgs {
    /// Folder of a plan all of whose blocks are trained, or its manifest.json.
    #[arg(value_name = "CITY")]
    pub city: PathBuf,
    /// Soup to write, .ply.
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
    /// Replace files that are there.
    #[arg(short, long)]
    pub force: bool,
}

/// Merges.
pub fn merge(args: &MergeArgs, global: &GlobalArgs, inputs: &Inputs) -> Result<()> {
    check_ply(&args.output)?;
    let blocks = Blocks::open(&args.city, &global.limits()?)?;
    let mut files = Outputs::new(inputs, args.force);
    files.reserve("--output", &args.output)?;
    let mut scene = files.take(&args.output)?;
    let triangles = blocks.merge_into(&mut scene)?;
    scene.commit()?;
    if !global.quiet {
        let triangles = many(triangles, "triangle");
        let count = many(blocks.count() as u64, "block");
        messages::print(&format!("wrote {}: {triangles} of {count}", args.output.display()));
    }
    Ok(())
}

// ---- `trisplat train --block PLAN:BLOCK`: one block of a plan -----------------------------------

/// Trains the block, unless its result exists.
pub(super) fn train_block(
    args: &TrainArgs,
    block: &BlockAddress,
    global: &GlobalArgs,
    inputs: &Inputs,
) -> Result<ExitCode> {
    let clock = Instant::now();
    let task = Task::open(&block.plan, block.index, &args.dataset_options.limits)?;
    let done = task.output();
    if done.is_file() && !args.force {
        // A run that was killed after its last rename leaves it.
        let _ = std::fs::remove_file(task.checkpoint());
        if !global.quiet {
            messages::print(&format!("{} already exists", done.display()));
        }
        return Ok(ExitCode::SUCCESS);
    }
    let mut guard = guard_block(args, block, &task, inputs)?;
    // Tried before any work, because another process may train this block.
    let mut file = AtomicFile::create(&done)?;
    let (dataset, cameras) = task.dataset(args.dataset.as_deref())?;
    guard.forbid_overwriting_photos(&dataset)?;
    let preview = args
        .preview
        .clone()
        .map(|folder| Preview { folder, interval: Duration::from_secs_f64(args.preview_every) });
    let outputs = task.outputs(args.checkpoint_every, preview, args.max_cpu_secs);
    let (run, broken) = task.run(&dataset, outputs)?;
    let run = run.start_on(&args.backend_options)?;
    let mut bar = TrainProgress::new(
        global,
        task.block().steps,
        run.steps(),
        args.log.as_deref(),
        run.curve(),
    )?;
    bar.announce(run.card.as_deref(), broken.iter().chain(&run.warnings).chain(&dataset.warnings));
    let trained = run.finish(&mut |event| bar.show(Event::of_training(TrainPart::Scene, event)))?;
    if bar.is_stopped("the block", &trained)? {
        return Ok(signals::ended());
    }
    let trained = task.finished(trained, cameras);
    trained.write_to(&mut file)?;
    file.commit()?;
    // The result exists, so the checkpoint is useless.
    let _ = std::fs::remove_file(task.checkpoint());
    bar.line(&format!(
        "wrote {}: {}, {}, {:.1} CPU s, {:.1} s",
        done.display(),
        many(trained.soup.len() as u64, "triangle"),
        counted(trained.steps.saturating_sub(task.block().first_step), "step"),
        trained.cpu_secs,
        clock.elapsed().as_secs_f64()
    ));
    Ok(ExitCode::SUCCESS)
}

/// Refuses a log and previews that cannot or must not be written; the block's own files have names
/// with a hash. A block that goes on from its checkpoint goes on with them, too.
fn guard_block<'a>(
    args: &TrainArgs,
    block: &BlockAddress,
    task: &Task,
    inputs: &'a Inputs,
) -> Result<Outputs<'a>> {
    let mut files = Outputs::new(inputs, args.force || task.checkpoint().is_file());
    files.add_input(&block.plan);
    args.log.as_deref().map_or(Ok(()), |path| files.check_writable("--log", path))?;
    args.preview
        .as_deref()
        .map_or(Ok(()), |folder| files.plan_pictures("--preview", folder, PREVIEW_PREFIX))?;
    Ok(files)
}
