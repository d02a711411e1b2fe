//! Looks for the worst case by climbing: a case is changed a little, and kept when its error is not smaller.

use super::axes::AXES;
use super::case::StressCase;
use super::promises::domain;
use super::rig::{Outcome, Rig};
use trisplat_scene::Rng;

/// Largest step along an axis, as a share of its range.
const STEP: f64 = 0.15;

/// Climbs from `start` on `error` within the promises' domain; returns the worst case found and its error.
pub(super) fn climb(
    rig: &mut Rig,
    seed: u64,
    start: &StressCase,
    steps: u64,
    error: impl Fn(&Outcome) -> f64,
) -> (StressCase, f64) {
    let mut best = (start.clone(), error(&rig.run(start)));
    for step in 0..steps {
        let case = neighbour(&best.0, Rng::new(seed, "stress climb", step));
        let found = error(&rig.run(&case));
        if found >= best.1 {
            best = (case, found);
        }
    }
    best
}

/// A case with two values moved, or in one of four with its triangles elsewhere.
fn neighbour(case: &StressCase, rng: Rng) -> StressCase {
    let mut out = case.clone();
    if rng.bits(0).is_multiple_of(4) {
        out.seed = rng.bits(1) >> 11;
    }
    for n in 0..2 {
        let row = &AXES[(rng.bits(2 + n) % AXES.len() as u64) as usize];
        let (least, most) = domain(row.axis);
        let share = row.share(least, most, case.value(row.axis)) + STEP * f64::from(rng.normal(4 + n));
        out.axes.insert(row.axis, row.between(least, most, share.clamp(0.0, 1.0)));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stress::axes::Axis;
    use std::collections::BTreeMap;

    #[test]
    fn a_climb_finds_worse_cases_than_its_start_and_stays_in_the_domain() {
        let start = StressCase { seed: 1, axes: BTreeMap::new() };
        let mut rig = Rig::default();
        let before = rig.run(&start).worst_value;
        let (case, found) = climb(&mut rig, 2, &start, 200, |o| o.worst_value);
        assert!(found > 2.0 * before, "{before} to {found}");
        assert_eq!(rig.run(&case).worst_value, found);
        let inside = |(axis, value): (&Axis, &f64)| {
            let (least, most) = domain(*axis);
            (least..=most).contains(value)
        };
        assert!(case.axes.iter().all(inside), "{case:?}");
        assert_eq!(climb(&mut Rig::default(), 2, &start, 200, |o| o.worst_value), (case, found));
    }
}
