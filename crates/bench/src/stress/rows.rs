//! The report of the stress test.

use super::axes::Axis;
use super::case::StressCase;
use super::promises::{On, Promise};
use crate::machine::Machine;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What `trisplat bench stress --json` prints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StressReport {
    /// Where it was measured.
    #[serde(flatten)]
    pub machine: Machine,
    /// First seed of the cases.
    pub seed: u64,
    /// Number of seeds.
    pub seeds: u64,
    /// Random cases.
    pub cases: u64,
    /// Seconds from start to end.
    pub wall_seconds: f64,
    /// Seconds of the ordinary case, the soft rasteriser forward and backward.
    pub ordinary_seconds: f64,
    /// What was measured where.
    pub rows: Vec<StressRow>,
    /// What must not change a picture, and by how much it does.
    pub invariances: Vec<InvarianceRow>,
    /// The promises, and what was found.
    pub promises: Vec<PromiseResult>,
}

/// Cases of one part of the axes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StressRow {
    /// Which.
    #[serde(flatten)]
    pub part: Part,
    /// Cases.
    pub cases: u64,
    /// Cases with visible triangles.
    pub drawn: u64,
    /// Pixels too near to a jump to be compared, of 1.
    pub undecided: f64,
    /// Errors of values.
    pub value: ErrorSummary,
    /// Errors of gradients.
    pub gradient: ErrorSummary,
    /// Numbers that are not finite.
    pub non_finite: u64,
    /// Wrong samples of the solid rasteriser.
    pub solid_wrong: u64,
    /// Median time over that of the ordinary case.
    pub time_ratio: f64,
}

/// A part of the axes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", tag = "part")]
pub enum Part {
    /// One axis is stretched alone, from here to there.
    Single {
        /// The axis.
        axis: Axis,
        /// Smallest value.
        from: f64,
        /// Largest value.
        to: f64,
    },
    /// Two axes are stretched to their ends.
    Pair {
        /// One axis.
        axis: Axis,
        /// The other.
        with: Axis,
    },
    /// The ranges on which the promises of accuracy hold.
    Domain,
}

/// Quantiles of errors.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ErrorSummary {
    /// How many errors.
    pub count: u64,
    /// Median.
    pub p50: f64,
    /// 99.9% are at most this.
    pub p999: f64,
    /// The largest.
    pub max: f64,
}

/// A change that must not change a picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct InvarianceRow {
    /// What is changed: "rotation", "threads".
    pub name: String,
    /// Scenes drawn both ways.
    pub cases: u64,
    /// Differences of the values of soft frames.
    pub value: ErrorSummary,
    /// Samples on which the solid rasteriser shows another face, of 1.
    pub solid_changed: f64,
    /// Largest 99.9% quantile of `value` that keeps the promise.
    pub at_most: f64,
    /// Whether it is kept.
    pub kept: bool,
}

/// A promise, and what was found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PromiseResult {
    /// Its name.
    pub name: String,
    /// Which.
    pub promise: Promise,
    /// On which cases.
    pub on: On,
    /// The largest value that is no failure.
    pub at_most: f64,
    /// The value found: of `frames` and `gradients` what 99.9% of the numbers do not exceed, else the worst.
    pub found: f64,
    /// What it was asked of: cases, of `frames` and `gradients` numbers.
    pub of: u64,
    /// How many of these failed.
    pub failures: u64,
    /// The share that may fail.
    pub rate_at_most: f64,
    /// The share that fails is below this, by what was counted (95%).
    pub rate_below: f64,
    /// Whether it is kept: the failures do not prove (99.9%) a larger share than may fail.
    pub kept: bool,
    /// The case that is worst.
    pub worst: Option<StressCase>,
}
