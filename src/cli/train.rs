//! `trisplat train DATASET -o scene.ply`.

use super::Global;
use super::files;
use super::harden;
use super::layers::{self, Layers};
use super::resume;
use super::train_args::TrainArgs;
use super::train_curve;
use super::train_progress::Bar;
use crate::atomic::AtomicFile;
use crate::bake::teacher::is_solid;
use crate::dataset::Dataset;
use crate::error::{Error, Result};
use crate::formats;
use crate::report::{OutputReport, Report};
use crate::scene::Loaded;
use crate::train::eval::Quality;
use crate::train::{Checkpoint, Preview, RunOptions, TrainOptions, TrainRun, Trained, checkpoint};
use clap::ArgMatches;
use indicatif::HumanCount;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Trains; `matches` holds which flags were typed.
pub fn run(args: &TrainArgs, matches: &ArgMatches, global: &Global) -> Result<()> {
    let clock = Instant::now();
    let outputs = outputs(args);
    guard(args, &outputs)?;
    let (checkpoint, point) = (outputs.checkpoint.clone(), checkpoint_to_resume(args, matches)?);
    let options = match &point {
        Some(point) => point.meta.options.clone(),
        None => resolve(args, matches)?,
    };
    let read = |path| formats::read(path, &args.dataset_options.read_options(3));
    let from = args.from.as_deref().map(read).transpose()?;
    let dataset = dataset(args, from.as_ref(), &options, global)?;
    let warnings: Vec<String> =
        from.iter().flat_map(|scene| &scene.warnings).chain(&dataset.warnings).cloned().collect();
    let run = TrainRun::new(&dataset, &options).with_dataset_options(&args.dataset_options);
    let run = TrainRun { outputs, from, resume: point, ..run }.start()?;
    let triangles = run.triangles();
    let mut bar = Bar::new(global, options.steps, run.steps(), args.log.as_deref(), run.curve())?;
    for warning in &warnings {
        bar.line(&format!("warning: {warning}"));
    }
    let trained = run.finish(&mut bar)?;
    bar.done()?;
    let mut report = Report::new("train");
    report.inputs = args.from.iter().chain(&args.dataset).map(|path| path.display().to_string()).collect();
    report.options = serde_json::to_value(&options).unwrap_or_default();
    report.warnings = warnings;
    report.stages.push(trained.stage(triangles, clock.elapsed().as_secs_f64()));
    report.outputs = write(args, &trained)?;
    report.seconds = clock.elapsed().as_secs_f64();
    if let Some(path) = &args.report {
        files::save_json(&report, path)?;
    }
    summary(args, &trained, &bar);
    if let (true, Some(checkpoint)) = (trained.stopped, &checkpoint) {
        let command = resume::command(matches, args, checkpoint);
        bar.line(&format!("stopped early; to go on: {command}"));
    }
    Ok(())
}

/// The checkpoint of `--resume`. Its run keeps the options it began with: anything else would not be the same run.
fn checkpoint_to_resume(args: &TrainArgs, matches: &ArgMatches) -> Result<Option<Checkpoint>> {
    let Some(path) = &args.resume else { return Ok(None) };
    let checkpoint = checkpoint::read(path)?;
    match resume::fixed().into_iter().find(|id| layers::is_typed(matches, id)) {
        Some(id) => {
            let flag = if id == "sets" { "--set".into() } else { format!("--{}", id.replace('_', "-")) };
            Err(Error::invalid(flag, "given with --resume", "the options of the checkpoint, or a new run"))
        }
        None => Ok(Some(checkpoint)),
    }
}

/// The photos, or pictures of the scene that teaches itself.
fn dataset(
    args: &TrainArgs,
    from: Option<&Loaded>,
    options: &TrainOptions,
    global: &Global,
) -> Result<Dataset> {
    let how = &args.dataset_options;
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
fn guard(args: &TrainArgs, outputs: &RunOptions) -> Result<()> {
    let out = &args.output;
    if out.extension().is_none_or(|e| !e.eq_ignore_ascii_case("ply")) {
        return Err(Error::invalid(
            "--output",
            out.display(),
            "a name that ends with .ply; bake turns it into .glb",
        ));
    }
    // A run that goes on adds to its log and replaces its own checkpoint.
    let fresh = |path: &Option<PathBuf>| path.clone().filter(|_| args.resume.is_none());
    let targets = [
        ("--output", Some(out.clone())),
        ("--report", args.report.clone()),
        ("--curve", args.curve.clone()),
        ("--log", fresh(&args.log)),
        ("--checkpoint", fresh(&outputs.checkpoint)),
    ];
    for (option, path) in targets {
        let Some(path) = path.filter(|path| path.as_os_str() != "-") else { continue };
        if args.from.as_deref().is_some_and(|from| files::is_same(from, &path)) {
            return Err(Error::invalid(
                option,
                path.display(),
                "a file that is not also the scene to start from",
            ));
        }
        if path.is_file() && !args.force {
            return Err(files::is_there(option, &path));
        }
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            return Err(Error::invalid(option, path.display(), "a file in a folder that exists"));
        }
    }
    Ok(())
}

/// Writes the soup and the curve.
fn write(args: &TrainArgs, trained: &Trained) -> Result<Vec<OutputReport>> {
    let written = |path: &Path, bytes: u64| OutputReport { path: path.display().to_string(), bytes };
    let mut outputs = vec![written(&args.output, trained.save(&args.output)?)];
    if let Some(path) = &args.curve {
        let mut file = AtomicFile::create(path)?;
        let svg = train_curve::svg(path, &trained.curve)?;
        file.write_all(svg.as_bytes()).map_err(|e| Error::io(path, e))?;
        outputs.push(written(path, file.commit()?));
    }
    Ok(outputs)
}

fn summary(args: &TrainArgs, trained: &Trained, bar: &Bar) {
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
    bar.line(&format!(
        "wrote {out}: {triangles} triangles, {} steps, {:.1} CPU s{held_out}",
        trained.steps, trained.cpu_secs
    ));
    if !is_solid(&trained.soup) {
        bar.line(
            "the scene is soft, for research; `trisplat bake --harden` makes a file of it that looks like it",
        );
    }
    if trained.dropped > 0 {
        bar.line(&format!("warning: {} gradients were not finite and were dropped", trained.dropped));
    }
}
