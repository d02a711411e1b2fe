//! Work that was done, and work that was skipped because it would have changed nothing or too little.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::ops::AddAssign;

/// Amounts of done and skipped work.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct WorkCount {
    /// Units done.
    pub done: u64,
    /// Units left out.
    pub skipped: u64,
}

impl WorkCount {
    /// `done` of `all` units.
    pub fn of(done: u64, all: u64) -> Self {
        Self { done, skipped: all.saturating_sub(done) }
    }

    /// Recounts `units` from skipped to done.
    pub fn turned_out_done(&mut self, units: u64) {
        self.done += units;
        self.skipped = self.skipped.saturating_sub(units);
    }

    /// The skipped share, from 0 to 1; 0 without any work.
    pub fn share(&self) -> f64 {
        self.skipped as f64 / (self.done + self.skipped).max(1) as f64
    }

    /// The skipped share as text, for example "pixels=61%"; `None` below half a percent.
    pub fn label(&self, name: &str) -> Option<String> {
        let percent = (100.0 * self.share()).round();
        (percent > 0.0).then(|| format!("{name}={percent}%"))
    }
}

impl AddAssign for WorkCount {
    fn add_assign(&mut self, other: Self) {
        self.done += other.done;
        self.skipped += other.skipped;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_of_all_that_there_was() {
        let mut work = WorkCount::of(30, 100);
        work += WorkCount::of(10, 60);
        assert_eq!(work, WorkCount { done: 40, skipped: 120 });
        assert_eq!(work.share(), 0.75);
        assert_eq!(work.label("pixels").as_deref(), Some("pixels=75%"));
        work.turned_out_done(20);
        assert_eq!(work, WorkCount { done: 60, skipped: 100 });
        assert_eq!(WorkCount::default().label("pixels"), None);
    }
}
