//! The report of the grid, and its picture.

use super::advice::CostAdvice;
use super::cell::CostCell;
use crate::machine::Machine;
use crate::plot::{self, BandPanel, BandPoint};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;
use trisplat_dataset::ShrunkSize;
use trisplat_scene::{Result, math::short::short};

/// What `trisplat bench cost --json` prints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "trisplat cost report")]
pub struct CostReport {
    /// Where it was measured.
    #[serde(flatten)]
    pub machine: Machine,
    /// The data set as given, or "synthetic".
    pub dataset: String,
    /// The size that the photos were shrunk to, "320x213"; absent where they were not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photo_size: Option<ShrunkSize>,
    /// Photos that were trained on.
    pub photos: u64,
    /// Photos of the training set that were left out, and measured with. Held-out photos are not looked at.
    pub watched: Vec<String>,
    /// CPU seconds that the dearest training was to take at most.
    pub budget: f64,
    /// The grid, in the order in which it was trained.
    pub cells: Vec<CostCell>,
    /// What it says.
    pub advice: CostAdvice,
}

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
