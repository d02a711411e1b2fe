//! A case: a seed and a value on every axis. From it follow a scene and everything that is drawn.

use super::axes::{AXES, Axis, DEEP_EVERY};
use super::promises::domain;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use trisplat_scene::{Error, Result, Rng};

/// A case of the stress test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StressCase {
    /// Where its triangles lie.
    pub seed: u64,
    /// Its values; ordinary on every other axis.
    #[serde(default)]
    pub axes: BTreeMap<Axis, f64>,
}

/// How the axes of a random case were chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stretch {
    /// One axis, over all of its range.
    Single(Axis),
    /// Two axes, over all of their ranges.
    Pair(Axis, Axis),
    /// Two axes, over the ranges of the promises.
    PromisedPair(Axis, Axis),
    /// All axes at once, over the ranges of the promises.
    Promised,
}

impl StressCase {
    /// Its value on an axis.
    pub fn value(&self, axis: Axis) -> f64 {
        self.axes.get(&axis).copied().unwrap_or(axis.row().ordinary)
    }

    /// Checks that every value lies on its axis.
    pub fn validate(&self) -> Result<()> {
        for (axis, value) in &self.axes {
            let row = axis.row();
            if !(row.least..=row.most).contains(value) {
                let wants = format!("{} to {}", row.least, row.most);
                return Err(Error::invalid(format!("axis {}", row.name), value, wants));
            }
        }
        Ok(())
    }

    /// Random case number `index` of a run, and how it was stretched. One in four of each kind.
    pub fn random(seed: u64, index: u64) -> (Self, Stretch) {
        let rng = Rng::new(seed, "stress", index);
        let count = AXES.len() as u64;
        let first = rng.bits(0) % count;
        // Another one.
        let second = (first + 1 + rng.bits(1) % (count - 1)) % count;
        let [a, b] = [first, second].map(|i| AXES[i as usize].axis);
        let stretch = match index % 4 {
            0 => Stretch::Single(a),
            1 => Stretch::Pair(a, b),
            2 => Stretch::PromisedPair(a, b),
            _ => Stretch::Promised,
        };
        let at = |axis: Axis| rng.uniform_f64(10 + axis as u64);
        let deep = rng.bits(3).is_multiple_of(DEEP_EVERY);
        let full = |axis: Axis, alone: bool| {
            let row = axis.row();
            let most = if alone && (axis != Axis::Layers || deep) { row.most } else { row.most_in_pairs };
            (axis, row.between(row.least, most, at(axis)))
        };
        let promised = |axis: Axis| {
            let (least, most) = domain(axis);
            (axis, axis.row().between(least, most.min(axis.row().most_in_pairs), at(axis)))
        };
        let axes = match stretch {
            Stretch::Single(a) => BTreeMap::from([full(a, true)]),
            Stretch::Pair(a, b) => BTreeMap::from([full(a, false), full(b, false)]),
            Stretch::PromisedPair(a, b) => BTreeMap::from([promised(a), promised(b)]),
            Stretch::Promised => AXES.iter().map(|row| promised(row.axis)).collect(),
        };
        (Self { seed: rng.bits(2) >> 11, axes }, stretch)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn random_cases_lie_on_their_axes_and_stretch_what_they_say() {
        for index in 0..4000 {
            let (case, stretch) = StressCase::random(3, index);
            case.validate().unwrap();
            let stretched = match stretch {
                Stretch::Single(a) => vec![a],
                Stretch::Pair(a, b) | Stretch::PromisedPair(a, b) => vec![a, b],
                Stretch::Promised => AXES.map(|row| row.axis).to_vec(),
            };
            assert_eq!(case.axes.len(), stretched.len(), "{stretch:?}");
            assert!(stretched.iter().all(|axis| case.axes.contains_key(axis)), "{stretch:?}");
            assert_eq!(StressCase::random(3, index), (case, stretch));
        }
    }

    #[test]
    fn a_case_is_the_same_after_it_was_written_and_read() {
        let (case, _) = StressCase::random(5, 3);
        let text = serde_json::to_string(&case).unwrap();
        assert_eq!(serde_json::from_str::<StressCase>(&text).unwrap(), case);
    }

    #[test]
    fn a_value_outside_its_axis_is_refused() {
        let case = StressCase { seed: 0, axes: BTreeMap::from([(Axis::Sigma, 1e9)]) };
        let message = case.validate().unwrap_err().to_string();
        assert_eq!(message, "axis sigma is 1000000000: expected 0.0001 to 1000");
    }
}
