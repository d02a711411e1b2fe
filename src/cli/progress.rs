//! What the terminal shows while stages run: a spinner on a TTY, and the stage table.

use super::{Global, flags};
use crate::bake::teacher::TeacherDetails;
use crate::report::{Observer, StageReport};
use indicatif::{HumanCount, ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::time::Duration;

/// Prints the stage table to stderr; shows a spinner for the running stage when stderr is a TTY.
#[derive(Debug)]
pub struct Progress {
    quiet: bool,
    verbose: bool,
    spinner: Option<ProgressBar>,
    /// Spells the fields named in reasons and warnings as flags.
    command: clap::Command,
}

impl Progress {
    /// Follows `-q` and `-v`.
    pub fn new(global: &Global) -> Self {
        let spinner = (!global.quiet && std::io::stderr().is_terminal()).then(|| {
            let bar = ProgressBar::new_spinner();
            if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} {elapsed}") {
                bar.set_style(style);
            }
            bar.enable_steady_tick(Duration::from_millis(100));
            bar
        });
        Self { quiet: global.quiet, verbose: global.verbose, spinner, command: clap::Command::default() }
    }

    /// Spells the fields named in reasons and warnings as the flags of `command`.
    pub fn with_flags_of(self, command: clap::Command) -> Self {
        Self { command, ..self }
    }

    /// Prints a line, above the spinner when there is one; nothing when quiet.
    pub fn line(&self, text: &str) {
        match &self.spinner {
            _ if self.quiet => {}
            Some(bar) => bar.suspend(|| eprintln!("{text}")),
            None => eprintln!("{text}"),
        }
    }

    /// Prints a warning of the library.
    pub fn warn(&self, warning: &str) {
        self.line(&format!("warning: {}", flags::spell(warning, &self.command)));
    }

    /// Shows beside the spinner what is being done.
    pub fn note(&self, text: &str) {
        if let Some(bar) = &self.spinner {
            bar.set_message(text.to_owned());
        }
    }

    /// Removes the spinner.
    pub fn done(&self) {
        if let Some(bar) = &self.spinner {
            bar.finish_and_clear();
        }
    }
}

impl Observer for Progress {
    fn started(&mut self, name: &str) {
        if let Some(bar) = &self.spinner {
            bar.set_message(name.to_owned());
        }
    }

    fn finished(&mut self, stage: &StageReport) {
        self.line(&flags::spell(&row(stage), &self.command));
        if self.verbose {
            for (key, value) in &stage.details {
                self.line(&format!("           {key}: {value}"));
            }
        }
    }
}

/// One row of the stage table: `prune      2,012,345 → 1,720,011  (-14.5%)   0.04 s`.
fn row(stage: &StageReport) -> String {
    let name = &stage.name;
    if let Some(why) = &stage.unneeded {
        return format!("{name:<11}not needed: {why}");
    }
    let (before, after) = (stage.before.triangles, stage.after.triangles);
    let counts = if let Some(teacher) = stage.details_as::<TeacherDetails>() {
        pictures(&teacher)
    } else if before == after || before == 0 {
        format!("{} triangles", thousands(after))
    } else {
        let change = 100.0 * (after as f64 - before as f64) / before as f64;
        format!("{} → {} ({change:+.1}%)", thousands(before), thousands(after))
    };
    format!("{name:<11}{counts:<36}{:>8.2} s", stage.seconds)
}

/// What the teacher drew: `106 pictures of 270x480 px`.
fn pictures(details: &TeacherDetails) -> String {
    let count = thousands(details.pictures.unwrap_or(0));
    let [width, height] = details.size_px.unwrap_or_default();
    format!("{count} pictures of {width}x{height} px")
}

/// 1234567 as "1,234,567", to be padded like any text.
pub fn thousands(number: u64) -> String {
    HumanCount(number).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thousands_are_grouped() {
        assert_eq!(thousands(0), "0");
        assert_eq!(thousands(999), "999");
        assert_eq!(thousands(1000), "1,000");
        assert_eq!(thousands(1_234_567), "1,234,567");
    }
}
