//! The progress of a job: lines of JSON on standard output, one object each, with one key that names its
//! kind.

use serde::Serialize;
use serde_json::json;
use std::io::{self, Write};
use trisplat_job::BakeJobObserver;
use trisplat_scene::{
    Result,
    report::{Observer, StageReport},
};
use trisplat_train::{TrainObserver, TrainOptions, TrainSample};

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
}

impl Lines {
    fn at(&mut self, fraction: f64) {
        if fraction < self.told || fraction >= self.told + STEP {
            self.told = fraction;
            say("fraction", fraction);
        }
    }
}

impl Observer for Lines {
    fn started(&mut self, name: &str) {
        self.told = 0.0;
        say("stage", name);
    }

    fn progressed(&mut self, fraction: f64) {
        self.at(fraction);
    }

    fn finished(&mut self, stage: &StageReport) {
        say("finished", stage);
    }
}

impl BakeJobObserver for Lines {
    fn hardening_begins(&mut self, options: &TrainOptions) -> Result<Box<dyn TrainObserver + '_>> {
        self.started("train");
        Ok(Box::new(Steps { lines: self, all: options.steps }))
    }

    fn drew(&mut self, done: usize, all: usize) {
        self.at(done as f64 / all.max(1) as f64);
    }
}

/// The steps of a training.
struct Steps<'a> {
    lines: &'a mut Lines,
    all: u64,
}

impl TrainObserver for Steps<'_> {
    fn stepped(&mut self, sample: &TrainSample) {
        self.lines.at(sample.step as f64 / self.all.max(1) as f64);
    }
}
