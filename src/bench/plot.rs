//! Plots of benchmarks as SVG.

use crate::error::{Error, Result};
use plotters::coord::Shift;
use plotters::prelude::*;
use std::path::Path;

/// A value at a place on the x axis, with the name of its line or dot.
#[derive(Debug, Clone, Copy)]
pub struct PlotPoint<'a> {
    /// The line that it is on, or the label of the dot.
    pub name: &'a str,
    /// Place on the x axis.
    pub x: f64,
    /// Value.
    pub y: f64,
}

/// A chart: its title and what it shows.
pub type Panel<'a> = (&'a str, Vec<PlotPoint<'a>>);

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

/// One chart: values against triangles, one line per name.
fn line_chart(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    title: &str,
    points: &[PlotPoint<'_>],
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
        .build_cartesian_2d((x0..x1).log_scale(), (y0..y1).log_scale())
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
        if !names.contains(&point.name) {
            names.push(point.name);
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

/// 20000 as "20k", 0.5 as "0.5", 12 as "12".
fn short(value: f64) -> String {
    match value.abs() {
        size if size >= 1e6 => format!("{}M", (value * 1e-4).round() * 1e-2),
        size if size >= 1e4 => format!("{}k", (value * 1e-1).round() * 1e-2),
        _ => format!("{}", (value * 1e3).round() * 1e-3),
    }
}

/// One chart: the PSNR of every dot.
fn dot_chart(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    title: &str,
    points: &[PlotPoint<'_>],
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
    let mut taken: Vec<[i32; 4]> = Vec::new();
    for (i, point) in points.iter().enumerate() {
        let (at, color) = ((point.x, point.y), Palette99::pick(i).to_rgba());
        let (px, py) = chart.backend_coord(&at);
        let [dx, dy] = free_offset(&taken, [px, py], point.name.len() as i32 * LETTER[0]);
        taken.push([px + dx, py + dy, point.name.len() as i32 * LETTER[0], LETTER[1]]);
        let label = Text::new(point.name.to_owned(), (dx, dy), ("sans-serif", 12).into_font());
        let dot = EmptyElement::at(at) + Circle::new((0, 0), 4, color.filled()) + label;
        chart.draw_series([dot]).map_err(|e| e.to_string())?;
    }
    Ok(())
}

/// Width and height of a letter of a label, px.
const LETTER: [i32; 2] = [7, 13];

/// Offset from its dot at which a label of this width does not overlap those `taken` (x, y, width, height), px.
fn free_offset(taken: &[[i32; 4]], dot: [i32; 2], width: i32) -> [i32; 2] {
    let clear = |dy: i32| {
        let [x, y] = [dot[0] + 7, dot[1] + dy];
        !taken.iter().any(|t| x < t[0] + t[2] && t[0] < x + width && y < t[1] + t[3] && t[1] < y + LETTER[1])
    };
    let rows = (0..40).map(|i: i32| LETTER[1] * (if i % 2 == 0 { i / 2 } else { -(i + 1) / 2 }) - 6);
    [7, rows.into_iter().find(|dy| clear(*dy)).unwrap_or(-6)]
}
