//! A round's measurements of every triangle, summed from many threads.

use std::sync::atomic::{AtomicI64, Ordering::Relaxed};

/// Units per squared difference in integer sums. Integers, because their sums do not depend on the order.
pub(super) const UNITS: f64 = (1u64 << 24) as f64;

/// Measurements of all faces.
pub(super) struct Found {
    pub(super) rows: Vec<FaceRow>,
    /// Squared error of all samples.
    pub(super) error: f64,
    /// Samples, by weight.
    pub(super) weight: f64,
}

/// Measurements of a face.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct FoundFace {
    /// Samples that show it.
    pub(super) samples: f64,
    /// Sum of the pictures' sRGB-encoded colours there.
    pub(super) rgb: [f64; 3],
    /// Sum of the squared errors there.
    pub(super) error: f64,
    /// Change of the squared error without the face.
    pub(super) removing: f64,
    /// Change of the squared error when the face moves.
    pub(super) moving: f64,
}

impl FoundFace {
    /// The pictures are matched better without the face.
    pub(super) fn is_harmful(&self) -> bool {
        self.removing < 0.0
    }
}

impl Found {
    /// Nothing yet.
    pub(super) fn new(faces: usize) -> Self {
        Self { rows: (0..faces).map(|_| FaceRow::default()).collect(), error: 0.0, weight: 0.0 }
    }

    /// Faces it knows.
    pub(super) fn len(&self) -> usize {
        self.rows.len()
    }

    /// About one face.
    pub(super) fn face(&self, face: usize) -> FoundFace {
        let [samples, r, g, b, error, removing, moving, _] =
            self.rows[face].0.each_ref().map(|sum| sum.load(Relaxed) as f64 / UNITS);
        FoundFace { samples, rgb: [r, g, b], error, removing, moving }
    }

    /// PSNR of the scene as drawn, dB, if there were pictures.
    pub(super) fn psnr(&self) -> Option<f64> {
        let mse = self.error / (3.0 * self.weight);
        (self.weight > 0.0).then(|| -10.0 * mse.max(1e-10).log10())
    }
}

/// The sums of one face, a cache line.
#[derive(Debug, Default)]
#[repr(align(64))]
pub(super) struct FaceRow([AtomicI64; 8]);

pub(super) const COUNT: usize = 0;
pub(super) const RGB: usize = 1;
pub(super) const ERROR: usize = 4;
pub(super) const REMOVING: usize = 5;
pub(super) const MOVING: usize = 6;

impl FaceRow {
    #[inline(always)]
    pub(super) fn add(&self, which: usize, value: f32) {
        add(&self.0[which], value.into());
    }
}

#[inline(always)]
pub(super) fn add(sum: &AtomicI64, value: f64) {
    sum.fetch_add((value * UNITS) as i64, Relaxed);
}
