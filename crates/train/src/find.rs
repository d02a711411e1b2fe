//! Points of a data set without any: places on which three photos agree, whatever their depth.
//!
//! They take the place of the sparse cloud in all that it is used for: first triangles, shell, extents, known depth.

use super::grow::{GrownPoint, search};
use super::known::greys;
use super::pyramid::{MIN_PX, Pyramid};
use super::start::thinned;
use trisplat_dataset::{Dataset, DatasetKind, Point, View, looking_distance};
use trisplat_scene::Result;
use trisplat_scene::camera::Camera;

/// Longest side of the photos searched, px.
const SIZE: f64 = 200.0;
/// Photos searched at most, evenly over all.
const PHOTOS: usize = 100;
/// Fewer points per photo say nothing about the scene.
const LEAST_PER_PHOTO: usize = 10;

/// Fills in the points and tracks of a data set of photos without points, and says so in its warnings. `photo_bytes` is the memory for photos.
///
/// Errors: photos that cannot be decoded.
pub fn find_points(dataset: &mut Dataset, photo_bytes: u64) -> Result<()> {
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
    if some < LEAST_PER_PHOTO * cameras.len() {
        let reason = "training starts from a random cloud in front of the cameras";
        dataset.warnings.push(format!("{some} places where three photos agree are too few: {reason}"));
        return Ok(());
    }
    dataset.views.iter_mut().for_each(|view| view.tracked.clear());
    dataset.warnings.push(format!("found {some} points where three photos agree"));
    for (number, GrownPoint { point, photos }) in found.into_iter().enumerate() {
        dataset.points.push(Point { position: point.position, rgb: point.rgb, error: None });
        photos.iter().for_each(|photo| dataset.views[chosen[*photo as usize]].tracked.push(number as u32));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{TrainOptions, TrainRun};
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
        pool.install(|| find_points(&mut found, DatasetOptions::default().photo_bytes())).unwrap();
        found
    }

    #[test]
    fn points_lie_on_the_surfaces_that_their_photos_show_and_train_better_than_a_random_cloud() {
        let (_folder, dataset) = hidden(30, 160);
        let found = found_by(1, &dataset);
        let (mut right, mut all) = (0u32, 0u32);
        for view in found.train() {
            for (_, point) in found.tracked(view) {
                let origin = view.camera.position().as_dvec3();
                let direction = point.position.as_dvec3() - origin;
                // A share of the distance to the point.
                let distance = trace(Ray { origin, direction }).unwrap().distance;
                (right, all) = (right + u32::from((distance - 1.0).abs() < 0.02), all + 1);
            }
        }
        let count = found.points.len();
        assert!(count > 1000 && f64::from(right) > 0.8 * f64::from(all), "{right} of {all}, {count} points");
        assert!(found.test().all(|view| view.tracked.is_empty()), "held-out photos find nothing");
        let again = found_by(2, &dataset);
        assert_eq!(again.points, found.points);
        assert!(again.views.iter().zip(&found.views).all(|(a, b)| a.tracked == b.tracked));
        assert_eq!(found_by(1, &again).points, found.points, "points stay as they are");

        let options = TrainOptions { steps: 400, max_triangles: 3000, ..TrainOptions::default() };
        let [random, found] = [&dataset, &found].map(|dataset| {
            let trained = TrainRun::new(dataset, &options).run(&mut |_| Continue(())).unwrap();
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
