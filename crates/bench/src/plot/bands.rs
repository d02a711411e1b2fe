//! A chart of seconds against quality: a line for each name, with a band around every point.

use super::axis::{labels, log_axis};
use plotters::coord::Shift;
use plotters::prelude::*;
use trisplat_scene::math::short::short;

/// A value with half the width of its band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct BandPoint {
    /// Place on the x axis, which is logarithmic.
    pub x: f64,
    /// Value.
    pub y: f64,
    /// Half the width of its band.
    pub half: f64,
}

/// One chart.
#[derive(Debug, Clone)]
pub(crate) struct BandPanel {
    /// What is shown.
    pub title: String,
    /// What x is.
    pub x: String,
    /// What y is.
    pub y: String,
    /// Names and points, from left to right.
    pub lines: Vec<(String, Vec<BandPoint>)>,
    /// A place that has a ring around it.
    pub ring: (f64, f64),
}

/// Colour of the ring.
const RING: RGBColor = RGBColor(200, 70, 40);

/// Draws a chart.
pub(super) fn chart(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    panel: &BandPanel,
) -> Result<(), Box<dyn std::error::Error>> {
    let points = || panel.lines.iter().flat_map(|(_, points)| points);
    let least = |of: fn(&BandPoint) -> f64| points().map(of).fold(f64::INFINITY, f64::min);
    let most = |of: fn(&BandPoint) -> f64| points().map(of).fold(f64::NEG_INFINITY, f64::max);
    let (x0, x1) = (least(|p| p.x), most(|p| p.x));
    let (y0, y1) = (least(|p| p.y - p.half), most(|p| p.y + p.half));
    let (wide, pad) = ((x1 / x0).powf(0.08).max(1.1), 0.08 * (y1 - y0).max(0.2));
    let mut chart = ChartBuilder::on(area)
        .caption(&panel.title, ("sans-serif", 16))
        .margin(12)
        .x_label_area_size(36)
        .y_label_area_size(52)
        .build_cartesian_2d(log_axis(x0 / wide, x1 * wide), y0 - pad..y1 + pad)?;
    chart
        .configure_mesh()
        .x_desc(&panel.x)
        .y_desc(&panel.y)
        .x_label_formatter(&|v| short(*v))
        .y_label_formatter(&labels(y0 - pad, y1 + pad))
        .light_line_style(WHITE)
        .draw()?;
    for (i, (name, points)) in panel.lines.iter().enumerate() {
        let style = Palette99::pick(i).stroke_width(2);
        let bars = |p: &BandPoint| PathElement::new([(p.x, p.y - p.half), (p.x, p.y + p.half)], style);
        chart.draw_series(points.iter().map(bars))?;
        let line = points.iter().map(|p| (p.x, p.y));
        chart
            .draw_series(LineSeries::new(line, style).point_size(3))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], style));
    }
    chart.draw_series([Circle::new(panel.ring, 7, RING.stroke_width(2))])?;
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerRight)
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK.mix(0.3))
        .draw()?;
    Ok(())
}
