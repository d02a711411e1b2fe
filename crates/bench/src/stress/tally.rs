//! Sums over cases: quantiles for every part of the axes, and the worst case of every promise.

use super::axes::{AXES, Axis};
use super::case::{StressCase, Stretch};
use super::histogram::Histogram;
use super::promises::{On, PROMISES, Promise, REACH};
use super::rig::{Outcome, Rig, layers_over_ordinary};
use super::rows::{ErrorSummary, Part, StressRow};

/// Parts that an axis is divided into when it is stretched alone.
pub(super) const PARTS: usize = 8;
/// Slowest cases that are timed again.
const SLOWEST: usize = 16;
const AXIS_COUNT: usize = AXES.len();
const SINGLES: usize = AXIS_COUNT * PARTS;
const PAIRS: usize = AXIS_COUNT * AXIS_COUNT;

/// Sums over the cases of one part.
#[derive(Debug, Clone, Default)]
pub(super) struct PartSums {
    cases: u64,
    drawn: u64,
    undecided: u64,
    non_finite: u64,
    solid_wrong: u64,
    pub(super) value: Histogram,
    pub(super) gradient: Histogram,
    seconds: Histogram,
}

/// The largest number and its case; of equals that of the lowest index.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Worst {
    pub(super) found: f64,
    index: u64,
    pub(super) case: Option<StressCase>,
}

/// What is looked at in some cases only: their files, and bakes of them.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Kept {
    /// Error of positions in a file, half steps.
    pub(super) stored: f64,
    /// Triangles that a bake loses.
    pub(super) lost: f64,
    /// Numbers of a bake that are not finite.
    pub(super) non_finite: f64,
}

impl Kept {
    /// What a promise is about; `None` of others.
    pub(super) fn of(&self, promise: Promise) -> Option<f64> {
        match promise {
            Promise::StoredPositions => Some(self.stored),
            Promise::BakedTriangles => Some(self.lost),
            Promise::BakedNonFinite => Some(self.non_finite),
            _ => None,
        }
    }
}

/// What a promise was asked of, and how many of these failed.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Failures {
    pub(super) of: u64,
    pub(super) failures: u64,
}

impl Failures {
    fn count(&mut self, values: impl Iterator<Item = f64>, at_most: f64) {
        for value in values {
            self.of += 1;
            self.failures += u64::from(!(value <= at_most));
        }
    }
}

/// Sums over all cases.
#[derive(Debug)]
pub(super) struct Tally {
    parts: Vec<PartSums>,
    worst: Vec<Worst>,
    counts: Vec<Failures>,
    /// The slowest cases for their layers, most first.
    pub(super) slowest: Vec<Worst>,
}

impl Default for Tally {
    fn default() -> Self {
        Self {
            parts: vec![PartSums::default(); SINGLES + PAIRS + 1],
            worst: vec![Worst::default(); PROMISES.len()],
            counts: vec![Failures::default(); PROMISES.len()],
            slowest: Vec::new(),
        }
    }
}

impl Worst {
    pub(super) fn add(&mut self, found: f64, index: u64, case: &StressCase) {
        let first = self.case.is_none() || (found == self.found && index < self.index);
        if found > self.found || (first && found > 0.0) {
            *self = Self { found, index, case: Some(case.clone()) };
        }
    }

    fn merge(&mut self, other: &Self) {
        if let Some(case) = &other.case {
            self.add(other.found, other.index, case);
        }
    }
}

/// The row of an axis stretched alone.
fn single(axis: Axis, value: f64) -> usize {
    let row = axis.row();
    let part = (row.share(row.least, row.most, value) * PARTS as f64) as usize;
    axis as usize * PARTS + part.min(PARTS - 1)
}

fn pair(a: Axis, b: Axis) -> usize {
    SINGLES + a.min(b) as usize * AXIS_COUNT + a.max(b) as usize
}

/// Whether a promise on such cases holds on a random one; `promised` says whether it was drawn from the promises' domain.
pub(super) fn holds(on: On, case: &StressCase, promised: bool) -> bool {
    let side = || case.value(Axis::Aspect) * case.value(Axis::Inradius).max(1.0);
    match on {
        On::Domain => promised,
        On::Reach => side() / case.value(Axis::Focal) <= REACH,
        On::Everything => true,
    }
}

impl Tally {
    /// Adds random case number `index`, just run on `rig`; `kept` what files and bakes of it lose,
    /// if these were made.
    pub(super) fn add(
        &mut self,
        index: u64,
        (case, stretch): (&StressCase, Stretch),
        outcome: &Outcome,
        rig: &Rig,
        kept: Option<Kept>,
    ) {
        let part = match stretch {
            Stretch::Single(axis) => single(axis, case.value(axis)),
            Stretch::Pair(a, b) => pair(a, b),
            Stretch::PromisedPair(..) | Stretch::Promised => SINGLES + PAIRS,
        };
        self.parts[part].add(outcome, rig);
        let promised = part == SINGLES + PAIRS;
        for ((row, worst), counts) in PROMISES.iter().zip(&mut self.worst).zip(&mut self.counts) {
            if !holds(row.on, case, promised) {
                continue;
            }
            let found = match row.promise {
                Promise::Frames | Promise::WorstFrame => outcome.worst_value,
                Promise::Gradients => outcome.worst_gradient,
                Promise::NonFinite => outcome.non_finite as f64,
                Promise::SolidSamples => outcome.solid_wrong as f64,
                Promise::Time => outcome.seconds / layers_over_ordinary(case),
                promise => kept.and_then(|kept| kept.of(promise)).unwrap_or(0.0),
            };
            worst.add(found, index, case);
            match row.promise {
                Promise::Frames => counts.count(rig.values.iter().copied(), row.at_most),
                Promise::Gradients => counts.count(rig.gradients.iter().copied(), row.at_most),
                Promise::StoredPositions | Promise::BakedTriangles | Promise::BakedNonFinite => {
                    counts.count(kept.map(|_| found).into_iter(), row.at_most);
                }
                // A single time is noise: the slowest cases are timed again.
                Promise::Time => {}
                _ => counts.count(std::iter::once(found), row.at_most),
            }
        }
        let slow = outcome.seconds / layers_over_ordinary(case);
        self.add_slow(Worst { found: slow, index, case: None }, Some(case));
    }

    fn add_slow(&mut self, mut slow: Worst, case: Option<&StressCase>) {
        if self.slowest.len() < SLOWEST || self.slowest.last().is_some_and(|last| slow.found > last.found) {
            slow.case = case.cloned().or(slow.case);
            let at = self.slowest.partition_point(|other| other.found >= slow.found);
            self.slowest.insert(at, slow);
            self.slowest.truncate(SLOWEST);
        }
    }

    /// Adds the sums of other cases.
    pub(super) fn merge(&mut self, other: Self) {
        self.parts.iter_mut().zip(&other.parts).for_each(|(a, b)| a.merge(b));
        self.worst.iter_mut().zip(&other.worst).for_each(|(a, b)| a.merge(b));
        for (a, b) in self.counts.iter_mut().zip(&other.counts) {
            (a.of, a.failures) = (a.of + b.of, a.failures + b.failures);
        }
        other.slowest.into_iter().for_each(|slow| self.add_slow(slow, None));
    }

    /// The worst case of a promise.
    pub(super) fn worst(&self, promise: Promise) -> &Worst {
        let at = PROMISES.iter().position(|row| row.promise == promise);
        &self.worst[at.unwrap_or_default()]
    }

    /// How many failed of a promise.
    pub(super) fn failures(&self, promise: Promise) -> Failures {
        let at = PROMISES.iter().position(|row| row.promise == promise);
        self.counts[at.unwrap_or_default()]
    }

    /// The cases of the promises' domain.
    pub(super) fn domain(&self) -> &PartSums {
        &self.parts[SINGLES + PAIRS]
    }

    /// A row for every part that has cases.
    pub(super) fn rows(&self, ordinary_seconds: f64) -> Vec<StressRow> {
        let part = |at: usize| {
            if at < SINGLES {
                let row = &AXES[at / PARTS];
                let end = |i: usize| row.between(row.least, row.most, i as f64 / PARTS as f64);
                Part::Single { axis: row.axis, from: end(at % PARTS), to: end(at % PARTS + 1) }
            } else if at < SINGLES + PAIRS {
                let at = at - SINGLES;
                Part::Pair { axis: AXES[at / AXIS_COUNT].axis, with: AXES[at % AXIS_COUNT].axis }
            } else {
                Part::Domain
            }
        };
        let some = self.parts.iter().enumerate().filter(|(_, sums)| sums.cases > 0);
        some.map(|(at, sums)| sums.row(part(at), ordinary_seconds)).collect()
    }
}

impl PartSums {
    fn add(&mut self, outcome: &Outcome, rig: &Rig) {
        self.cases += 1;
        self.drawn += u64::from(outcome.drawn);
        self.undecided += outcome.undecided;
        self.non_finite += outcome.non_finite;
        self.solid_wrong += outcome.solid_wrong;
        rig.values.iter().for_each(|e| self.value.add(*e));
        rig.gradients.iter().for_each(|e| self.gradient.add(*e));
        self.seconds.add(outcome.seconds);
    }

    fn merge(&mut self, other: &Self) {
        self.cases += other.cases;
        self.drawn += other.drawn;
        self.undecided += other.undecided;
        self.non_finite += other.non_finite;
        self.solid_wrong += other.solid_wrong;
        self.value.merge(&other.value);
        self.gradient.merge(&other.gradient);
        self.seconds.merge(&other.seconds);
    }

    fn row(&self, part: Part, ordinary_seconds: f64) -> StressRow {
        let pixels = self.cases * u64::from(super::scene::SIDE).pow(2);
        StressRow {
            part,
            cases: self.cases,
            drawn: self.drawn,
            undecided: self.undecided as f64 / pixels as f64,
            value: summary(&self.value),
            gradient: summary(&self.gradient),
            non_finite: self.non_finite,
            solid_wrong: self.solid_wrong,
            time_ratio: self.seconds.quantile(0.5) / ordinary_seconds,
        }
    }
}

/// The quantiles that are reported.
pub(super) fn summary(errors: &Histogram) -> ErrorSummary {
    ErrorSummary {
        count: errors.total(),
        p50: errors.quantile(0.5),
        p999: errors.quantile(0.999),
        max: errors.most(),
    }
}
