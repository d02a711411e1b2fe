//! The observations of a COLMAP model: which photo shows which point.

use super::colmap;
use super::options::DatasetOptions;
use glam::{UVec2, Vec2};
use std::collections::HashMap;
use std::path::Path;
use trisplat_scene::{Error, Result};

/// The photos of a model, and the points of each.
#[derive(Debug, Clone, PartialEq)]
pub struct Tracks {
    /// In order of name.
    pub photos: Vec<TrackedPhoto>,
    /// Number of points.
    pub points: usize,
    /// Mean reprojection error, px.
    pub error_px: Option<f64>,
}

/// A photo and its points.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackedPhoto {
    /// Its path below the folder of photos.
    pub name: String,
    /// Width and height of its camera, px.
    pub size: UVec2,
    /// Indices of points, and their image positions, px.
    pub seen: Vec<(u32, Vec2)>,
}

/// The tracks of the COLMAP model in `folder`, or in the usual places of a data set.
///
/// Errors: no model; a broken model.
pub fn tracks(folder: &Path, options: &DatasetOptions) -> Result<Tracks> {
    let Some(files) = colmap::locate(folder) else {
        return Err(Error::unsupported(folder, "holds no COLMAP model; find the poses again"));
    };
    let (model, places) = (files.model(&options.limits, true)?, files.places(&options.limits)?);
    let mut ids: Vec<u64> = places.into_keys().collect();
    ids.sort_unstable();
    let index: HashMap<u64, u32> = ids.iter().copied().zip(0..).collect();
    let mut photos: Vec<TrackedPhoto> = model
        .images
        .iter()
        .map(|image| TrackedPhoto {
            name: image.name.replace('\\', "/"),
            size: model.cameras.get(&image.camera).map_or(UVec2::ONE, |lens| lens.size),
            seen: image.observations.iter().filter_map(|(id, at)| Some((*index.get(id)?, *at))).collect(),
        })
        .collect();
    photos.sort_by(|a, b| a.name.cmp(&b.name));
    let error_px = colmap::reprojection(folder, &options.limits)?.map(|measured| measured.mean_px);
    Ok(Tracks { photos, points: ids.len(), error_px })
}
