//! The grid as a picture.

use super::cell::CostCell;
use super::report::CostReport;
use crate::bench::plot::{self, BandPanel, BandPoint};
use crate::dataset::ShrunkSize;
use crate::error::Result;
use crate::math::short::short;
use std::path::Path;

/// Writes PSNR against CPU seconds as SVG, a line with bands for each number of triangles; the settings to use are a ring.
pub(super) fn plot(path: &Path, report: &CostReport) -> Result<()> {
    let mut rows: Vec<u64> = report.cells.iter().map(|cell| cell.max_triangles).collect();
    rows.dedup();
    let point = |cell: &CostCell| BandPoint {
        x: cell.cpu_seconds,
        y: cell.psnr,
        half: cell.psnr_band.unwrap_or(0.0),
    };
    let line = |triangles: u64| {
        let cells = report.cells.iter().filter(|cell| cell.max_triangles == triangles);
        (format!("{} triangles", short(triangles as f64)), cells.map(point).collect())
    };
    let size = ShrunkSize::beside(report.photo_size);
    plot::bands(
        path,
        &BandPanel {
            title: format!("{} watched photos, {} seeds", report.watched.len(), report.cells[0].runs.len()),
            x: "CPU seconds of a training".into(),
            y: format!("PSNR, dB{size}"),
            lines: rows.into_iter().map(line).collect(),
            ring: (report.advice.cpu_seconds, report.advice.psnr),
        },
    )
}
