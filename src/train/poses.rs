//! Corrections of the photos' poses, found while a scene trains.
//!
//! A correction turns a camera about its own centre and then moves it. Both are counted in pixels: a turn by
//! the pixels that the middle of the photo moves, a motion by those of a point at distance 1, the median
//! distance in training space. Each step moves the correction of its photo against the gradient of the loss,
//! by Adam. What all corrections together do to the scene as a whole (motion, rotation, scale) is taken out,
//! so held-out poses keep their meaning.

use crate::camera::Camera;
use crate::math::normal_equations::solved;
use crate::raster::soft::CameraGrad;
use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Largest turn and largest motion, px.
const MOST_PX: f64 = 3.0;
/// Largest rate, px.
const MOST_RATE: f64 = 0.2;
/// Pull towards the given pose, as a share of the correction per rate: small, because gradients already fix
/// what the photo shows.
const ANCHOR: f64 = 0.05;
/// Decays of Adam's moments. The second is lower than that of triangles: a photo has few steps.
const BETA: [f64; 2] = [0.9, 0.98];
/// Fewer photos do not determine a scene and their own poses.
const LEAST_PHOTOS: usize = 4;

/// The correction of one photo.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
struct Correction {
    /// Turn about the camera's axes, then motion along them, px.
    px: [f32; 6],
    first: [f32; 6],
    second: [f32; 6],
    steps: u32,
}

/// The corrections of all photos.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Poses {
    /// Empty before the first correction. `[photos]`
    corrections: Vec<Correction>,
}

impl Correction {
    /// Turn and motion, in radians and training units, of a camera with this focal length.
    fn motion(&self, focal: f64) -> [DVec3; 2] {
        let at = |k: usize| DVec3::from_array([0, 1, 2].map(|axis| f64::from(self.px[k + axis]) / focal));
        [at(0), at(3)]
    }

    fn set_motion(&mut self, motion: [DVec3; 2], focal: f64) {
        for (px, part) in self.px.chunks_exact_mut(3).zip(motion) {
            let part = (part * focal).clamp_length_max(MOST_PX).as_vec3();
            px.copy_from_slice(&part.to_array());
        }
    }

    /// One step of Adam with this rate, px.
    fn step(&mut self, gradient: &CameraGrad, focal: f64, rate: f64) {
        let gradient = [gradient.rotation, gradient.translation].map(|part| (part / focal).to_array());
        if gradient.as_flattened().iter().any(|g| !g.is_finite()) {
            return;
        }
        self.steps = self.steps.saturating_add(1);
        let late = self.steps.min(1_000_000) as i32;
        let [weight, weight2] = BETA.map(|beta| 1.0 - beta.powi(late));
        for (k, g) in gradient.into_iter().flatten().enumerate() {
            let first = BETA[0] * f64::from(self.first[k]) + (1.0 - BETA[0]) * g;
            let second = BETA[1] * f64::from(self.second[k]) + (1.0 - BETA[1]) * g * g;
            (self.first[k], self.second[k]) = (first as f32, second as f32);
            let by = first / weight / ((second / weight2).sqrt() + 1e-15);
            self.px[k] -= (rate * (by + ANCHOR * f64::from(self.px[k]))) as f32;
        }
        self.set_motion(self.motion(focal), focal);
    }
}

impl Poses {
    /// True when photos with these flags, true for photos and false for drawn pictures, can be corrected.
    pub(super) fn are_possible(photos: &[bool]) -> bool {
        photos.iter().filter(|photo| **photo).count() >= LEAST_PHOTOS
    }

    /// Moves the pose of photo `index` against `gradient`, by about `rate` px. `given` are the cameras of all
    /// photos, in training space.
    pub(super) fn step(&mut self, index: usize, gradient: &CameraGrad, rate: f64, given: &[Camera]) {
        if self.corrections.is_empty() {
            self.corrections.resize(given.len(), Correction::default());
        }
        self.corrections[index].step(gradient, given[index].mean_focal(), rate.min(MOST_RATE));
    }

    /// The corrected camera of photo `index`, which is the given one as long as nothing was corrected.
    pub(super) fn camera(&self, index: usize, given: &Camera) -> Camera {
        let Some(correction) = self.corrections.get(index).filter(|c| c.px != [0.0; 6]) else {
            return *given;
        };
        let [turn, motion] = correction.motion(given.mean_focal());
        given.moved(turn, motion)
    }

    /// Takes out the motion, rotation and scale that the corrections of `photos` have in common: the least
    /// squares of what they move in the photos. Turns alone would not tell: the scene also moves upwards when all
    /// cameras turn a little downwards.
    pub(super) fn settle(&mut self, given: &[Camera], photos: &[bool]) {
        let all: Vec<usize> = (0..self.corrections.len()).filter(|i| photos[*i]).collect();
        let count = all.len().max(1) as f64;
        let center = all.iter().map(|i| given[*i].position().as_dvec3()).sum::<DVec3>() / count;
        let (mut matrix, mut wanted) = ([[0.0; 7]; 7], [0.0; 7]);
        for &i in &all {
            let common = common_motions(&given[i], center);
            let metric = metric(&given[i]);
            let own = flat(self.corrections[i].motion(given[i].mean_focal()));
            for (row, a) in common.iter().enumerate() {
                wanted[row] += product(&metric, a, &own);
                common.iter().enumerate().for_each(|(k, b)| matrix[row][k] += product(&metric, a, b));
            }
        }
        let shares = solved(matrix, wanted);
        for &i in &all {
            let mut own = flat(self.corrections[i].motion(given[i].mean_focal()));
            for (share, motion) in shares.iter().zip(common_motions(&given[i], center)) {
                own.iter_mut().zip(motion).for_each(|(x, m)| *x -= share * m);
            }
            let parts = [0, 3].map(|k| DVec3::new(own[k], own[k + 1], own[k + 2]));
            self.corrections[i].set_motion(parts, given[i].mean_focal());
        }
    }

    /// What was corrected, for photos with these names; `None` if nothing was.
    pub(super) fn details<'a>(&self, names: impl Iterator<Item = &'a str>) -> Option<PoseDetails> {
        let photo = |(name, correction): (&str, &Correction)| {
            let length = |k: usize| DVec3::from_array([0, 1, 2].map(|a| f64::from(correction.px[k + a])));
            let [turn_px, motion_px] = [0, 3].map(|k| length(k).length() as f32);
            PhotoPose { name: name.to_owned(), turn_px, motion_px }
        };
        let photos: Vec<PhotoPose> = names.zip(&self.corrections).map(photo).collect();
        let count = photos.len().max(1) as f32;
        let mean_px = photos.iter().map(|p| p.turn_px.hypot(p.motion_px)).sum::<f32>() / count;
        (!photos.is_empty()).then_some(PoseDetails { mean_px, photos })
    }
}

/// Turn and motion of a camera, radians and training units, about and along its own axes.
type Motion = [f64; 6];

fn flat([turn, motion]: [DVec3; 2]) -> Motion {
    [turn.x, turn.y, turn.z, motion.x, motion.y, motion.z]
}

/// How a camera moves when the whole scene turns about each axis of the world through `center`, moves along it, and
/// grows: by one unit each.
fn common_motions(camera: &Camera, center: DVec3) -> [Motion; 7] {
    let (to_camera, arm) = (camera.rotation.as_dmat3(), camera.position().as_dvec3() - center);
    let seen = |turn: DVec3, motion: DVec3| flat([-(to_camera * turn), -(to_camera * motion)]);
    let axes = DVec3::AXES;
    let [x, y, z] = axes.map(|axis| seen(axis, axis.cross(arm)));
    let [along_x, along_y, along_z] = axes.map(|axis| seen(DVec3::ZERO, axis));
    [x, y, z, along_x, along_y, along_z, seen(DVec3::ZERO, arm)]
}

/// The sum of what motions move in a photo, squared px, as a matrix: of points over the photo, at distances around
/// 1, the median in training space.
fn metric(camera: &Camera) -> [Motion; 6] {
    let mut sum = [[0.0; 6]; 6];
    let (size, focal, center) = (camera.size.as_dvec2(), camera.focal.as_dvec2(), camera.center.as_dvec2());
    for k in 0..75 {
        let place = DVec2::new(f64::from(k % 5) + 0.5, f64::from(k / 5 % 5) + 0.5) / 5.0;
        let [x, y] = ((size * place - center) / focal).to_array();
        let near = [1.5, 1.0, 2.0 / 3.0][k as usize / 25];
        // Of q = (x, y, 1) / near: f (dq_x - x dq_z) near, dq = turn × q + motion.
        let right = [-x * y, 1.0 + x * x, -y, near, 0.0, -x * near].map(|d| focal.x * d);
        let down = [-1.0 - y * y, x * y, x, 0.0, near, -y * near].map(|d| focal.y * d);
        for row in 0..6 {
            for column in 0..6 {
                sum[row][column] += right[row] * right[column] + down[row] * down[column];
            }
        }
    }
    sum
}

/// a · metric · b.
fn product(metric: &[Motion; 6], a: &Motion, b: &Motion) -> f64 {
    let row = |row: &Motion| row.iter().zip(b).map(|(m, b)| m * b).sum::<f64>();
    a.iter().zip(metric).map(|(a, m)| a * row(m)).sum()
}

/// The corrections of a run. The corrected cameras are those of its file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PoseDetails {
    /// Mean size of the corrections, px.
    pub mean_px: f32,
    /// Photo by photo.
    pub photos: Vec<PhotoPose>,
}

/// The correction of a photo's pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PhotoPose {
    /// The photo.
    pub name: String,
    /// Its turn, as a distance in the middle of the photo, px.
    pub turn_px: f32,
    /// Its motion, as a distance of points at the median distance, px.
    pub motion_px: f32,
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat3, UVec2, Vec2, Vec3};

    fn cameras() -> Vec<Camera> {
        let camera = |i: i32| {
            let rotation = Mat3::from_rotation_y(0.7 * i as f32) * Mat3::from_rotation_x(0.1 * i as f32);
            let eye = Vec3::new((i as f32).cos(), 0.2 * (i % 3) as f32, (1.3 * i as f32).sin());
            let (focal, size) = (Vec2::splat(120.0), UVec2::new(160, 120));
            Camera { rotation, translation: -(rotation * eye), focal, center: size.as_vec2() / 2.0, size }
        };
        (0..9).map(camera).collect()
    }

    #[test]
    fn a_step_moves_a_pose_against_its_gradient() {
        let (given, mut poses) = (cameras(), Poses::default());
        assert_eq!(poses.camera(3, &given[3]), given[3]);
        let gradient = CameraGrad { rotation: DVec3::X, translation: -DVec3::Z };
        poses.step(3, &gradient, 0.1, &given);
        assert_eq!(poses.camera(2, &given[2]), given[2], "others stay");
        let moved = poses.camera(3, &given[3]);
        // A tenth of a pixel each.
        let point = given[3].position() + given[3].rotation.transpose() * Vec3::Z;
        let before = given[3].rotation * point + given[3].translation;
        let after = moved.rotation * point + moved.translation;
        let change = (after - before) * 120.0;
        assert!(change.distance(Vec3::new(0.0, 0.1, 0.1)) < 2e-3, "{change}");
        for _ in 0..100 {
            poses.step(3, &gradient, 0.1, &given);
        }
        let details = poses.details(["a"; 9].into_iter()).unwrap();
        assert!(
            (details.photos[3].turn_px - 3.0).abs() < 1e-5
                && (details.photos[3].motion_px - 3.0).abs() < 1e-5
        );
        let kept = poses.clone();
        poses.step(3, &CameraGrad { rotation: DVec3::NAN, ..gradient }, 0.1, &given);
        assert_eq!(poses, kept);
    }

    #[test]
    fn what_moves_the_whole_scene_is_taken_out() {
        let given = cameras();
        let whole = |i: usize, own: [DVec3; 2]| {
            let (turn, shift, growth) =
                (DVec3::new(0.004, -0.002, 0.001), DVec3::new(0.01, 0.002, -0.003), 0.002);
            let c = given[i].position().as_dvec3();
            let moved = [turn, shift + turn.cross(c) + growth * c];
            let to_camera = given[i].rotation.as_dmat3();
            let mut correction = Correction::default();
            let parts = [0, 1].map(|k| own[k] - to_camera * moved[k]);
            correction.set_motion(parts, 120.0);
            correction
        };
        let photos = [true; 9];
        let mut poses = Poses { corrections: (0..9).map(|i| whole(i, [DVec3::ZERO; 2])).collect() };
        poses.settle(&given, &photos);
        let left = poses.corrections.iter().flat_map(|c| c.px).fold(0f32, |most, px| most.max(px.abs()));
        assert!(left < 1e-4, "{left}");
        // A correction of its own stays, for the most part, and another time changes nothing.
        let one = |i: usize| if i == 4 { [DVec3::X * 0.005, DVec3::ZERO] } else { [DVec3::ZERO; 2] };
        let mut poses = Poses { corrections: (0..9).map(|i| whole(i, one(i))).collect() };
        poses.settle(&given, &photos);
        assert!((0.3..0.6).contains(&poses.corrections[4].px[0]), "{:?}", poses.corrections[4].px);
        let once = poses.clone();
        poses.settle(&given, &photos);
        for (a, b) in once.corrections.iter().zip(&poses.corrections) {
            assert!(a.px.iter().zip(&b.px).all(|(a, b)| (a - b).abs() < 1e-4));
        }
    }
}
