//! `trisplat train DATASET -o scene.ply`.

use super::Global;
use super::files;
use super::layers::{self, Config};
use super::resume;
use super::train_progress::Bar;
use crate::asset::{Placement, Provenance};
use crate::atomic::AtomicFile;
use crate::camera::{self, Camera};
use crate::dataset::{Dataset, DatasetOptions};
use crate::error::{Error, Result};
use crate::formats::ply;
use crate::report::{Counts, OutputReport, Report, StageReport, generator};
use crate::train::cpu::Cpu;
use crate::train::options::{Preset, TrainOptions};
use crate::train::{RunOptions, Trained, Trainer, checkpoint, clock, curve, eval, run as run_training};
use clap::ArgMatches;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Files, what to leave behind, and the options of the training.
#[derive(Debug, clap::Args)]
pub struct TrainArgs {
    /// Folder of posed photos (COLMAP model or transforms.json).
    #[arg(value_name = "DATASET")]
    pub dataset: PathBuf,
    /// Soup to write, .ply.
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
    /// Replace files that are there.
    #[arg(short, long)]
    pub force: bool,
    /// JSON file with training options; --set and flags win over it.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Set any training option by its key, as in refine.every=500; may be given often.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
    /// Go on from a checkpoint, with the options it was made with.
    #[arg(long, value_name = "FILE")]
    pub resume: Option<PathBuf>,
    /// Where checkpoints go; OUT with the ending .checkpoint unless given.
    #[arg(long, value_name = "FILE")]
    pub checkpoint: Option<PathBuf>,
    /// Write a checkpoint every N steps; 0: only when stopped with Ctrl-C.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub checkpoint_every: u64,
    /// Write one JSON line per sample of the curve; "-" is standard output.
    #[arg(long, value_name = "FILE")]
    pub log: Option<PathBuf>,
    /// Steps between samples; 0: a hundred samples a run.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub log_every: u64,
    /// Judge on the held-out photos every N steps, outside the clock; 0: only at the end.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub judge_every: u64,
    /// Write what the run did as JSON (schema: trisplat schema report).
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Draw PSNR and triangles over CPU seconds, as SVG.
    #[arg(long, value_name = "FILE")]
    pub curve: Option<PathBuf>,
    /// Folder for pictures of the first held-out photo while training.
    #[arg(long, value_name = "FOLDER")]
    pub preview: Option<PathBuf>,
    /// Seconds between preview pictures.
    #[arg(long, value_name = "SECS", default_value_t = 10.0)]
    pub preview_every: f64,
    /// Stop as Ctrl-C does after this many CPU seconds; 0: never.
    #[arg(long, value_name = "SECS", default_value_t = 0.0)]
    pub max_cpu_secs: f64,
    /// The photos.
    #[command(flatten)]
    pub dataset_options: DatasetOptions,
    /// The training.
    #[command(flatten)]
    pub options: TrainOptions,
}

/// Trains; `matches` tells which flags were typed.
pub fn run(args: &TrainArgs, matches: &ArgMatches, global: &Global) -> Result<()> {
    let clock = Instant::now();
    let plan = plan(args);
    guard(args, &plan)?;
    let dataset = Dataset::load(&args.dataset, &args.dataset_options)?;
    let photo_bytes = u64::from(args.dataset_options.photo_memory_mib) << 20;
    let point = args.resume.as_deref().map(checkpoint::read).transpose()?;
    let options = match &point {
        Some(point) => {
            refuse_changes(matches)?;
            point.meta.options.clone()
        }
        None => resolve(args, matches)?,
    };
    let drawing = options.drawing(args.dataset_options.background.to_f32());
    let backend = Cpu::new(drawing);
    let (curve, cpu_before) =
        point.as_ref().map_or((Vec::new(), 0.0), |p| (p.meta.curve.clone(), p.meta.cpu_secs));
    let trainer = match point {
        Some(point) => Trainer::resume(&dataset, point, photo_bytes, backend)?,
        None => Trainer::start(&dataset, &options, photo_bytes, backend)?,
    };
    let before = triangles(trainer.triangles());
    let mut bar = Bar::new(global, options.steps, trainer.steps(), args.log.as_deref(), &curve)?;
    for warning in &dataset.warnings {
        bar.line(&format!("warning: {warning}"));
    }
    let trained = run_training(trainer, &dataset, &drawing, &plan, curve, cpu_before, &mut bar)?;
    bar.done()?;
    let mut report = Report::new("train");
    report.inputs = vec![args.dataset.display().to_string()];
    report.options = serde_json::to_value(&options).unwrap_or_default();
    report.warnings.clone_from(&dataset.warnings);
    report.stages.push(stage(&trained, before, clock.elapsed().as_secs_f64()));
    report.outputs = write(args, &dataset, &trained)?;
    report.seconds = clock.elapsed().as_secs_f64();
    if let Some(path) = &args.report {
        files::save_json(&report, path)?;
    }
    summary(args, &trained, &bar);
    if let (true, Some(checkpoint)) = (trained.stopped, &plan.checkpoint) {
        let command = resume::command(matches, args, checkpoint);
        bar.line(&format!("stopped early; to go on: {command}"));
    }
    Ok(())
}

/// What the run leaves behind.
fn plan(args: &TrainArgs) -> RunOptions {
    let checkpoint = args.checkpoint.clone().unwrap_or_else(|| args.output.with_extension("checkpoint"));
    let pause = Duration::from_secs_f64(args.preview_every.clamp(0.0, 1e6));
    RunOptions {
        checkpoint: Some(checkpoint),
        checkpoint_every: args.checkpoint_every,
        sample_every: args.log_every,
        test_every_steps: args.judge_every,
        preview: args.preview.clone().map(|folder| (folder, pause)),
        max_cpu_secs: args.max_cpu_secs,
    }
}

/// Preset, then config file, then `--set`, then the flags really typed.
fn resolve(args: &TrainArgs, matches: &ArgMatches) -> Result<TrainOptions> {
    let config = args.config.as_deref().map(Config::read::<TrainOptions>).transpose()?;
    let preset = if layers::is_typed(matches, "preset") {
        args.options.preset
    } else {
        config.as_ref().and_then(|c| c.field::<Preset>("preset")).unwrap_or_default()
    };
    let preset = TrainOptions::preset(preset);
    let config = layers::with_sets(&preset, config, &args.sets)?;
    let options = layers::layer(&preset, config.as_ref(), &args.options, matches)?;
    options.validate()?;
    Ok(options)
}

/// A resumed run has the options it began with: anything else would not be the same run.
fn refuse_changes(matches: &ArgMatches) -> Result<()> {
    match resume::fixed().into_iter().find(|id| layers::is_typed(matches, id)) {
        Some(id) => {
            let flag = if id == "sets" { "--set".into() } else { format!("--{}", id.replace('_', "-")) };
            Err(Error::invalid(flag, "given with --resume", "the options of the checkpoint, or a new run"))
        }
        None => Ok(()),
    }
}

/// Refuses what would fail, or replace a file, only after the training.
fn guard(args: &TrainArgs, plan: &RunOptions) -> Result<()> {
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
        ("--checkpoint", fresh(&plan.checkpoint)),
    ];
    for (option, path) in targets {
        let Some(path) = path.filter(|path| path.as_os_str() != "-") else { continue };
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
fn write(args: &TrainArgs, dataset: &Dataset, trained: &Trained) -> Result<Vec<OutputReport>> {
    let source = args.dataset.file_name().map(|n| n.to_string_lossy().into_owned());
    let cameras: Vec<Camera> = dataset.train().map(|view| view.camera).collect();
    let provenance = Provenance {
        generator: Some(generator()),
        source,
        trainer: Some(generator()),
        up: Some(dataset.up_axis()),
        placement: Placement { center: dataset.origin.to_array(), ..Placement::IDENTITY },
        viewpoint: camera::viewpoint(&cameras),
    };
    let io = |e| Error::io(&args.output, e);
    let mut file = AtomicFile::create(&args.output)?;
    ply::write_soup(&mut file, &trained.soup, &provenance, &cameras).map_err(io)?;
    let mut outputs = vec![committed(file)?];
    if let Some(path) = &args.curve {
        let mut file = AtomicFile::create(path)?;
        file.write_all(curve::svg(path, &trained.curve)?.as_bytes()).map_err(|e| Error::io(path, e))?;
        outputs.push(committed(file)?);
    }
    Ok(outputs)
}

fn committed(file: AtomicFile) -> Result<OutputReport> {
    let path = file.path().display().to_string();
    Ok(OutputReport { path, bytes: file.commit()? })
}

fn triangles(count: usize) -> Counts {
    Counts { triangles: count as u64, vertices: 3 * count as u64 }
}

/// The run as the one stage of its report.
fn stage(trained: &Trained, before: Counts, seconds: f64) -> StageReport {
    let figures = serde_json::json!({
        "steps": trained.steps,
        "stopped": trained.stopped,
        "cpu_secs": trained.cpu_secs,
        "peak_bytes": clock::peak_bytes(),
        "dropped_gradients": trained.dropped,
        "psnr": eval::mean(&trained.scores).map(|mean| mean.0),
        "ssim": eval::mean(&trained.scores).map(|mean| mean.1),
        "held_out": trained.scores,
    });
    StageReport {
        name: "train".into(),
        seconds,
        before,
        after: triangles(trained.soup.len()),
        unneeded: None,
        details: figures.as_object().cloned().unwrap_or_default(),
    }
}

fn summary(args: &TrainArgs, trained: &Trained, bar: &Bar) {
    let out = args.output.display();
    let triangles = super::progress::thousands(trained.soup.len() as u64);
    let held_out = match eval::mean(&trained.scores) {
        Some((psnr, ssim)) => format!(", held out {psnr:.2} dB / {ssim:.4}"),
        None => String::new(),
    };
    bar.line(&format!(
        "wrote {out}: {triangles} triangles, {} steps, {:.1} CPU s{held_out}",
        trained.steps, trained.cpu_secs
    ));
    if trained.dropped > 0 {
        bar.line(&format!("warning: {} gradients were not finite and were dropped", trained.dropped));
    }
}
