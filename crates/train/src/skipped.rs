//! The work that the steps of a run skipped.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::ops::AddAssign;
use trisplat_scene::WorkCount;

/// The full work of this process's steps, and the skipped part.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct SkippedWork {
    /// Pixels of photos: early steps look at small photos (`warmup`).
    pub pixels: WorkCount,
    /// Rows of the optimiser, one per triangle; those without a gradient are skipped (`rates.sparse`).
    pub rows: WorkCount,
    /// Coefficients of spherical harmonics, one per triangle and basis function; degrees not in use are
    /// skipped.
    pub coefficients: WorkCount,
}

impl SkippedWork {
    /// Of a step on some of the photo's `pixels`, with `triangles`, and some of the `degrees` of their
    /// colours. Rows count as updated once the step's figures are known.
    pub(super) fn of_step(pixels: (u32, u32), triangles: u64, degrees: (u8, u8)) -> Self {
        let functions = |degree: u8| (u64::from(degree) + 1).pow(2);
        Self {
            pixels: WorkCount::of(pixels.0.into(), pixels.1.into()),
            rows: WorkCount::of(0, triangles),
            coefficients: WorkCount::of(triangles * functions(degrees.0), triangles * functions(degrees.1)),
        }
    }

    /// The skipped shares as text, for example "pixels=61%".
    pub fn labels(&self) -> Vec<String> {
        let of = [("pixels", self.pixels), ("rows", self.rows), ("coefficients", self.coefficients)];
        of.iter().filter_map(|(name, work)| work.label(name)).collect()
    }
}

impl AddAssign for SkippedWork {
    fn add_assign(&mut self, other: Self) {
        self.pixels += other.pixels;
        self.rows += other.rows;
        self.coefficients += other.coefficients;
    }
}
