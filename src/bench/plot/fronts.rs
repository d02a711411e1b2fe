//! Charts of settings: seconds against an error, what is on the front joined and labelled.

use super::axis::{PlotPoint, labels as labels_from, log_axis};
use super::labels::{Rect, place};
use crate::math::short::short;
use plotters::coord::Shift;
use plotters::coord::combinators::{LogCoord, WithKeyPoints};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

/// One chart; its x axis is logarithmic.
#[derive(Debug, Clone, Default)]
pub struct DotPanel {
    /// What is shown.
    pub title: String,
    /// What x is.
    pub x: String,
    /// What y is.
    pub y: String,
    /// Whether y is an error, not a quality.
    pub less_is_better: bool,
    /// What no other beats, in any order; it may be by a third quantity.
    pub front: Vec<PlotPoint>,
    /// The default, which may be on the front too.
    pub default: Option<PlotPoint>,
    /// Everything else, without labels.
    pub others: Vec<PlotPoint>,
}

/// Colour of the front.
const FRONT: RGBColor = RGBColor(40, 90, 190);
/// Colour of the default.
const DEFAULT: RGBColor = RGBColor(200, 70, 40);
/// Colour of everything else.
const OTHERS: RGBColor = RGBColor(150, 150, 150);

type Chart<'a, 'b> =
    ChartContext<'a, SVGBackend<'b>, Cartesian2d<WithKeyPoints<LogCoord<f64>>, RangedCoordf64>>;

impl DotPanel {
    /// Without what cannot be drawn on a logarithmic axis.
    fn drawable(&self) -> Self {
        let can = |p: &PlotPoint| p.x.is_finite() && p.x > 0.0 && p.y.is_finite();
        let kept = |points: &[PlotPoint]| points.iter().filter(|p| can(p)).cloned().collect();
        let default = self.default.clone().filter(can);
        Self { front: kept(&self.front), default, others: kept(&self.others), ..self.clone() }
    }

    fn all(&self) -> impl Iterator<Item = &PlotPoint> {
        self.front.iter().chain(&self.default).chain(&self.others)
    }

    /// The points of the front that no other beats in x and y, from left to right.
    fn line(&self) -> Vec<(f64, f64)> {
        let better = |a: f64, b: f64| if self.less_is_better { a < b } else { a > b };
        let mut sorted: Vec<(f64, f64)> = self.front.iter().map(|p| (p.x, p.y)).collect();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut line: Vec<(f64, f64)> = Vec::new();
        for point in sorted {
            if line.last().is_none_or(|last| better(point.1, last.1)) {
                line.push(point);
            }
        }
        line
    }

    /// What has a label: the default and the front, each point once.
    fn labelled(&self) -> Vec<&PlotPoint> {
        let front = self.front.iter().filter(|p| Some(*p) != self.default.as_ref());
        self.default.iter().chain(front).collect()
    }
}

/// Draws a chart; nothing when there are no points.
pub(super) fn chart(area: &DrawingArea<SVGBackend<'_>, Shift>, panel: &DotPanel) -> Result<(), String> {
    let panel = panel.drawable();
    let range = |of: fn(&PlotPoint) -> f64| {
        let start = (f64::INFINITY, f64::NEG_INFINITY);
        panel.all().map(of).fold(start, |(low, high), v| (low.min(v), high.max(v)))
    };
    let ((x0, x1), (y0, y1)) = (range(|p| p.x), range(|p| p.y));
    if panel.all().next().is_none() {
        return Ok(());
    }
    let (wide, pad) = ((x1 / x0).powf(0.12).max(1.1), 0.12 * (y1 - y0).max(0.2));
    let mut chart = ChartBuilder::on(area)
        .caption(&panel.title, ("sans-serif", 16))
        .margin(12)
        .x_label_area_size(36)
        .y_label_area_size(52)
        .build_cartesian_2d(log_axis(x0 / wide, x1 * wide), y0 - pad..y1 + pad)
        .map_err(|e| e.to_string())?;
    chart
        .configure_mesh()
        .x_desc(&panel.x)
        .y_desc(&panel.y)
        .x_label_formatter(&|v| short(*v))
        .y_label_formatter(&labels_from(y0 - pad, y1 + pad))
        .light_line_style(WHITE)
        .draw()
        .map_err(|e| e.to_string())?;
    dots(&mut chart, &panel).and_then(|()| labels(&mut chart, &panel)).map_err(|e| e.to_string())
}

type Drawn = Result<(), Box<dyn std::error::Error>>;

/// The front joined, the default as a ring, the rest as small dots.
fn dots(chart: &mut Chart<'_, '_>, panel: &DotPanel) -> Drawn {
    let at = |p: &PlotPoint| (p.x, p.y);
    chart.draw_series(panel.others.iter().map(|p| Circle::new(at(p), 3, OTHERS.filled())))?;
    chart.draw_series([PathElement::new(panel.line(), FRONT.mix(0.5))])?;
    chart.draw_series(panel.front.iter().map(|p| Circle::new(at(p), 4, FRONT.filled())))?;
    chart.draw_series(panel.default.iter().map(|p| Circle::new(at(p), 6, DEFAULT.stroke_width(2))))?;
    Ok(())
}

fn labels(chart: &mut Chart<'_, '_>, panel: &DotPanel) -> Drawn {
    let labelled = panel.labelled();
    let names: Vec<&str> = labelled.iter().map(|p| p.name.as_str()).collect();
    let all = labelled.iter().copied().chain(&panel.others);
    let dots: Vec<[i32; 2]> = all.map(|p| chart.backend_coord(&(p.x, p.y)).into()).collect();
    let (across, down) = chart.plotting_area().get_pixel_range();
    let frame = Rect { at: [across.start, down.start], size: [across.len() as i32, down.len() as i32] };
    for ((point, dot), label) in labelled.iter().zip(&dots).zip(place(&names, &dots, frame)) {
        let Some(Rect { at: [x, y], .. }) = label else { continue };
        let font = ("sans-serif", 12).into_font();
        let text = Text::new(point.name.clone(), (x - dot[0], y - dot[1]), font);
        chart.draw_series([EmptyElement::at((point.x, point.y)) + text])?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_joins_what_improves() {
        let point = |x: f64, y: f64| PlotPoint { name: String::new(), x, y };
        let front = vec![point(3.0, 5.0), point(1.0, 2.0), point(2.0, 1.0), point(4.0, 4.0)];
        let more = DotPanel { front, ..DotPanel::default() };
        assert_eq!(more.line(), [(1.0, 2.0), (3.0, 5.0)]);
        let less = DotPanel { less_is_better: true, ..more };
        assert_eq!(less.line(), [(1.0, 2.0), (2.0, 1.0)]);
    }
}
