//! A step submitted to the card whose figures are not read yet.

use super::job::{COUNTS, Count};
use super::photos::PhotoSource;
use super::source::GROUP;
use super::step_buffers::StepCapacity;
use super::uniform::{SceneShape, StepPlan, StepUniform};
use crate::backend::{StepPhoto, StepStats};
use crate::schedule::StepParams;
use trisplat_gpu::readback::Readback;
use trisplat_raster::kernel::loss::Photometric;
use trisplat_raster::soft::tile_count;

/// Everything to make a step, once or repeatedly.
#[derive(Debug)]
pub(super) struct PendingStep {
    pub(super) plan: StepPlan,
    pub(super) step: StepUniform,
    /// The counts before the first pass.
    pub(super) counts: [u32; COUNTS],
    pub(super) photo: PhotoSource,
    /// Means over the scene are needed.
    pub(super) regularised: bool,
    /// Reads back the counts after the last pass.
    pub(super) readback: Readback,
    dssim: f64,
}

impl PendingStep {
    pub(super) fn new(
        plan: StepPlan,
        photo: &StepPhoto<'_>,
        source: PhotoSource,
        rates: &StepParams,
        shape: SceneShape,
        readback: Readback,
    ) -> Self {
        Self {
            step: StepUniform::new(&plan, photo, rates, shape),
            counts: first_counts(&plan, shape),
            photo: source,
            regularised: rates.beta_size > 0.0,
            readback,
            dssim: rates.dssim,
            plan,
        }
    }

    /// Its figures, from the counts after the last pass.
    pub(super) fn stats(&self, counts: &[u32]) -> StepStats {
        let sum = |count: Count| f64::from(f32::from_bits(counts[count as usize]));
        let values = 3.0 * f64::from(self.plan.photo_pixels().max(1));
        let means = Photometric {
            l1: sum(Count::LossL1) / values,
            ssim: sum(Count::LossSsim) / values,
            mse: sum(Count::LossMse) / values,
        };
        StepStats {
            loss: means.value(self.dssim) + sum(Count::LossGeometry),
            mse: means.mse,
            dropped: counts[Count::Dropped as usize].into(),
            touched: counts[Count::Touched as usize].into(),
        }
    }
}

/// The counts before the first pass.
pub(super) fn first_counts(plan: &StepPlan, shape: SceneShape) -> [u32; COUNTS] {
    let mut counts = [0u32; COUNTS];
    for (count, value) in [
        (Count::Triangles1, shape.triangles + 1),
        (Count::Pixels1, plan.frame_pixels() + 1),
        (Count::PhotoTiles, tile_count(plan.photo).element_product()),
        (Count::SceneGroups, shape.triangles.div_ceil(GROUP)),
        (Count::FrameGroups, plan.frame_pixels().div_ceil(GROUP)),
    ] {
        counts[count as usize] = value;
    }
    counts
}

/// The capacity that a step lacked, with a margin; such a step did nothing.
pub(super) fn missing_capacity(counts: &[u32]) -> Option<StepCapacity> {
    let wanted = |count: Count| {
        let n = counts[count as usize];
        n.saturating_add(n / 4)
    };
    let more = StepCapacity {
        splats: wanted(Count::WantedSplats),
        pairs: wanted(Count::WantedPairs),
        layers: wanted(Count::WantedLayers),
        ..StepCapacity::default()
    };
    (more != StepCapacity::default()).then_some(more)
}
