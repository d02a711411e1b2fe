//! `trisplat stereo PHOTOS -o points.ply`: surfaces from posed photos.

use super::Global;
use super::files;
use super::outputs::Outputs;
use super::pictures::Pictures;
use super::progress::{Progress, thousands};
use crate::dataset::{Dataset, DatasetOptions, View};
use crate::error::{Error, Result};
use crate::report::{Counts, Outcome, OutputReport, Report};
use crate::stereo::{self, DepthMap, StereoDetails, StereoOptions, points};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Photos, files, and the options of stereo.
#[derive(Debug, clap::Args)]
pub struct StereoArgs {
    /// Posed photos: a folder with a COLMAP model or a transforms.json; held-out photos are not used
    #[arg(value_name = "DATASET")]
    pub input: PathBuf,
    /// File of points to write: positions, normals, colours, radii (half the distance between pixels) and confidence
    #[arg(short, long, value_name = "OUT.ply")]
    pub output: PathBuf,
    /// Write a picture per photo into FOLDER: the photo, its depths, normals and confidence
    #[arg(long, value_name = "FOLDER")]
    pub depth: Option<PathBuf>,
    /// Replace files that are there
    #[arg(short, long)]
    pub force: bool,
    /// Write the results as JSON (schema: trisplat schema report)
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// How depths are estimated.
    #[command(flatten)]
    pub options: StereoOptions,
    /// How the data set is read.
    #[command(flatten)]
    pub dataset_options: DatasetOptions,
}

/// Estimates depths, fuses them and writes the points.
pub fn run(args: &StereoArgs, global: &Global) -> Result<()> {
    let clock = Instant::now();
    args.options.validate()?;
    if !args.output.extension().is_some_and(|end| end.eq_ignore_ascii_case("ply")) {
        return Err(Error::invalid("output", args.output.display(), "a name ending in .ply"));
    }
    let mut outputs = Outputs::new([], args.force).with_dataset(Some(&args.input));
    outputs.claim("--output", &args.output)?;
    args.report.as_deref().map_or(Ok(()), |path| outputs.claim("--report", path))?;
    let dataset = Dataset::load(&args.input, &args.dataset_options)?;
    outputs.spare_photos(&dataset)?;
    let views: Vec<&View> = dataset.train().collect();
    if views.len() < 2 {
        let reason = format!("{} photo to compare, and depths want at least 2", views.len());
        return Err(Error::unsupported(
            &args.input,
            format!("{reason}; give more photos, or hold out fewer"),
        ));
    }
    let plan = |folder: &PathBuf| pictures(folder, &views, &mut outputs);
    let pictures = args.depth.as_ref().map(plan).transpose()?;

    let mut report = Report { warnings: dataset.warnings.clone(), ..Report::new("stereo") };
    report.inputs = vec![args.input.display().to_string()];
    report.options = serde_json::to_value(&args.options).unwrap_or_default();
    let command = <StereoArgs as clap::Args>::augment_args(clap::Command::new("stereo"));
    let mut progress = Progress::new(global).with_flags_of(command);
    let maps = estimate(&views, &dataset, &args.options, &mut report, &mut progress)?;
    let fused = stereo::fuse(&maps);
    if fused.is_empty() {
        let reason =
            "no two photos agree on a surface: give photos that overlap, taken from different places";
        return Err(Error::unsupported(&args.input, reason));
    }
    points::write(&fused, dataset.origin, outputs.take(&args.output)?)?;
    if let Some(pictures) = &pictures {
        maps.iter().enumerate().try_for_each(|(i, map)| pictures.save(i, &stereo::picture(map)))?;
    }
    report.outputs.push(output(&args.output));
    report.seconds = clock.elapsed().as_secs_f64();

    progress.done();
    report.warnings.iter().for_each(|warning| progress.warn(warning));
    let known = 100.0 * report.details::<StereoDetails>().unwrap_or_default().known;
    progress.line(&format!("{known:.0}% of {} photos have a depth", views.len()));
    let count = thousands(fused.len() as u64);
    progress.line(&format!("wrote {} ({count} points, {:.2} s)", args.output.display(), report.seconds));
    match &args.report {
        Some(path) => files::save_json(&report, outputs.take(path)?),
        None => Ok(()),
    }
}

/// Estimates the depths as a stage of the report.
fn estimate(
    views: &[&View],
    dataset: &Dataset,
    options: &StereoOptions,
    report: &mut Report,
    progress: &mut Progress,
) -> Result<Vec<DepthMap>> {
    let count = |_: &Vec<DepthMap>| Counts::default();
    report.long_stage(progress, Vec::new(), count, |maps, details: &mut StereoDetails, progress| {
        *maps = stereo::estimate(views, &dataset.points, options, progress)?;
        *details = StereoDetails::of(maps);
        Ok(Outcome::Changed(()))
    })
}

fn pictures(folder: &Path, views: &[&View], outputs: &mut Outputs) -> Result<Pictures> {
    Pictures::plan("--depth", folder, views.iter().map(|view| view.name.as_str()), outputs)
}

fn output(path: &Path) -> OutputReport {
    let bytes = std::fs::metadata(path).map_or(0, |meta| meta.len());
    OutputReport { path: path.display().to_string(), bytes }
}
