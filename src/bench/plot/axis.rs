//! Axes, and the points on them.

use plotters::coord::combinators::{LogCoord, WithKeyPoints};
use plotters::prelude::*;

/// A value at a place on the x axis, with the name of its line or dot.
#[derive(Debug, Clone, PartialEq)]
pub struct PlotPoint {
    /// The line that it is on, or the label of the dot.
    pub name: String,
    /// Place on the x axis.
    pub x: f64,
    /// Value.
    pub y: f64,
}

/// A logarithmic axis, with ticks at the powers of ten and between them where these would be fewer than three.
pub(super) fn log_axis(low: f64, high: f64) -> WithKeyPoints<LogCoord<f64>> {
    let decades = low.log10().floor() as i32..=high.log10().ceil() as i32;
    let ticks = |steps: &'static [f64]| -> Vec<f64> {
        let all = decades.clone().flat_map(|power| steps.iter().map(move |step| step * 10f64.powi(power)));
        all.filter(|tick| (low..=high).contains(tick)).collect()
    };
    let all = TICKS.iter().map(|steps| ticks(steps));
    let ticks = all.reduce(|coarse, fine| if coarse.len() < 3 { fine } else { coarse }).unwrap_or_default();
    (low..high).log_scale().with_key_points(ticks)
}

/// Ticks within a decade, from coarse to fine.
const TICKS: [&[f64]; 4] = [
    &[1.0],
    &[1.0, 2.0, 5.0],
    &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0],
    &[1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.5, 3.0],
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logarithmic_axes_have_three_ticks_however_short_they_are() {
        let ticks = |low, high| log_axis(low, high).bold_points().to_vec();
        assert_eq!(ticks(0.5, 2e4), [1.0, 10.0, 100.0, 1000.0, 10_000.0]);
        assert_eq!(ticks(0.9, 11.0), [1.0, 2.0, 5.0, 10.0]);
        assert!(ticks(1.1, 3.1).len() >= 3 && ticks(0.0011, 0.0017).len() >= 3);
    }
}
