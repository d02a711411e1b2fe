//! Colour channels from floats: sRGB-encoded, usually but not always in [0, 1].

use std::path::Path;
use trisplat_scene::{Error, Result};

/// A channel above this is not an overshoot but has another scale.
const OVERSHOOT: f32 = 2.0;

/// Counts clamped values.
#[derive(Debug, Default)]
pub(super) struct Clamped {
    count: usize,
    largest: f32,
}

impl Clamped {
    /// The channel in [0, 1]; NaN when it is not finite, so that its triangle is dropped and counted.
    #[inline]
    pub(super) fn channel(&mut self, value: f32) -> f32 {
        if (0.0..=1.0).contains(&value) {
            return value;
        }
        if !value.is_finite() {
            return f32::NAN;
        }
        self.count += 1;
        self.largest = self.largest.max(value);
        value.clamp(0.0, 1.0)
    }

    /// Adds what another thread counted.
    pub(super) fn merge(&mut self, other: Clamped) {
        self.count += other.count;
        self.largest = self.largest.max(other.largest);
    }

    /// A warning when values were clamped, an error when they are on another scale altogether.
    pub(super) fn report(&self, path: &Path, warnings: &mut Vec<String>) -> Result<()> {
        if self.largest > OVERSHOOT {
            let reason = format!(
                "float colours reach {}; floats must lie in 0 to 1: divide by 255, or write integers \
                 where the format has them",
                self.largest
            );
            return Err(Error::malformed(path, "colours", reason));
        }
        if self.count > 0 {
            warnings.push(format!("{} colour values outside 0 to 1 were clamped", self.count));
        }
        Ok(())
    }
}
