//! Plots of benchmarks as SVG.

mod axis;
mod bands;
mod heat;
mod labels;

pub(crate) use axis::PlotPoint;
pub(crate) use bands::{BandPanel, BandPoint};
pub(crate) use heat::HeatMap;

use self::labels::{Rect, place};
use axis::{labels, log_axis};
use plotters::coord::Shift;
use plotters::prelude::*;
use std::path::Path;
use trisplat_scene::{Error, Result, math::short::short};

/// A chart: its title and what it shows.
pub(crate) type Panel<'a> = (&'a str, Vec<PlotPoint>);

/// Writes two charts of values against triangles side by side: one line per name, both axes logarithmic.
pub(crate) fn lines(path: &Path, panels: &[Panel<'_>; 2]) -> Result<()> {
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
pub(crate) fn dots(path: &Path, panels: &[Panel<'_>; 3]) -> Result<()> {
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

/// Writes a chart of lines with bands: what something costs against how good it is.
pub(crate) fn bands(path: &Path, panel: &BandPanel) -> Result<()> {
    let bad = |e: String| Error::unsupported(path, format!("cannot be drawn: {e}"));
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (800, 460)).into_drawing_area();
        area.fill(&WHITE).map_err(|e| bad(e.to_string()))?;
        bands::chart(&area, panel).map_err(|e| bad(e.to_string()))?;
    }
    std::fs::write(path, svg).map_err(|e| Error::io(path, e))
}

/// Writes two heat maps side by side.
pub(crate) fn heat_maps(path: &Path, maps: &[HeatMap; 2]) -> Result<()> {
    let bad = |e: String| Error::unsupported(path, format!("cannot be drawn: {e}"));
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (1240, 660)).into_drawing_area();
        area.fill(&WHITE).map_err(|e| bad(e.to_string()))?;
        for (area, map) in area.split_evenly((1, 2)).iter().zip(maps) {
            heat::chart(area, map).map_err(bad)?;
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
        .y_label_formatter(&labels(low - 0.5, high + 0.5))
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
    fn heat_maps_are_written() {
        let names = ["scale", "focal"].map(str::to_owned).to_vec();
        let map = HeatMap { title: "frames".into(), names, cells: vec![(0, 0, 2e-5), (1, 0, 0.0)] };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("heat.svg");
        heat_maps(&path, &[map, HeatMap::default()]).unwrap();
        let svg = std::fs::read_to_string(&path).unwrap();
        for text in ["frames", "scale", "focal", "2e-5", "0"] {
            assert!(svg.lines().any(|line| line == text), "{text}: {svg}");
        }
    }

    #[test]
    fn lines_with_bands_are_written() {
        let point = |x: f64, y: f64| BandPoint { x, y, half: 0.5 };
        let lines = [("3k triangles", [point(1.0, 20.0), point(20_000.0, 30.0)])];
        let panel = BandPanel {
            title: "6 photos".into(),
            x: "seconds".into(),
            y: "PSNR".into(),
            lines: lines.map(|(name, points)| (name.to_owned(), points.to_vec())).into(),
            ring: (1.0, 20.0),
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bands.svg");
        bands(&path, &panel).unwrap();
        let svg = std::fs::read_to_string(&path).unwrap();
        // From 1 to 20,000 seconds there is a tick per decade.
        for text in ["6 photos", "3k triangles", "seconds", "10k", "100", "10"] {
            assert!(svg.lines().any(|line| line == text), "{text}");
        }
    }
}
