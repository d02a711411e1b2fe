//! `trisplat capture INPUT -o FOLDER`: photos or a video become a data set with poses.

use super::inputs::Inputs;
use super::outputs::Outputs;
use super::progress::Progress;
use super::terminal::Terminal;
use super::{GlobalArgs, flags, signals};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;
use trisplat_dataset::capture::{Capture, CaptureOptions, VerdictDetails};
use trisplat_job::MakePart;
use trisplat_scene::Result;
use trisplat_scene::report::Report;

/// Photos or videos, and the folder to make of them.
#[derive(Debug, clap::Args)]
pub struct CaptureArgs {
    /// Photos, a video, or folders of them: .jpg .png .webp .tif, .mp4 .mov .mkv and others
    #[arg(required = true, value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// Folder to make: images/, sparse/0/, and capture/ with the log and the files of the pose
    /// program
    #[arg(short, long, value_name = "FOLDER")]
    pub output: PathBuf,
    /// Set a capture of other inputs that FOLDER holds aside, as FOLDER.old
    #[arg(short, long)]
    pub force: bool,
    /// Write the steps and the verdict as JSON (schema: trisplat schema report)
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Capture options.
    #[command(flatten)]
    pub options: CaptureOptions,
}

/// Makes the data set.
pub fn run(args: &CaptureArgs, global: &GlobalArgs, inputs: &Inputs) -> Result<ExitCode> {
    let clock = Instant::now();
    let mut outputs = Outputs::new(inputs, args.force);
    outputs.reserve_report(args.report.as_deref())?;
    let mut job = Capture::new(args.inputs.iter().cloned(), args.output.clone());
    job.options = args.options.clone();
    job.force = args.force;

    let mut report = Report::new("capture");
    report.options = serde_json::to_value(&args.options).unwrap_or_default();
    let mut terminal = Terminal::new(global, flags::command_of::<CaptureArgs>("capture"));
    terminal.begin_part(MakePart::Capture);
    let verdict = job.run(&mut report, &mut |event| terminal.tell_stage(event.into()))?;
    let progress = &terminal.done();
    report.seconds = clock.elapsed().as_secs_f64();
    for warning in &report.warnings {
        progress.warn(warning);
    }
    let folder = args.output.display();
    let Some(verdict) = verdict else {
        progress.line("stopped; the same command goes on from here");
        return Ok(signals::ended());
    };
    advise(&verdict, progress);
    progress.line(&format!(
        "wrote {folder} ({:.0} s); next: trisplat train {folder} -o scene.ply",
        report.seconds
    ));
    outputs.save_report(args.report.as_deref(), &report).map(|()| ExitCode::SUCCESS)
}

/// Prints what to do about a capture.
pub(super) fn advise(verdict: &VerdictDetails, progress: &Progress) {
    for advice in &verdict.advice {
        progress.line(&format!("           {advice}"));
    }
}
