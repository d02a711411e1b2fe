//! Axes, and the points on them.

use plotters::coord::combinators::{LogCoord, WithKeyPoints};
use plotters::prelude::*;
use trisplat_scene::math::short::short;

/// A value at a place on the x axis, with the name of its line or dot.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PlotPoint {
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

/// Labels of a linear axis from `low` to `high`: with as many digits as tell neighbours apart.
pub(super) fn labels(low: f64, high: f64) -> impl Fn(&f64) -> String {
    // Ticks are at least a fiftieth of the axis apart.
    let digits = (-((high - low) / 50.0).max(1e-12).log10().floor() as i32).clamp(0, 6) as usize;
    move |value| {
        let brief = short(*value);
        let exact = format!("{value:.digits$}");
        let exact =
            if exact.contains('.') { exact.trim_end_matches('0').trim_end_matches('.') } else { &exact };
        let is_same = brief.parse().is_ok_and(|brief: f64| (brief - value).abs() < (high - low) / 1e3);
        if is_same || value.abs() >= 9995.0 && digits == 0 {
            brief
        } else if exact == "-0" {
            "0".into()
        } else {
            exact.to_owned()
        }
    }
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

    #[test]
    fn no_label_of_an_axis_is_there_twice() {
        use plotters::coord::ranged1d::{BoldPoints, Ranged};
        use plotters::coord::types::RangedCoordf64;
        for (low, high) in [
            (28.2, 28.31),
            (19.4, 30.2),
            (27.0, 27.21),
            (0.0, 1.0),
            (-0.02, 0.03),
            (99.95, 100.1),
            (0.0, 25_000.0),
        ] {
            let axis: RangedCoordf64 = (low..high).into();
            let texts: Vec<String> = axis.key_points(BoldPoints(11)).iter().map(labels(low, high)).collect();
            let mut once = texts.clone();
            once.sort();
            once.dedup();
            assert!(texts.len() >= 4 && once.len() == texts.len(), "{low} to {high}: {texts:?}");
        }
        for (low, high) in
            [(0.5, 2e4), (0.9, 11.0), (1.1, 3.1), (0.0011, 0.0017), (10.1, 10.4), (103.0, 118.0)]
        {
            let texts: Vec<String> =
                log_axis(low, high).bold_points().iter().map(|tick| short(*tick)).collect();
            let mut once = texts.clone();
            once.sort();
            once.dedup();
            assert!(once.len() == texts.len(), "{low} to {high}: {texts:?}");
        }
    }
}
