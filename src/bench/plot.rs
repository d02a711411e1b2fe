//! Plots of benchmarks as SVG.

mod fronts;
mod labels;

pub use fronts::DotPanel;

use crate::error::{Error, Result};
use labels::{Rect, place};
use plotters::coord::Shift;
use plotters::coord::combinators::{LogCoord, WithKeyPoints};
use plotters::prelude::*;
use std::path::Path;

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

/// A chart: its title and what it shows.
pub type Panel<'a> = (&'a str, Vec<PlotPoint>);

/// Writes two charts of values against triangles side by side: one line per name, both axes logarithmic.
pub fn lines(path: &Path, panels: &[Panel<'_>; 2]) -> Result<()> {
    let bad = |e: String| Error::unsupported(path, format!("cannot be drawn: {e}"));
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (1100, 460)).into_drawing_area();
        area.fill(&WHITE).map_err(|e| bad(e.to_string()))?;
        let (left, right) = area.split_horizontally(550);
        for (area, (title, points)) in [left, right].iter().zip(panels) {
            line_chart(area, title, points).map_err(bad)?;
        }
    }
    std::fs::write(path, svg).map_err(|e| Error::io(path, e))
}

/// Writes charts of PSNR side by side, each against what its title says: one labelled dot per point.
pub fn dots(path: &Path, panels: &[Panel<'_>; 3]) -> Result<()> {
    let bad = |e: String| Error::unsupported(path, format!("cannot be drawn: {e}"));
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (1350, 420)).into_drawing_area();
        area.fill(&WHITE).map_err(|e| bad(e.to_string()))?;
        for (area, (title, points)) in area.split_evenly((1, 3)).iter().zip(panels) {
            dot_chart(area, title, points).map_err(bad)?;
        }
    }
    std::fs::write(path, svg).map_err(|e| Error::io(path, e))
}

/// Writes charts of settings, two side by side: what a setting costs against how close it comes.
pub fn fronts(path: &Path, panels: &[DotPanel]) -> Result<()> {
    let bad = |e: String| Error::unsupported(path, format!("cannot be drawn: {e}"));
    let rows = panels.len().div_ceil(2).max(1);
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (1200, 440 * rows as u32)).into_drawing_area();
        area.fill(&WHITE).map_err(|e| bad(e.to_string()))?;
        for (area, panel) in area.split_evenly((rows, 2)).iter().zip(panels) {
            fronts::chart(area, panel).map_err(bad)?;
        }
    }
    std::fs::write(path, svg).map_err(|e| Error::io(path, e))
}

/// One chart: values against triangles, one line per name.
fn line_chart(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    title: &str,
    points: &[PlotPoint],
) -> std::result::Result<(), String> {
    let range = |values: Vec<f64>| {
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(0.0, f64::max);
        (low.max(1e-4) * 0.8, high.max(1e-3) * 1.25)
    };
    let (x0, x1) = range(points.iter().map(|p| p.x).collect());
    let (y0, y1) = range(points.iter().map(|p| p.y).collect());
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", 18))
        .margin(12)
        .x_label_area_size(36)
        .y_label_area_size(56)
        .build_cartesian_2d(log_axis(x0, x1), log_axis(y0, y1))
        .map_err(|e| e.to_string())?;
    chart
        .configure_mesh()
        .x_desc("triangles")
        .x_label_formatter(&|v| short(*v))
        .y_label_formatter(&|v| short(*v))
        .light_line_style(WHITE)
        .draw()
        .map_err(|e| e.to_string())?;
    let mut names: Vec<&str> = Vec::new();
    for point in points {
        if !names.contains(&point.name.as_str()) {
            names.push(&point.name);
        }
    }
    for (i, name) in names.iter().enumerate() {
        let style = Palette99::pick(i).stroke_width(2);
        let line: Vec<(f64, f64)> = points.iter().filter(|p| p.name == *name).map(|p| (p.x, p.y)).collect();
        chart
            .draw_series(LineSeries::new(line, style).point_size(3))
            .map_err(|e| e.to_string())?
            .label(*name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], style));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK.mix(0.3))
        .draw()
        .map_err(|e| e.to_string())
}

/// A logarithmic axis, with ticks at the powers of ten and between them where these would be fewer than three.
fn log_axis(low: f64, high: f64) -> WithKeyPoints<LogCoord<f64>> {
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

/// One chart: the PSNR of every dot.
fn dot_chart(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    title: &str,
    points: &[PlotPoint],
) -> std::result::Result<(), String> {
    let least = |values: &mut dyn Iterator<Item = f64>| values.fold(f64::INFINITY, f64::min);
    let most = |values: &mut dyn Iterator<Item = f64>| values.fold(f64::NEG_INFINITY, f64::max);
    let right = most(&mut points.iter().map(|p| p.x)).max(1e-6) * 1.25;
    let (low, high) = (least(&mut points.iter().map(|p| p.y)), most(&mut points.iter().map(|p| p.y)));
    let mut chart = ChartBuilder::on(area)
        .margin(12)
        .x_label_area_size(36)
        .y_label_area_size(48)
        .build_cartesian_2d(0.0..right, (low - 0.5)..(high + 0.5))
        .map_err(|e| e.to_string())?;
    chart
        .configure_mesh()
        .x_desc(title)
        .y_desc("PSNR, dB")
        .x_label_formatter(&|v| short(*v))
        .y_label_formatter(&|v| short(*v))
        .light_line_style(WHITE)
        .draw()
        .map_err(|e| e.to_string())?;
    let names: Vec<&str> = points.iter().map(|p| p.name.as_str()).collect();
    let dots: Vec<[i32; 2]> = points.iter().map(|p| chart.backend_coord(&(p.x, p.y)).into()).collect();
    let (across, down) = chart.plotting_area().get_pixel_range();
    let frame = Rect { at: [across.start, down.start], size: [across.len() as i32, down.len() as i32] };
    let labels = place(&names, &dots, frame);
    for (i, ((point, dot), label)) in points.iter().zip(&dots).zip(labels).enumerate() {
        let (at, color) = ((point.x, point.y), Palette99::pick(i).to_rgba());
        let mark = EmptyElement::at(at) + Circle::new((0, 0), 4, color.filled());
        chart.draw_series([mark]).map_err(|e| e.to_string())?;
        if let Some(Rect { at: [x, y], .. }) = label {
            let text =
                Text::new(point.name.clone(), (x - dot[0], y - dot[1]), ("sans-serif", 12).into_font());
            chart.draw_series([EmptyElement::at(at) + text]).map_err(|e| e.to_string())?;
        }
    }
    Ok(())
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

    #[test]
    fn every_chart_is_written() {
        let point = |name: &str, x: f64, y: f64| PlotPoint { name: name.into(), x, y };
        let panel = DotPanel {
            title: "bake".into(),
            front: vec![point("steps=500", 1.0, 20.0), point("steps=2000", 20_000.0, 30.0)],
            default: Some(point("default", 3.0, 24.0)),
            others: vec![point("x", 4.0, f64::NAN), point("y", 5.0, 23.0)],
            ..DotPanel::default()
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("fronts.svg");
        fronts(&path, &[panel.clone(), DotPanel::default(), panel]).unwrap();
        let svg = std::fs::read_to_string(&path).unwrap();
        // A front from 1 to 20,000 seconds has a tick per decade.
        for text in ["steps=500", "steps=2000", "default", "10k", "100", "10"] {
            assert!(svg.lines().any(|line| line == text), "{text}");
        }
    }
}
