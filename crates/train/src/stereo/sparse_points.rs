//! Sparse points of a data set that has none: three photos agree on each, searched over all depths.
//!
//! They replace the sparse cloud everywhere: first triangles, shell, extents, depth anchors.

use super::consistency::MatchedPoint;
use super::gray_image::{GrayImage, gray_images, ray, read_depths};
use super::matching::{group_by_photo, neighbours, propagate_planes, shared_points};
use super::propagation::{PatchPlane, Propagation, SeedPoint};
use crate::initial::even_subset;
use crate::pyramid::{MIN_PX, Pyramid};
use glam::Vec2;
use trisplat_dataset::{Dataset, DatasetKind, Point, View, looking_distance};
use trisplat_scene::Result;
use trisplat_scene::camera::Camera;

/// Longest side of the matched photos, px.
const MAX_PHOTO_SIDE: f64 = 200.0;
/// Maximum number of matched photos, evenly over all.
const MAX_PHOTOS: usize = 100;
/// Largest difference of the depths of one surface in two of these photos, as a share.
const DEPTH_TOLERANCE: f32 = 0.02;
/// Number of trial depths, evenly spaced in their inverse.
const DEPTHS: u32 = 48;
/// Nearest trial depth, as a share of the typical depth.
const NEAREST_DEPTH: f32 = 0.25;
/// Minimum correlation of a trial depth that is refined.
const MIN_FIRST_CORRELATION: f32 = 0.7;
/// Maximum number of cells of all photos.
const MAX_CELLS: u64 = 60_000;
/// Minimum number of points per photo: fewer say nothing about the scene.
const MIN_POINTS_PER_PHOTO: usize = 10;

/// Fills in the points and tracks of a data set of photos without points, or adds a warning if they
/// are too few. `photo_bytes` is the memory for photos.
///
/// # Errors
///
/// Photos or depth maps that cannot be decoded.
pub fn reconstruct_points(dataset: &mut Dataset, photo_bytes: u64) -> Result<()> {
    if !dataset.points.is_empty() || dataset.kind == DatasetKind::Drawn {
        return Ok(());
    }
    let chosen: Vec<usize> = (0..dataset.len()).filter(|i| !dataset.views[*i].test).collect();
    let chosen = even_subset(&chosen, MAX_PHOTOS);
    let views: Vec<&View> = chosen.iter().map(|i| &dataset.views[*i]).collect();
    let cameras: Vec<Camera> = views.iter().map(|view| view.camera).collect();
    let mut photos = Pyramid::new(&views, photo_bytes, MIN_PX);
    let mut images = gray_images(&mut photos, 0, &cameras, MAX_PHOTO_SIDE)?;
    read_depths(&mut images, &views, 1.0)?;
    let points = search(&images, looking_distance(&views));
    let count = points.len();
    if count < MIN_POINTS_PER_PHOTO * cameras.len() {
        let reason = "training starts from a random cloud in front of the cameras";
        dataset
            .warnings
            .push(format!("{count} places where three photos agree are too few: {reason}"));
        return Ok(());
    }
    for view in &mut dataset.views {
        view.tracked.clear();
    }
    for (number, MatchedPoint { point, photos, .. }) in points.into_iter().enumerate() {
        dataset.points.push(Point { position: point.position, rgb: point.rgb, error: None });
        for photo in photos {
            dataset.views[chosen[photo as usize]].tracked.push(number as u32);
        }
    }
    dataset.fit_depths()
}

impl Propagation<'_> {
    /// Gives each cell the best plane of its trial depths.
    fn search(&mut self, typical_depth: f32) {
        for cell in 0..self.planes.len() as u32 {
            let at = self.cells.middle(cell);
            let Some(patch) = self.patch(at).filter(|_| self.own.is_unmasked(at)) else { continue };
            let from = ray(&self.own.camera, at);
            // Cells try different depths, by the golden ratio; the best goes to the neighbours.
            let shift = (cell as f32 * 0.618_034).fract();
            let plane = |k: u32| {
                let depth =
                    NEAREST_DEPTH * typical_depth * DEPTHS as f32 / (k as f32 + shift + 0.01);
                let plane = PatchPlane { depth, normal: -from.normalize(), score: 0.0 };
                PatchPlane { score: self.score(from, plane, &patch), ..plane }
            };
            let best = (0..DEPTHS).map(plane).max_by(|a, b| a.score.total_cmp(&b.score));
            if let Some(plane) = best.filter(|plane| plane.score > MIN_FIRST_CORRELATION) {
                self.try_plane(cell, plane);
            }
        }
    }
}

/// Points on which three photos agree, if only their typical depth is known.
fn search(photos: &[GrayImage], typical_depth: f32) -> Vec<MatchedPoint> {
    let mut seeds = shared_points(photos, 0);
    if seeds.is_empty() {
        seeds = assumed_points(photos, typical_depth);
    }
    let of_photo = group_by_photo(photos.len(), &seeds);
    let begin = |photo: &mut Propagation<'_>, _: usize| photo.search(typical_depth);
    // Far away a pixel is a larger share of the depth.
    let tolerance = |depth: f32| DEPTH_TOLERANCE * (0.5 * depth / typical_depth).max(1.0);
    propagate_planes(photos, &neighbours(photos, &of_photo), MAX_CELLS, begin, tolerance)
}

/// Stand-ins for tracked points, to choose which photos to compare: on nine rays of each photo, at
/// three depths, with each photo that shows them.
fn assumed_points(photos: &[GrayImage], typical_depth: f32) -> Vec<SeedPoint> {
    let mut seeds = Vec::new();
    for (own, GrayImage { camera, .. }) in photos.iter().enumerate() {
        for i in 0..27u32 {
            let at = Vec2::new((i % 3) as f32 + 0.5, (i / 3 % 3) as f32 + 0.5) / 3.0;
            let in_camera = ray(camera, at * camera.size.as_vec2())
                * typical_depth
                * 0.5
                * 2f32.powf((i / 9) as f32);
            let position = camera.rotation.transpose() * (in_camera - camera.translation);
            let point = 27 * own as u32 + i;
            let shows =
                |photo: &usize| *photo == own || photos[*photo].camera.project(position).is_some();
            let shown = (0..photos.len()).filter(shows);
            seeds.extend(shown.map(|photo| SeedPoint { photo: photo as u32, point, position }));
        }
    }
    seeds
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{TrainInputs, TrainOptions};
    use std::ops::ControlFlow::Continue;
    use trisplat_dataset::DatasetOptions;
    use trisplat_synthetic::{Ray, SyntheticOptions, trace};

    /// A scene of `views` photos without its points.
    fn without_points(views: u32, width: u32, depth: bool) -> (tempfile::TempDir, Dataset) {
        let folder = tempfile::tempdir().unwrap();
        let options = SyntheticOptions { views, width, depth, ..SyntheticOptions::default() };
        trisplat_synthetic::write(folder.path(), &options).unwrap();
        let mut dataset = Dataset::load(folder.path(), &DatasetOptions::default()).unwrap();
        dataset.points.clear();
        for view in &mut dataset.views {
            view.tracked.clear();
        }
        (folder, dataset)
    }

    fn reconstructed_by(threads: usize, dataset: &Dataset) -> Dataset {
        let mut dataset = dataset.clone();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| reconstruct_points(&mut dataset, DatasetOptions::default().photo_bytes()))
            .unwrap();
        dataset
    }

    /// Share of the track entries that are within `tolerance` of a surface, a share of the distance.
    fn correct_share(dataset: &Dataset, tolerance: f64) -> f64 {
        let mut correct = 0u32;
        let mut all = 0u32;
        for view in dataset.train() {
            for (_, point) in dataset.tracked(view) {
                let origin = view.camera.position().as_dvec3();
                let direction = point.position.as_dvec3() - origin;
                // A share of the distance to the point.
                let distance = trace(Ray { origin, direction }).unwrap().distance;
                correct += u32::from((distance - 1.0).abs() < tolerance);
                all += 1;
            }
        }
        f64::from(correct) / f64::from(all)
    }

    #[test]
    fn depth_maps_add_points_and_make_them_exact() {
        let [without, with] = [false, true].map(|depth| {
            let (_folder, dataset) = without_points(12, 96, depth);
            let matched = reconstructed_by(1, &dataset);
            (matched.points.len(), correct_share(&matched, 0.01))
        });
        assert!(with.0 > 2 * without.0, "{with:?} {without:?}");
        assert!(with.1 > without.1, "{with:?} {without:?}");
    }

    #[test]
    fn sparse_points_lie_on_surfaces_and_beat_a_random_cloud() {
        let (_folder, dataset) = without_points(24, 128, false);
        let matched = reconstructed_by(1, &dataset);
        let count = matched.points.len();
        let correct = correct_share(&matched, 0.02);
        assert!(count > 1000 && correct > 0.8, "{correct} of {count} points");
        assert!(matched.test().all(|view| view.tracked.is_empty()), "held-out photos find nothing");
        let again = reconstructed_by(2, &dataset);
        assert_eq!(again.points, matched.points);
        assert!(again.views.iter().zip(&matched.views).all(|(a, b)| a.tracked == b.tracked));
        assert_eq!(reconstructed_by(1, &again).points, matched.points, "points stay as they are");

        let options = TrainOptions { steps: 200, max_triangles: 2000, ..TrainOptions::default() };
        let [random, matched] = [&dataset, &matched].map(|dataset| {
            let trained = TrainInputs::new(dataset, &options).run(&mut |_| Continue(())).unwrap();
            assert!(trained.soup.shell_count() >= 128, "closed all around");
            trained.scores.iter().map(|score| score.psnr).sum::<f64>() / trained.scores.len() as f64
        });
        assert!(matched > random + 1.0, "{matched:.2} dB, {random:.2} dB from a random cloud");
    }

    #[test]
    fn photos_that_share_nothing_begin_with_a_random_cloud() {
        let (_folder, mut dataset) = without_points(2, 48, false);
        dataset.views[0].test = false;
        let matched = reconstructed_by(1, &dataset);
        assert!(matched.points.is_empty() && !matched.has_tracks());
        assert!(
            matched.warnings.last().unwrap().contains("random cloud"),
            "{:?}",
            matched.warnings
        );
    }
}
