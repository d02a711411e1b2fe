//! `trisplat train DATASET -o scene.ply`.

use super::flags::{self, OptionSources};
use super::inputs::Inputs;
use super::messages::{self, many};
use super::outputs::Outputs;
use super::progress::Progress;
use super::terminal::Terminal;
use super::train_args::{self, TrainArgs};
use super::train_progress::TrainProgress;
use super::{GlobalArgs, plan, signals};
use clap::ArgMatches;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};
use trisplat_bake::{BackgroundDetails, BackgroundOptions, background, is_solid};
use trisplat_dataset::{Dataset, DatasetOptions, Masks, ShrunkSize, exposure::differ};
use trisplat_formats as formats;
use trisplat_job::{Event, TeacherPlan, TrainBegins, TrainJob, TrainPart, TrainResult, reading};
use trisplat_scene::layered::Layered;
use trisplat_scene::report::{OutputReport, Report, counted};
use trisplat_scene::{Error, ImportedScene, Result, Soup};
use trisplat_teacher as teacher;
use trisplat_train::budget::{Budget, BudgetDetails, Seconds};
use trisplat_train::{
    Checkpoint, ExposureDetails, PREVIEW_PREFIX, Preview, Quality, TrainOptions, TrainOutputs,
    TrainSample, Trained, checkpoint,
};

/// Trains, with an optional observer; `matches` holds the typed flags. Returns the exit code of a
/// run that was finished, or stopped cleanly.
pub fn run(
    args: &TrainArgs,
    matches: &ArgMatches,
    global: &GlobalArgs,
    inputs: &Inputs,
    watcher: Option<Box<dyn Watcher>>,
) -> Result<ExitCode> {
    if let Some(block) = &args.block {
        return plan::train_block(args, block, global, inputs);
    }
    let clock = Instant::now();
    let outputs = outputs(args);
    let read = checkpoint_to_resume(args, matches);
    // An output that must not be written is said before a checkpoint that cannot be read.
    let mut files = guard(args, inputs, &outputs)?;
    let (point, warnings) = read?;
    let options = layered_options(args, matches, point.as_ref())?;
    let how = reading(&args.dataset_options, point.as_ref());
    let read = |path| formats::read(path, &how.read_options(3));
    let mut from = args.from.as_deref().map(read).transpose()?;
    let dataset = dataset(args, &how, from.as_mut(), &options.options, global)?;
    files.forbid_overwriting_photos(&dataset)?;
    let teacher_file = train_args::teacher_path(&args.output);
    let mut job = TrainJob::with_layers(dataset, options);
    job.dataset_options = how;
    job.from = from;
    job.teacher = args.teacher.teacher.clone();
    job.teacher_share = args.teacher.teacher_share;
    job.teacher_file = Some(teacher_file.clone());
    job.budget = args.budget.map(Budget::cpu).or_else(|| args.budget_wall.map(Budget::wall));
    job.began = Some(clock);
    job.backend = args.backend_options.clone();
    job.outputs = outputs;
    job.resume = point;
    job.force_resume = args.force_resume;

    let terminal = Terminal::new(global, flags::command_of::<TrainArgs>("train"));
    let mut shown = TrainTerminal {
        args,
        terminal,
        files,
        teacher_file,
        watcher,
        warnings,
        written: None,
        failed: None,
    };
    let done = job.run(&mut |event| shown.tell(event));
    let TrainTerminal { mut terminal, files, warnings, written, failed, watcher, .. } = shown;
    if let Some(error) = failed {
        return Err(error);
    }
    let done = match done {
        Err(Error::Stopped { what }) if signals::exit_code().is_some() => {
            drop(terminal);
            Progress::new(global).line(&what);
            return Ok(signals::ended());
        }
        done => done?,
    };
    let Some(bar) = terminal.bar.take() else { unreachable!("a training that ended has begun") };
    drop(terminal);
    finish(args, matches, clock, done, TrainEnd { bar, files, warnings, written, watcher })
}

/// Parts of the terminal that outlive the training.
struct TrainEnd<'a> {
    bar: TrainProgress,
    files: Outputs<'a>,
    warnings: Vec<String>,
    written: Option<OutputReport>,
    watcher: Option<Box<dyn Watcher>>,
}

/// Writes the scene and the report; prints the result and the next command.
fn finish(
    args: &TrainArgs,
    matches: &ArgMatches,
    clock: Instant,
    done: TrainResult,
    end: TrainEnd<'_>,
) -> Result<ExitCode> {
    let TrainResult { trained, mut report, teacher, teacher_share } = done;
    let TrainEnd { mut bar, mut files, mut warnings, written, mut watcher } = end;
    let read =
        args.from.as_deref().into_iter().chain(teacher.input()).chain(args.dataset.as_deref());
    report.inputs = read.map(|path| path.display().to_string()).collect();
    warnings.append(&mut report.warnings);
    report.warnings = warnings;
    report.outputs.extend(written);
    write(args, &trained, report, clock, &mut files, &mut bar)?;
    let lost = bar.finish();
    let written = written_line(args, &trained);
    bar.line(&written);
    if let Some(watcher) = &mut watcher {
        watcher.end(&written, trained.clone().into());
    }
    summary(args, (&teacher, teacher_share), &trained, &bar);
    if trained.stopped
        && let Some(checkpoint) = &trained.checkpoint
    {
        let command = train_args::command(matches, args, checkpoint);
        bar.line(&format!("stopped early; to continue: {command}"));
    }
    exit_code(args, &trained, &lost)
}

/// The options of a new run, or those of the checkpoint that it resumes.
fn layered_options(
    args: &TrainArgs,
    matches: &ArgMatches,
    point: Option<&Checkpoint>,
) -> Result<Layered<TrainOptions>> {
    if let Some(point) = point {
        return Ok(Layered::over(&point.meta.options, point.meta.options.clone()));
    }
    let preset = if args.from.is_some() { TrainOptions::from_scene } else { TrainOptions::preset };
    let sources = OptionSources { matches, sets: &args.sets, config: args.config.as_deref() };
    let options = sources.resolve(&args.options, &args.dataset_options.limits, preset)?;
    options.options.validate()?;
    Ok(options)
}

/// Another viewer of a run.
pub trait Watcher {
    /// The data set of the run.
    fn begin(&mut self, dataset: &Dataset);
    /// True to get the present scene.
    fn wants_scene(&mut self) -> bool;
    /// The scene after the step of `sample`.
    fn scene(&mut self, sample: &TrainSample, scene: Box<ImportedScene>);
    /// The run has ended, with its result and the written scene.
    fn end(&mut self, what: &str, scene: ImportedScene);
}

/// Shows the training, and writes its teacher.
struct TrainTerminal<'a, 'b> {
    args: &'a TrainArgs,
    terminal: Terminal<'a>,
    files: Outputs<'b>,
    teacher_file: PathBuf,
    watcher: Option<Box<dyn Watcher>>,
    /// Notes on the checkpoint.
    warnings: Vec<String>,
    /// The teacher, once it was written.
    written: Option<OutputReport>,
    /// Error that stopped the job.
    failed: Option<Error>,
}

impl TrainTerminal<'_, '_> {
    fn tell(&mut self, event: Event<'_>) -> ControlFlow<()> {
        match event {
            Event::TrainingStarted(begins) => {
                self.failed = self.begin(begins).err();
                if self.failed.is_some() {
                    return ControlFlow::Break(());
                }
            }
            Event::Teacher(teacher) => self.keep(teacher),
            Event::SceneCopy(sample, scene) => {
                if let Some(watcher) = &mut self.watcher {
                    watcher.scene(sample, scene);
                }
            }
            Event::Step { part, sample, wants_scene } => {
                if let (TrainPart::Scene, Some(watcher)) = (part, &mut self.watcher) {
                    *wants_scene = watcher.wants_scene();
                }
                return self.terminal.tell(Event::Step { part, sample, wants_scene });
            }
            event => return self.terminal.tell(event),
        }
        ControlFlow::Continue(())
    }

    fn begin(&mut self, begins: &TrainBegins<'_>) -> Result<()> {
        match begins.part {
            TrainPart::Trial => return self.terminal.begin(begins, None),
            TrainPart::Teacher => {
                // The file of a requested one is claimed already.
                if self.args.teacher.teacher.is_none() {
                    self.files.reserve("--teacher", &self.teacher_file)?;
                }
                return self.terminal.begin(begins, None);
            }
            TrainPart::Scene => self.terminal.begin(begins, self.args.log.as_deref())?,
        }
        if let (Some(watcher), Some(photos)) = (&mut self.watcher, begins.photos) {
            watcher.begin(photos);
        }
        for warning in self.warnings.iter().chain(begins.warnings) {
            self.terminal.line(&format!(
                "warning: {}",
                flags::as_flags(warning, &flags::command_of::<TrainArgs>("train"))
            ));
        }
        // An automatic decision, and the flag that overrides it.
        let asked = self.args.dataset_options.masks;
        if asked == Masks::Auto
            && begins.photos.is_some_and(|photos| photos.masks(asked) == Masks::Cut)
        {
            self.terminal.line("masks are silhouettes: nothing is drawn beside the object (--masks ignore draws there what no photo shows)");
        }
        Ok(())
    }

    /// Writes the teacher.
    fn keep(&mut self, teacher: &Trained) {
        let path = &self.teacher_file;
        match self.files.take(path).and_then(|file| teacher.save_to(file)) {
            Ok(bytes) => {
                self.written = Some(OutputReport { path: path.display().to_string(), bytes });
            }
            // The run has the scene in memory.
            Err(error) => {
                let retrained = "the training continues; a resumed one trains its teacher again";
                if let Some(bar) = &mut self.terminal.bar {
                    bar.note_lost(&error, retrained);
                }
            }
        }
    }
}

/// The end of the program: success, stopped, or an error that names missing outputs beside the
/// scene.
fn exit_code(args: &TrainArgs, trained: &Trained, lost: &[String]) -> Result<ExitCode> {
    if lost.is_empty() {
        Ok(signals::exit_code()
            .filter(|_| trained.stopped)
            .map_or(ExitCode::SUCCESS, ExitCode::from))
    } else {
        let scene = args.output.display();
        let lost = lost.join("; ");
        Err(Error::Incomplete(format!("{scene} is written, but not everything beside it: {lost}")))
    }
}

/// The checkpoint of `--resume`, and the faults of newer ones. Its run keeps its options, because
/// with others it would be another run.
fn checkpoint_to_resume(
    args: &TrainArgs,
    matches: &ArgMatches,
) -> Result<(Option<Checkpoint>, Vec<String>)> {
    let Some(path) = &args.resume else { return Ok((None, Vec::new())) };
    let (checkpoint, warnings) = if path.is_dir() {
        let (newest, checkpoint, broken) = checkpoint::newest(path)?;
        let broken =
            broken.iter().map(|error| format!("{error}; resuming from {}", newest.display()));
        (checkpoint, broken.collect())
    } else {
        (checkpoint::read(path)?, Vec::new())
    };
    match train_args::fixed().into_iter().find(|id| flags::is_typed(matches, id)) {
        Some(id) => {
            let flag =
                if id == "sets" { "--set".into() } else { format!("--{}", id.replace('_', "-")) };
            let wants = match id.as_str() {
                "steps" | "budget" | "budget_wall" => format!(
                    "the {} of its run, towards whose end all rates fall; finish it, then train on from its scene with `--from {}`",
                    counted(checkpoint.meta.options.steps, "step"),
                    train_args::quoted(&args.output.to_string_lossy())
                ),
                _ => "the options of the checkpoint, or a new run".into(),
            };
            Err(Error::invalid(flag, "given with --resume", wants))
        }
        None => Ok((Some(checkpoint), warnings)),
    }
}

/// The photos, or pictures of a scene that teaches itself.
fn dataset(
    args: &TrainArgs,
    how: &DatasetOptions,
    from: Option<&mut ImportedScene>,
    options: &TrainOptions,
    global: &GlobalArgs,
) -> Result<Dataset> {
    match (&args.dataset, &args.from, from) {
        (None, Some(path), Some(scene)) => {
            let mut found = BackgroundDetails::default();
            background(scene, false, &BackgroundOptions::DEFAULT, &mut found);
            draw(path, scene, options, found.object_color(), how, global)
        }
        (path, ..) => Dataset::load(path.as_deref().unwrap_or(Path::new("")), how),
    }
}

/// The soft pictures of `scene` that replace photos in training, drawn under a bar.
fn draw(
    path: &Path,
    scene: &ImportedScene,
    options: &TrainOptions,
    behind: Option<[f32; 3]>,
    how: &DatasetOptions,
    global: &GlobalArgs,
) -> Result<Dataset> {
    let drawing = options.drawing(how.background.to_f32());
    let progress = Progress::new(global);
    let mut drawn = |done, all| progress.note(&format!("drawing soft pictures: {done} of {all}"));
    let dataset = teacher::dataset(path, scene, &drawing, behind, how.photo_bytes(), &mut drawn);
    progress.done();
    dataset
}

/// Outputs of the run beside its scene.
fn outputs(args: &TrainArgs) -> TrainOutputs {
    let checkpoint =
        args.checkpoint.clone().unwrap_or_else(|| args.output.with_extension("checkpoint"));
    let interval = Duration::from_secs_f64(args.preview_every);
    TrainOutputs {
        checkpoint: Some(checkpoint),
        keep: args.keep,
        checkpoint_every: args.checkpoint_every,
        sample_every: args.log_every,
        evaluate_every: args.eval_every,
        preview: args.preview.clone().map(|folder| Preview { folder, interval }),
        max_cpu_secs: args.max_cpu_secs,
    }
}

/// Refuses outputs that would fail, or replace a file, only after the training.
fn guard<'a>(args: &TrainArgs, inputs: &'a Inputs, outputs: &TrainOutputs) -> Result<Outputs<'a>> {
    let out = &args.output;
    train_args::check_ply(out)?;
    // A default one is claimed when the photos are counted.
    let teacher_file = train_args::teacher_path(out);
    let plan = |source| TeacherPlan::requested(source, args.resume.is_some(), Some(&teacher_file));
    let teacher = args.teacher.teacher.as_ref().map(plan);
    let read = teacher.as_ref().and_then(TeacherPlan::input);
    let trains = teacher == Some(TeacherPlan::Train);
    let mut files = Outputs::new(inputs, args.force);
    if let Some(path) = read {
        files.add_input(path);
    }
    if let Some(path) = &args.resume {
        files.add_resumed(path);
    }
    files.reserve("--output", out)?;
    if trains {
        files.reserve("--teacher", &teacher_file)?;
    }
    files.reserve_report(args.report.as_deref())?;
    // A resumed run adds to its log and replaces its own checkpoint.
    let goes_on = args.force || args.resume.is_some();
    files.release(goes_on);
    if let Some(path) = &outputs.checkpoint {
        if let (false, true, Some((_, old))) =
            (goes_on, args.keep > 1, checkpoint::numbered_files(path).first())
        {
            let wants = "a name without checkpoints of an earlier run, or --force to replace them";
            return Err(Error::invalid("--checkpoint", old.display(), wants));
        }
        files.check_writable("--checkpoint", path)?;
    }
    args.log.as_deref().map_or(Ok(()), |path| files.check_writable("--log", path))?;
    args.preview
        .as_deref()
        .map_or(Ok(()), |folder| files.plan_pictures("--preview", folder, PREVIEW_PREFIX))?;
    Ok(files)
}

/// Writes the soup, then the report, whose loss is a warning.
fn write(
    args: &TrainArgs,
    trained: &Trained,
    mut report: Report,
    clock: Instant,
    files: &mut Outputs,
    bar: &mut TrainProgress,
) -> Result<()> {
    let bytes = files.take(&args.output).and_then(|file| trained.save_to(file));
    let bytes = bytes.map_err(|error| rescued(error, args, trained))?;
    report.outputs.push(OutputReport { path: args.output.display().to_string(), bytes });
    if let Some(path) = &args.report {
        report.warnings.extend_from_slice(&bar.lost);
        report.seconds = clock.elapsed().as_secs_f64();
        if let Err(error) = files.take(path).and_then(|file| messages::save_json(&report, file)) {
            bar.note_lost(&error, "the report is missing");
        }
    }
    Ok(())
}

/// The error of a scene that could not be written; the scene is saved in the system's temporary
/// folder if possible.
fn rescued(error: Error, args: &TrainArgs, trained: &Trained) -> Error {
    let stem = args.output.file_stem().unwrap_or_default().to_string_lossy();
    let path = std::env::temp_dir().join(format!("{stem}.rescued-{}.ply", std::process::id()));
    match trained.save(&path) {
        Ok(_) => Error::Incomplete(format!("{error}; the scene was saved as {}", path.display())),
        Err(_) => error,
    }
}

/// The next command: the bake of the written scene.
fn next_command(args: &TrainArgs, soup: &Soup) -> String {
    let quoted = |path: &Path| train_args::quoted(&path.to_string_lossy());
    let photos = args
        .dataset
        .as_deref()
        .map_or(String::new(), |path| format!(" --dataset {}", quoted(path)));
    let kind = match (is_solid(soup), soup.sh_degree) {
        (false, _) => " --harden".to_owned(),
        (true, 0) => String::new(),
        (true, degree) => format!(" --sh {degree}"),
    };
    let file = quoted(args.output.with_extension("glb").as_path());
    format!("next: trisplat bake {}{photos}{kind} -o {file}", quoted(args.output.as_path()))
}

/// The result of the run.
fn written_line(args: &TrainArgs, trained: &Trained) -> String {
    let out = args.output.display();
    let triangles = many(trained.soup.len() as u64, "triangle");
    let held_out = match trained.quality() {
        Some(Quality { psnr, ssim }) => {
            let drawn = match trained.samples {
                Some(n) => format!("drawn solid, {n}×{n} samples per pixel"),
                None => "drawn soft".to_owned(),
            };
            let size = ShrunkSize::suffix(trained.photo_size);
            let corrected = trained.psnr_corrected();
            let corrected =
                corrected.map_or(String::new(), |p| format!(", {p:.2} dB with corrected colours"));
            let when = "as trained, before a bake";
            format!(", held out {psnr:.2} dB / {ssim:.4} ({when}; {drawn}{size}){corrected}")
        }
        None => String::new(),
    };
    let steps = counted(trained.steps, "step");
    let cpu_secs = trained.cpu_secs;
    format!("wrote {out}: {triangles}, {steps}, {cpu_secs:.1} CPU s{held_out}")
}

fn summary(
    args: &TrainArgs,
    (teacher, share): (&TeacherPlan, Option<f64>),
    trained: &Trained,
    bar: &TrainProgress,
) {
    bar.line(&next_command(args, &trained.soup));
    if !is_solid(&trained.soup) {
        bar.line(
            "the scene is soft, for research; `trisplat bake --harden` makes a file of it that looks like it",
        );
    }
    if let (Some(BudgetDetails { budget, spent_secs, repeat, .. }), false) =
        (trained.budget(), trained.stopped)
    {
        let spent = Seconds(spent_secs);
        let teacher = match teacher {
            TeacherPlan::Without(_) => String::new(),
            TeacherPlan::Read(path) => format!(" --teacher {}", path.display()),
            TeacherPlan::Train => {
                format!(" --teacher {}", train_args::teacher_path(&args.output).display())
            }
        };
        let share = share.map_or(String::new(), |share| format!(" --teacher-share {share}"));
        bar.line(&format!(
            "spent {spent} of the budget {budget}; the same run without it: {repeat}{teacher}{share}"
        ));
    }
    if let Some(ExposureDetails { verdict: Some(verdict), exposures }) = &trained.exposure {
        let photos = counted(exposures.gains.len() as u64 - verdict.unknown, "photo");
        let unknown = match verdict.unknown {
            0 => String::new(),
            count => format!(", the light of {} is unknown", counted(count, "photo")),
        };
        bar.line(&format!(
            "{} and by {:.0}% in white balance: {photos} corrected{unknown}",
            differ(verdict.exposure),
            100.0 * verdict.balance
        ));
    }
    let all = trained.soup.len();
    let shell = trained.soup.shell_count();
    // An empty scene keeps one.
    if all <= shell + 1 && !trained.stopped {
        let steps = counted(trained.steps, "step");
        let left = if all == shell { "no triangle but the shell" } else { "only one triangle" };
        bar.line(&format!(
            "warning: {left} is left, because {steps} cannot make one opaque: --steps 1000 or more"
        ));
    }
    if trained.dropped > 0 {
        let gradients = counted(trained.dropped, "gradient");
        bar.line(&format!("warning: dropped {gradients} with numbers that are not finite"));
    }
}
