//! Which axes are worst together, as a picture.

use super::axes::{AXES, Axis};
use super::rows::{ErrorSummary, Part, StressReport, StressRow};
use crate::plot::{self, HeatMap};
use std::path::Path;
use trisplat_scene::Result;

/// Writes an SVG of two heat maps, errors of frames and of gradients: what 99.9% of them are at most with two axes stretched to their ends,
/// on the diagonal with one alone, in the worst part of its range.
///
/// # Errors
/// [`Error::Io`](trisplat_scene::Error::Io) when the file cannot be written.
pub fn plot(path: &Path, report: &StressReport) -> Result<()> {
    let frames = heat_map("frames: error, 99.9% are at most", &report.rows, |row| &row.value);
    let gradients = heat_map("gradients: error, 99.9% are at most", &report.rows, |row| &row.gradient);
    plot::heat_maps(path, &[frames, gradients])
}

fn heat_map(title: &str, rows: &[StressRow], errors: impl Fn(&StressRow) -> &ErrorSummary) -> HeatMap {
    let index = |axis: Axis| axis as usize;
    let place = |row: &StressRow| match row.part {
        Part::Single { axis, .. } => Some((index(axis), index(axis))),
        Part::Pair { axis, with } => Some((index(axis).max(index(with)), index(axis).min(index(with)))),
        Part::Domain => None,
    };
    let mut cells: Vec<(usize, usize, f64)> = Vec::new();
    for row in rows {
        let Some((down, across)) = place(row) else { continue };
        let worst = errors(row).p999;
        match cells.iter_mut().find(|cell| (cell.0, cell.1) == (down, across)) {
            Some(cell) => cell.2 = cell.2.max(worst),
            None => cells.push((down, across, worst)),
        }
    }
    let names = AXES.iter().map(|row| row.name.to_owned()).collect();
    HeatMap { title: title.to_owned(), names, cells }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(part: Part, p999: f64) -> StressRow {
        let summary = ErrorSummary { count: 1, p50: 0.0, p999, max: 1.0 };
        StressRow {
            part,
            cases: 1,
            drawn: 1,
            undecided: 0.0,
            value: summary,
            gradient: summary,
            non_finite: 0,
            solid_wrong: 0,
            time_ratio: 1.0,
        }
    }

    #[test]
    fn pairs_lie_below_the_diagonal_and_axes_alone_on_it() {
        let alone = |from: f64, p999| row(Part::Single { axis: Axis::Aspect, from, to: 10.0 * from }, p999);
        let pair = row(Part::Pair { axis: Axis::Scale, with: Axis::Sh }, 0.5);
        let turned = row(Part::Pair { axis: Axis::Sigma, with: Axis::Aspect }, 0.25);
        let rows = [alone(1.0, 1e-5), alone(10.0, 1e-3), pair, turned, row(Part::Domain, 9.0)];
        let map = heat_map("", &rows, |row| &row.value);
        let (aspect, sigma, sh) = (Axis::Aspect as usize, Axis::Sigma as usize, Axis::Sh as usize);
        assert_eq!(map.cells, [(aspect, aspect, 1e-3), (sh, 0, 0.5), (sigma, aspect, 0.25)]);
        assert_eq!(map.names.len(), AXES.len());
    }
}
