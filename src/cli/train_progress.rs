//! The terminal output of a training: a bar on a TTY, the log, and Ctrl-C.

use super::GlobalArgs;
use super::messages::{Stdout, many};
use super::pace::Pace;
use super::progress::Lines;
use super::signals::Listener;
use indicatif::{ProgressBar, ProgressStyle};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use trisplat_dataset::ShrunkSize;
use trisplat_job::Event;
use trisplat_scene::{Error, Result};
use trisplat_train::budget::Correction;
use trisplat_train::{Densified, TrainSample, Trained};

/// Shows PSNR, triangles and time left; writes the log; stops on Ctrl-C.
pub struct TrainProgress {
    lines: Lines,
    log: Option<(PathBuf, Box<dyn Write>)>,
    /// Outputs that could not be written, with their errors.
    pub lost: Vec<String>,
    /// From here on a request to stop is for the training.
    stop: Option<Listener>,
    /// PSNR on photos left out of the training, and the size to which they were shrunk, if they
    /// were.
    held_out: Option<(f64, Option<ShrunkSize>)>,
    /// Steps of the whole run.
    steps: u64,
    /// The last percentage that was printed; `None` with a bar, and unless verbose.
    percent: Option<u64>,
    /// Lines without a bar, unless verbose.
    pace: Pace,
    /// Steps made when the measurement of the rate began; `None` once the rate was printed.
    pub rate_from: Option<u64>,
}

/// Seconds over which the rate of the first steps is measured.
const RATE_SECS: f64 = 3.0;

impl TrainProgress {
    /// Progress over `steps`, with `done` made already. A log file begins with the samples of the
    /// resumed run, `earlier_samples`.
    pub fn new(
        global: &GlobalArgs,
        steps: u64,
        done: u64,
        log: Option<&Path>,
        earlier_samples: &[TrainSample],
    ) -> Result<Self> {
        let lines = Lines::new(global, || {
            let bar = ProgressBar::new(steps).with_position(done);
            let style = ProgressStyle::with_template("{bar:30} {pos}/{len}  {msg}  {eta} left");
            if let Ok(style) = style {
                bar.set_style(style);
            }
            bar
        });
        let log = log.map(|path| open_log(path, earlier_samples)).transpose()?;
        let percent = (lines.verbose && lines.bar.is_none()).then(|| percent(done, steps));
        let pace = Pace::new(done as f64 / steps.max(1) as f64);
        let stop = Some(Listener::new());
        let lost = Vec::new();
        let held_out = None;
        let rate_from = None;
        Ok(Self { lines, log, lost, stop, held_out, steps, percent, pace, rate_from })
    }

    /// Prints a line above the bar; nothing when quiet.
    pub fn line(&self, text: &str) {
        self.lines.print(text);
    }

    /// Removes the bar and returns outputs that could not be written. From here on the first Ctrl-C
    /// ends the program.
    pub fn finish(&mut self) -> Vec<String> {
        self.stop = None;
        self.lines.clear();
        std::mem::take(&mut self.lost)
    }

    /// Names the card, and prints the notes on the start.
    pub fn announce<'a>(&self, card: Option<&str>, warnings: impl IntoIterator<Item = &'a String>) {
        if let Some(card) = card {
            self.line(&format!("training on {card}"));
        }
        for warning in warnings {
            self.line(&format!("warning: {warning}"));
        }
    }

    /// Removes the bar; returns whether the training of `what` was stopped.
    ///
    /// # Errors
    ///
    /// A stop without a checkpoint.
    pub fn is_stopped(&mut self, what: &str, trained: &Trained) -> Result<bool> {
        let lost = self.finish().join("; ");
        match &trained.checkpoint {
            _ if !trained.stopped => Ok(false),
            Some(checkpoint) => {
                self.line(&format!(
                    "stopped at {}; the same command continues",
                    checkpoint.display()
                ));
                Ok(true)
            }
            None => {
                Err(Error::Incomplete(format!("{what} was stopped without a checkpoint: {lost}")))
            }
        }
    }

    /// Warns that something was not written.
    pub fn note_lost(&mut self, error: &Error, what: &str) {
        self.line(&format!("warning: {error}; {what}"));
        self.lost.push(error.to_string());
    }
}

/// Progress of the run, rounded down.
fn percent(step: u64, steps: u64) -> u64 {
    100 * step / steps.max(1)
}

fn open_log(path: &Path, earlier_samples: &[TrainSample]) -> Result<(PathBuf, Box<dyn Write>)> {
    if path.as_os_str() == "-" {
        return Ok((path.to_owned(), Box::new(Stdout)));
    }
    let io = |e| Error::io(path, e);
    let mut file = BufWriter::new(File::create(path).map_err(io)?);
    for sample in earlier_samples {
        write_line(&mut file, sample).map_err(io)?;
    }
    Ok((path.to_owned(), Box::new(file)))
}

/// One line of the log.
fn write_line(log: &mut dyn Write, sample: &TrainSample) -> std::io::Result<()> {
    serde_json::to_writer(&mut *log, sample)?;
    writeln!(log)?;
    log.flush()
}

impl TrainProgress {
    /// Shows an event of the training; `Break` after a request to stop.
    pub fn show(&mut self, event: Event<'_>) -> ControlFlow<()> {
        match event {
            Event::Step { sample, .. } => self.show_step(sample),
            Event::CurveSample(sample) => self.record_sample(sample),
            Event::Densified(step, densified) => self.show_densification(step, densified),
            Event::StepsReplanned(correction) => self.show_correction(correction),
            Event::WriteFailed(error) => self.note_lost(error, "the training continues"),
            _ => {}
        }
        if self.stop.as_ref().is_some_and(Listener::is_asked) {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    }

    fn show_step(&mut self, sample: &TrainSample) {
        if let Some(from) = self.rate_from.filter(|_| sample.wall_secs >= RATE_SECS) {
            self.rate_from = None;
            let rate = (sample.step - from) as f64 / sample.wall_secs;
            let sizes = format!(
                "{}, photos {} px wide",
                many(sample.triangles, "triangle"),
                sample.width_px
            );
            self.line(&format!("{rate:.1} steps per second at first ({sizes})"));
        }
        let triangles = many(sample.triangles, "triangle");
        let held_out = |(p, size)| format!(" ({p:.2} held out{})", ShrunkSize::suffix(size));
        let held_out = self.held_out.map_or(String::new(), held_out);
        let status = || format!("{:.2} dB{held_out}  {triangles}", sample.psnr);
        let now = percent(sample.step, self.steps);
        if let Some(bar) = &self.lines.bar {
            bar.set_position(sample.step);
            bar.set_message(status());
        } else if self.percent.is_some_and(|before| now > before) {
            self.percent = Some(now);
            self.line(&format!("{now:>3}%  step {}/{}  {}", sample.step, self.steps, status()));
        } else if self.percent.is_none()
            && let Some(text) = self.pace.due(sample.step as f64 / self.steps.max(1) as f64)
        {
            self.line(&format!("step {}/{}  {}  {text}", sample.step, self.steps, status()));
        }
    }

    fn record_sample(&mut self, sample: &TrainSample) {
        self.held_out = sample.test_psnr.map(|psnr| (psnr, sample.test_size)).or(self.held_out);
        if let Some((path, log)) = &mut self.log
            && let Err(e) = write_line(log, sample)
        {
            // One warning is enough, and a log's first half is worth more than one with holes.
            let error = Error::io(&*path, e);
            self.log = None;
            self.note_lost(&error, "the training continues without a log");
        }
    }

    fn show_densification(&mut self, step: u64, densified: &Densified) {
        if self.lines.verbose {
            self.line(&format!(
                "step {step}: {}; +{} cloned, +{} split, -{} faint, -{} unimportant, -{} unseen, -{} unsupported, -{} blocking, +{} filled",
                many(densified.triangles as u64, "triangle"),
                densified.cloned,
                3 * densified.split,
                densified.faint,
                densified.unimportant,
                densified.unseen,
                densified.unsupported,
                densified.blocking,
                densified.filled
            ));
        }
    }

    fn show_correction(&mut self, correction: &Correction) {
        let Correction { step, spent_secs, steps } = *correction;
        self.steps = steps;
        if let Some(bar) = &self.lines.bar {
            bar.set_length(steps);
        }
        if self.lines.verbose {
            self.line(&format!("step {step}: {spent_secs:.1} s spent, {steps} steps in all"));
        }
    }
}
