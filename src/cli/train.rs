//! `trisplat train DATASET -o scene.ply`.

use super::Global;
use super::files;
use super::flags;
use super::harden;
use super::layers::{self, Layers};
use super::outputs::Outputs;
use super::resume;
use super::signals;
use super::teacher_args::TeacherPlan;
use super::train_args::TrainArgs;
use super::train_block;
use super::train_budget::{self, Planned};
use super::train_curve;
use super::train_progress::{Bar, Watcher};
use super::train_teacher::{Lesson, Taught};
use crate::atomic::AtomicFile;
use crate::bake::teacher::is_solid;
use crate::dataset::{Dataset, DatasetOptions};
use crate::error::{Error, Result};
use crate::formats;
use crate::report::{OutputReport, Report};
use crate::scene::Loaded;
use crate::train::budget::{BudgetDetails, Seconds};
use crate::train::device::OpenRun;
use crate::train::eval::Quality;
use crate::train::{Checkpoint, Preview, RunOptions, TrainOptions, TrainRun, Trained, checkpoint, rotation};
use clap::ArgMatches;
use indicatif::HumanCount;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Trains, while somebody else may watch; `matches` holds which flags were typed. Returns the exit code of a run that was finished, or
/// stopped in good order.
pub fn run(
    args: &TrainArgs,
    matches: &ArgMatches,
    global: &Global,
    watcher: Option<Box<dyn Watcher>>,
) -> Result<ExitCode> {
    if let Some(block) = &args.block {
        return train_block::run(args, block, global);
    }
    let clock = Instant::now();
    train_budget::check(args)?;
    let outputs = outputs(args);
    let mut files = guard(args, &outputs)?;
    let (point, mut warnings) = checkpoint_to_resume(args, matches)?;
    let options = match &point {
        Some(point) => point.meta.options.clone(),
        None => resolve(args, matches)?,
    };
    let mut how = args.dataset_options.clone();
    // A budget may have chosen the size of the photos.
    let chosen = point.as_ref().and_then(|point| point.meta.pace.as_ref()?.plan.max_size);
    how.max_size = how.max_size.or(chosen);
    let read = |path| formats::read(path, &how.read_options(3));
    let from = args.from.as_deref().map(read).transpose()?;
    let dataset = dataset(args, &how, from.as_ref(), &options, global)?;
    files.spare_photos(&dataset)?;
    let (from_scene, resumes) = (from.as_ref(), point.as_ref());
    let lesson = Lesson { args, matches, global, from: from_scene, options, resumes, began: clock };
    let Taught { planned, plan: teacher, dataset, stage, output, warnings: about_teacher } =
        lesson.begin(dataset, &mut how, &mut files)?;
    let Planned { dataset: photos, options, paced } = planned;
    let dataset = dataset.as_ref().unwrap_or(&photos);
    let plan = paced.as_ref().map(|paced| paced.pace.summary());
    warnings.extend(from.iter().flat_map(|scene| &scene.warnings).chain(&dataset.warnings).cloned());
    warnings.extend(about_teacher);
    let run = TrainRun::new(dataset, &options).with_dataset_options(&how);
    let (force_resume, began) = (args.force_resume, Some(clock));
    let run = TrainRun { outputs, from, resume: point, paced, began, force_resume, ..run };
    let OpenRun { run, card, warnings: about_backend } = run.start_at(&args.backend_options)?;
    warnings.extend(about_backend);
    warnings.extend(run.differences().iter().map(|difference| format!("resumed although {difference}")));
    let triangles = run.triangles();
    let steps = run.steps();
    let bar = Bar::new(global, options.steps, steps, args.log.as_deref(), run.curve())?;
    let mut bar = bar.watched(&photos, watcher);
    if let Some(card) = card {
        bar.line(&format!("training on {card}"));
        bar.say_rate(steps);
    }
    for warning in &warnings {
        bar.line(&format!("warning: {}", flags::spell(warning, &command())));
    }
    plan.iter().for_each(|plan| bar.line(plan));
    let trained = run.finish(&mut bar)?;
    let mut report = report(args, &teacher, &trained, warnings);
    report.outputs.extend(output);
    report.stages.extend(stage);
    report.stages.push(trained.stage(triangles, clock.elapsed().as_secs_f64()));
    write(args, &trained, report, clock, &mut files, &mut bar)?;
    let lost = bar.done();
    summary(args, &teacher, &trained, &mut bar);
    if let (true, Some(checkpoint)) = (trained.stopped, &trained.checkpoint) {
        let command = resume::command(matches, args, checkpoint);
        bar.line(&format!("stopped early; to go on: {command}"));
    }
    ended(args, &trained, &lost)
}

/// What the run did, but for its stages.
fn report(args: &TrainArgs, teacher: &TeacherPlan, trained: &Trained, warnings: Vec<String>) -> Report {
    let mut report = Report::new("train");
    let read = args.from.as_deref().into_iter().chain(teacher.input()).chain(args.dataset.as_deref());
    report.inputs = read.map(|path| path.display().to_string()).collect();
    report.options = serde_json::to_value(&trained.options).unwrap_or_default();
    Report { warnings, ..report }
}

/// How the program ends: with success, as one that was stopped, or with what is missing beside the scene.
fn ended(args: &TrainArgs, trained: &Trained, lost: &[String]) -> Result<ExitCode> {
    match lost.is_empty() {
        true => {
            Ok(signals::exit_code().filter(|_| trained.stopped).map_or(ExitCode::SUCCESS, ExitCode::from))
        }
        false => {
            let (scene, lost) = (args.output.display(), lost.join("; "));
            Err(Error::Incomplete(format!("{scene} is written, but not everything beside it: {lost}")))
        }
    }
}

/// The command, for the names of its flags.
fn command() -> clap::Command {
    <TrainArgs as clap::Args>::augment_args(clap::Command::new("train"))
}

/// The checkpoint of `--resume`, and what is wrong with newer ones. Its run keeps the options it began with: anything else would
/// not be the same run.
fn checkpoint_to_resume(args: &TrainArgs, matches: &ArgMatches) -> Result<(Option<Checkpoint>, Vec<String>)> {
    let Some(path) = &args.resume else { return Ok((None, Vec::new())) };
    let (checkpoint, warnings) = match path.is_dir() {
        true => {
            let (newest, checkpoint, broken) = rotation::newest(path)?;
            let broken = broken.iter().map(|error| format!("{error}; going on from {}", newest.display()));
            (checkpoint, broken.collect())
        }
        false => (checkpoint::read(path)?, Vec::new()),
    };
    match resume::fixed().into_iter().find(|id| layers::is_typed(matches, id)) {
        Some(id) => {
            let flag = if id == "sets" { "--set".into() } else { format!("--{}", id.replace('_', "-")) };
            Err(Error::invalid(flag, "given with --resume", "the options of the checkpoint, or a new run"))
        }
        None => Ok((Some(checkpoint), warnings)),
    }
}

/// The photos, or pictures of the scene that teaches itself.
fn dataset(
    args: &TrainArgs,
    how: &DatasetOptions,
    from: Option<&Loaded>,
    options: &TrainOptions,
    global: &Global,
) -> Result<Dataset> {
    match (&args.dataset, &args.from, from) {
        (None, Some(path), Some(scene)) => harden::draw(path, scene, options, how, global),
        (path, ..) => Dataset::load(path.as_deref().unwrap_or(Path::new("")), how),
    }
}

/// What the run leaves behind.
fn outputs(args: &TrainArgs) -> RunOptions {
    let checkpoint = args.checkpoint.clone().unwrap_or_else(|| args.output.with_extension("checkpoint"));
    let pause = Duration::from_secs_f64(args.preview_every);
    RunOptions {
        checkpoint: Some(checkpoint),
        keep: args.keep,
        checkpoint_every: args.checkpoint_every,
        sample_every: args.log_every,
        evaluate_every: args.eval_every,
        preview: args.preview.clone().map(|folder| Preview { folder, pause }),
        max_cpu_secs: args.max_cpu_secs,
    }
}

/// Preset, then config file, then `--set`, then the flags really typed.
fn resolve(args: &TrainArgs, matches: &ArgMatches) -> Result<TrainOptions> {
    let config = args.config.as_deref();
    let preset = if args.from.is_some() { TrainOptions::from_scene } else { TrainOptions::preset };
    let limits = &args.dataset_options.limits;
    let layers = Layers { config, limits, sets: &args.sets, typed: &args.options, matches };
    let options = layers.resolve(args.options.preset, preset)?;
    options.validate()?;
    Ok(options)
}

/// Refuses what would fail, or replace a file, only after the training.
fn guard(args: &TrainArgs, outputs: &RunOptions) -> Result<Outputs> {
    let out = &args.output;
    if out.extension().is_none_or(|e| !e.eq_ignore_ascii_case("ply")) {
        return Err(Error::invalid(
            "--output",
            out.display(),
            "a name that ends with .ply; bake turns it into .glb",
        ));
    }
    // One that nobody asked for is claimed when the photos are counted.
    let teacher = args.teacher.asked(out, args.resume.is_some());
    let [read, trained] =
        [TeacherPlan::input, TeacherPlan::output].map(|file| teacher.as_ref().and_then(file));
    let inputs = args.from.as_deref().into_iter().chain(read).chain(args.config.as_deref());
    let mut files = Outputs::new(inputs, args.force).with_dataset(args.dataset.as_deref());
    args.resume.iter().for_each(|path| files.add_input(path));
    files.claim("--output", out)?;
    let [report, curve] = [&args.report, &args.curve].map(Option::as_deref);
    for (option, path) in [("--teacher", trained), ("--report", report), ("--curve", curve)] {
        path.map_or(Ok(()), |path| files.claim(option, path))?;
    }
    // A run that goes on adds to its log and replaces its own checkpoint.
    args.resume.iter().for_each(|path| files.remove_input(path));
    let goes_on = args.force || args.resume.is_some();
    files.replacing(goes_on);
    if let Some(path) = &outputs.checkpoint {
        if let (false, true, Some((_, old))) = (goes_on, args.keep > 1, rotation::kept(path).first()) {
            let wants = "a name without checkpoints of an earlier run, or --force to replace them";
            return Err(Error::invalid("--checkpoint", old.display(), wants));
        }
        files.probe("--checkpoint", path)?;
    }
    args.log.as_deref().map_or(Ok(()), |path| files.probe("--log", path))?;
    args.preview.as_deref().map_or(Ok(()), |folder| files.plan_folder("--preview", folder))?;
    Ok(files)
}

/// Writes the soup, then the curve and the report; what of these cannot be written is a warning.
fn write(
    args: &TrainArgs,
    trained: &Trained,
    mut report: Report,
    clock: Instant,
    files: &mut Outputs,
    bar: &mut Bar,
) -> Result<()> {
    let written = |path: &Path, bytes: u64| OutputReport { path: path.display().to_string(), bytes };
    let bytes = files.take(&args.output).and_then(|file| trained.save_to(file));
    let bytes = bytes.map_err(|error| rescued(error, args, trained))?;
    report.outputs.push(written(&args.output, bytes));
    if let Some(path) = &args.curve {
        match files.take(path).and_then(|file| save_curve(file, trained)) {
            Ok(bytes) => report.outputs.push(written(path, bytes)),
            Err(error) => bar.note_lost(&error, "the curve is missing"),
        }
    }
    if let Some(path) = &args.report {
        report.warnings.extend_from_slice(bar.lost_so_far());
        report.seconds = clock.elapsed().as_secs_f64();
        if let Err(error) = files.take(path).and_then(|file| files::save_json(&report, file)) {
            bar.note_lost(&error, "the report is missing");
        }
    }
    Ok(())
}

/// The error of a scene that could not be written: it is saved in the system's folder for temporary files, if that is possible.
fn rescued(error: Error, args: &TrainArgs, trained: &Trained) -> Error {
    let stem = args.output.file_stem().unwrap_or_default().to_string_lossy();
    let path = std::env::temp_dir().join(format!("{stem}.rescued-{}.ply", std::process::id()));
    match trained.save(&path) {
        Ok(_) => Error::Incomplete(format!("{error}; the scene was saved as {}", path.display())),
        Err(_) => error,
    }
}

fn save_curve(mut file: AtomicFile, trained: &Trained) -> Result<u64> {
    let svg = train_curve::svg(file.path(), &trained.curve)?;
    file.write_all(svg.as_bytes()).map_err(|e| Error::io(file.path(), e))?;
    file.commit()
}

fn summary(args: &TrainArgs, teacher: &TeacherPlan, trained: &Trained, bar: &mut Bar) {
    let out = args.output.display();
    let triangles = HumanCount(trained.soup.len() as u64);
    let held_out = match trained.quality() {
        Some(Quality { psnr, ssim }) => {
            let drawn = match trained.samples {
                Some(n) => format!("solid, {n}×{n} samples per pixel"),
                None => "soft".to_owned(),
            };
            format!(", held out {psnr:.2} dB / {ssim:.4} ({drawn})")
        }
        None => String::new(),
    };
    let Trained { steps, cpu_secs, .. } = trained;
    bar.ended(
        &format!("wrote {out}: {triangles} triangles, {steps} steps, {cpu_secs:.1} CPU s{held_out}"),
        trained,
    );
    if !is_solid(&trained.soup) {
        bar.line(
            "the scene is soft, for research; `trisplat bake --harden` makes a file of it that looks like it",
        );
    }
    if let (Some(BudgetDetails { budget, spent_secs, repeat, .. }), false) =
        (trained.budget(), trained.stopped)
    {
        let spent = Seconds(spent_secs);
        let teacher = teacher.output().or(teacher.input());
        let teacher = teacher.map_or(String::new(), |path| format!(" --teacher {}", path.display()));
        bar.line(&format!(
            "spent {spent} of the budget {budget}; the same run without it: {repeat}{teacher}"
        ));
    }
    if trained.dropped > 0 {
        bar.line(&format!("warning: {} gradients were not finite and were dropped", trained.dropped));
    }
}
