//! Points of a data set without any: places on which three photos agree, searched over all depths.
//!
//! They take the place of the sparse cloud in all that it is used for: first triangles, shell,
//! extents, known depth.

use super::grow::{Grey, GrownPoint, Growth, Plane, Seed, by_photo, others, ray, spread};
use super::known::greys;
use super::pyramid::{MIN_PX, Pyramid};
use super::start::thinned;
use glam::Vec2;
use trisplat_dataset::{Dataset, DatasetKind, Point, View, looking_distance};
use trisplat_scene::Result;
use trisplat_scene::camera::Camera;

/// Longest side of the photos searched, px.
const SIZE: f64 = 200.0;
/// Photos searched at most, evenly over all.
const PHOTOS: usize = 100;
/// Depths of one surface in two of these photos differ by less, as a share.
const SAME_FOUND: f32 = 0.02;
/// Depths of a search, even in their inverse.
const DEPTHS: u32 = 48;
/// The nearest of them, as a share of the distance at which a photo looks.
const NEAREST: f32 = 0.25;
/// Minimum correlation of a depth that is adjusted.
const FIRST_MATCH: f32 = 0.7;
/// Cells of all photos in a search.
const SEARCHED_CELLS: u64 = 60_000;
/// Fewer points per photo say nothing about the scene.
const MIN_PER_PHOTO: usize = 10;

/// Fills in the points and tracks of a data set of photos without points; a warning says where too
/// few are found. `photo_bytes` is the memory for photos.
///
/// # Errors
///
/// Photos that cannot be decoded.
pub fn reconstruct_points(dataset: &mut Dataset, photo_bytes: u64) -> Result<()> {
    if !dataset.points.is_empty() || dataset.kind == DatasetKind::Drawn {
        return Ok(());
    }
    let chosen: Vec<usize> = (0..dataset.len()).filter(|i| !dataset.views[*i].test).collect();
    let chosen = thinned(&chosen, PHOTOS);
    let views: Vec<&View> = chosen.iter().map(|i| &dataset.views[*i]).collect();
    let cameras: Vec<Camera> = views.iter().map(|view| view.camera).collect();
    let mut photos = Pyramid::new(&views, photo_bytes, MIN_PX);
    let found = search(&greys(&mut photos, 0, &cameras, SIZE)?, looking_distance(&views));
    let some = found.len();
    if some < MIN_PER_PHOTO * cameras.len() {
        let reason = "training starts from a random cloud in front of the cameras";
        dataset
            .warnings
            .push(format!("{some} places where three photos agree are too few: {reason}"));
        return Ok(());
    }
    dataset.views.iter_mut().for_each(|view| view.tracked.clear());
    for (number, GrownPoint { point, photos }) in found.into_iter().enumerate() {
        dataset.points.push(Point { position: point.position, rgb: point.rgb, error: None });
        photos
            .iter()
            .for_each(|photo| dataset.views[chosen[*photo as usize]].tracked.push(number as u32));
    }
    Ok(())
}

impl Growth<'_> {
    /// Begins at the best depth of each cell, for a photo that looks at this distance.
    fn search(&mut self, usual: f32) {
        for cell in 0..self.planes.len() as u32 {
            let at = self.cells.middle(cell);
            let Some(patch) = self.patch(at).filter(|_| self.own.counts(at)) else { continue };
            let from = ray(&self.own.camera, at);
            // Other cells try other depths, by the golden ratio; the best goes to its neighbours.
            let shift = (cell as f32 * 0.618_034).fract();
            let plane = |k: u32| {
                let depth = NEAREST * usual * DEPTHS as f32 / (k as f32 + shift + 0.01);
                let plane = Plane { depth, normal: -from.normalize(), score: 0.0 };
                Plane { score: self.score(from, plane, &patch), ..plane }
            };
            let best = (0..DEPTHS).map(plane).max_by(|a, b| a.score.total_cmp(&b.score));
            if let Some(plane) = best.filter(|plane| plane.score > FIRST_MATCH) {
                self.offer(cell, plane);
            }
        }
    }
}

/// The points on which three photos agree, where nothing is known but the distance at which they
/// look.
fn search(photos: &[Grey], usual: f32) -> Vec<GrownPoint> {
    let of_photo = by_photo(photos.len(), &looked_at(photos, usual));
    let begin = |growth: &mut Growth<'_>, _: usize| growth.search(usual);
    // Far away a pixel is a larger share of the depth.
    let same = |found: f32, depth: f32| {
        (found / depth - 1.0).abs() < SAME_FOUND * (0.5 * depth / usual).max(1.0)
    };
    spread(photos, &others(photos, &of_photo), SEARCHED_CELLS, begin, same)
}

/// Places that photos may show, in place of tracked points: on nine rays of each, at three depths.
fn looked_at(photos: &[Grey], usual: f32) -> Vec<Seed> {
    let mut seeds = Vec::new();
    for (own, Grey { camera, .. }) in photos.iter().enumerate() {
        for i in 0..27u32 {
            let at = Vec2::new((i % 3) as f32 + 0.5, (i / 3 % 3) as f32 + 0.5) / 3.0;
            let seen =
                ray(camera, at * camera.size.as_vec2()) * usual * 0.5 * 2f32.powf((i / 9) as f32);
            let position = camera.rotation.transpose() * (seen - camera.translation);
            let point = 27 * own as u32 + i;
            let shows =
                |photo: &usize| *photo == own || photos[*photo].camera.project(position).is_some();
            let shown = (0..photos.len()).filter(shows);
            seeds.extend(shown.map(|photo| Seed { photo: photo as u32, point, position }));
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
    fn hidden(views: u32, width: u32) -> (tempfile::TempDir, Dataset) {
        let folder = tempfile::tempdir().unwrap();
        let options = SyntheticOptions { views, width, ..SyntheticOptions::default() };
        trisplat_synthetic::write(folder.path(), &options).unwrap();
        let mut dataset = Dataset::load(folder.path(), &DatasetOptions::default()).unwrap();
        dataset.points.clear();
        dataset.views.iter_mut().for_each(|view| view.tracked.clear());
        (folder, dataset)
    }

    fn found_by(threads: usize, dataset: &Dataset) -> Dataset {
        let mut found = dataset.clone();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| reconstruct_points(&mut found, DatasetOptions::default().photo_bytes()))
            .unwrap();
        found
    }

    #[test]
    fn points_lie_on_the_surfaces_that_their_photos_show_and_train_better_than_a_random_cloud() {
        let (_folder, dataset) = hidden(24, 128);
        let found = found_by(1, &dataset);
        let mut right = 0u32;
        let mut all = 0u32;
        for view in found.train() {
            for (_, point) in found.tracked(view) {
                let origin = view.camera.position().as_dvec3();
                let direction = point.position.as_dvec3() - origin;
                // A share of the distance to the point.
                let distance = trace(Ray { origin, direction }).unwrap().distance;
                right += u32::from((distance - 1.0).abs() < 0.02);
                all += 1;
            }
        }
        let count = found.points.len();
        assert!(
            count > 1000 && f64::from(right) > 0.8 * f64::from(all),
            "{right} of {all}, {count} points"
        );
        assert!(found.test().all(|view| view.tracked.is_empty()), "held-out photos find nothing");
        let again = found_by(2, &dataset);
        assert_eq!(again.points, found.points);
        assert!(again.views.iter().zip(&found.views).all(|(a, b)| a.tracked == b.tracked));
        assert_eq!(found_by(1, &again).points, found.points, "points stay as they are");

        let options = TrainOptions { steps: 200, max_triangles: 2000, ..TrainOptions::default() };
        let [random, found] = [&dataset, &found].map(|dataset| {
            let trained = TrainInputs::new(dataset, &options).run(&mut |_| Continue(())).unwrap();
            assert!(trained.soup.shell_count() >= 128, "closed all around");
            trained.scores.iter().map(|score| score.psnr).sum::<f64>() / trained.scores.len() as f64
        });
        assert!(found > random + 1.0, "{found:.2} dB, {random:.2} dB from a random cloud");
    }

    #[test]
    fn photos_that_share_nothing_begin_with_a_random_cloud() {
        let (_folder, mut dataset) = hidden(2, 48);
        dataset.views[0].test = false;
        let found = found_by(1, &dataset);
        assert!(found.points.is_empty() && !found.has_tracks());
        assert!(found.warnings.last().unwrap().contains("random cloud"), "{:?}", found.warnings);
    }
}
