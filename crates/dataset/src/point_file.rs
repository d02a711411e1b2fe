//! The file of a cloud of points. It is read once for the extent of the scene and again for the points, and
//! is never held in f64, because a city has very many points.

use super::colmap_model::FoundPoint;
use super::{colmap_binary, colmap_text, point_ply};
use std::path::PathBuf;
use trisplat_scene::{Limits, Result};

/// Where the points are.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum PointFile {
    None,
    ColmapBinary(PathBuf),
    ColmapText(PathBuf),
    Ply(PathBuf),
}

impl PointFile {
    /// Passes every point to `visit`, in the order of the file.
    pub(super) fn each(&self, limits: &Limits, visit: &mut dyn FnMut(FoundPoint)) -> Result<()> {
        match self {
            Self::None => Ok(()),
            Self::ColmapBinary(path) => colmap_binary::each_point(path, limits, &mut |row| visit(row.into())),
            Self::ColmapText(path) => colmap_text::each_point(path, limits, &mut |row| visit(row.into())),
            Self::Ply(path) => point_ply::each_point(path, limits, visit),
        }
    }

    /// How messages call it.
    pub(super) fn name(&self) -> String {
        match self {
            Self::None => "points".into(),
            Self::ColmapBinary(path) | Self::ColmapText(path) | Self::Ply(path) => path.display().to_string(),
        }
    }
}
