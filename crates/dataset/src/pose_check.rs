//! Checks cameras against the points, and names the usual mistakes of those who write poses: axes
//! of another program, and matrices of the other direction.

use super::dataset::{Dataset, DatasetKind};
use glam::{DMat3, DVec3};
use trisplat_scene::camera::Camera;
use trisplat_scene::math::lists::evenly_spaced;

/// Points that are looked at.
const POINTS: usize = 2000;
/// Fewer say nothing.
const MIN_POINTS: usize = 50;
/// Share of the points that some camera shows where poses are right.
const MIN_SHOWN: f64 = 0.5;

/// The pose that was meant shows a point to this many times as many cameras.
const MIN_GAIN: f64 = 2.0;

/// World to camera, in f64.
#[derive(Clone, Copy)]
pub(super) struct Pose {
    pub(super) rotation: DMat3,
    pub(super) translation: DVec3,
}

/// A mistake: the name of what the poses are, the remedy, and the pose that was meant.
pub(super) type Mistake = (&'static str, &'static str, fn(Pose) -> Pose);

/// Mistakes of those who write a `transforms.json`.
const IN_TRANSFORMS: [Mistake; 3] = [
    (
        "with OpenCV's axes (x right, y down, z forward)",
        "multiply columns 2 and 3 of each transform_matrix by -1",
        with_other_axes,
    ),
    ("from world to camera", "invert each transform_matrix", |pose| {
        with_other_axes(inverse(with_other_axes(pose)))
    }),
    (
        "from world to camera with OpenCV's axes",
        "invert each transform_matrix, and multiply columns 2 and 3 of the result by -1",
        |pose| inverse(with_other_axes(pose)),
    ),
];
/// Mistakes of those who write a COLMAP model.
const IN_COLMAP: [Mistake; 3] = [
    (
        "with OpenGL's axes (x right, y up, z back)",
        "multiply rows 2 and 3 of each rotation and translation by -1",
        with_other_axes,
    ),
    ("from camera to world", "invert each pose", inverse),
    (
        "from camera to world with OpenGL's axes",
        "invert each pose, and multiply rows 2 and 3 of the result by -1",
        |pose| with_other_axes(inverse(pose)),
    ),
];

/// From OpenCV's axes to OpenGL's and back.
fn with_other_axes(pose: Pose) -> Pose {
    let turn = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    Pose { rotation: turn * pose.rotation, translation: turn * pose.translation }
}

fn inverse(pose: Pose) -> Pose {
    let rotation = pose.rotation.transpose();
    Pose { rotation, translation: -(rotation * pose.translation) }
}

/// The warning that cameras do not show the points, with the reason if one of the usual mistakes
/// explains it. Where photos track points, their reader compares places in photos instead.
pub(super) fn unseen_points(dataset: &Dataset) -> Option<String> {
    let points: Vec<DVec3> = evenly_spaced(dataset.points.len(), POINTS)
        .map(|i| dataset.points[i].position.as_dvec3() + dataset.origin)
        .collect();
    if points.len() < MIN_POINTS || dataset.has_tracks() {
        return None;
    }
    let poses: Vec<(Pose, Camera)> = dataset
        .views
        .iter()
        .map(|view| (world_pose(&view.camera, dataset.origin), view.camera))
        .collect();
    let shown = ShownShares::of(&points, &poses, |pose| pose);
    let tried = mistakes(dataset.kind)
        .map(|mistake| (ShownShares::of(&points, &poses, mistake.2), mistake));
    // The first of equals is the simplest.
    let best = |share: fn(&ShownShares) -> f64| {
        tried.iter().rev().max_by(|a, b| share(&a.0).total_cmp(&share(&b.0)))
    };
    if shown.any < MIN_SHOWN {
        let seen = format!(
            "only {:.0}% of the points are in front of and inside any camera",
            100.0 * shown.any
        );
        return Some(match best(|shares| shares.any) {
            Some((better, (name, remedy, _))) if better.any >= MIN_SHOWN.max(1.5 * shown.any) => {
                format!(
                    "{seen}; read as poses {name} it would be {:.0}%: {remedy}",
                    100.0 * better.any
                )
            }
            _ => format!(
                "{seen}: poses and points may be of two worlds, or much was not photographed"
            ),
        });
    }
    // Around an object, wrong poses stand in its middle, and some look at any point.
    let (better, (name, remedy, _)) = best(|shares| shares.mean)?;
    (better.mean >= MIN_SHOWN && better.mean >= MIN_GAIN * shown.mean).then(|| {
        format!(
            "a point is in front of and inside only {:.0}% of the cameras; read as poses {name} it \
             would be {:.0}%: {remedy}",
            100.0 * shown.mean,
            100.0 * better.mean
        )
    })
}

/// The mistakes of those who write poses of this kind.
pub(super) fn mistakes(kind: DatasetKind) -> [Mistake; 3] {
    match kind {
        DatasetKind::ColmapBinary | DatasetKind::ColmapText => IN_COLMAP,
        _ => IN_TRANSFORMS,
    }
}

/// Shares of points that cameras show.
struct ShownShares {
    /// Points that some camera shows.
    any: f64,
    /// Cameras that show a point, on average.
    mean: f64,
}

impl ShownShares {
    /// Of cameras with changed poses.
    fn of(points: &[DVec3], cameras: &[(Pose, Camera)], change: fn(Pose) -> Pose) -> Self {
        let cameras: Vec<(Pose, &Camera)> =
            cameras.iter().map(|(pose, camera)| (change(*pose), camera)).collect();
        let mut some = 0;
        let mut all = 0;
        for point in points {
            let count = cameras.iter().filter(|(pose, camera)| pose.shows(camera, *point)).count();
            some += usize::from(count > 0);
            all += count;
        }
        let count = points.len() as f64;
        Self { any: some as f64 / count, mean: all as f64 / count / cameras.len() as f64 }
    }
}

fn world_pose(camera: &Camera, origin: DVec3) -> Pose {
    let rotation = camera.rotation.as_dmat3();
    Pose { rotation, translation: camera.translation.as_dvec3() - rotation * origin }
}

impl Pose {
    /// True for a point in front of a camera at this pose, and inside its picture.
    fn shows(&self, camera: &Camera, point: DVec3) -> bool {
        let at = self.rotation * point + self.translation;
        let pixel = at.truncate() / at.z * camera.focal.as_dvec2() + camera.center.as_dvec2();
        at.z > 0.0
            && pixel.cmpge(glam::DVec2::ZERO).all()
            && pixel.cmplt(camera.size.as_dvec2()).all()
    }
}
