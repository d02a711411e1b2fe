//! A point of a cloud, from its file.

use super::colmap_model::PointRow;
use glam::DVec3;

/// A point of the cloud in f64.
pub(super) struct FoundPoint {
    pub(super) position: DVec3,
    pub(super) rgb: [u8; 3],
    pub(super) error: Option<f32>,
}

impl From<PointRow> for FoundPoint {
    fn from(row: PointRow) -> Self {
        // COLMAP writes -1 for a point that was never refined.
        let error = (row.error >= 0.0 && row.error.is_finite()).then_some(row.error as f32);
        Self { position: row.position, rgb: row.rgb, error }
    }
}
