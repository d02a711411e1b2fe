//! The progress of a job: lines of JSON on standard output, one object each, with one key that names its
//! kind.

use serde::Serialize;
use serde_json::json;
use std::io::{self, Write};
use trisplat_job::Event;
use trisplat_scene::report::StageEvent;
use trisplat_train::TrainEvent;

/// Smallest reported change of a fraction.
const STEP: f64 = 0.01;

/// Prints one line; failures are ignored.
pub(super) fn say(key: &str, value: impl Serialize) {
    let line = json!({ key: value }).to_string() + "\n";
    let mut out = io::stdout().lock();
    let _ = out.write_all(line.as_bytes()).and_then(|()| out.flush());
}

/// Reports stages and their progress.
#[derive(Debug, Default)]
pub(super) struct Lines {
    told: f64,
    /// Steps of the training.
    steps: u64,
}

impl Lines {
    fn at(&mut self, fraction: f64) {
        if fraction < self.told || fraction >= self.told + STEP {
            self.told = fraction;
            say("fraction", fraction);
        }
    }
}

impl Lines {
    /// Prints what is new.
    pub(super) fn tell(&mut self, event: &Event<'_>) {
        match event {
            Event::Stage(StageEvent::Started(name)) => self.start(name),
            Event::Stage(StageEvent::Progressed(fraction)) => self.at(*fraction),
            Event::Stage(StageEvent::Finished(stage)) => say("finished", stage),
            Event::Begins(begins) => {
                self.start("train");
                self.steps = begins.steps;
            }
            Event::Train(_, TrainEvent::Step { sample, .. }) => {
                self.at(sample.step as f64 / self.steps.max(1) as f64);
            }
            Event::Drew { done, all } => self.at(*done as f64 / (*all).max(1) as f64),
            _ => {}
        }
    }

    fn start(&mut self, name: &str) {
        self.told = 0.0;
        say("stage", name);
    }
}
