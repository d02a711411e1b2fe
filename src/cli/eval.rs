//! `trisplat eval FILE DATASET`: PSNR, SSIM and FLIP against the photos, raw and with corrected
//! colours.

use super::GlobalArgs;
use super::inputs::Inputs;
use super::messages::{self, many, thousands};
use super::outputs::Outputs;
use super::progress::Progress;
use super::render::PictureFiles;
use std::io::Write;
use std::path::PathBuf;
use trisplat_dataset::{Dataset, ShrunkSize, View};
use trisplat_job::{
    CoverageScores, DepthScores, EvalJob, EvalReport, RepresentationScore, ScoredPicture, Scores,
    ShineScores,
};
use trisplat_scene::{Error, Result};

/// Scene and photos to evaluate.
#[derive(Debug, clap::Args)]
pub struct EvalArgs {
    /// Trained soup (.ply .pt), mesh (.glb .gltf .obj .ply .off) or Gaussian splats (.ply .splat
    /// .spz .sog .glb). Several are compared with the first, in one table of means.
    ///
    /// A mesh is drawn as an engine draws it. A soup is drawn soft, as it was trained; solid, after
    /// a bake with default options; and from a quantised and compressed file. This shows the loss
    /// of each step. Gaussian splats are drawn as their trainers draw them.
    #[arg(value_name = "FILE", required = true)]
    pub files: Vec<PathBuf>,
    /// The scene, the photos, and how it is drawn.
    #[command(flatten)]
    pub job: EvalJob,
    /// Folder of posed photos, or a transforms.json.
    #[arg(value_name = "DATASET", help_heading = None::<&'static str>)]
    pub dataset: PathBuf,
    /// Write the drawings into this folder, as PNG files named like the photos. If a soup is drawn
    /// at every step, they go into its folders soft, solid and file.
    #[arg(long, value_name = "DIR", help_heading = None::<&'static str>)]
    pub save_renders: Option<PathBuf>,
    /// Write all scores as JSON (schema: trisplat schema eval); those of several scenes as a list.
    #[arg(long, value_name = "FILE", help_heading = None::<&'static str>)]
    pub report: Option<PathBuf>,
    /// Print all scores as JSON instead of a table.
    #[arg(long, help_heading = None::<&'static str>)]
    pub json: bool,
    /// Replace files that are there.
    #[arg(short, long, help_heading = None::<&'static str>)]
    pub force: bool,
}

/// Draws, measures, and prints a row per photo and step and the means on `out`; only the means when
/// quiet.
pub fn run(
    args: &EvalArgs,
    global: &GlobalArgs,
    inputs: &Inputs,
    out: &mut dyn Write,
) -> Result<()> {
    let mut outputs = Outputs::new(inputs, args.force);
    outputs.reserve_report(args.report.as_deref())?;
    let dataset = Dataset::load(&args.dataset, &args.job.dataset_options)?;
    outputs.forbid_overwriting_photos(&dataset)?;
    let [file] = &args.files[..] else { return compare(args, &dataset, global, outputs, out) };
    let mut ready = EvalJob { file: file.clone(), ..args.job.clone() }.prepare(&dataset)?;
    let folders = folders(args, ready.steps(), ready.views(), &mut outputs)?;

    let progress = Progress::new(global);
    ready.draw_on(|card, warnings| progress.drawing_on(card, warnings))?;
    let table = ScoreTable::new(ready.views().iter().map(|v| v.name.as_str()), global, args);
    progress.suspend(|| table.header(out))?;
    let report = ready.run(|photo, drawn| {
        progress.suspend(|| drawn.iter().try_for_each(|one| table.photo(out, one)))?;
        folders.iter().zip(drawn).try_for_each(|(folder, one)| folder.save(photo, &one.picture))
    })?;
    progress.done();
    for warning in &report.warnings {
        progress.warn(warning);
    }
    if args.json {
        messages::print_json(&report, out).map_err(|e| Error::io("-", e))?
    } else {
        table.end(out, &report)?
    }
    outputs.save_report(args.report.as_deref(), &report)
}

/// Evaluates several scenes, and prints the means of the last step of each, what an engine gets,
/// and the differences to the first.
fn compare(
    args: &EvalArgs,
    dataset: &Dataset,
    global: &GlobalArgs,
    mut outputs: Outputs<'_>,
    out: &mut dyn Write,
) -> Result<()> {
    if args.save_renders.is_some() {
        let wants = "one scene, whose pictures it writes";
        return Err(Error::invalid("--save-renders", "given with several scenes", wants));
    }
    let names: Vec<String> = args.files.iter().map(|file| file.display().to_string()).collect();
    let table =
        ScoreTable { photos: false, ..ScoreTable::new(names.iter().map(|n| &n[..]), global, args) };
    table.header(out)?;
    let mut reports: Vec<EvalReport> = Vec::new();
    for (file, name) in args.files.iter().zip(&names) {
        let progress = Progress::new(global);
        let mut ready = EvalJob { file: file.clone(), ..args.job.clone() }.prepare(dataset)?;
        ready.draw_on(|card, warnings| progress.drawing_on(card, warnings))?;
        let report = ready.run(|_, _| Ok(()))?;
        progress.done();
        if let (Some(step), true) = (report.steps.last(), table.shown) {
            let first = reports.first().and_then(|first| first.steps.last());
            let cells = table.cells(name, &step.name, &step.mean);
            let (count, part) =
                step.splats.map_or((step.triangles, "triangle"), |splats| (splats, "splat"));
            let beside = first.map_or(String::new(), |first| format!("; {}", against(step, first)));
            let grade = step.grade.map_or("", |grade| grade.word());
            table.line(out, &format!("{cells}  {}, {grade}{beside}", many(count, part)))?;
        }
        reports.push(report);
    }
    if args.json {
        messages::print_json(&reports, out).map_err(|e| Error::io("-", e))?;
    }
    outputs.save_report(args.report.as_deref(), &reports)
}

/// The differences of the means, and the photos of higher PSNR: `+0.21 dB, -0.0013 SSIM, 7 of 9
/// photos better`.
fn against(step: &RepresentationScore, first: &RepresentationScore) -> String {
    let pairs = step.images.iter().zip(&first.images);
    let better = pairs.filter(|(a, b)| a.score.psnr > b.score.psnr).count();
    format!(
        "{:+.3} dB, {:+.4} SSIM, {:+.4} FLIP, {better} of {} better",
        step.mean.psnr - first.mean.psnr,
        step.mean.ssim - first.mean.ssim,
        step.mean.flip - first.mean.flip,
        many(step.images.len() as u64, "photo")
    )
}

/// Scores as text, in columns.
struct ScoreTable {
    /// Width of the column of names.
    width: usize,
    /// True if photos have rows.
    photos: bool,
    /// True if there is a table.
    shown: bool,
}

impl ScoreTable {
    fn new<'a>(names: impl Iterator<Item = &'a str>, global: &GlobalArgs, args: &EvalArgs) -> Self {
        let width = names.map(|name| name.chars().count()).max().unwrap_or(0).max("photo".len());
        Self { width, photos: !global.quiet && !args.json, shown: !args.json }
    }

    fn line(&self, out: &mut dyn Write, text: &str) -> Result<()> {
        messages::write(out, text.trim_end())
            .and_then(|()| out.flush())
            .map_err(|e| Error::io("-", e))
    }

    /// Name, step and scores.
    fn cells(&self, name: &str, step: &str, scores: &Scores) -> String {
        let width = self.width;
        let Scores { psnr, ssim, flip, psnr_corrected, ssim_corrected } = scores;
        let cells = format!("{name:<width$}  {step:<5} {psnr:>8.3} {ssim:>7.4} {flip:>7.4}");
        format!("{cells}  {psnr_corrected:>12.3} {ssim_corrected:>7.4}")
    }

    fn header(&self, out: &mut dyn Write) -> Result<()> {
        let width = self.width;
        let header = format!(
            "{:<width$}  {:<5} {:>8} {:>7} {:>7}",
            "photo", "step", "PSNR dB", "SSIM", "FLIP"
        );
        let header = format!("{header}  {:>12} {:>7}", "corrected dB", "SSIM");
        if self.shown { self.line(out, &header) } else { Ok(()) }
    }

    fn photo(&self, out: &mut dyn Write, drawn: &ScoredPicture) -> Result<()> {
        let score = &drawn.score;
        if !self.photos {
            return Ok(());
        }
        self.line(out, &self.cells(&score.name, drawn.step, &score.score))
    }

    fn mean(
        &self,
        out: &mut dyn Write,
        step: &RepresentationScore,
        report: &EvalReport,
    ) -> Result<()> {
        let cells = self.cells("mean", &step.name, &step.mean);
        self.line(out, &format!("{cells}  {}", remark(step, report)))
    }

    /// Depth at tracked points, and the coverage of views beside the cameras.
    fn extrapolation(&self, out: &mut dyn Write, step: &RepresentationScore) -> Result<()> {
        let name = &step.name;
        if let Some(DepthScores { rays, within, before, behind }) = step.depth {
            let rays = thousands(rays);
            let shares = format!(
                "{within:.3} within 1%, {before:.3} over 5% before, {behind:.3} over 5% behind"
            );
            self.line(
                out,
                &format!("depth   {name:<5} {shares}, of {rays} rays to tracked points"),
            )?;
        }
        if let Some(psnr) = step.psnr_own_exposure {
            let what = "at each photo's exposure and white balance as tracked points tell them";
            self.line(out, &format!("exposed {name:<5} {psnr:.3} dB {what}"))?;
        }
        if let Some(ShineScores { typical, largest }) = step.shine {
            let change = format!("{typical:.3} typical, {largest:.3} largest change of colour");
            self.line(
                out,
                &format!("shine   {name:<5} {change}, seen from 60° beside the cameras"),
            )?;
        }
        let Some(CoverageScores { unsupported, empty }) = step.beside else { return Ok(()) };
        let shares = format!("{unsupported:.3} that no photo supports, {empty:.3} empty");
        self.line(
            out,
            &format!("beside  {name:<5} {shares}, of the pixels beside the training cameras"),
        )
    }

    fn end(&self, out: &mut dyn Write, report: &EvalReport) -> Result<()> {
        report.steps.iter().try_for_each(|step| self.mean(out, step, report))?;
        report.steps.iter().try_for_each(|step| self.extrapolation(out, step))?;
        let grade = report.steps.last().and_then(|step| Some((&step.name, step.grade?)));
        grade.map_or(Ok(()), |(name, grade)| {
            self.line(out, &format!("looks   {name:<5} {}: {}", grade.word(), grade.meaning()))
        })
    }
}

/// The line after the means of a step.
fn remark(step: &RepresentationScore, report: &EvalReport) -> String {
    let samples = report.ssaa;
    let (count, part) =
        step.splats.map_or((step.triangles, "triangle"), |splats| (splats, "splat"));
    let mut remark = format!("{}, {}", many(step.images.len() as u64, "photo"), many(count, part));
    if let Some(bytes) = step.bytes {
        remark += &format!(", {} bytes", thousands(bytes));
    }
    if !["soft", "splats"].contains(&step.name.as_str()) {
        remark += &format!(", {samples}×{samples} samples per pixel");
    }
    remark += &ShrunkSize::suffix(report.photo_size);
    let made = match step.name.as_str() {
        "soft" => ", as it was trained",
        "solid" if report.steps.len() > 1 => ", after a default bake and with its backdrop",
        "file" => ", the same written small and read back",
        _ => "",
    };
    remark += made;
    if let Some(change) = &step.change {
        remark += &format!("; {:+.3} dB by this step", change.psnr);
    }
    remark
}

/// The folders of drawings, one per step; none when no drawings are kept. Refuses to replace
/// pictures before any is drawn.
fn folders(
    args: &EvalArgs,
    steps: Vec<&str>,
    views: &[&View],
    outputs: &mut Outputs,
) -> Result<Vec<PictureFiles>> {
    let folders: Vec<PathBuf> = match &args.save_renders {
        None => Vec::new(),
        Some(folder) if steps.len() == 1 => vec![folder.clone()],
        Some(folder) => steps.iter().map(|step| folder.join(step)).collect(),
    };
    let names = || views.iter().map(|v| v.name.as_str());
    folders
        .iter()
        .map(|folder| PictureFiles::plan("--save-renders", folder, names(), outputs))
        .collect()
}
