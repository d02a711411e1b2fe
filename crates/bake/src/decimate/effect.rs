//! The effect of changing single faces on the error of a scene, summed from many threads.

use std::sync::atomic::{AtomicI64, AtomicU32, Ordering::Relaxed};

/// Units per squared difference in integer sums. Integers, because their sums do not depend on the order.
const UNITS: f64 = (1u64 << 32) as f64;

/// What changing one face does.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Effect {
    /// Change of the squared error.
    pub(super) error_change: f64,
    /// Samples that see the face before it changes, where they were counted.
    pub(super) samples: f64,
}

/// Effects of all faces while they are summed.
pub(super) struct EffectSums {
    error_change: Vec<AtomicI64>,
    samples: Vec<AtomicU32>,
}

impl EffectSums {
    /// Zeros for `faces`.
    pub(super) fn new(faces: usize) -> Self {
        Self {
            error_change: (0..faces).map(|_| AtomicI64::new(0)).collect(),
            samples: (0..faces).map(|_| AtomicU32::new(0)).collect(),
        }
    }

    /// Adds a sample at which the face is seen.
    #[inline(always)]
    pub(super) fn add_sample(&self, face: u32) {
        self.samples[face as usize].fetch_add(1, Relaxed);
    }

    /// Adds the change of a sample's squared error when the face changes.
    #[inline(always)]
    pub(super) fn add_change(&self, face: u32, change: f32) {
        self.error_change[face as usize].fetch_add((f64::from(change) * UNITS) as i64, Relaxed);
    }

    /// The sums.
    pub(super) fn into_effects(self) -> Vec<Effect> {
        let sums = self.error_change.into_iter().zip(self.samples);
        let effect = |(change, samples): (AtomicI64, AtomicU32)| Effect {
            error_change: change.into_inner() as f64 / UNITS,
            samples: samples.into_inner().into(),
        };
        sums.map(effect).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_of_either_sign_add_up() {
        let sums = EffectSums::new(2);
        for change in [0.5, -0.25, 3.0, 2f32.powi(-30)] {
            sums.add_change(1, change);
            sums.add_sample(1);
        }
        let exact = Effect { error_change: 3.25 + 2f64.powi(-30), samples: 4.0 };
        assert_eq!(sums.into_effects(), [Effect::default(), exact]);
    }
}
