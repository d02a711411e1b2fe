//! The terminal output during stages: a spinner on a TTY, a bar for stages that report progress,
//! and the stage table.

use super::messages::{self, many, thousands};
use super::pace::{Pace, time_left};
use super::{GlobalArgs, flags};
use indicatif::{HumanCount, ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::time::{Duration, Instant};
use trisplat_bake::{BackdropDetails, PlaceDetails, TeacherDetails, TextureDetails};
use trisplat_dataset::capture::{
    FeaturesDetails, MatchesDetails, ModelDetails, PhotosDetails, VerdictDetails,
};
use trisplat_dataset::exposure::ExposureEvidence;
use trisplat_job::Event;
use trisplat_scene::report::{Report, StageDetails, StageReport, counted};
use trisplat_train::TrainDetails;

/// Template of a stage without progress.
const SPINNER: &str = "{spinner} {prefix:<10} {elapsed}  {msg}";
/// Template of a stage with progress.
const BAR: &str = "{spinner} {prefix:<10} {bar:30} {percent:>3}%  {msg}";
/// Length of a bar, in units of its position.
const BAR_LENGTH: u64 = 1000;
/// Minimum seconds of a stage that changed nothing, for it to get a line.
const MIN_SKIPPED_SECS: f64 = 0.1;

/// Lines on stderr, above a bar when stderr is a TTY; none with `-q`.
#[derive(Debug)]
pub(super) struct Lines {
    quiet: bool,
    pub(super) verbose: bool,
    pub(super) bar: Option<ProgressBar>,
}

impl Lines {
    pub(super) fn new(global: &GlobalArgs, bar: impl FnOnce() -> ProgressBar) -> Self {
        let bar = (!global.quiet && std::io::stderr().is_terminal()).then(bar);
        Self { quiet: global.quiet, verbose: global.verbose, bar }
    }

    pub(super) fn print(&self, text: &str) {
        match &self.bar {
            _ if self.quiet => {}
            // A finished bar would be drawn again, and stay.
            Some(bar) if !bar.is_finished() => bar.suspend(|| messages::print(text)),
            _ => messages::print(text),
        }
    }

    /// Removes the bar.
    pub(super) fn clear(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// A failed run leaves no bar either.
impl Drop for Lines {
    fn drop(&mut self) {
        self.clear();
    }
}

/// Prints the stage table to stderr; shows a spinner or a bar for the running stage when stderr is
/// a TTY, and otherwise a line now and then.
#[derive(Debug)]
pub struct Progress {
    lines: Lines,
    /// When the running stage started, and its progress if it reports any.
    running: (Instant, Option<f64>),
    /// Name of the running stage.
    name: String,
    pace: Pace,
    /// Spells the fields named in reasons and warnings as flags.
    command: clap::Command,
}

impl Progress {
    /// Follows `-q` and `-v`.
    pub fn new(global: &GlobalArgs) -> Self {
        let lines = Lines::new(global, || {
            let bar = ProgressBar::new(BAR_LENGTH);
            set_template(&bar, SPINNER);
            // The bar's own thread panics where the system has none left.
            if std::thread::Builder::new().spawn(|| {}).is_ok() {
                bar.enable_steady_tick(Duration::from_millis(100));
            }
            bar
        });
        let running = (Instant::now(), None);
        let command = clap::Command::default();
        Self { lines, running, name: String::new(), pace: Pace::new(0.0), command }
    }

    /// Spells the fields named in reasons and warnings as the flags of `command`.
    pub fn with_flags_of(self, command: clap::Command) -> Self {
        Self { command, ..self }
    }

    /// Prints a line, above the bar when there is one; nothing when quiet.
    pub fn line(&self, text: &str) {
        self.lines.print(text);
    }

    /// Runs code that prints on standard output, with the bar hidden.
    pub fn suspend<T>(&self, print: impl FnOnce() -> T) -> T {
        match &self.lines.bar {
            Some(bar) if !bar.is_finished() => bar.suspend(print),
            _ => print(),
        }
    }

    /// Prints a warning of the library.
    pub fn warn(&self, warning: &str) {
        self.line(&format!("warning: {}", flags::as_flags(warning, &self.command)));
    }

    /// Names the files that were written.
    pub fn wrote(&self, report: &Report) {
        let verb = if report.dry_run { "would write" } else { "wrote" };
        for file in &report.outputs {
            let bytes = thousands(file.bytes);
            self.line(&format!("{verb} {} ({bytes} bytes, {:.2} s)", file.path, report.seconds));
        }
    }

    /// Names the card that draws soft pictures, if any, and prints a note.
    pub fn drawing_on(&self, card: Option<&str>, warnings: &[String]) {
        if let Some(card) = card {
            self.line(&format!("drawing soft pictures on {card}"));
        }
        for warning in warnings {
            self.warn(warning);
        }
    }

    /// Shows the present activity beside the spinner.
    pub fn note(&self, text: &str) {
        if let Some(bar) = &self.lines.bar {
            bar.set_message(text.to_owned());
        }
    }

    /// Removes the bar.
    pub fn done(&self) {
        self.lines.clear();
    }
}

impl Progress {
    /// Shows an event of a stage.
    pub fn tell(&mut self, event: Event<'_>) {
        match event {
            Event::StageStarted(name) => self.show_start(name),
            Event::StageProgress(fraction) => self.show_progress(fraction),
            Event::StageNote(text) => self.note(text),
            Event::StageFinished(stage) => self.show_result(stage),
            _ => {}
        }
    }

    /// Shows a stage that starts.
    pub(super) fn show_start(&mut self, name: &str) {
        self.running = (Instant::now(), None);
        name.clone_into(&mut self.name);
        self.pace = Pace::new(0.0);
        if let Some(bar) = &self.lines.bar {
            set_template(bar, SPINNER);
            bar.set_prefix(name.to_owned());
            bar.set_message("");
        }
    }

    /// Shows the share of the running stage that is done.
    pub(super) fn show_progress(&mut self, fraction: f64) {
        let (start, before) = self.running;
        let fraction = fraction.max(before.unwrap_or(0.0));
        self.running.1 = Some(fraction);
        if let Some(bar) = &self.lines.bar {
            if before.is_none() {
                set_template(bar, BAR);
            }
            bar.set_position((fraction * BAR_LENGTH as f64) as u64);
            bar.set_message(time_left(start.elapsed(), fraction, 0.0).unwrap_or_default());
        } else if let Some(text) = self.pace.due(fraction) {
            self.line(&format!("{:<11}{text}", self.name));
        }
    }

    fn show_result(&mut self, stage: &StageReport) {
        if !self.lines.verbose && !is_told(stage) {
            return;
        }
        self.line(&flags::as_flags(&row(stage), &self.command));
        if self.lines.verbose {
            for (key, value) in &stage.details {
                self.line(&format!("           {key}: {value}"));
            }
        }
    }
}

fn set_template(bar: &ProgressBar, template: &str) {
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
}

/// True for a stage with a line: one that changed something, took long, or was requested.
fn is_told(stage: &StageReport) -> bool {
    let is_expected =
        |why: &String| matches!(stage.name.as_str(), "capture" | "train") || why == "done before";
    stage.seconds >= MIN_SKIPPED_SECS || stage.skipped.as_ref().is_none_or(is_expected)
}

/// One row of the stage table: `prune      2,012,345 → 1,720,011  (-14.5%)   0.04 s`.
fn row(stage: &StageReport) -> String {
    let name = &stage.name;
    if let Some(train) = stage.details_as::<TrainDetails>() {
        let reason = stage.skipped.as_ref().map_or(String::new(), |why| format!(" ({why})"));
        let triangles = many(stage.after.triangles, "triangle");
        let steps = counted(train.steps, "step");
        let text = format!("{triangles}, {steps}, {:.0} CPU s{reason}", train.cpu_secs);
        return format!("{name:<11}{text:<55} {:>8.2} s", stage.seconds);
    }
    if let Some(why) = &stage.skipped {
        let took = if stage.seconds >= MIN_SKIPPED_SECS {
            format!(" ({:.2} s)", stage.seconds)
        } else {
            String::new()
        };
        return format!("{name:<11}not needed: {why}{took}");
    }
    if let Some(basis) = stage.details_as::<PlaceDetails>().and_then(|place| place.basis()) {
        return format!("{name:<11}{basis:<36}{:>8.2} s", stage.seconds);
    }
    if let Some(text) = capture_row(stage) {
        return format!("{name:<11}{text:<55} {:>8.2} s", stage.seconds);
    }
    if let Some(evidence) = stage.details_as::<ExposureEvidence>() {
        let text = format!("{} left out of short trainings", counted(evidence.photos, "photo"));
        return format!("{name:<11}{text:<36}{:>8.2} s", stage.seconds);
    }
    let before = stage.before.triangles;
    let after = stage.after.triangles;
    let with_pictures =
        stage.details_as::<TeacherDetails>().filter(|teacher| teacher.pictures.is_some());
    let counts = if let Some(teacher) = with_pictures {
        pictures(&teacher)
    } else if name == TeacherDetails::STAGE && before != after {
        // A training; its first triangles say nothing.
        format!("a soft scene of {}", many(after, "triangle"))
    } else if let Some(compared) =
        stage.details_as::<TextureDetails>().and_then(|texture| texture.comparison())
    {
        format!("{}, {compared}", many(after, "triangle"))
    } else if name == BackdropDetails::STAGE && after >= before {
        format!("{} behind {}", many(after - before, "triangle"), thousands(before))
    } else if before == after || before == 0 {
        many(after, "triangle")
    } else {
        let change = 100.0 * (after as f64 - before as f64) / before as f64;
        format!("{} → {} ({change:+.1}%)", thousands(before), thousands(after))
    };
    format!("{name:<11}{counts:<36}{:>8.2} s", stage.seconds)
}

/// The teacher's pictures: `106 pictures of 270x480 px`.
fn pictures(details: &TeacherDetails) -> String {
    let count = many(details.pictures.unwrap_or(0), "picture");
    let [width, height] = details.size_px.unwrap_or_default();
    format!("{count} of {width}x{height} px")
}

// ---- The rows of the stage table for the steps of a capture -------------------------------------

/// The middle of the row of a step; `None` for other stages.
fn capture_row(stage: &StageReport) -> Option<String> {
    if let Some(details) = stage.details_as::<PhotosDetails>() {
        return Some(photos(&details));
    }
    if let Some(FeaturesDetails { program, focal_px }) = stage.details_as() {
        let focal = focal_px
            .map_or(String::new(), |f| format!(", focal length {f:.0} px by the photos' notes"));
        return Some(format!("{program}{focal}"));
    }
    if let Some(MatchesDetails { how, pairs }) = stage.details_as() {
        return Some(pairs.map_or(how.clone(), |pairs| format!("{}, {how}", many(pairs, "pair"))));
    }
    if let Some(ModelDetails { mapper, registered, photos, models, straight, .. }) =
        stage.details_as()
    {
        let parts = if models > 1 { format!(", in {models} parts") } else { String::new() };
        let lens = if straight { ", lens without distortion" } else { "" };
        return Some(format!(
            "{registered} of {photos} photos have a pose{parts} ({mapper}{lens})"
        ));
    }
    stage.details_as::<VerdictDetails>().map(|details| verdict(&details))
}

fn photos(details: &PhotosDetails) -> String {
    let PhotosDetails { photos, frames, video_frames, turned, converted, cameras, .. } = *details;
    let mut text = match frames {
        0 => counted(photos, "photo"),
        _ if photos == frames => format!("{frames} of {} frames", HumanCount(video_frames)),
        _ => {
            let stills = photos - frames;
            format!("{}, {frames} of {} frames", counted(stills, "photo"), HumanCount(video_frames))
        }
    };
    for (number, what) in [(turned, "turned upright"), (converted, "converted")] {
        if number > 0 {
            text += &format!(", {number} {what}");
        }
    }
    if cameras > 1 {
        text += &format!(", {cameras} cameras");
    }
    text
}

fn verdict(details: &VerdictDetails) -> String {
    let error = details.error_px.map_or(String::new(), |error| format!(", {error:.2} px"));
    let points = many(details.points, "point");
    let track = details.track_length;
    format!("{}: {points}, each in {track:.1} photos{error}", details.verdict.word())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_happened_is_told_and_what_was_tried() {
        let skipped = |name: &str, why: &str, seconds: f64| StageReport {
            seconds,
            ..StageReport::skipped(name, why.to_owned())
        };
        assert!(!is_told(&skipped("lod", "`lod` was not given", 0.0)));
        let tried = skipped("reshape", "the input triangles match the pictures better", 7.0);
        assert!(is_told(&tried) && row(&tried).ends_with("better (7.00 s)"), "{}", row(&tried));
        assert!(is_told(&skipped("train", "the input is a mesh", 0.0)));
        assert!(is_told(&StageReport { skipped: None, ..skipped("place", "", 0.0) }));
    }

    #[test]
    fn a_backdrop_does_not_look_like_a_scene_that_grew() {
        let counts =
            |triangles| trisplat_scene::report::Counts { triangles, vertices: 3 * triangles };
        let backdrop = StageReport {
            before: counts(8954),
            after: counts(11_002),
            skipped: None,
            ..StageReport::skipped("backdrop", String::new())
        };
        assert!(row(&backdrop).contains("2,048 triangles behind 8,954"), "{}", row(&backdrop));
    }

    #[test]
    fn the_parts_of_a_training_are_rows_that_a_person_understands() {
        let counts =
            |triangles| trisplat_scene::report::Counts { triangles, vertices: 3 * triangles };
        let done =
            |name: &str| StageReport { skipped: None, ..StageReport::skipped(name, String::new()) };
        let evidence = ExposureEvidence { photos: 1, ..ExposureEvidence::default() };
        let details = trisplat_scene::report::to_json(&evidence);
        let evidence = row(&StageReport { details, ..done(ExposureEvidence::STAGE) });
        assert!(evidence.contains("1 photo left out of short trainings"), "{evidence}");
        let teacher =
            row(&StageReport { before: counts(4803), after: counts(15_438), ..done("teacher") });
        assert!(
            teacher.contains("a soft scene of 15,438 triangles") && !teacher.contains('%'),
            "{teacher}"
        );
    }

    #[test]
    fn the_row_of_a_texture_says_what_held_out_photos_found() {
        let details = TextureDetails {
            psnr_before: Some(25.0),
            psnr_after: Some(24.8),
            ssim_before: Some(0.7),
            ssim_after: Some(0.75),
            ..TextureDetails::default()
        };
        let details = trisplat_scene::report::to_json(&details);
        let stage = StageReport {
            details,
            skipped: None,
            ..StageReport::skipped("texture", String::new())
        };
        assert!(
            row(&stage).contains("25.0 → 24.8 dB, SSIM 0.700 → 0.750 on held-out photos"),
            "{}",
            row(&stage)
        );
    }

    #[test]
    fn a_bar_never_goes_back() {
        let mut progress = Progress::new(&GlobalArgs { quiet: true, ..GlobalArgs::default() });
        progress.show_start("refit");
        for fraction in [0.1, 0.4, 0.3] {
            progress.show_progress(fraction);
        }
        assert_eq!(progress.running.1, Some(0.4));
        progress.show_start("lod");
        assert_eq!(progress.running.1, None);
    }

    #[test]
    fn thousands_are_grouped() {
        assert_eq!(thousands(0), "0");
        assert_eq!(thousands(999), "999");
        assert_eq!(thousands(1000), "1,000");
        assert_eq!(thousands(1_234_567), "1,234,567");
        assert_eq!([0, 1, 1000].map(|n| many(n, "photo")), ["0 photos", "1 photo", "1,000 photos"]);
    }
}
