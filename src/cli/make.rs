//! `trisplat make INPUT -o scene.glb`: from photos or a video to a file for an engine and a page,
//! in one command.

use super::bake::{shine_note, textured_by_itself};
use super::capture::advise;
use super::flags::{self, OptionSources};
use super::inputs::Inputs;
use super::outputs::Outputs;
use super::progress::Progress;
use super::terminal::Terminal;
use super::{GlobalArgs, signals};
use clap::ArgMatches;
use indicatif::HumanDuration;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;
use trisplat_bake::BakeOptions;
use trisplat_dataset::capture::CaptureOptions;
use trisplat_dataset::{DatasetOptions, ShrunkSize};
use trisplat_formats::output::OutputFormat;
use trisplat_job::{Event, Grade, MakeDone, MakeJob, MakePart, Scores};
use trisplat_scene::math::lists::median;
use trisplat_scene::report::{OutputReport, counted};
use trisplat_scene::{Error, Result, Seconds, parallel};
use trisplat_train::budget::BudgetDetails;
use trisplat_train::{BackendOptions, TrainDetails, TrainOptions};

/// A photo that is so much worse than half of the others, dB, was blurred or moved, or its pose is
/// wrong.
const FAR_BELOW: f64 = 5.0;
/// More time that gained less, dB, is not advised again.
const MIN_GAIN: f64 = 0.3;
/// A training that spent this share of its budget would have used more.
const USED_UP: f64 = 0.8;
/// Number of worst photos that are named.
const WORST: usize = 2;

/// Photos or videos, and the files to make.
#[derive(Debug, clap::Args)]
#[command(mut_arg("sh", |sh| sh.default_value("auto")))]
pub struct MakeArgs {
    /// Photos, a video, or folders of them; or a data set that has poses
    #[arg(required = true, value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// File to write: .glb .gltf .obj .ply .usdz .tileset.json
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
    /// Replace OUT and the page, and a begun run with other inputs
    #[arg(short, long)]
    pub force: bool,
    /// CPU time of training and bake, on all cores together, as in 90s, 2m or 1.5h; finding poses
    /// comes on top
    #[arg(long, value_name = "TIME", default_value_t = Seconds(600.0))]
    pub budget: Seconds,
    /// Train this many steps instead: the same bytes on every run, also after a stop
    #[arg(long, value_name = "N", conflicts_with = "budget", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    pub steps: Option<u64>,
    /// Folder for continuing a stopped run: photos, poses, checkpoints; OUT with the ending .make
    /// unless given
    #[arg(long, value_name = "FOLDER")]
    pub work: Option<PathBuf>,
    /// Page to write beside OUT, to be opened in a browser; OUT with the ending .html unless given
    #[arg(long, value_name = "FILE.html")]
    pub page: Option<PathBuf>,
    /// Train although the photos can hardly make a scene: few points tie them, or they share too
    /// little
    #[arg(long)]
    pub anyway: bool,
    /// Write the results of every step as JSON (schema: trisplat schema report)
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Photos and poses.
    #[command(flatten)]
    pub capture: CaptureOptions,
    /// The options of the bake.
    #[command(flatten, next_help_heading = "Bake")]
    pub bake: BakeOptions,
    /// Training backend.
    #[command(flatten, next_help_heading = "Backend")]
    pub backend_options: BackendOptions,
    /// Reading options of the data set.
    #[command(flatten)]
    pub dataset_options: DatasetOptions,
}

/// Makes it.
pub fn run(
    args: &MakeArgs,
    matches: &ArgMatches,
    global: &GlobalArgs,
    inputs: &Inputs,
) -> Result<ExitCode> {
    let page = args.page.clone().unwrap_or_else(|| args.output.with_extension("html"));
    let mut job = MakeJob::new(args.inputs.iter().cloned(), args.output.clone());
    if let Some(work) = &args.work {
        job.work = work.clone();
    }
    let sources = OptionSources { matches, sets: &[], config: None };
    let limits = &args.dataset_options.limits;
    job.bake = sources.resolve(&args.bake, limits, BakeOptions::preset_for_photos)?.options;
    textured_by_itself(&mut job.bake, matches, &args.output);
    guard(args, inputs, &page, &job)?;
    job.page = Some(page);
    job.report = args.report.clone();
    job.capture = args.capture.clone();
    job.force = args.force;
    job.anyway = args.anyway;
    job.dataset_options = args.dataset_options.clone();
    job.backend = args.backend_options.clone();
    if let Some(most) = job.bake.prune.max_triangles {
        job.train = TrainOptions { max_triangles: most, ..TrainOptions::default() };
    }
    // Harmonics that are asked for are trained; those by choice come to a scene of plain colours.
    job.train.sh_degree = job.bake.sh.sh.asked();
    job.budget = Some(args.budget);
    if let Some(steps) = args.steps {
        job.train.steps = steps;
        job.budget = None;
    }

    let work = job.work.display().to_string();
    let budget = args.steps.is_none().then_some(args.budget);
    let mut terminal = Terminal::new(global, flags::command_of::<MakeArgs>("make"));
    let done = job.run(&mut |event| {
        if let (Event::Part(part), Some(budget)) = (&event, budget)
            && let Some(text) = announced(*part, budget)
        {
            terminal.line(&text);
        }
        terminal.tell(event)
    })?;
    say(&done, args, &work, &terminal.done());
    Ok(if done.stopped { signals::ended() } else { ExitCode::SUCCESS })
}

/// Refuses inputs that are not there, and outputs that cannot or must not be written, before any
/// work.
fn guard(args: &MakeArgs, inputs: &Inputs, page: &Path, job: &MakeJob) -> Result<()> {
    if args.output.as_os_str() == "-" || args.output.extension().is_some_and(|e| e == "html") {
        let wants = "a file for an engine, as in scene.glb; the page is written beside it";
        return Err(Error::invalid("output", args.output.display(), wants));
    }
    if OutputFormat::of(&args.output).is_err() {
        let wants = "a name ending in .glb, .gltf, .obj, .ply, .usdz or .tileset.json";
        return Err(Error::invalid("output", args.output.display(), wants));
    }
    if page.extension().is_none_or(|e| e != "html") {
        return Err(Error::invalid("page", page.display(), "a name ending in .html"));
    }
    let planned = job.bake.clone().plan_output(&args.output, None)?;
    let mut outputs = Outputs::new(inputs, args.force);
    outputs.unfinished = job.unfinished();
    outputs.plan_scene(&planned)?;
    if let Some(file) = job.subject_file() {
        outputs.plan_scene(&job.subject_bake().plan_output(&file, None)?)?;
    }
    outputs.plan("--page", page)?;
    if let Some(report) = &args.report {
        outputs.check_writable("--report", report)?;
    }
    for input in &args.inputs {
        std::fs::metadata(input).map_err(|e| Error::unread(input, e))?;
    }
    Ok(())
}

/// The result, and the next step.
fn say(done: &MakeDone, args: &MakeArgs, work: &str, progress: &Progress) {
    for warning in &done.report.warnings {
        progress.warn(warning);
    }
    if let Some(verdict) = &done.verdict {
        advise(verdict, progress);
    }
    if done.stopped {
        progress.line(&format!("stopped; the same command goes on from {work}"));
        return;
    }
    // First the file for viewers that frame a whole file.
    let mut files: Vec<&OutputReport> = done.report.outputs.iter().collect();
    files.sort_by_key(|file| Some(Path::new(&file.path)) != done.subject.as_deref());
    for file in files {
        let bytes = super::messages::thousands(file.bytes);
        progress.line(&format!(
            "wrote {} ({bytes} bytes){}",
            file.path,
            purpose(Path::new(&file.path), done, args)
        ));
    }
    if let Some(why) = done.no_subject {
        let whole = args.output.display();
        progress.line(&format!("no file of the subject alone, as {why}; {whole} is the scene"));
    }
    if let Some(note) = shine_note(&done.report) {
        progress.line(&note);
    }
    if let Some(details) = done.report.details::<TrainDetails>() {
        for line in verdict(&details, done, args) {
            progress.line(&line);
        }
    }
    let pages = done.report.outputs.iter().filter(|file| file.path.ends_with(".html"));
    for page in pages {
        progress.line(&format!("open {} in a browser", page.path));
    }
}

/// Purpose of a file, if there are two of a kind.
fn purpose(file: &Path, done: &MakeDone, args: &MakeArgs) -> &'static str {
    match &done.subject {
        Some(subject) if subject == file => {
            ": the subject alone, for viewers that frame the whole file, and to place it elsewhere"
        }
        Some(_) if file == args.output => {
            ": everything with its surroundings, to look around from within"
        }
        _ => "",
    }
}

/// The score of the file and its grade, as `trisplat eval` has them, and what comes next.
fn verdict(details: &TrainDetails, done: &MakeDone, args: &MakeArgs) -> Vec<String> {
    let of_training = || {
        let psnr = details.psnr?;
        let ssim = details.ssim?;
        Some((psnr, format!("{psnr:.1} dB / {ssim:.3} SSIM")))
    };
    let of_file = done.score.as_ref().map(|score| {
        let Scores { psnr, ssim, flip, .. } = score.mean;
        (psnr, format!("{psnr:.1} dB / {ssim:.3} SSIM / {flip:.3} FLIP"))
    });
    let Some((psnr, scores)) = of_file.or_else(of_training) else { return Vec::new() };
    // Pixels that fewer than two training photos show are not judged.
    let photos: Vec<(&str, f64)> = match &done.score {
        _ if !done.judged.is_empty() => {
            done.judged.iter().map(|(name, psnr)| (&name[..], *psnr)).collect()
        }
        Some(score) => {
            score.images.iter().map(|photo| (&photo.name[..], photo.score.psnr)).collect()
        }
        None => details.held_out.iter().map(|photo| (&photo.name[..], photo.psnr)).collect(),
    };
    // A few photos of what no other shows say little about the scene.
    let half = median(photos.iter().map(|photo| photo.1).collect(), f64::total_cmp).unwrap_or(psnr);
    let size = ShrunkSize::suffix(details.photo_size);
    let count = counted(done.trained_on as u64, "photo");
    let grade = done.score.as_ref().and_then(|score| score.grade);
    let words =
        grade.map_or(String::new(), |grade| format!(": {}, {}", grade.word(), grade.meaning()));
    let mut lines =
        vec![format!("{scores} on photos that training did not see{size}, of {count}{words}")];
    let below: Vec<String> = photos
        .iter()
        .filter(|photo| photo.1 < half - FAR_BELOW)
        .map(|photo| format!("{} ({:.1} dB)", photo.0, photo.1))
        .collect();
    if !below.is_empty() {
        let named = below.iter().take(5).cloned().collect::<Vec<_>>().join(", ");
        lines.push(format!(
            "far below the others: {named}: blurred, moved, with a wrong pose, or seen by no other photo"
        ));
    }
    let helps = done.earlier.is_none_or(|earlier| psnr >= earlier + MIN_GAIN);
    if grade != Some(Grade::Good) {
        lines.extend(next(details, &photos, helps, args.steps, args.budget));
    }
    lines
}

/// Advice for a better scene: more time, if it was used up and time `helps`, and photos of the
/// worst views.
fn next(
    details: &TrainDetails,
    photos: &[(&str, f64)],
    helps: bool,
    steps: Option<u64>,
    budget: Seconds,
) -> Option<String> {
    let spent = |budget: &BudgetDetails| budget.spent_secs >= USED_UP * budget.budget.seconds.0;
    let time = match steps {
        Some(steps) => Some(format!("--steps {}", 2 * steps)),
        // A part of the budget is left if more steps gain nothing.
        None => details
            .budget
            .as_ref()
            .is_none_or(spent)
            .then(|| format!("--budget {}", Seconds(2.0 * budget.0))),
    };
    let mut worst = photos.to_vec();
    worst.sort_by(|a, b| a.1.total_cmp(&b.1).then_with(|| a.0.cmp(b.0)));
    let worst: Vec<String> =
        worst.iter().take(WORST).map(|(name, psnr)| format!("{name} ({psnr:.1} dB)")).collect();
    let time = time.filter(|_| helps);
    let photos =
        (!worst.is_empty()).then(|| format!("more photos of what {} shows", worst.join(" or ")));
    let ways: Vec<String> =
        time.map(|time| format!("more time ({time} --force)")).into_iter().chain(photos).collect();
    (!ways.is_empty()).then(|| format!("next: {}", ways.join(", or ")))
}

/// Use of the budget, as a part begins.
fn announced(part: MakePart, budget: Seconds) -> Option<String> {
    match part {
        MakePart::Capture => {
            let threads = parallel::threads();
            let time = HumanDuration(Duration::from_secs_f64(budget.0 / threads as f64));
            Some(format!(
                "camera poses are found first; the {budget} of --budget are for training and bake, and begin after that: {time} on {}",
                counted(threads as u64, "thread")
            ))
        }
        MakePart::Train => Some(format!(
            "of the {budget} of --budget, most are for training and the rest for the bake"
        )),
        MakePart::Subject => Some("the subject alone, as a file of its own".to_owned()),
        MakePart::Bake => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_verdict_names_what_to_do_next() {
        let photos = [("a.jpg", 26.0), ("b.jpg", 18.0), ("c.jpg", 21.0)];
        let next =
            |helps, steps| next(&TrainDetails::default(), &photos, helps, steps, Seconds(90.0));
        let said = next(true, None).unwrap_or_default();
        let wants = "next: more time (--budget 3m --force), or more photos of what b.jpg (18.0 dB) or c.jpg (21.0 dB) shows";
        assert_eq!(said, wants);
        let said = next(true, Some(500)).unwrap_or_default();
        assert!(said.contains("(--steps 1000 --force)"), "{said}");
        let said = next(false, None).unwrap_or_default();
        assert!(
            said.starts_with("next: more photos of what b.jpg"),
            "time did not help before: {said}"
        );
    }
}
