//! Poses that are half a pixel off, found again while a scene is trained.

use super::{psnr, train};
use glam::{Quat, Vec2, Vec3};
use std::path::Path;
use trisplat::camera::Camera;
use trisplat::dataset::{Dataset, DatasetOptions};
use trisplat::rng::Rng;
use trisplat::train::{PoseUse, RunOptions, TrainOptions, TrainPreset, TrainRun, checkpoint};

/// Standard deviation of the errors along each axis, px: for rotation and for position.
const ERROR_PX: f32 = 0.25;
/// Viewing distance of the sample's cameras.
const DISTANCE: f32 = 4.0;

fn options(poses: PoseUse) -> TrainOptions {
    TrainOptions { steps: 800, max_triangles: 3000, poses, ..TrainOptions::preset(TrainPreset::Solid) }
}

/// The sample data set, and the same with errors in the poses of its training photos.
fn data_sets() -> [Dataset; 2] {
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/dataset");
    let truth = Dataset::load(&sample, &DatasetOptions::default()).unwrap();
    let mut disturbed = truth.clone();
    for (i, view) in (0..).zip(&mut disturbed.views).filter(|(_, view)| !view.test) {
        let rng = Rng::new(5, "pose", i);
        let vector = |from: u64| Vec3::from_array([0, 1, 2].map(|k| rng.normal(from + k)));
        let angle = ERROR_PX / view.camera.focal.x;
        let camera = &mut view.camera;
        let turn = Quat::from_scaled_axis(angle * vector(0));
        camera.rotation = glam::Mat3::from_quat(turn) * camera.rotation;
        camera.translation = turn * camera.translation + angle * DISTANCE * vector(3);
    }
    [truth, disturbed]
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

#[test]
fn poses_half_a_pixel_off_are_found_again() {
    let [truth, disturbed] = data_sets();
    let points: Vec<Vec3> = truth.points.iter().map(|p| p.position).collect();
    let error = |cameras: &[Camera]| {
        let errors = truth.train().zip(cameras).map(|(view, camera)| distance(&view.camera, camera, &points));
        errors.sum::<f32>() / cameras.len() as f32
    };
    let given = train(&disturbed, &options(PoseUse::Off)).unwrap();
    let found = train(&disturbed, &options(PoseUse::On)).unwrap();
    assert!(
        given.poses.is_none() && given.cameras.iter().zip(disturbed.train()).all(|(c, v)| *c == v.camera)
    );
    let (before, after) = (error(&given.cameras), error(&found.cameras));
    // A part of what is left moves the whole scene, which no photo shows: docs/benchmarks/poses.md.
    assert!(before > 0.4 && after < 0.25, "{before} px became {after} px");
    assert!(psnr(&found) > psnr(&given) + 0.2, "{} dB became {} dB", psnr(&given), psnr(&found));
}

#[test]
fn a_run_that_goes_on_finds_the_same_poses() {
    let [_, disturbed] = data_sets();
    let options = TrainOptions { steps: 120, ..options(PoseUse::On) };
    let straight = train(&disturbed, &options).unwrap();
    assert!(straight.cameras.iter().zip(disturbed.train()).any(|(camera, view)| *camera != view.camera));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.checkpoint");
    let outputs =
        RunOptions { checkpoint: Some(path.clone()), checkpoint_every: 60, ..RunOptions::default() };
    let half = TrainRun { outputs, until_step: Some(60), ..TrainRun::new(&disturbed, &options) };
    half.run(&mut ()).unwrap();
    let resumed =
        TrainRun::from_checkpoint(&disturbed, checkpoint::read(&path).unwrap()).run(&mut ()).unwrap();
    assert!(
        resumed.soup == straight.soup
            && resumed.cameras == straight.cameras
            && resumed.poses == straight.poses
    );
}
