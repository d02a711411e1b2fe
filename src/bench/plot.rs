//! Plots of benchmark rows as SVG.

use super::bake::BakeRow;
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
        panel(&left, "CPU seconds", rows, |r| r.cpu_seconds).map_err(bad)?;
        panel(&right, "peak memory, MB", rows, |r| r.peak_bytes as f64 * 1e-6).map_err(bad)?;
    }
    std::fs::write(path, svg).map_err(|e| Error::io(path, e))
}

/// One chart: `value` of every case against triangles.
fn panel(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    title: &str,
    rows: &[BakeRow],
    value: fn(&BakeRow) -> f64,
) -> std::result::Result<(), String> {
    let range = |values: Vec<f64>| {
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(0.0, f64::max);
        (low.max(1e-4) * 0.8, high.max(1e-3) * 1.25)
    };
    let (x0, x1) = range(rows.iter().map(|r| r.triangles as f64).collect());
    let (y0, y1) = range(rows.iter().map(value).collect());
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", 18))
        .margin(12)
        .x_label_area_size(36)
        .y_label_area_size(56)
        .build_cartesian_2d((x0..x1).log_scale(), (y0..y1).log_scale())
        .map_err(|e| e.to_string())?;
    chart.configure_mesh().x_desc("triangles").light_line_style(WHITE).draw().map_err(|e| e.to_string())?;
    let mut cases: Vec<&str> = Vec::new();
    for row in rows {
        if !cases.contains(&row.case.as_str()) {
            cases.push(&row.case);
        }
    }
    for (i, case) in cases.iter().enumerate() {
        let style = Palette99::pick(i).stroke_width(2);
        let points: Vec<(f64, f64)> =
            rows.iter().filter(|r| r.case == *case).map(|r| (r.triangles as f64, value(r))).collect();
        chart
            .draw_series(LineSeries::new(points, style).point_size(3))
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
