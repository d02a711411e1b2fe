//! A run: random cases, the climb from the worst of them, the invariances, and the promises.

use super::axes::{AXES, AxisRow};
use super::baked;
use super::case::StressCase;
use super::climb::climb;
use super::invariances;
use super::promises::{PROMISES, Promise, PromiseRow, domain};
use super::rate;
use super::rig::{Outcome, Rig, layers_over_ordinary};
use super::rows::{PromiseResult, StressReport};
use super::scene::StressScene;
use super::stored::half_steps;
use super::tally::{Failures, Kept, Tally, holds};
use crate::machine::Machine;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;
use trisplat_formats::gltf::PositionEncoding;
use trisplat_scene::{Error, Result};

/// Cases that a thread takes at once.
const BATCH: u64 = 64;
/// One case in this many is written to files and read, and baked.
const STORED_EVERY: u64 = 32;
/// One case in this many is drawn in all the ways that must not change it.
const VARIED_EVERY: u64 = 500;
/// Times the ordinary case and the slowest ones are drawn for their least time.
const TIMED_RUNS: usize = 25;

/// What to measure.
#[derive(Debug, Clone, clap::Args)]
pub struct StressArgs {
    /// Random cases.
    #[arg(long, default_value_t = 1_000_000, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000_000))]
    pub cases: u64,
    /// First seed of the cases.
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub seed: u64,
    /// Number of seeds; cases are split evenly.
    #[arg(long, default_value_t = 16, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub seeds: u64,
    /// Steps of each search for a worst case.
    #[arg(long, default_value_t = 5000, value_name = "N", value_parser = clap::value_parser!(u64).range(0..=1_000_000_000))]
    pub climb: u64,
    /// File that the worst case is written to when a promise is broken.
    #[arg(long, default_value = "stress-worst.json", value_name = "FILE")]
    pub worst: PathBuf,
    /// Draw the case of this file alone and print what is found; exit code 1 where it fails a promise.
    #[arg(long, value_name = "FILE")]
    pub replay: Option<PathBuf>,
    /// Print JSON (`trisplat schema stress` describes it).
    #[arg(long)]
    pub json: bool,
}

/// Measures, with the threads of the pool it is called in.
///
/// # Errors
/// [`Error::Io`] when the files of the cases cannot be written.
pub fn run(args: &StressArgs) -> Result<StressReport> {
    let clock = Instant::now();
    let folder = tempfile::tempdir().map_err(|e| Error::io("temporary folder", e))?;
    let ordinary = StressCase { seed: args.seed, axes: BTreeMap::new() };
    let ordinary_seconds = alone(|| Ok(Rig::default().least_seconds(&ordinary, 4 * TIMED_RUNS)))?;
    let tally = random_cases(args, folder.path())?;
    let promises = alone(|| Ok(results(args, &tally, ordinary_seconds)))?;
    Ok(StressReport {
        machine: Machine::here(),
        seed: args.seed,
        seeds: args.seeds,
        cases: args.cases,
        rows: tally.rows(ordinary_seconds),
        invariances: invariances::rows(args.seed, args.cases.div_ceil(VARIED_EVERY))?,
        promises,
        ordinary_seconds,
        wall_seconds: clock.elapsed().as_secs_f64(),
    })
}

/// Runs the random cases. A thread draws its cases alone, so that their time is their own.
fn random_cases(args: &StressArgs, folder: &Path) -> Result<Tally> {
    let next = AtomicU64::new(0);
    let threads = rayon::current_num_threads();
    let work = |thread: usize| -> Result<Tally> {
        let path = folder.join(format!("{thread}.glb"));
        let (mut rig, mut tally) = (Rig::default(), Tally::default());
        loop {
            let first = next.fetch_add(BATCH, Ordering::Relaxed);
            if first >= args.cases {
                return Ok(tally);
            }
            for index in first..(first + BATCH).min(args.cases) {
                let (case, stretch) =
                    StressCase::random(args.seed.wrapping_add(index % args.seeds), index / args.seeds);
                let outcome = rig.run(&case);
                let kept = match (index / args.seeds / 4).is_multiple_of(STORED_EVERY) {
                    true => Some(kept(&case, &path)?),
                    false => None,
                };
                tally.add(index, (&case, stretch), &outcome, &rig, kept);
            }
        }
    };
    let tallies: Vec<Result<Tally>> = std::thread::scope(|scope| {
        let start = |thread| scope.spawn(move || alone(|| work(thread)));
        let handles: Vec<_> = (0..threads).map(start).collect();
        handles.into_iter().map(|h| h.join().unwrap_or_else(|_| Err(panicked()))).collect()
    });
    let mut sum = Tally::default();
    for tally in tallies {
        sum.merge(tally?);
    }
    Ok(sum)
}

fn panicked() -> Error {
    Error::Incomplete("a case of the stress test ended a thread".to_owned())
}

/// Runs `work` with no other threads.
fn alone<T: Send>(work: impl FnOnce() -> Result<T> + Send) -> Result<T> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let pool = pool.map_err(|e| Error::invalid("threads", 1, e.to_string()))?;
    pool.install(work)
}

/// What files of the case lose, plain and quantised, and bakes of it.
fn kept(case: &StressCase, path: &Path) -> Result<Kept> {
    let scene = StressScene::new(case);
    let (mesh, _) = scene.solid();
    let plain = half_steps(&mesh, PositionEncoding::F32, path)?;
    let stored = plain.max(half_steps(&mesh, PositionEncoding::ChunkU16, path)?);
    Ok(Kept { stored, lost: baked::lost(&scene), non_finite: baked::non_finite(&scene) })
}

/// What was found of every promise.
fn results(args: &StressArgs, tally: &Tally, ordinary_seconds: f64) -> Vec<PromiseResult> {
    let mut rig = Rig::default();
    let result = |row: &PromiseRow| {
        let worst = tally.worst(row.promise);
        let (mut case, mut found) = (worst.case.clone(), worst.found);
        match row.promise {
            Promise::Frames => found = tally.domain().value.quantile(0.999),
            Promise::Gradients => found = tally.domain().gradient.quantile(0.999),
            Promise::WorstFrame => {
                if let Some(start) = &case {
                    let (worst, error) = climb(&mut rig, args.seed, start, args.climb, |o| o.worst_value);
                    (case, found) = (Some(worst), error);
                }
            }
            // What the worst case has: a count over all would grow with their number.
            Promise::NonFinite | Promise::SolidSamples => {}
            Promise::StoredPositions | Promise::BakedTriangles | Promise::BakedNonFinite => {}
            Promise::Time => (case, found) = slowest(&mut rig, tally, ordinary_seconds),
        }
        let Failures { of, failures } = match row.promise {
            Promise::Time => Failures { of: args.cases, failures: u64::from(found > row.at_most) },
            promise => tally.failures(promise),
        };
        PromiseResult {
            name: row.name.to_owned(),
            promise: row.promise,
            on: row.on,
            at_most: row.at_most,
            found,
            of,
            failures,
            rate_at_most: row.rate,
            rate_below: rate::upper(failures, of),
            kept: rate::lower(failures, of) <= row.rate,
            worst: case,
        }
    };
    PROMISES.iter().map(result).collect()
}

/// The slowest case for its layers, timed again so that another program's work does not count.
fn slowest(rig: &mut Rig, tally: &Tally, ordinary_seconds: f64) -> (Option<StressCase>, f64) {
    let mut worst = (None, 0.0);
    for case in tally.slowest.iter().filter_map(|slow| slow.case.as_ref()) {
        let seconds = rig.least_seconds(case, TIMED_RUNS);
        let ratio = seconds / layers_over_ordinary(case) / ordinary_seconds;
        if ratio > worst.1 {
            worst = (Some(case.clone()), ratio);
        }
    }
    worst
}

/// What one case gives: every figure by its promise's name.
///
/// # Errors
/// [`Error::Invalid`] for a value outside its axis, [`Error::Io`] when its file cannot be written.
pub fn replay(case: &StressCase) -> Result<BTreeMap<String, f64>> {
    case.validate()?;
    alone(|| figures(case))
}

fn figures(case: &StressCase) -> Result<BTreeMap<String, f64>> {
    let folder = tempfile::tempdir().map_err(|e| Error::io("temporary folder", e))?;
    let mut rig = Rig::default();
    let outcome: Outcome = rig.run(case);
    let ordinary = StressCase { seed: case.seed, axes: BTreeMap::new() };
    let ordinary_seconds = rig.least_seconds(&ordinary, TIMED_RUNS);
    let time = rig.least_seconds(case, TIMED_RUNS) / layers_over_ordinary(case) / ordinary_seconds;
    let kept = kept(case, &folder.path().join("case.glb"))?;
    let found = |promise: Promise| match promise {
        Promise::Frames | Promise::WorstFrame => outcome.worst_value,
        Promise::Gradients => outcome.worst_gradient,
        Promise::NonFinite => outcome.non_finite as f64,
        Promise::SolidSamples => outcome.solid_wrong as f64,
        Promise::Time => time,
        promise => kept.of(promise).unwrap_or(0.0),
    };
    Ok(PROMISES.iter().map(|row| (row.name.to_owned(), found(row.promise))).collect())
}

/// The first promise that a case fails whose figures [`replay`] found: in words, with its limit.
pub fn broken(case: &StressCase, found: &BTreeMap<String, f64>) -> Option<String> {
    let inside = |axis: &AxisRow| {
        let ((least, most), value) = (domain(axis.axis), case.value(axis.axis));
        (least..=most).contains(&value)
    };
    let promised = AXES.iter().all(inside);
    PROMISES.iter().filter(|row| holds(row.on, case, promised)).find_map(|row| {
        let value = *found.get(row.name)?;
        let fails = !(value <= row.at_most);
        fails.then(|| {
            format!("the case fails the promise \"{}\": {value:.3e}, at most {:.1e}", row.name, row.at_most)
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stress::axes::Axis;
    use crate::stress::rows::Part;

    fn args(cases: u64) -> StressArgs {
        StressArgs { cases, seed: 1, seeds: 1, climb: 300, worst: PathBuf::new(), replay: None, json: false }
    }

    #[test]
    fn every_promise_can_be_broken_and_its_case_fails_when_it_is_replayed() {
        let (case, stretch) = StressCase::random(1, 3);
        let wrong = Outcome {
            worst_value: 0.9,
            worst_gradient: 5.0,
            non_finite: 1,
            solid_wrong: 1,
            ..Outcome::default()
        };
        let mut rig = Rig::default();
        (rig.values, rig.gradients) = (vec![0.9; 10], vec![5.0; 10]);
        let mut tally = Tally::default();
        let kept = Kept { stored: 2.0, lost: 1.0, non_finite: 3.0 };
        (0..100).for_each(|index| tally.add(index, (&case, stretch), &wrong, &rig, Some(kept)));
        let results = results(&StressArgs { climb: 0, ..args(100) }, &tally, 1e-12);
        for promise in results {
            assert!(!promise.kept && promise.rate_below > promise.rate_at_most, "{promise:?}");
            let figures = BTreeMap::from([(promise.name.clone(), 1e3)]);
            let told = broken(&case, &figures).unwrap();
            assert!(told.starts_with(&format!("the case fails the promise \"{}\"", promise.name)), "{told}");
        }
        assert_eq!(broken(&case, &PROMISES.iter().map(|row| (row.name.to_owned(), 0.0)).collect()), None);
        // Outside the domain nothing is promised of its frames.
        let far = StressCase { axes: BTreeMap::from([(Axis::Distance, 1e6)]), ..case };
        assert_eq!(broken(&far, &BTreeMap::from([("frames".to_owned(), 0.5)])), None);
    }

    #[test]
    fn a_rare_failure_does_not_break_a_promise_of_a_rate() {
        assert!(rate::lower(1, 150_000) <= 1e-5 && rate::lower(9, 150_000) > 1e-5);
        assert!(rate::lower(1, 150_000) > 0.0, "a promise of no failure is broken by one");
    }

    /// Another seed in every run of the suite, which a failure names: TRISPLAT_STRESS_SEED repeats it.
    #[test]
    fn promises_hold_on_the_cases_of_the_suite() {
        let now = || std::time::UNIX_EPOCH.elapsed().unwrap().as_secs();
        let seed = std::env::var("TRISPLAT_STRESS_SEED").map_or_else(|_| now(), |text| text.parse().unwrap());
        let again = format!("TRISPLAT_STRESS_SEED={seed} repeats this run");
        #[allow(clippy::print_stderr, reason = "the suite shows it when the test fails")]
        {
            eprintln!("{again}");
        }
        let report = run(&StressArgs { seed, ..args(CASES) }).unwrap();
        let kept = |p: &&PromiseResult| p.kept || p.promise == Promise::Time;
        let broken: Vec<_> = report.promises.iter().filter(|p| !kept(p)).collect();
        assert!(broken.is_empty(), "{again}: {broken:#?}");
        let broken: Vec<_> = report.invariances.iter().filter(|row| !row.kept).collect();
        assert!(broken.is_empty(), "{again}: {broken:#?}");
    }

    /// Few cases of each of many seeds: one seed finds the same places again and again.
    #[test]
    fn promises_hold_on_other_seeds() {
        for seed in 2..10 {
            let report = run(&StressArgs { seed, climb: 1, ..args(2000) }).unwrap();
            // Quantiles want more cases, and times a machine that does nothing else.
            let counted = |p: &&PromiseResult| {
                matches!(p.promise, Promise::NonFinite | Promise::SolidSamples | Promise::BakedNonFinite)
            };
            let broken: Vec<_> = report.promises.iter().filter(counted).filter(|p| !p.kept).collect();
            assert!(broken.is_empty(), "{seed}: {broken:#?}");
        }
    }

    /// Case of seed 3 among 150,000: parallel slivers, a millionth of their distance apart and 444 times as long as high.
    #[test]
    fn slivers_a_millionth_apart_hide_each_other_as_far_as_their_depths_are_exact() {
        let axes = [(Axis::Aspect, 443.764_202_811_409_6), (Axis::Gap, 9.214_683_723_385_382e-7)];
        let case = StressCase { seed: 95_633_771_826_690, axes: axes.into_iter().collect() };
        assert_eq!(replay(&case).unwrap()["solid_samples"], 0.0);
    }

    /// As many as take 20 s of a build without optimisation on two cores.
    const CASES: u64 = 100_000;

    #[test]
    fn a_report_does_not_depend_on_the_number_of_threads() {
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut report = pool.install(|| run(&args(600))).unwrap();
            (report.wall_seconds, report.ordinary_seconds) = (0.0, 0.0);
            report.rows.iter_mut().for_each(|row| row.time_ratio = 0.0);
            report.promises.retain(|p| p.promise != Promise::Time);
            report
        };
        let one = with(1);
        assert_eq!(one, with(3));
        assert_eq!(one.rows.iter().map(|row| row.cases).sum::<u64>(), 600);
        let domain = one.rows.iter().find(|row| row.part == Part::Domain).unwrap();
        assert!(domain.cases == 300 && domain.drawn > 200 && domain.value.count > 100_000, "{domain:?}");
    }

    #[test]
    fn the_worst_case_gives_the_same_again() {
        let report = run(&args(600)).unwrap();
        let frame = report.promises.iter().find(|p| p.promise == Promise::WorstFrame).unwrap();
        let case = frame.worst.as_ref().unwrap();
        let text = serde_json::to_string(case).unwrap();
        let again = replay(&serde_json::from_str(&text).unwrap()).unwrap();
        assert_eq!(again["worst_frame"], frame.found);
    }
}
