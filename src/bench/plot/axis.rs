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

/// A number as axes show it: three digits, then k, M or G. 20000 as "20k", 1234567 as "1.23M", 0.5 as "0.5".
pub fn short(value: f64) -> String {
    let (unit, letter) = match value.abs() {
        size if size >= 0.9995e9 => (1e9, "G"),
        size if size >= 0.9995e6 => (1e6, "M"),
        size if size >= 9995.0 => (1e3, "k"),
        _ => (1.0, ""),
    };
    let scaled = value / unit;
    let digits = (2 - scaled.abs().max(1e-4).log10().floor() as i32).clamp(0, 5) as usize;
    let text = format!("{scaled:.digits$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    format!("{}{letter}", if text == "-0" { "0" } else { text })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_on_axes_are_short() {
        let wants = [
            (0.0, "0"),
            (0.5, "0.5"),
            (0.00123, "0.00123"),
            (12.0, "12"),
            (28.25, "28.2"),
            (999.4, "999"),
            (5000.0, "5000"),
            (10_000.0, "10k"),
            (150_000.0, "150k"),
            (999_900.0, "1M"),
            (1_234_567.0, "1.23M"),
            (-20_000.0, "-20k"),
            (3e9, "3G"),
        ];
        for (value, text) in wants {
            assert_eq!(short(value), text);
        }
    }

    #[test]
    fn logarithmic_axes_have_three_ticks_however_short_they_are() {
        let ticks = |low, high| log_axis(low, high).bold_points().to_vec();
        assert_eq!(ticks(0.5, 2e4), [1.0, 10.0, 100.0, 1000.0, 10_000.0]);
        assert_eq!(ticks(0.9, 11.0), [1.0, 2.0, 5.0, 10.0]);
        assert!(ticks(1.1, 3.1).len() >= 3 && ticks(0.0011, 0.0017).len() >= 3);
    }
}
