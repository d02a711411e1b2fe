//! Promises of the rasterisers and the files, in numbers: the one table, which
//! `trisplat-bench stress` checks and docs/numerics.md repeats.

use super::axes::Axis;

/// The range of an axis on which the promises of accuracy hold, all axes at once.
pub(super) fn domain(axis: Axis) -> (f64, f64) {
    let row = axis.row();
    match axis {
        Axis::Scale => (row.least, row.most),
        Axis::Distance => (1.0, 10.0),
        Axis::Aspect => (1.0, 10.0),
        Axis::Inradius => (0.5, 100.0),
        Axis::Sigma => (1e-2, 10.0),
        Axis::Opacity => (0.05, 1.0),
        Axis::DepthRatio => (1.0, 1e4),
        Axis::Focal => (4.0, 1e3),
        Axis::Behind => (0.0, 0.45),
        Axis::Gap => (1e-3, 1.0),
        Axis::Layers => (1.0, row.most_in_pairs),
        Axis::Sh => (1e-3, 10.0),
    }
}

/// Measured quantity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Promise {
    /// 99.9% of the values of soft frames: error relative to 1 or to the largest sum of magnitudes
    /// in a colour.
    Frames,
    /// The largest such error of a case: single precision may take a pixel to the other side of a
    /// jump, but rarely.
    WorstFrame,
    /// 99.9% of the entries of gradients: error relative to the largest entry of the triangle's
    /// group (vertices, opacity, σ, SH), or to 2% of the largest of all triangles.
    Gradients,
    /// Numbers of a case's frame and gradients that are not finite, gradients that were dropped for
    /// it included.
    NonFinite,
    /// Samples of a case on which the solid rasteriser shows a face that it cannot, or misses one.
    SolidSamples,
    /// Positions read back from a GLB, plain and quantised: error in half steps of the format.
    StoredPositions,
    /// Triangles of a case, made opaque, that a bake loses or moves.
    BakedTriangles,
    /// Numbers of a bake of a soft case that are not finite.
    BakedNonFinite,
    /// Time of the soft rasteriser, forward and backward, over that of the ordinary case and its
    /// layers.
    Time,
}

/// Cases on which a promise holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum On {
    /// Cases whose values lie in [`domain`].
    Domain,
    /// All of them, to the ends of the axes, whose triangles are no longer than [`REACH`] times
    /// their depth.
    Reach,
    /// All of them, to the ends of the axes.
    Everything,
}

/// Longest side of a triangle over its depth, up to which the solid rasteriser's promise holds: its
/// corners' depths are differences of coordinates of that size in single precision.
pub(super) const REACH: f64 = 100.0;

/// A row of the table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PromiseRow {
    /// Measured quantity.
    pub(super) promise: Promise,
    /// Its name in reports.
    pub(super) name: &'static str,
    /// Cases for which it holds.
    pub(super) on: On,
    /// The largest value that is no failure.
    pub(super) at_most: f64,
    /// The share of the cases that may fail; of `Frames` and `Gradients` that of the numbers.
    pub(super) rate: f64,
}

/// Largest error of a value that nobody sees: half a level of 8 bits.
const HALF_A_LEVEL: f64 = 1.96e-3;

/// The share of the cases of the domain in which some pixel may fall to the other side of a jump.
const WORST_FRAME_RATE: f64 = 1e-4;

/// All promises.
pub(super) const PROMISES: [PromiseRow; 9] = [
    row(Promise::Frames, "frames", On::Domain, 1e-4, 1e-3),
    row(Promise::WorstFrame, "worst_frame", On::Domain, HALF_A_LEVEL, WORST_FRAME_RATE),
    row(Promise::Gradients, "gradients", On::Domain, 1e-3, 1e-3),
    row(Promise::NonFinite, "non_finite", On::Everything, 0.0, 0.0),
    row(Promise::SolidSamples, "solid_samples", On::Reach, 0.0, 1e-5),
    row(Promise::StoredPositions, "stored_positions", On::Everything, 1.0, 0.0),
    row(Promise::BakedTriangles, "baked_triangles", On::Everything, 0.0, 1e-4),
    row(Promise::BakedNonFinite, "baked_non_finite", On::Everything, 0.0, 0.0),
    row(Promise::Time, "time", On::Everything, 4.0, 0.0),
];

const fn row(promise: Promise, name: &'static str, on: On, at_most: f64, rate: f64) -> PromiseRow {
    PromiseRow { promise, name, on, at_most, rate }
}
