//! The curve of a run as a picture: PSNR and triangles over CPU seconds.

use std::fmt::Write as _;
use trisplat_dataset::ShrunkSize;
use trisplat_scene::math::short::short;
use trisplat_train::TrainSample;

/// Width and height of the picture, px.
const SIZE: [f64; 2] = [900.0, 480.0];
/// Left, top, right and bottom edge of the chart, px.
const CHART: [f64; 4] = [60.0, 14.0, 836.0, 432.0];
/// Steps between the numbers of an axis.
const TICKS: u32 = 5;

/// Colours of triangles, training photos and held-out photos.
const COLORS: [&str; 3] = ["#aaaaaa", "#5a8cdc", "#c84628"];

/// A point: CPU seconds and a value.
type Point = (f64, f64);

/// The curve as SVG.
pub(super) fn svg(samples: &[TrainSample]) -> String {
    let points = |value: &dyn Fn(&TrainSample) -> Option<f64>| -> Vec<Point> {
        samples.iter().filter_map(|s| value(s).filter(|v| v.is_finite()).map(|v| (s.cpu_secs, v))).collect()
    };
    let (train, test) = (points(&|s| Some(s.psnr)), points(&|s| s.test_psnr));
    let triangles = points(&|s| Some(s.triangles as f64));
    let end = samples.iter().map(|s| s.cpu_secs).fold(1e-3, f64::max);
    let decibels = value_range(train.iter().chain(&test));
    let counts = (0.0, 1.05 * value_range(triangles.iter()).1);
    let place = |(x, y): Point, (low, high): (f64, f64)| {
        let [left, top, right, bottom] = CHART;
        (left + (right - left) * x / end, bottom - (bottom - top) * (y - low) / (high - low))
    };

    let [width, height] = SIZE;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
    );
    axes(&mut svg, end, decibels, counts);
    for ((points, range), color) in
        [(&triangles, counts), (&train, decibels), (&test, decibels)].into_iter().zip(COLORS)
    {
        let places: String =
            points.iter().map(|p| place(*p, range)).fold(String::new(), |mut all, (x, y)| {
                let _ = write!(all, "{x:.1},{y:.1} ");
                all
            });
        let _ = writeln!(
            svg,
            "<polyline points=\"{places}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.5\"/>"
        );
    }
    for (x, y) in test.iter().map(|p| place(*p, decibels)) {
        let _ = writeln!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" fill=\"{}\"/>", COLORS[2]);
    }
    let held_out = format!("held out{}", ShrunkSize::beside(samples.iter().find_map(|s| s.test_size)));
    for (i, name) in ["triangles", "training photos", &held_out].into_iter().enumerate() {
        let y = CHART[3] - 46.0 + 16.0 * i as f64;
        text(&mut svg, (CHART[2] - 8.0, y), "end", COLORS[i], name);
    }
    svg.push_str("</svg>\n");
    svg
}

/// The frame, the numbers along it and what they are.
fn axes(svg: &mut String, end: f64, decibels: (f64, f64), counts: (f64, f64)) {
    let [left, top, right, bottom] = CHART;
    let (width, height) = (right - left, bottom - top);
    let _ = writeln!(
        svg,
        "<rect x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\" fill=\"none\" stroke=\"black\"/>"
    );
    for i in 0..=TICKS {
        let share = f64::from(i) / f64::from(TICKS);
        let between = |(low, high): (f64, f64)| short(low + (high - low) * share);
        let y = bottom - height * share + 4.0;
        text(svg, (left + width * share, bottom + 18.0), "middle", "black", &between((0.0, end)));
        text(svg, (left - 6.0, y), "end", "black", &between(decibels));
        text(svg, (right + 6.0, y), "start", "black", &between(counts));
    }
    text(svg, ((left + right) / 2.0, bottom + 36.0), "middle", "black", "CPU seconds");
    text(svg, (left + 8.0, top + 18.0), "start", "black", "PSNR, dB");
    text(svg, (right - 8.0, top + 18.0), "end", "black", "triangles");
}

fn text(svg: &mut String, (x, y): Point, anchor: &str, color: &str, text: &str) {
    let _ = writeln!(
        svg,
        "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" fill=\"{color}\">{text}</text>"
    );
}

fn value_range<'a>(points: impl Iterator<Item = &'a Point>) -> (f64, f64) {
    let (low, high) =
        points.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| (low.min(p.1), high.max(p.1)));
    if low < high { (low.floor(), high.ceil()) } else { (0.0, 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_of_any_length_is_a_picture() {
        let sample = |i: u64| TrainSample {
            step: i,
            triangles: 100 * i,
            psnr: 10.0 + i as f64,
            cpu_secs: i as f64,
            test_psnr: i.is_multiple_of(2).then_some(9.0),
            ..TrainSample::default()
        };
        for n in [0, 1, 5] {
            let samples: Vec<TrainSample> = (0..n).map(sample).collect();
            let svg = svg(&samples);
            assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n"), "{n}");
            // Held out are every second sample, and all lie within the picture.
            assert_eq!(svg.matches("<circle").count() as u64, n.div_ceil(2));
            let places = svg.split("points=\"").skip(1).flat_map(|rest| rest.split('"').next());
            for place in places.flat_map(|places| places.split([' ', ','])).filter(|p| !p.is_empty()) {
                assert!((0.0..=SIZE[0]).contains(&place.parse::<f64>().unwrap()), "{place} of {n}");
            }
        }
    }
}
