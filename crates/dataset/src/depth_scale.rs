//! Scales of depth maps: from the file of their scales beside a COLMAP model, and to the points.

use super::dataset::{Dataset, DatasetKind, Point};
use super::depth::{DepthFile, DepthUnit};
use super::listing::DatasetListing;
use super::transforms::quoted;
use glam::Vec2;
use serde_json::{Map, Value};
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use trisplat_scene::camera::Camera;
use trisplat_scene::math::lists::{evenly_spaced, median};
use trisplat_scene::{Error, Limits, Result, input};

/// Folders of inverse depth maps, and the file of their scales beside the model.
const FOLDERS: [&str; 2] = ["depths", "depth"];
const PARAMS: &str = "depth_params.json";
/// Scales further from the median are of networks that failed, as the authors of 3D Gaussian
/// Splatting have it.
const USUAL_SCALES: std::ops::RangeInclusive<f64> = 0.2..=5.0;
/// Maximum numbers of photos and points per photo whose depths are compared.
const COMPARED_PHOTOS: usize = 24;
const COMPARED_POINTS: usize = 2000;
/// Cells per side of a photo; a point behind that of another one in its cell may be hidden.
const CELLS: f32 = 24.0;
/// Minimum number of compared points.
const MIN_POINTS: usize = 50;
/// Largest median error of depth maps that are used, as a share of the depth.
const MAX_MEDIAN_ERROR: f64 = 0.1;
/// Smallest change of scale that is told.
const TOLD_SCALE: f64 = 0.05;

/// Gives the photos of a COLMAP model the maps of a folder beside them.
///
/// # Errors
///
/// A broken file of scales.
pub(super) fn find_depths(listing: &mut DatasetListing, limits: &Limits) -> Result<()> {
    if !matches!(listing.kind, DatasetKind::ColmapBinary | DatasetKind::ColmapText) {
        return Ok(());
    }
    let folders = FOLDERS.map(|name| listing.root.join(name));
    let Some(folder) = folders.iter().find(|folder| folder.is_dir()) else { return Ok(()) };
    let file = listing.list.with_file_name(PARAMS);
    if !file.is_file() {
        listing.warnings.push(format!(
            "the depth maps of {} are not used: their scales are unknown without {}, which \
             make_depth_scale.py of 3D Gaussian Splatting writes",
            folder.display(),
            file.display()
        ));
        return Ok(());
    }
    let units = inverse_units(&file, limits)?;
    for photo in &mut listing.photos {
        let key = Path::new(&photo.name).with_extension("");
        let path = folder.join(&key).with_added_extension("png");
        let unit = units.get(&key).filter(|_| path.is_file());
        photo.depth = unit.map(|unit| DepthFile { path, unit: *unit });
    }
    let total = listing.photos.len();
    let without = listing.photos.iter().filter(|photo| photo.depth.is_none()).count();
    if without > 0 {
        listing.warnings.push(format!(
            "{without} of {total} photos have no depth map in {} with a plausible scale in {}",
            folder.display(),
            file.display()
        ));
    }
    Ok(())
}

/// The plausible scales of `file`, by the names of photos without their extensions.
fn inverse_units(file: &Path, limits: &Limits) -> Result<HashMap<PathBuf, DepthUnit>> {
    let text = quoted(&input::read_text(file, limits)?);
    let params: Map<String, Value> = serde_json::from_str(&text).map_err(|e| {
        let at = format!("line {} column {}", e.line(), e.column());
        Error::malformed(file, at, format!("is no list of scales and offsets: {e}; make it again"))
    })?;
    let number = |value: &Value, key: &str| value[key].as_f64();
    let scale = |value: &Value| number(value, "scale").filter(|scale| *scale > 0.0);
    let usual = median(params.values().filter_map(scale).collect(), f64::total_cmp).unwrap_or(0.0);
    let unit = |(name, value): (String, Value)| {
        let scale = scale(&value).filter(|scale| USUAL_SCALES.contains(&(scale / usual)))?;
        Some((name.into(), DepthUnit::Inverse { scale, offset: number(&value, "offset")? }))
    };
    Ok(params.into_iter().filter_map(unit).collect())
}

impl Dataset {
    /// Scales the depth maps to the points, or leaves them out where these differ.
    ///
    /// # Errors
    ///
    /// Maps that cannot be decoded.
    pub fn fit_depths(&mut self) -> Result<()> {
        let ratios = depth_ratios(self)?;
        if ratios.len() < MIN_POINTS {
            return Ok(());
        }
        let factor = median(ratios.clone(), f64::total_cmp).unwrap_or(1.0);
        let error = median_error(ratios.iter().map(|ratio| ratio / factor));
        if error > MAX_MEDIAN_ERROR {
            self.warnings.push(format!(
                "depth maps are not used: at half of the points they are {:.0}% off or more",
                100.0 * error
            ));
            for view in &mut self.views {
                view.photo.depth = None;
            }
            return Ok(());
        }
        if (factor - 1.0).abs() > TOLD_SCALE {
            self.warnings.push(format!(
                "depth maps are multiplied by {factor:.4} to fit the points, as if they had \
                 another unit"
            ));
        }
        for depth in self.views.iter_mut().filter_map(|view| view.photo.depth.as_mut()) {
            depth.rescale(factor);
        }
        Ok(())
    }
}

/// Median error of the depth maps at the points, as a share of the depth; `None` of few points.
///
/// # Errors
///
/// Maps that cannot be decoded.
pub(super) fn depth_error(dataset: &Dataset) -> Result<Option<f64>> {
    let ratios = depth_ratios(dataset)?;
    Ok((ratios.len() >= MIN_POINTS).then(|| median_error(ratios.into_iter())))
}

fn median_error(ratios: impl Iterator<Item = f64>) -> f64 {
    median(ratios.map(|ratio| (ratio - 1.0).abs()).collect(), f64::total_cmp).unwrap_or(0.0)
}

/// Depth of points, the tracked ones where there are tracks, as shares of that in depth maps.
fn depth_ratios(dataset: &Dataset) -> Result<Vec<f64>> {
    let views: Vec<_> = dataset.views.iter().filter(|view| view.photo.depth.is_some()).collect();
    let has_tracks = dataset.has_tracks();
    let mut ratios = Vec::new();
    for view in evenly_spaced(views.len(), COMPARED_PHOTOS).map(|i| views[i]) {
        let Some(picture) = view.photo.decode_depth()? else { continue };
        let shown = if has_tracks {
            let project = |(_, point): (usize, &Point)| view.camera.project(point.position);
            dataset.tracked(view).filter_map(project).collect()
        } else {
            nearest_points(&dataset.points, &view.camera)
        };
        ratios.extend(evenly_spaced(shown.len(), COMPARED_POINTS).filter_map(|i| {
            let (pixel, depth) = shown[i];
            Some(f64::from(depth) / f64::from(picture.depth(pixel)?))
        }));
    }
    Ok(ratios)
}

/// The pixel and depth of the nearest point in each cell of a photo.
fn nearest_points(points: &[Point], camera: &Camera) -> Vec<(Vec2, f32)> {
    let mut nearest: BTreeMap<[u32; 2], (Vec2, f32)> = BTreeMap::new();
    for (pixel, depth) in points.iter().filter_map(|point| camera.project(point.position)) {
        let cell = (pixel / camera.size.as_vec2() * CELLS).as_uvec2().to_array();
        let before = nearest.entry(cell).or_insert((pixel, depth));
        if depth < before.1 {
            *before = (pixel, depth);
        }
    }
    nearest.into_values().collect()
}
