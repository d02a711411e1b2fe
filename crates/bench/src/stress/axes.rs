//! Axes along which a case of the stress test is stretched, one table: name, range, ordinary value,
//! and application.

use serde::{Deserialize, Serialize};

/// An axis: the index into [`AXES`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Axis {
    /// Every coordinate, and the near plane, times this.
    Scale,
    /// Camera and triangles are moved this far from the origin, in units of the scene.
    Distance,
    /// Longest side over its height.
    Aspect,
    /// Inradius of the triangles, px.
    Inradius,
    /// Window exponent.
    Sigma,
    /// Opacity.
    Opacity,
    /// Depth of the farthest triangle over that of the nearest.
    DepthRatio,
    /// Focal length, px.
    Focal,
    /// One or two corners of every other triangle are moved to (1 - 2x) times their depth: 0.5 is
    /// the camera's plane.
    Behind,
    /// Triangles face the camera, each this share of its depth behind the one before; 1 is a random
    /// slant and depth.
    Gap,
    /// Triangles, all of them over the middle of the picture when there are more than eight. Alone,
    /// one case in [`DEEP_EVERY`] has more than a pair may have.
    Layers,
    /// Size of the SH coefficients, degrees 0 to 3.
    Sh,
}

/// A row of the table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct AxisRow {
    /// The axis.
    pub(super) axis: Axis,
    /// Its name.
    pub(super) name: &'static str,
    /// Smallest value.
    pub(super) least: f64,
    /// Largest value, when the axis is stretched alone.
    pub(super) most: f64,
    /// Largest value in all other cases: layers are costly.
    pub(super) most_in_pairs: f64,
    /// The value in a case that is not stretched along it.
    pub(super) ordinary: f64,
    /// True when values are spread evenly by their logarithm.
    pub(super) log: bool,
}

/// One in this many of the cases that are stretched along the layers alone goes to the end of the
/// axis: it costs as much as thousands of others.
pub(super) const DEEP_EVERY: u64 = 256;

/// Smallest opacity: the cutoff of the soft rasteriser.
const CUTOFF: f64 = 1.0 / 255.0;

const fn row(axis: Axis, name: &'static str, least: f64, most: f64, ordinary: f64) -> AxisRow {
    AxisRow { axis, name, least, most, most_in_pairs: most, ordinary, log: true }
}

/// All axes, in the order of [`Axis`].
pub(super) const AXES: [AxisRow; 12] = [
    row(Axis::Scale, "scale", 1e-30, 1e30, 1.0),
    row(Axis::Distance, "distance", 1.0, 1e7, 1.0),
    row(Axis::Aspect, "aspect", 1.0, 1e8, 2.0),
    row(Axis::Inradius, "inradius", 1e-4, 1e4, 3.0),
    row(Axis::Sigma, "sigma", 1e-4, 1e3, 1.0),
    row(Axis::Opacity, "opacity", CUTOFF, 1.0, 0.6),
    row(Axis::DepthRatio, "depth_ratio", 1.0, 1e7, 3.0),
    row(Axis::Focal, "focal", 1.0, 1e6, 16.0),
    AxisRow { log: false, ..row(Axis::Behind, "behind", 0.0, 1.0, 0.0) },
    row(Axis::Gap, "gap", 1e-9, 1.0, 1.0),
    AxisRow { most_in_pairs: 16.0, ..row(Axis::Layers, "layers", 1.0, 1e5, 4.0) },
    row(Axis::Sh, "sh", 1e-3, 1e6, 0.5),
];

impl Axis {
    /// Its row of the table.
    pub(super) fn row(self) -> &'static AxisRow {
        &AXES[self as usize]
    }
}

impl AxisRow {
    /// The value at `share` of the way from `from` to `to`; on log axes, interpolates the
    /// logarithm.
    pub(super) fn between(&self, from: f64, to: f64, share: f64) -> f64 {
        let value =
            if self.log { from * (to / from).powf(share) } else { from + (to - from) * share };
        value.clamp(from, to)
    }

    /// Share of the way from `from` to `to` at a value, in [0, 1]: the inverse of
    /// [`Self::between`].
    pub(super) fn share(&self, from: f64, to: f64, value: f64) -> f64 {
        let share = if self.log {
            (value / from).ln() / (to / from).ln()
        } else {
            (value - from) / (to - from)
        };
        if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stress_axes_are_in_order_and_hold_their_ordinary_values() {
        for (i, row) in AXES.iter().enumerate() {
            assert_eq!(row.axis as usize, i, "{}", row.name);
            assert_eq!(serde_json::to_value(row.axis).unwrap(), row.name);
            assert!(row.least <= row.ordinary && row.ordinary <= row.most_in_pairs, "{}", row.name);
            assert!(row.most_in_pairs <= row.most && (!row.log || row.least > 0.0), "{}", row.name);
            for share in [0.0, 0.3, 1.0] {
                let value = row.between(row.least, row.most, share);
                assert!(
                    (row.share(row.least, row.most, value) - share).abs() < 1e-9,
                    "{}",
                    row.name
                );
            }
        }
    }
}
