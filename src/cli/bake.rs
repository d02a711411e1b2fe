//! `trisplat bake IN... -o OUT`.

use super::Global;
use super::bake_args::BakeArgs;
use super::bake_city;
use super::files;
use super::inputs::Inputs;
use super::layers;
use super::outputs::Outputs;
use super::progress::Progress;
use super::terminal::Terminal;
use clap::ArgMatches;
use std::path::PathBuf;
use std::time::Instant;
use trisplat_bake::{BakeOptions, ReshapeDetails, TeacherDetails};
use trisplat_dataset::Dataset;
use trisplat_formats::{info::Softness, output::Output};
use trisplat_job::{BakeDone, BakeInput, BakeJob};
use trisplat_scene::{
    Result,
    layered::Layers,
    report::{Report, counted},
};
use trisplat_train::TrainDetails;

/// Bakes; `matches` says which flags were typed.
pub fn run(args: &BakeArgs, matches: &ArgMatches, global: &Global, inputs: &Inputs) -> Result<()> {
    let clock = Instant::now();
    let mut options = resolve(args, matches)?;
    if let [plan] = &args.inputs[..]
        && bake_city::is_plan(plan)
    {
        return bake_city::run(args, plan, options, global, inputs);
    }
    let output = options.plan_output(&args.output, args.format)?;
    let mut outputs = guard(args, inputs, &output)?;
    let files = if args.dry_run { output.dry_run() } else { output.start()? };
    outputs.confirm()?;

    let read = |path: &PathBuf| Dataset::load(path, &args.dataset_options);
    let photos = args.dataset.as_ref().map(read).transpose()?;
    photos.as_ref().map_or(Ok(()), |photos| outputs.spare_photos(photos))?;
    let job = BakeJob {
        inputs: args.inputs.iter().cloned().map(BakeInput::File).collect(),
        options,
        photos,
        dataset_options: args.dataset_options.clone(),
        harden: args.harden.harden,
        max_bytes: args.max_bytes.map(|size| size.0),
        began: Some(clock),
    };
    let mut terminal = Terminal::new(global, command());
    let BakeDone { mut report, .. } = job.write(&output, files, &mut |event| terminal.tell(event))?;
    report.dry_run = args.dry_run;
    say(&report, &terminal.done());
    match &args.report {
        Some(path) => files::save_json(&report, outputs.take(path)?),
        None => Ok(()),
    }
}

/// The lines after the stages of a bake.
fn say(report: &Report, progress: &Progress) {
    for warning in &report.warnings {
        progress.warn(warning);
    }
    let hardened = report.details::<TrainDetails>();
    let softness = report.details::<TeacherDetails>().and_then(|details| details.softness);
    if let (Some(softness), None) = (softness, hardened) {
        progress.line(&soft_note(&softness, report.details().as_ref()));
    }
    for file in &report.outputs {
        let verb = if report.dry_run { "would write" } else { "wrote" };
        let bytes = super::counts::thousands(file.bytes);
        progress.line(&format!("{verb} {} ({bytes} bytes, {:.2} s)", file.path, report.seconds));
    }
}

/// The command, for the names of its flags.
fn command() -> clap::Command {
    <BakeArgs as clap::Args>::augment_args(clap::Command::new("bake"))
}

/// The softness of the scene, the score of its solid triangles, and a hint.
fn soft_note(softness: &Softness, reshaped: Option<&ReshapeDetails>) -> String {
    let (psnr, pictures) = (softness.psnr, counted(softness.pictures, "picture"));
    let gain = reshaped.and_then(|details| Some(details.psnr_last? - details.psnr_first?));
    let fitted = match gain {
        Some(gain) => format!("fitting them to its pictures gained {gain:.1} dB"),
        None => "they were not fitted to its pictures (`reshape`)".to_owned(),
    };
    format!(
        "soft scene: its solid triangles match its soft pictures to {psnr:.1} dB ({pictures}); {fitted}; \
         --harden trains it solid, which takes longer and comes closer"
    )
}

/// Preset, then config file, then `--set`, then the flags really typed.
fn resolve(args: &BakeArgs, matches: &ArgMatches) -> Result<BakeOptions> {
    let layers = Layers::default().settings(&args.sets).given(layers::typed(&args.options, matches)?);
    let layers = match &args.config {
        Some(path) => layers.file(path, &args.dataset_options.limits)?,
        None => layers,
    };
    Ok(layers.resolve(BakeOptions::preset)?.options)
}

/// Refuses outputs that cannot or must not be written, before any work. A dry run replaces nothing.
fn guard<'a>(args: &BakeArgs, inputs: &'a Inputs, output: &Output) -> Result<Outputs<'a>> {
    let mut outputs = Outputs::new(inputs, args.force || args.dry_run);
    outputs.plan_scene(output)?;
    outputs.replacing(args.force);
    args.report.as_deref().map_or(Ok(()), |path| outputs.claim("--report", path))?;
    Ok(outputs)
}
