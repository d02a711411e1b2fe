//! The rows as a picture for docs: the static twin of the page.

use super::knobs::{CostInput, CostStage};
use super::row::CostRow;
use crate::bench::plot::{self, DotPanel, PlotPoint};
use crate::dataset::ShrunkSize;
use crate::error::Result;
use std::path::Path;

/// Writes an SVG with a chart per stage and input: PSNR against CPU seconds (drawings: the difference from the exact
/// answer); settings on the front are labelled and joined, the default is a ring.
pub(super) fn plot(path: &Path, rows: &[CostRow]) -> Result<()> {
    let mut groups: Vec<(CostStage, CostInput)> = rows.iter().map(|r| (r.stage, r.input)).collect();
    groups.dedup();
    let panels: Vec<DotPanel> = groups.into_iter().map(|group| panel(rows, group)).collect();
    plot::fronts(path, &panels)
}

fn panel(rows: &[CostRow], (stage, input): (CostStage, CostInput)) -> DotPanel {
    let exact = stage == CostStage::Draw;
    let rows = || rows.iter().filter(|r| (r.stage, r.input) == (stage, input));
    let size = ShrunkSize::beside(rows().find_map(|r| r.photo_size));
    let point = |row: &CostRow| PlotPoint {
        name: row.label(),
        x: row.cpu_seconds,
        y: if exact { row.exact_rms.unwrap_or(f64::NAN) } else { row.psnr },
    };
    DotPanel {
        title: format!("{} ({})", stage.name(), input.name()),
        x: if exact { "CPU seconds of a picture" } else { "CPU seconds" }.into(),
        y: if exact { "difference from exact, levels".into() } else { format!("PSNR, dB{size}") },
        less_is_better: exact,
        front: rows().filter(|r| r.on_front).map(point).collect(),
        default: rows().find(|r| r.is_default).map(point),
        others: rows().filter(|r| !r.on_front && !r.is_default).map(point).collect(),
    }
}
