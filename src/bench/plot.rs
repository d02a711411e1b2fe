//! Plots of benchmark rows as SVG.

use super::bake::BakeRow;
use super::fidelity::FidelityRow;
use crate::error::{Error, Result};
use plotters::coord::Shift;
use plotters::prelude::*;
use std::path::Path;

/// CPU seconds and peak memory against triangles, a line a case, both axes logarithmic.
pub fn cost(path: &Path, rows: &[BakeRow]) -> Result<()> {
    let bad = |e: String| Error::unsupported(path, format!("cannot be drawn: {e}"));
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (1100, 460)).into_drawing_area();
        area.fill(&WHITE).map_err(|e| bad(e.to_string()))?;
        let (left, right) = area.split_horizontally(550);
        let of = |value: fn(&BakeRow) -> f64| -> Vec<Point<'_>> {
            rows.iter().map(|r| (r.case.as_str(), r.triangles as f64, value(r))).collect()
        };
        panel(&left, "CPU seconds", &of(|r| r.cpu_seconds)).map_err(bad)?;
        panel(&right, "peak memory, MB", &of(|r| r.peak_bytes as f64 * 1e-6)).map_err(bad)?;
    }
    std::fs::write(path, svg).map_err(|e| Error::io(path, e))
}

/// Milliseconds a frame against triangles, a line a case and size, both axes logarithmic.
#[cfg(feature = "gpu")]
pub fn frames(path: &Path, rows: &[super::fps::FpsRow]) -> Result<()> {
    let bad = |e: String| Error::unsupported(path, format!("cannot be drawn: {e}"));
    let names: Vec<String> = rows.iter().map(|r| format!("{}, {}x{}", r.case, r.width, r.height)).collect();
    let points = |value: fn(&super::fps::FpsRow) -> f64| -> Vec<Point<'_>> {
        rows.iter().zip(&names).map(|(r, name)| (name.as_str(), r.triangles as f64, value(r))).collect()
    };
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (1100, 460)).into_drawing_area();
        area.fill(&WHITE).map_err(|e| bad(e.to_string()))?;
        let (left, right) = area.split_horizontally(550);
        panel(&left, "ms a frame, median", &points(|r| r.cost.frame_ms)).map_err(bad)?;
        panel(&right, "processor ms a frame", &points(|r| r.cost.cpu_ms)).map_err(bad)?;
    }
    std::fs::write(path, svg).map_err(|e| Error::io(path, e))
}

/// Case, triangles and a value.
type Point<'a> = (&'a str, f64, f64);

/// One chart: values against triangles, a line a case.
fn panel(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    title: &str,
    points: &[Point<'_>],
) -> std::result::Result<(), String> {
    let range = |values: Vec<f64>| {
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(0.0, f64::max);
        (low.max(1e-4) * 0.8, high.max(1e-3) * 1.25)
    };
    let (x0, x1) = range(points.iter().map(|p| p.1).collect());
    let (y0, y1) = range(points.iter().map(|p| p.2).collect());
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
    let mut cases: Vec<&str> = Vec::new();
    for (case, ..) in points {
        if !cases.contains(case) {
            cases.push(case);
        }
    }
    for (i, case) in cases.iter().enumerate() {
        let style = Palette99::pick(i).stroke_width(2);
        let line: Vec<(f64, f64)> = points.iter().filter(|p| p.0 == *case).map(|p| (p.1, p.2)).collect();
        chart
            .draw_series(LineSeries::new(line, style).point_size(3))
            .map_err(|e| e.to_string())?
            .label(*case)
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

/// What a dot's place is read from: its name and value.
type Axis = (&'static str, fn(&FidelityRow) -> f64);

/// PSNR on held-out photos against triangles, bytes and seconds of the bake, a dot a case, at the highest
/// sampling.
pub fn fidelity(path: &Path, rows: &[FidelityRow]) -> Result<()> {
    let bad = |e: String| Error::unsupported(path, format!("cannot be drawn: {e}"));
    let highest = rows.iter().map(|r| r.ssaa).max().unwrap_or(1);
    let mut shown: Vec<&FidelityRow> = Vec::new();
    for row in rows.iter().filter(|r| r.ssaa == highest && r.case != "soft") {
        // A dot a case: its targets differ by less than a dot.
        if !shown.iter().any(|other| other.case == row.case) {
            shown.push(row);
        }
    }
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (1350, 420)).into_drawing_area();
        area.fill(&WHITE).map_err(|e| bad(e.to_string()))?;
        let parts = area.split_evenly((1, 3));
        let axes: [Axis; 3] = [
            ("thousand triangles", |r| r.triangles as f64 * 1e-3),
            ("megabytes", |r| r.bytes as f64 * 1e-6),
            ("seconds of baking", |r| r.bake_secs),
        ];
        for (part, (name, x)) in parts.iter().zip(axes) {
            dots(part, name, &shown, x).map_err(bad)?;
        }
    }
    std::fs::write(path, svg).map_err(|e| Error::io(path, e))
}

/// One chart: PSNR of every case against `x`.
fn dots(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    name: &str,
    rows: &[&FidelityRow],
    x: fn(&FidelityRow) -> f64,
) -> std::result::Result<(), String> {
    let least = |values: &mut dyn Iterator<Item = f64>| values.fold(f64::INFINITY, f64::min);
    let most = |values: &mut dyn Iterator<Item = f64>| values.fold(f64::NEG_INFINITY, f64::max);
    let right = most(&mut rows.iter().map(|r| x(r))).max(1e-6) * 1.25;
    let (low, high) = (least(&mut rows.iter().map(|r| r.psnr)), most(&mut rows.iter().map(|r| r.psnr)));
    let mut chart = ChartBuilder::on(area)
        .margin(12)
        .x_label_area_size(36)
        .y_label_area_size(48)
        .build_cartesian_2d(0.0..right, (low - 0.5)..(high + 0.5))
        .map_err(|e| e.to_string())?;
    chart
        .configure_mesh()
        .x_desc(name)
        .y_desc("PSNR, dB")
        .x_label_formatter(&|v| short(*v))
        .y_label_formatter(&|v| short(*v))
        .light_line_style(WHITE)
        .draw()
        .map_err(|e| e.to_string())?;
    let mut taken: Vec<[i32; 4]> = Vec::new();
    for (i, row) in rows.iter().enumerate() {
        let (at, color) = ((x(row), row.psnr), Palette99::pick(i).to_rgba());
        let (px, py) = chart.backend_coord(&at);
        let [dx, dy] = free(&taken, [px, py], row.case.len() as i32 * LETTER[0]);
        taken.push([px + dx, py + dy, row.case.len() as i32 * LETTER[0], LETTER[1]]);
        let label = Text::new(row.case.clone(), (dx, dy), ("sans-serif", 12).into_font());
        let dot = EmptyElement::at(at) + Circle::new((0, 0), 4, color.filled()) + label;
        chart.draw_series([dot]).map_err(|e| e.to_string())?;
    }
    Ok(())
}

/// Room a letter of a label takes, px.
const LETTER: [i32; 2] = [7, 13];

/// How far from its dot a label of this width stands clear of those that are `taken` (x, y, width, height), px.
fn free(taken: &[[i32; 4]], dot: [i32; 2], width: i32) -> [i32; 2] {
    let clear = |dy: i32| {
        let [x, y] = [dot[0] + 7, dot[1] + dy];
        !taken.iter().any(|t| x < t[0] + t[2] && t[0] < x + width && y < t[1] + t[3] && t[1] < y + LETTER[1])
    };
    let rows = (0..40).map(|i: i32| LETTER[1] * (if i % 2 == 0 { i / 2 } else { -(i + 1) / 2 }) - 6);
    [7, rows.into_iter().find(|dy| clear(*dy)).unwrap_or(-6)]
}
