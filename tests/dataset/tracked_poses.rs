//! Poses that stand elsewhere than the tracks of their photos say.

use glam::{Quat, Vec2, Vec3};
use std::path::Path;
use trisplat_dataset::{
    Dataset, DatasetOptions,
    tracked_poses::{TrackedPoses, follow_tracks},
};
use trisplat_scene::{Rng, camera::Camera};

/// Viewing distance of the sample's cameras.
const DISTANCE: f32 = 4.0;

fn sample() -> Dataset {
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/dataset");
    Dataset::load(&sample, &DatasetOptions::default()).unwrap()
}

/// The sample with random errors of this standard deviation, px, in turns and motions of its training poses along each axis.
fn disturbed(error_px: f32, seed: u64) -> Dataset {
    let mut dataset = sample();
    for (i, view) in (0..).zip(&mut dataset.views).filter(|(_, view)| !view.test) {
        let rng = Rng::new(seed, "pose", i);
        let vector = |from: u64| Vec3::from_array([0, 1, 2].map(|k| rng.normal(from + k)));
        let angle = error_px / view.camera.focal.x;
        let turn = Quat::from_scaled_axis(angle * vector(0));
        view.camera.rotation = glam::Mat3::from_quat(turn) * view.camera.rotation;
        view.camera.translation = turn * view.camera.translation + angle * DISTANCE * vector(3);
    }
    dataset
}

/// The root of the mean square of how far points of the scene move between the two cameras, px.
fn distance(a: &Camera, b: &Camera, points: &[Vec3]) -> f32 {
    let place = |camera: &Camera, point: Vec3| {
        let q = camera.rotation * point + camera.translation;
        q.truncate() / q.z * camera.focal + camera.center
    };
    let seen: Vec<Vec2> =
        points.iter().filter(|p| a.frames(**p)).map(|p| place(b, *p) - place(a, *p)).collect();
    (seen.iter().map(|d| d.length_squared()).sum::<f32>() / seen.len() as f32).sqrt()
}

/// Root mean square over the training photos, px.
fn error(dataset: &Dataset) -> f32 {
    let truth = sample();
    let points: Vec<Vec3> = truth.points.iter().map(|p| p.position).collect();
    let errors = truth.train().zip(dataset.train()).map(|(a, b)| distance(&a.camera, &b.camera, &points));
    (errors.map(|error| error * error).sum::<f32>() / truth.train().count() as f32).sqrt()
}

fn follow(dataset: &mut Dataset) -> TrackedPoses {
    follow_tracks(dataset, &DatasetOptions::default()).unwrap().unwrap()
}

#[test]
fn poses_that_are_off_are_found_again_within_a_tenth_of_a_pixel() {
    for (error_px, seed) in [(0.25, 5), (0.25, 6), (0.6, 7)] {
        let mut dataset = disturbed(error_px, seed);
        let held_out: Vec<Camera> = dataset.test().map(|view| view.camera).collect();
        let before = error(&dataset);
        let found = follow(&mut dataset);
        let after = error(&dataset);
        assert!(before > 1.5 * error_px && after < 0.1, "{before} px became {after} px");
        assert!(found.moved == 35 && found.error_px[1] < found.error_px[0] && found.kept.is_empty());
        assert!((found.moved_px - before).abs() < 0.2 * before, "{found:?}");
        assert!(dataset.test().map(|view| view.camera).eq(held_out), "held-out poses stay");
    }
}

#[test]
fn right_poses_stay_to_the_bit() {
    let mut dataset = sample();
    let found = follow(&mut dataset);
    assert!(found.moved == 0 && found.moved_px < 0.1 && found.summary().is_none(), "{found:?}");
    assert!(dataset.views.iter().zip(sample().views).all(|(a, b)| a.camera == b.camera));
}

#[test]
fn a_pose_of_another_photo_stays_and_is_named() {
    let mut dataset = disturbed(0.25, 5);
    let first = dataset.views.iter().position(|view| !view.test).unwrap();
    let camera = &mut dataset.views[first].camera;
    camera.rotation = glam::Mat3::from_rotation_y(0.3) * camera.rotation;
    let (name, given) = (dataset.views[first].name.clone(), dataset.views[first].camera);
    let found = follow(&mut dataset);
    assert_eq!((found.moved, &found.kept), (34, &vec![name.clone()]));
    assert_eq!(dataset.views[first].camera, given);
    assert!(found.warning().unwrap().contains(&name));
}

#[test]
fn a_data_set_without_tracks_has_nothing_to_follow() {
    let folder = tempfile::tempdir().unwrap();
    let (sample, model) =
        (Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/dataset"), folder.path().join("sparse/0"));
    std::fs::create_dir_all(&model).unwrap();
    for name in ["cameras.txt", "points3D.txt"] {
        std::fs::copy(sample.join("sparse/0").join(name), model.join(name)).unwrap();
    }
    let images = std::fs::read_to_string(sample.join("sparse/0/images.txt")).unwrap();
    let poses = images.lines().filter(|line| line.starts_with('#') || line.ends_with(".png"));
    let images: String =
        poses.flat_map(|line| [line, "\n", if line.starts_with('#') { "" } else { "\n" }]).collect();
    std::fs::write(model.join("images.txt"), images).unwrap();
    std::fs::create_dir(folder.path().join("images")).unwrap();
    for entry in std::fs::read_dir(sample.join("images")).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, folder.path().join("images").join(path.file_name().unwrap())).unwrap();
    }
    let mut dataset = Dataset::load(folder.path(), &DatasetOptions::default()).unwrap();
    assert_eq!(follow_tracks(&mut dataset, &DatasetOptions::default()).unwrap(), None);
}
