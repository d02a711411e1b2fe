//! Depths of photos: the depth of every cell of a photo on which photos agree.

use super::anchors::is_usable;
use super::gray_image::{GrayImage, gray_images};
use super::matching::propagate_depths;
use super::propagation::{DepthCells, SeedPoint};
use crate::pyramid::{MIN_PX, Pyramid};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_dataset::{Dataset, DatasetKind, Point, View};
use trisplat_scene::Result;
use trisplat_scene::camera::{Camera, PhotoDepths};

/// Longest side of the matched photos, px.
const MAX_PHOTO_SIDE: f64 = 480.0;
/// Minimum side of a cell, px.
const MIN_CELL_SIDE: u32 = 3;
/// Maximum number of cells of all photos: they take 10 µs each.
const MAX_CELLS: u64 = 1_500_000;

/// Depths that photos agree on.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DepthsDetails {
    /// Photos with a depth in at least one cell.
    pub photos: u64,
    /// Mean share of the cells of a photo with a depth, 0 to 1.
    pub known: f64,
}

trisplat_scene::stage!(DepthsDetails, "depths");

impl DepthsDetails {
    /// The figures of `maps`.
    pub fn new(maps: &[PhotoDepths]) -> Self {
        let known = |map: &PhotoDepths| {
            let known = map.depth.iter().filter(|depth| **depth > 0.0).count();
            known as f64 / map.depth.len().max(1) as f64
        };
        let shares = || maps.iter().map(known);
        Self {
            photos: shares().filter(|share| *share > 0.0).count() as u64,
            known: shares().sum::<f64>() / maps.len().max(1) as f64,
        }
    }
}

/// The depths of the training photos of `dataset`, in its frame, from its tracked points; empty
/// without points. Points that measure the depth error of scenes are not used. `photo_bytes` is the
/// memory for photos.
///
/// # Errors
///
/// Photos that cannot be decoded.
pub fn measure_depths(dataset: &Dataset, photo_bytes: u64) -> Result<Vec<PhotoDepths>> {
    if dataset.kind == DatasetKind::Drawn {
        return Ok(Vec::new());
    }
    let seeds = seeds(dataset);
    if seeds.is_empty() {
        return Ok(Vec::new());
    }
    let views: Vec<&View> = dataset.train().collect();
    let cameras: Vec<Camera> = views.iter().map(|view| view.camera).collect();
    let mut photos = Pyramid::new(&views, photo_bytes, MIN_PX);
    let images = gray_images(&mut photos, 0, &cameras, MAX_PHOTO_SIDE)?;
    Ok(match_photos(&images, &seeds))
}

/// A seed per usable tracked point and photo.
fn seeds(dataset: &Dataset) -> Vec<SeedPoint> {
    let of_view = |(photo, view): (usize, &View)| {
        let is_shown = |(_, point): &(usize, &Point)| view.camera.project(point.position).is_some();
        let seed = |(i, point): (usize, &Point)| SeedPoint {
            photo: photo as u32,
            point: i as u32,
            position: point.position,
        };
        let tracked = dataset.tracked(view).filter(is_usable).filter(is_shown);
        tracked.map(seed).collect::<Vec<SeedPoint>>()
    };
    dataset.train().enumerate().flat_map(of_view).collect()
}

/// The depths of each photo, propagated from `seeds`.
fn match_photos(photos: &[GrayImage], seeds: &[SeedPoint]) -> Vec<PhotoDepths> {
    let pixels = |photo: &GrayImage| u64::from(photo.camera.size.element_product());
    let pixels: u64 = photos.iter().map(pixels).sum();
    let side = (MIN_CELL_SIDE..)
        .find(|side| pixels / u64::from(side * side) <= MAX_CELLS)
        .unwrap_or(MIN_CELL_SIDE);
    let map = |(photo, depth): (&GrayImage, Vec<f32>)| {
        let camera = photo.camera;
        let cells = DepthCells::new(&camera, side);
        let code = |cell: usize| photo.photo.rgb[photo.index(cells.middle(cell as u32))];
        let focal = camera.focal / side as f32;
        let center = camera.center / side as f32;
        PhotoDepths {
            camera: Camera { focal, center, size: camera.size / side, ..camera },
            depth,
            rgb: (0..cells.len()).map(code).collect(),
        }
    };
    photos.iter().zip(propagate_depths(photos, seeds, side)).map(map).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_dataset::DatasetOptions;
    use trisplat_synthetic::{Ray, SyntheticOptions, trace};

    /// The maps of a synthetic scene, and the share of known depths that are within 1%.
    fn measured(dataset: &Dataset, threads: usize) -> (Vec<PhotoDepths>, f64) {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let bytes = DatasetOptions::default().photo_bytes();
        let maps = pool.install(|| measure_depths(dataset, bytes)).unwrap();
        let mut correct = 0u32;
        let mut known = 0u32;
        for map in &maps {
            let origin = map.camera.position().as_dvec3();
            for (cell, depth) in map.depth.iter().enumerate().filter(|(_, depth)| **depth > 0.0) {
                let width = map.camera.size.x as usize;
                let at = glam::Vec2::new((cell % width) as f32 + 0.5, (cell / width) as f32 + 0.5);
                let ray = ((at - map.camera.center) / map.camera.focal).extend(1.0);
                let direction = (map.camera.rotation.transpose() * (ray * *depth)).as_dvec3();
                let hit = trace(Ray { origin, direction }).unwrap();
                correct += u32::from((hit.distance - 1.0).abs() < 0.01);
                known += 1;
            }
        }
        (maps, f64::from(correct) / f64::from(known.max(1)))
    }

    #[test]
    fn photo_depths_are_right_and_the_same_for_any_number_of_threads() {
        let folder = tempfile::tempdir().unwrap();
        let options = SyntheticOptions { views: 24, width: 160, ..SyntheticOptions::default() };
        trisplat_synthetic::write(folder.path(), &options).unwrap();
        let mut dataset = Dataset::load(folder.path(), &DatasetOptions::default()).unwrap();
        let (maps, correct) = measured(&dataset, 1);
        assert_eq!(maps.len(), dataset.train().count(), "a map per training photo");
        let known = maps.iter().flat_map(|map| &map.depth).filter(|depth| **depth > 0.0).count();
        assert!(known > 8000 && correct > 0.75, "{correct} of {known}");
        // Points that judge are not used.
        for (i, point) in dataset.points.iter_mut().enumerate() {
            if Dataset::is_validation_point(i) {
                point.position *= 1.5;
            }
        }
        assert_eq!(measured(&dataset, 2).0, maps);
        dataset.kind = DatasetKind::Drawn;
        assert!(measured(&dataset, 1).0.is_empty(), "pictures of a scene measure nothing");
    }
}
