//! `trisplat bake IN... -o OUT`.

use super::Global;
use super::bake_args::BakeArgs;
use super::bake_budget;
use super::bake_bytes;
use super::bake_city;
use super::files;
use super::harden::{self, Hardened};
use super::layers::Layers;
use super::outputs::Outputs;
use super::progress::Progress;
use crate::bake::backdrop::BackdropWhen;
use crate::bake::merge::merge;
use crate::bake::reshape::ReshapeDetails;
use crate::bake::teacher::{TeacherDetails, TeacherWhen};
use crate::bake::{Bake, BakeOptions, Views};
use crate::dataset::Dataset;
use crate::error::{Error, Result};
use crate::formats::info::Softness;
use crate::formats::output::{self, Output, OutputFormat};
use crate::formats::{self, ReadOptions};
use crate::report::{Observer, Report};
use crate::scene::Loaded;
use clap::ArgMatches;
use std::path::PathBuf;
use std::time::Instant;

/// Bakes; `matches` says which flags were typed.
pub fn run(args: &BakeArgs, matches: &ArgMatches, global: &Global) -> Result<()> {
    let clock = Instant::now();
    let mut options = resolve(args, matches)?;
    if let [plan] = &args.inputs[..]
        && bake_city::is_plan(plan)
    {
        return bake_city::run(args, plan, &options, global);
    }
    let output = Output::plan(&args.output, args.format, &options.output, options.bvh.bvh)?
        .with_levels(options.lod.lod.len(), &options.output)?;
    let output = match options.backdrop.backdrop {
        BackdropWhen::File => output.with_backdrop_file(&options.output)?,
        _ => output,
    };
    let output = match options.collision.collision {
        true => output.with_collision(&options.output)?,
        false => output,
    };

    let mut outputs = guard(args, &output)?;
    let files = if args.dry_run { output.dry_run() } else { output.start()? };
    outputs.confirm()?;

    let mut report = Report::new("bake");
    report.inputs = args.inputs.iter().map(|p| p.display().to_string()).collect();
    report.dry_run = args.dry_run;

    let (scenes, mut views) = scenes(args, &options, &mut outputs, &mut report, global)?;
    if let Some(limit) = args.max_bytes {
        options = bake_bytes::fitted(limit, &scenes, views.as_mut(), &options, &output)?;
    }
    report.options = serde_json::to_value(&options).unwrap_or_default();
    let mut pace = bake_budget::pace(args, clock);
    let mut progress = Progress::new(global).with_flags_of(command());
    report.stages.iter().for_each(|stage| progress.finished(stage));
    let bake = Bake::new(&options).photos(views.as_mut()).report(&mut report).observer(&mut progress);
    let asset = bake.pace(&mut pace).run(scenes)?;
    output::write(&asset, &output, files, &options.output, &mut report, &mut progress)?;
    if let Some(stage) = bake_budget::stage(&pace) {
        progress.finished(&stage);
        report.stages.push(stage);
    }
    report.warnings.extend(bake_budget::warning(args, &pace));
    report.seconds = clock.elapsed().as_secs_f64();

    progress.done();
    for warning in &report.warnings {
        progress.warn(warning);
    }
    bake_budget::lines(&pace).iter().for_each(|line| progress.line(line));
    if let Some(softness) = report.details::<TeacherDetails>().and_then(|details| details.softness) {
        progress.line(&soft_note(&softness, report.details().as_ref()));
    }
    for file in &report.outputs {
        let verb = if args.dry_run { "would write" } else { "wrote" };
        let bytes = super::progress::thousands(file.bytes);
        progress.line(&format!("{verb} {} ({bytes} bytes, {:.2} s)", file.path, report.seconds));
    }
    match &args.report {
        Some(path) => files::save_json(&report, outputs.take(path)?),
        None => Ok(()),
    }
}

/// The command, for the names of its flags.
fn command() -> clap::Command {
    <BakeArgs as clap::Args>::augment_args(clap::Command::new("bake"))
}

/// How soft the scene was, how close its solid triangles came, and what to do about it.
fn soft_note(softness: &Softness, reshaped: Option<&ReshapeDetails>) -> String {
    let Softness { psnr, pictures } = softness;
    let gain = reshaped.and_then(|details| Some(details.psnr_last? - details.psnr_first?));
    let fitted = match gain {
        Some(gain) => format!("fitting them to its pictures gained {gain:.1} dB"),
        None => "they were not fitted to its pictures (`reshape`)".to_owned(),
    };
    format!(
        "soft scene: as solid triangles {psnr:.1} dB from how it was trained to look ({pictures} pictures); {fitted}; \
         --harden trains it solid, which takes longer and comes closer"
    )
}

/// What is baked, and the photos or pictures that the bake may look at: the inputs, or with `--harden` what training
/// made of them, which is a stage of `report`.
fn scenes(
    args: &BakeArgs,
    options: &BakeOptions,
    outputs: &mut Outputs,
    report: &mut Report,
    global: &Global,
) -> Result<(Vec<Loaded>, Option<Views>)> {
    let dataset = photos(args, report)?;
    dataset.as_ref().map_or(Ok(()), |dataset| outputs.spare_photos(dataset))?;
    let views = dataset.as_ref().map(|dataset| Views::new(dataset, &args.dataset_options));
    let inputs = read_all(&args.inputs, &args.dataset_options.read_options(sh_degree(args, options)))?;
    if !args.harden.harden {
        return Ok((inputs, views));
    }
    let soft = merge(inputs)?;
    let hardened = match harden::needless(&soft) {
        Some(why) => Hardened::needless(soft, why),
        None => {
            let most = options.prune.max_triangles;
            let training = harden::options(&args.harden, soft.scene.triangle_count(), most);
            let (how, path) = (&args.dataset_options, &args.inputs[0]);
            harden::harden(&args.harden, path, soft, dataset.as_ref(), how, &training, global)?
        }
    };
    report.stages.push(hardened.stage);
    Ok((vec![hardened.scene], views.or(hardened.taught)))
}

/// The photos of `--dataset`.
fn photos(args: &BakeArgs, report: &mut Report) -> Result<Option<Dataset>> {
    let Some(path) = &args.dataset else { return Ok(None) };
    let how = &args.dataset_options;
    let dataset = Dataset::load(path, how)?;
    report.inputs.push(path.display().to_string());
    report.warnings.extend(dataset.warnings.iter().cloned());
    Ok(Some(dataset))
}

/// Preset, then config file, then the flags really typed.
fn resolve(args: &BakeArgs, matches: &ArgMatches) -> Result<BakeOptions> {
    let (config, limits) = (args.config.as_deref(), &args.dataset_options.limits);
    let layers = Layers { config, limits, sets: &[], typed: &args.options, matches };
    let mut options = layers.resolve(args.options.preset, BakeOptions::preset)?;
    let format = args.format.map_or_else(|| OutputFormat::of(&args.output), Ok)?;
    if options.tiles.tiles && format != OutputFormat::Tiles {
        let wants = "a name ending in .tileset.json, which `tiles` writes";
        return Err(Error::invalid("--output", args.output.display(), wants));
    }
    options.tiles.tiles = format == OutputFormat::Tiles;
    options.validate()?;
    Ok(options)
}

/// Refuses what cannot be written, or may not be, before any work. A dry run replaces nothing.
fn guard(args: &BakeArgs, output: &Output) -> Result<Outputs> {
    let inputs = args.inputs.iter().chain(&args.config).map(PathBuf::as_path);
    let mut outputs = Outputs::new(inputs, args.force || args.dry_run).with_dataset(args.dataset.as_deref());
    output.paths().try_for_each(|path| outputs.plan("--output", path))?;
    outputs.replacing(args.force);
    args.report.as_deref().map_or(Ok(()), |path| outputs.claim("--report", path))?;
    Ok(outputs)
}

/// The degree of the colours that are read: only the teacher draws more than the constant one.
fn sh_degree(args: &BakeArgs, options: &BakeOptions) -> u8 {
    let teaches = args.dataset.is_none() && options.teacher.teacher == TeacherWhen::Auto;
    if teaches || args.harden.harden { 3 } else { 0 }
}

/// Reads every input. Readers run one after the other, so that memory holds one file's spare buffers at a time.
fn read_all(inputs: &[PathBuf], options: &ReadOptions) -> Result<Vec<Loaded>> {
    if inputs.iter().filter(|p| p.as_os_str() == "-").count() > 1 {
        return Err(Error::invalid("IN", "- -", "standard input once"));
    }
    inputs.iter().map(|path| formats::read(path, options)).collect()
}
