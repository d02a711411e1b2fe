//! `trisplat mesh SOUP [DATASET] -o OUT`: one connected surface of a scene.

use super::Global;
use super::files;
use super::layers;
use super::outputs::Outputs;
use super::progress::{Progress, thousands};
use crate::bake::Views;
use crate::bake::mesh::{MeshOptions, mesh};
use crate::dataset::{Dataset, DatasetOptions};
use crate::error::{Error, Result};
use crate::formats;
use crate::formats::output::{self, Beside, Output, OutputFormat};
use crate::layered::Layers;
use crate::report::Report;
use clap::ArgMatches;
use std::path::PathBuf;
use std::time::Instant;

/// Files, and the options of every stage.
#[derive(Debug, clap::Args)]
pub struct MeshArgs {
    /// Scene to make a surface of: a trained soup (.ply .pt), or a mesh (.glb .gltf .obj .ply .off)
    #[arg(value_name = "SCENE")]
    pub input: PathBuf,
    /// Posed photos of it, whose cameras determine the surface; without them the cameras of SCENE, or chosen
    /// ones
    #[arg(value_name = "DATASET")]
    pub dataset: Option<PathBuf>,
    /// File to write: .ply .glb .gltf .obj, with --texture .html too
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
    /// Replace OUT if it exists
    #[arg(short, long)]
    pub force: bool,
    /// Do everything but write
    #[arg(long)]
    pub dry_run: bool,
    /// Write what every stage did as JSON (schema: trisplat schema report)
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Set any option of the surface and its frame by its key, as in center=true; may be given often
    #[arg(long = "set", value_name = "KEY=VALUE", allow_hyphen_values = true)]
    pub sets: Vec<String>,
    /// The options of the stages.
    #[command(flatten)]
    pub options: MeshOptions,
    /// How the data set is read.
    #[command(flatten)]
    pub dataset_options: DatasetOptions,
}

/// Makes the surface and writes it.
pub fn run(args: &MeshArgs, matches: &ArgMatches, global: &Global) -> Result<()> {
    let clock = Instant::now();
    let layers = Layers::default().settings(&args.sets).given(layers::typed(&args.options, matches)?);
    let options = &layers.resolve(|()| MeshOptions::default())?.options;
    options.validate()?;
    let output = plan(args, options)?;
    if options.texture.texture && args.dataset.is_none() {
        let wants = "photos: give the data set after the scene, as in trisplat mesh scene.ply photos --texture -o room.glb";
        return Err(Error::invalid("texture", "given without photos", wants));
    }
    let mut outputs = guard(args, &output)?;
    let files = if args.dry_run { output.dry_run() } else { output.start()? };
    outputs.confirm()?;

    let mut report = Report { dry_run: args.dry_run, ..Report::new("mesh") };
    report.inputs = vec![args.input.display().to_string()];
    report.options = serde_json::to_value(options).unwrap_or_default();
    let mut views = photos(args, &mut outputs, &mut report)?;
    let scene = formats::read(&args.input, &args.dataset_options.read_options(3))?;
    let command = <MeshArgs as clap::Args>::augment_args(clap::Command::new("mesh"));
    let mut progress = Progress::new(global).with_flags_of(command);
    let limits = &args.dataset_options.limits;
    let asset = mesh(scene, views.as_mut(), options, limits, &mut report, &mut progress)?;
    output::write(&asset, &output, files, &options.output, &mut report, &mut progress)?;
    report.seconds = clock.elapsed().as_secs_f64();

    progress.done();
    report.warnings.iter().for_each(|warning| progress.warn(warning));
    for file in &report.outputs {
        let verb = if args.dry_run { "would write" } else { "wrote" };
        let bytes = thousands(file.bytes);
        progress.line(&format!("{verb} {} ({bytes} bytes, {:.2} s)", file.path, report.seconds));
    }
    match &args.report {
        Some(path) => files::save_json(&report, outputs.take(path)?),
        None => Ok(()),
    }
}

/// The files of the output: a surface is one mesh, so formats for whole scenes are refused.
fn plan(args: &MeshArgs, options: &MeshOptions) -> Result<Output> {
    let format = OutputFormat::of(&args.output)?;
    if format == OutputFormat::Tiles || format == OutputFormat::Html && !options.texture.texture {
        let wants = "a name ending in .ply, .glb, .gltf or .obj";
        return Err(Error::invalid("output", args.output.display(), wants));
    }
    options.texture.check_format(&args.output, format)?;
    let beside = Beside { texture: options.texture.texture, ..Beside::default() };
    Output::of_scene(&args.output, Some(format), &options.output, &beside)
}

/// Refuses outputs that cannot or must not be written, before any work. A dry run replaces nothing.
fn guard(args: &MeshArgs, output: &Output) -> Result<Outputs> {
    let mut outputs = Outputs::new([args.input.as_path()], args.force || args.dry_run)
        .with_dataset(args.dataset.as_deref());
    output.paths().try_for_each(|path| outputs.plan("--output", path))?;
    outputs.replacing(args.force);
    args.report.as_deref().map_or(Ok(()), |path| outputs.claim("--report", path))?;
    Ok(outputs)
}

/// The cameras of the data set.
fn photos(args: &MeshArgs, outputs: &mut Outputs, report: &mut Report) -> Result<Option<Views>> {
    let Some(path) = &args.dataset else { return Ok(None) };
    let dataset = Dataset::load(path, &args.dataset_options)?;
    outputs.spare_photos(&dataset)?;
    report.inputs.push(path.display().to_string());
    report.warnings.extend(dataset.warnings.iter().cloned());
    Ok(Some(Views::new(&dataset, &args.dataset_options)))
}
