//! `stress`: how exact the rasterisers and the files are when a scene is stretched, and where they
//! break.
//!
//! ```text
//! seed ──► case (axes) ──► scene ──► soft, solid, files, bakes ──┐
//!                            └─────► oracles in f64 ─────────────┴──► errors ──► promises
//! ```

mod axes;
mod case;
mod draw;
mod kept;
mod promises;

use crate::machine::{Machine, print_json};
use axes::{AXES, Axis};
use case::{StressCase, Stretch};
use draw::{Draw, Errors};
use promises::{PROMISES, Promise, PromiseRow};
use serde::Serialize;
use std::path::Path;
use std::time::Instant;
use trisplat_scene::{Error, Result};

/// Parts that an axis is divided into when it is stretched alone.
const PARTS: usize = 8;
/// One case in this many is written to files and read, and baked.
const KEPT_EVERY: u64 = 32;
/// One case in this many of the promises' domain has its gradients compared, which takes as long as
/// hundreds of pictures.
const GRADIENTS_EVERY: u64 = 16;

/// Measurement of the stress test.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct StressArgs {
    /// Random cases.
    #[arg(long, default_value_t = 100_000, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000_000))]
    cases: u64,
    /// First seed of the cases.
    #[arg(long, default_value_t = 0, value_name = "N")]
    seed: u64,
    /// Number of seeds; cases are split evenly.
    #[arg(long, default_value_t = 16, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    seeds: u64,
    /// Draw this case alone, as in {"seed": 1, "axes": {"sigma": 0.5}}, and print what is found.
    #[arg(long, value_name = "JSON")]
    replay: Option<String>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Report printed by `--json`.
#[derive(Debug, Serialize)]
struct StressReport {
    #[serde(flatten)]
    machine: Machine,
    seed: u64,
    seeds: u64,
    cases: u64,
    wall_seconds: f64,
    /// Seconds of the ordinary case, the soft rasteriser forward and backward.
    ordinary_seconds: f64,
    rows: Vec<AxisPart>,
    promises: Vec<PromiseResult>,
}

/// Cases with one axis stretched alone, from here to there.
#[derive(Debug, Clone, Serialize)]
struct AxisPart {
    axis: Axis,
    from: f64,
    to: f64,
    /// Pixels too near to a jump to be compared, of 1.
    undecided: f64,
    /// Median over the cases of the largest error of a value.
    frames_p50: f64,
    /// Largest error of a value.
    frames_max: f64,
    /// Wrong samples of the solid rasteriser.
    solid_wrong: f64,
}

/// A promise, and what was found.
#[derive(Debug, Clone, Serialize)]
struct PromiseResult {
    name: &'static str,
    /// The largest error that is no failure.
    at_most: f64,
    /// The share that may fail.
    rate: f64,
    /// The largest error.
    found: f64,
    /// Errors that were looked at: one for a case, of `frames` and `gradients` one for a number.
    of: u64,
    failures: u64,
    /// The case of `found`.
    worst: Option<StressCase>,
}

impl PromiseResult {
    fn new(row: &PromiseRow) -> Self {
        let PromiseRow { name, at_most, rate, .. } = *row;
        Self { name, at_most, rate, found: 0.0, of: 0, failures: 0, worst: None }
    }

    fn add(&mut self, case: &StressCase, errors: &[f64]) {
        self.of += errors.len() as u64;
        self.failures += errors.iter().filter(|error| !(**error <= self.at_most)).count() as u64;
        let largest = errors.iter().copied().fold(0.0, f64::max);
        if largest > self.found {
            self.found = largest;
            self.worst = Some(case.clone());
        }
    }

    /// True when there are no more failures than the rate allows, by four standard deviations of a
    /// count of rare events.
    fn is_kept(&self) -> bool {
        let allowed = self.rate * self.of as f64;
        self.failures as f64 <= allowed + 4.0 * allowed.sqrt()
    }
}

/// Sums over cases.
#[derive(Debug)]
struct Tally {
    promises: Vec<PromiseResult>,
    /// Undecided pixels, largest error of a value and wrong samples, by axis and part.
    singles: Vec<Vec<[f64; 3]>>,
}

impl Default for Tally {
    fn default() -> Self {
        let promises = PROMISES.iter().map(PromiseResult::new).collect();
        Self { promises, singles: vec![Vec::new(); AXES.len() * PARTS] }
    }
}

impl Tally {
    fn add(&mut self, (case, stretch): &(StressCase, Stretch), errors: &Errors) {
        let promised = matches!(stretch, Stretch::PromisedPair(..) | Stretch::Promised);
        for ((row, result), errors) in PROMISES.iter().zip(&mut self.promises).zip(&errors.of) {
            if case.is_on(row.on, promised) {
                result.add(case, errors);
            }
        }
        if let Stretch::Single(axis) = *stretch {
            let row = axis.row();
            let worst = |promise| errors.worst(promise);
            let part = (row.share(row.least, row.most, case.value(axis)) * PARTS as f64) as usize;
            let found =
                [errors.undecided, worst(Promise::WorstFrame), worst(Promise::SolidSamples)];
            self.singles[axis as usize * PARTS + part.min(PARTS - 1)].push(found);
        }
    }

    fn merge(&mut self, other: Self) {
        for (a, b) in self.promises.iter_mut().zip(other.promises) {
            a.of += b.of;
            a.failures += b.failures;
            if b.found > a.found {
                a.found = b.found;
                a.worst = b.worst;
            }
        }
        for (a, b) in self.singles.iter_mut().zip(other.singles) {
            a.extend(b);
        }
    }

    fn rows(&self) -> Vec<AxisPart> {
        let part = |(at, found): (usize, &Vec<[f64; 3]>)| {
            let row = &AXES[at / PARTS];
            let part = at % PARTS;
            let end = |part: usize| row.between(row.least, row.most, part as f64 / PARTS as f64);
            let sum = |of: usize| found.iter().map(|found| found[of]).sum::<f64>();
            let mut frames: Vec<f64> = found.iter().map(|found| found[1]).collect();
            frames.sort_by(f64::total_cmp);
            Some(AxisPart {
                axis: row.axis,
                from: end(part),
                to: end(part + 1),
                undecided: sum(0) / found.len() as f64,
                frames_p50: frames[frames.len() / 2],
                frames_max: *frames.last()?,
                solid_wrong: sum(2),
            })
        };
        self.singles
            .iter()
            .enumerate()
            .filter(|(_, found)| !found.is_empty())
            .filter_map(part)
            .collect()
    }
}

/// Draws random cases, or the one to replay, and prints what is found.
///
/// # Errors
/// A broken promise, with its worst case; files of the cases cannot be written.
pub(crate) fn run(args: &StressArgs) -> Result<()> {
    if let Some(text) = &args.replay {
        return replay(&StressCase::parse(text)?);
    }
    let report = measure(args)?;
    if args.json {
        print_json(&report)?;
    } else {
        print(&report);
    }
    verdict(&report)
}

/// Measures, with a thread for each of the pool it is called in; each draws its cases alone, so
/// that their time is their own.
fn measure(args: &StressArgs) -> Result<StressReport> {
    let clock = Instant::now();
    let folder = tempfile::tempdir().map_err(|e| Error::io("temporary folder", e))?;
    let ordinary_seconds = alone(|| Ok(Draw::default().ordinary_seconds(args.seed)))?;
    let threads = rayon::current_num_threads() as u64;
    let work = |thread: u64| -> Result<Tally> {
        let path = folder.path().join(format!("{thread}.glb"));
        let mut draw = Draw::default();
        let mut tally = Tally::default();
        for index in (thread..args.cases).step_by(threads as usize) {
            let seed = args.seed.wrapping_add(index % args.seeds);
            let index = index / args.seeds;
            let random = StressCase::random(seed, index);
            // Cases go through four kinds of stretch in turn: of each kind, one in `KEPT_EVERY` is
            // written.
            let kept = (index / 4).is_multiple_of(KEPT_EVERY).then_some(path.as_path());
            let promised = matches!(random.1, Stretch::PromisedPair(..) | Stretch::Promised);
            let gradients = promised && (index / 4).is_multiple_of(GRADIENTS_EVERY);
            tally.add(&random, &draw.run(&random.0, ordinary_seconds, gradients, kept)?);
        }
        Ok(tally)
    };
    let tallies: Vec<Result<Tally>> = std::thread::scope(|scope| {
        let start = |thread| scope.spawn(move || alone(|| work(thread)));
        let handles: Vec<_> = (0..threads).map(start).collect();
        let panicked = || Error::Incomplete("a case of the stress test ended a thread".to_owned());
        handles
            .into_iter()
            .map(|handle| handle.join().unwrap_or_else(|_| Err(panicked())))
            .collect()
    });
    let mut sum = Tally::default();
    for tally in tallies {
        sum.merge(tally?);
    }
    Ok(StressReport {
        machine: Machine::here(),
        seed: args.seed,
        seeds: args.seeds,
        cases: args.cases,
        wall_seconds: clock.elapsed().as_secs_f64(),
        ordinary_seconds,
        rows: sum.rows(),
        promises: sum.promises,
    })
}

/// Runs `work` with no other threads.
fn alone<T: Send>(work: impl FnOnce() -> Result<T> + Send) -> Result<T> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let pool = pool.map_err(|e| Error::invalid("threads", 1, e.to_string()))?;
    pool.install(work)
}

/// An error when a promise is broken.
fn verdict(report: &StressReport) -> Result<()> {
    let Some(PromiseResult { name, found, at_most, failures, of, rate, worst }) =
        report.promises.iter().find(|promise| !promise.is_kept())
    else {
        return Ok(());
    };
    let case = worst.as_ref().map_or(String::new(), StressCase::text);
    Err(Error::Incomplete(format!(
        "the promise \"{name}\" is broken: {found:.3e}, at most {at_most:.1e}, in {failures} of {of}, at most {rate:.0e} of them; \
         `stress --replay '{case}'` draws the worst again"
    )))
}

/// Draws one case and prints every error by its promise; fails where one is larger than a promise
/// that holds for it allows.
fn replay(case: &StressCase) -> Result<()> {
    let errors = alone(|| figures(case))?;
    let worst = |row: &PromiseRow| errors.worst(row.promise);
    for row in &PROMISES {
        eprintln!("{:<18}{:.3e}", row.name, worst(row));
    }
    let promised = case.is_promised();
    let fails = |row: &&PromiseRow| case.is_on(row.on, promised) && !(worst(row) <= row.at_most);
    PROMISES.iter().find(fails).map_or(Ok(()), |row| {
        let name = row.name;
        let found = worst(row);
        let at_most = row.at_most;
        Err(Error::Incomplete(format!(
            "the case fails the promise \"{name}\": {found:.3e}, at most {at_most:.1e}"
        )))
    })
}

/// All that can be found of one case.
fn figures(case: &StressCase) -> Result<Errors> {
    let folder = tempfile::tempdir().map_err(|e| Error::io("temporary folder", e))?;
    let mut draw = Draw::default();
    let ordinary = draw.ordinary_seconds(case.seed);
    draw.run(case, ordinary, case.is_promised(), Some(&folder.path().join("case.glb") as &Path))
}

fn print(report: &StressReport) {
    eprintln!("axis            from        to  undecided  frames p50      max  wrong samples");
    for row in &report.rows {
        let AxisPart { from, to, frames_p50, frames_max, solid_wrong, .. } = row;
        let name = row.axis.row().name;
        let undecided = 100.0 * row.undecided;
        eprintln!(
            "{name:<12}{from:>8.1e}{to:>10.1e}{undecided:>10.2}%{frames_p50:>12.1e}{frames_max:>9.1e}{solid_wrong:>15}"
        );
    }
    eprintln!("\npromise             worst  at most    failures          of  may be");
    for promise in &report.promises {
        let PromiseResult { name, found, at_most, failures, of, rate, .. } = promise;
        let kept = if promise.is_kept() { "" } else { "  BROKEN" };
        eprintln!("{name:<17}{found:>8.1e}{at_most:>9.1e}{failures:>12}{of:>12}{rate:>8.0e}{kept}");
    }
    let micros = 1e6 * report.ordinary_seconds;
    eprintln!(
        "{} cases in {:.1} s; the ordinary one takes {micros:.1} µs",
        report.cases, report.wall_seconds
    );
}

#[cfg(test)]
mod tests;
