//! `trisplat mesh SCENE|PHOTOS [DATASET] -o OUT`: one connected surface of a scene, or of photos
//! alone.

use super::flags::{self, OptionSources};
use super::info::is_dataset;
use super::inputs::Inputs;
use super::outputs::Outputs;
use super::terminal::Terminal;
use super::{GlobalArgs, signals};
use clap::ArgMatches;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;
use trisplat_bake::MeshOptions;
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_formats as formats;
use trisplat_formats::output::{self, Output, OutputFormat, SideFiles};
use trisplat_job::MeshJob;
use trisplat_scene::report::Report;
use trisplat_scene::{Error, Result};

/// Files, and the options of every stage.
#[derive(Debug, clap::Args)]
pub struct MeshArgs {
    /// Scene to make a surface of: a trained soup (.ply .pt), a mesh (.glb .gltf .obj .ply .off) or
    /// Gaussian splats (.ply .splat .spz .sog .glb), whose drawings are its photos; or posed photos
    /// alone, on which a scene is trained first, for half a minute of CPU time
    #[arg(value_name = "SCENE|PHOTOS")]
    pub input: PathBuf,
    /// Posed photos of it, whose cameras determine the surface; without them the cameras of SCENE,
    /// or chosen ones
    #[arg(value_name = "DATASET")]
    pub dataset: Option<PathBuf>,
    /// File to write: .ply .glb .gltf .obj .usdz, with --texture .html too
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
    /// Set any option of the surface and its frame by its key, as in center=true; may be given
    /// often
    #[arg(long = "set", value_name = "KEY=VALUE", allow_hyphen_values = true)]
    pub sets: Vec<String>,
    /// The options of the stages.
    #[command(flatten)]
    pub options: MeshOptions,
    /// Reading options of the data set.
    #[command(flatten)]
    pub dataset_options: DatasetOptions,
}

/// Makes the surface and writes it.
pub fn run(
    args: &MeshArgs,
    matches: &ArgMatches,
    global: &GlobalArgs,
    inputs: &Inputs,
) -> Result<ExitCode> {
    let clock = Instant::now();
    let sources = OptionSources { matches, sets: &args.sets, config: None };
    let limits = &args.dataset_options.limits;
    let options = &sources.resolve(&args.options, limits, |()| MeshOptions::default())?.options;
    options.validate()?;
    let output = plan(args, options)?;
    let from_photos = is_dataset(&args.input);
    if from_photos && let Some(second) = &args.dataset {
        let wants = format!(
            "one data set, or a scene before it: {} is a data set already",
            args.input.display()
        );
        return Err(Error::invalid("DATASET", second.display(), wants));
    }
    let has_pictures =
        from_photos || args.dataset.is_some() || formats::holds_splats(&args.input, limits);
    options.check_photos(has_pictures)?;
    let mut outputs = Outputs::new(inputs, args.force);
    let files = outputs.start_scene(&output, args.dry_run, args.report.as_deref())?;

    let mut report = Report { dry_run: args.dry_run, ..Report::new("mesh") };
    report.inputs = vec![args.input.display().to_string()];
    report.options = serde_json::to_value(options).unwrap_or_default();
    let mut job =
        MeshJob::new(None, photos(args, from_photos, &mut outputs, &mut report)?, options.clone());
    job.dataset_options = args.dataset_options.clone();
    if !from_photos {
        job.scene =
            Some(formats::read_content(&args.input, &args.dataset_options.read_options(3))?);
    }
    let mut terminal = Terminal::new(global, flags::command_of::<MeshArgs>("mesh"));
    let Some(asset) = job.run(&mut report, &mut |event| terminal.tell(event))? else {
        return Ok(signals::ended());
    };
    output::write(&asset, &output, files, &options.output, &mut report, &mut |event| {
        terminal.tell_stage(event.into())
    })?;
    report.seconds = clock.elapsed().as_secs_f64();

    let progress = terminal.done();
    for warning in &report.warnings {
        progress.warn(warning);
    }
    progress.wrote(&report);
    outputs.save_report(args.report.as_deref(), &report).map(|()| ExitCode::SUCCESS)
}

/// The files of the output: a surface is one mesh, so formats for whole scenes are refused.
fn plan(args: &MeshArgs, options: &MeshOptions) -> Result<Output> {
    let format = OutputFormat::of(&args.output)?;
    if format == OutputFormat::Tiles || format == OutputFormat::Html && !options.texture.is_wanted()
    {
        let wants = "a name ending in .ply, .glb, .gltf or .obj";
        return Err(Error::invalid("output", args.output.display(), wants));
    }
    options.texture.check_format(&args.output, format)?;
    let beside = SideFiles { texture: options.texture.is_wanted(), ..SideFiles::default() };
    Output::of_scene(&args.output, Some(format), &options.output, &beside)
}

/// The data set, which may be the input.
fn photos(
    args: &MeshArgs,
    from_photos: bool,
    outputs: &mut Outputs,
    report: &mut Report,
) -> Result<Option<Dataset>> {
    let Some(path) = args.dataset.as_ref().or(from_photos.then_some(&args.input)) else {
        return Ok(None);
    };
    let dataset = Dataset::load(path, &args.dataset_options)?;
    outputs.forbid_overwriting_photos(&dataset)?;
    if !from_photos {
        report.inputs.push(path.display().to_string());
    }
    report.warnings.extend(dataset.warnings.iter().cloned());
    Ok(Some(dataset))
}
