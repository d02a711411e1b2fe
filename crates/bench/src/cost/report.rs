//! The report of the grid.

use super::advice::CostAdvice;
use super::cell::CostCell;
use crate::machine::Machine;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_dataset::ShrunkSize;

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
