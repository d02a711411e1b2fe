//! The pinhole camera.

use crate::bounds::Bounds;
use crate::error::{Error, Result};
use crate::limits::Limits;
use glam::{DVec2, DVec3, Mat3, Mat4, UVec2, Vec2, Vec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f32::consts::TAU;

/// A pinhole camera with +x right, +y down and +z forward, as in COLMAP: q = K (R v + t). Pixel
/// centres are at +0.5.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// World to camera rotation R.
    pub rotation: Mat3,
    /// World to camera translation t.
    pub translation: Vec3,
    /// Focal lengths, px.
    pub focal: Vec2,
    /// Principal point, px; anywhere.
    pub center: Vec2,
    /// Image width and height, px.
    pub size: UVec2,
}

/// Depths measured in a photo.
#[derive(Debug, Clone, PartialEq)]
pub struct PhotoDepths {
    /// The photo's camera at the size of the map.
    pub camera: Camera,
    /// Depth z in the camera's frame; 0 where none is known. `[height * width]`
    pub depth: Vec<f32>,
    /// sRGB codes. `[height * width]`
    pub rgb: Vec<[u8; 3]>,
}

/// The ranges of a lens, for messages: a lens beyond them draws nothing, or one point.
pub const LENS: &str = "focal lengths of 0.001 to 100,000 times the longer side and a centre within 10,000 times it, px";

/// Elevation of the cameras of [`Camera::orbit`]: 20 degrees, in radians.
const ORBIT_ELEVATION: f32 = TAU / 18.0;

impl Camera {
    /// A camera at `eye` that looks at `target`, with `up` upwards in its picture; `fov_y` is the
    /// vertical field of view, radians.
    pub fn look_at(eye: Vec3, target: Vec3, up: Vec3, fov_y: f32, size: impl Into<UVec2>) -> Self {
        Self::at_origin(fov_y, size.into()).with_look_at(eye, target, up)
    }

    /// Cameras for `count` pictures from a circle around `bounds`, whose +Y points up, each looking
    /// at the middle from 20 degrees above it. The sphere around the box fits into every picture.
    /// `fov_y` as for [`Camera::look_at`].
    pub fn orbit(bounds: &Bounds, count: u32, fov_y: f32, size: impl Into<UVec2>) -> Vec<Self> {
        let size = size.into();
        let lens = Self::at_origin(fov_y, size);
        // The narrower of the two fields of view; a single point is seen from a distance of 1.
        let half_tan = size.min_element() as f32 / (2.0 * lens.focal.y);
        let radius = if bounds.radius() > 0.0 { bounds.radius() } else { half_tan.atan().sin() };
        let distance = radius / half_tan.atan().sin();
        let center = bounds.center();
        let (rise, level) = ORBIT_ELEVATION.sin_cos();
        let place = |k: u32| {
            let (sin, cos) = (TAU * k as f32 / count as f32).sin_cos();
            let offset = Vec3::new(level * sin, rise, level * cos) * distance;
            lens.with_look_at(center + offset, center, Vec3::Y)
        };
        (0..count).map(place).collect()
    }

    /// The camera of a view matrix as of glTF and OpenGL, with +y up and -z forward; `fov_y` in
    /// radians.
    pub fn from_view(view: Mat4, fov_y: f32, size: impl Into<UVec2>) -> Self {
        let turn = Mat3::from_diagonal(Vec3::new(1.0, -1.0, -1.0));
        let rotation = turn * Mat3::from_mat4(view);
        let translation = turn * view.w_axis.truncate();
        Self { rotation, translation, ..Self::at_origin(fov_y, size.into()) }
    }

    fn at_origin(fov_y: f32, size: UVec2) -> Self {
        let focal = Vec2::splat(size.y as f32 / (2.0 * (fov_y / 2.0).tan()));
        let rotation = Mat3::IDENTITY;
        let translation = Vec3::ZERO;
        Self { rotation, translation, focal, center: size.as_vec2() / 2.0, size }
    }

    /// The camera's position in the world: -R^T t.
    pub fn position(&self) -> Vec3 {
        -(self.rotation.transpose() * self.translation)
    }

    /// The same camera for an image resized to `size`.
    pub fn resized(&self, size: UVec2) -> Self {
        let ratio = size.as_vec2() / self.size.as_vec2();
        Self { focal: self.focal * ratio, center: self.center * ratio, size, ..*self }
    }

    /// Project a point of the world: its pixel position and depth, hidden or not; `None` outside
    /// the picture.
    pub fn project(&self, point: Vec3) -> Option<(Vec2, f32)> {
        let in_camera = self.rotation * point + self.translation;
        let at = in_camera.truncate() / in_camera.z * self.focal + self.center;
        let within =
            in_camera.z > 0.0 && at.cmpge(Vec2::ZERO).all() && at.cmplt(self.size.as_vec2()).all();
        within.then_some((at, in_camera.z))
    }

    /// True when a point of the world is within the picture, hidden or not.
    pub fn is_in_frustum(&self, point: Vec3) -> bool {
        let [x, y, z] = (self.rotation * point + self.translation).to_array();
        let [u, v] = [self.focal.x * x + self.center.x * z, self.focal.y * y + self.center.y * z];
        let within = |at: f32, size: u32| at >= 0.0 && at <= size as f32 * z;
        z > 0.0 && within(u, self.size.x) && within(v, self.size.y)
    }

    /// The same camera for a picture with sides of at most `max_side` px.
    pub fn fit_within(&self, max_side: u32) -> Self {
        let share = f64::from(max_side) / f64::from(self.size.max_element());
        if share >= 1.0 {
            *self
        } else {
            self.resized((self.size.as_dvec2() * share).as_uvec2().max(UVec2::ONE))
        }
    }

    /// The same camera moved to `eye`, with `target` in the middle of its view and `up` upwards in
    /// it.
    pub fn with_look_at(&self, eye: Vec3, target: Vec3, up: Vec3) -> Self {
        let forward = (target - eye).normalize_or(Vec3::Z);
        let right =
            forward.cross(up).try_normalize().unwrap_or_else(|| forward.any_orthonormal_vector());
        let rotation = Mat3::from_cols(right, forward.cross(right), forward).transpose();
        Self { rotation, translation: -(rotation * eye), ..*self }
    }

    /// True when a lens may have these focal lengths and this principal point, px, for pictures of
    /// `size`: [`LENS`].
    pub fn is_lens(focal: DVec2, center: DVec2, size: UVec2) -> bool {
        let longer = f64::from(size.max_element());
        let range = 1e-3 * longer..=1e5 * longer;
        size.min_element() > 0
            && focal.to_array().iter().all(|f| range.contains(f))
            && center.abs().max_element() <= 1e4 * longer
    }

    /// Checks that everything is finite, the lens is [possible](Camera::is_lens), and the size is
    /// within `limits`.
    pub fn validate(&self, limits: &Limits) -> Result<()> {
        let finite = self.rotation.is_finite()
            && self.translation.is_finite()
            && self.focal.is_finite()
            && self.center.is_finite();
        if !finite || !Self::is_lens(self.focal.as_dvec2(), self.center.as_dvec2(), self.size) {
            return Err(Error::invalid(
                "camera",
                format!("{self:?}"),
                format!("finite numbers, {LENS}"),
            ));
        }
        limits.camera("camera", self.size)
    }
}

/// The world point nearest to the optical axes of all cameras, in the least-squares sense: their
/// common focus. `None` when the axes are nearly parallel, or when it is behind half of the
/// cameras.
pub fn focus<'a>(cameras: impl Iterator<Item = &'a Camera> + Clone) -> Option<Vec3> {
    let count = cameras.clone().count() as f32;
    let middle = cameras.clone().map(Camera::position).sum::<Vec3>() / count;
    let mut normal = Mat3::ZERO;
    let mut target = Vec3::ZERO;
    for camera in cameras.clone() {
        let axis = camera.rotation.row(2);
        let across = Mat3::IDENTITY - Mat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        normal += across * (1.0 / count);
        target += across * (camera.position() - middle) * (1.0 / count);
    }
    let converging = normal.determinant() > 1e-3;
    if !converging {
        return None;
    }
    let focus = normal.inverse() * target + middle;
    let in_front = cameras.filter(|c| (c.rotation * focus + c.translation).z > 0.0).count();
    (focus.is_finite() && in_front as f32 * 2.0 >= count).then_some(focus)
}

/// The first viewpoint of a scene, in the frame of its file.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Viewpoint {
    /// Position of the viewer.
    pub eye: [f64; 3],
    /// The point that the viewer looks at and orbits.
    pub target: [f64; 3],
    /// Up direction of the photos; a unit vector.
    pub up: [f64; 3],
    /// Vertical field of view, degrees.
    pub fov: f64,
    /// Radius of the subject around the target; absent when unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius: Option<f64>,
    /// Range of the photos' directions around the target; absent when unknown or on all sides.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub orbit: Option<OrbitRange>,
}

/// Range of the photos' directions around a [`Viewpoint`]'s target, and a little beyond. Viewers
/// keep their orbit within.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OrbitRange {
    /// Minimum and maximum turn around the up direction, degrees: 0 is the eye, and more is
    /// counter-clockwise seen from above. Absent when photos surround the target.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turn: Option<[f64; 2]>,
    /// Minimum and maximum elevation above the target, degrees.
    pub elevation: [f64; 2],
}

impl OrbitRange {
    /// True when the numbers are angles, the lower one first, and the eye is within.
    fn is_possible(&self) -> bool {
        let [low, high] = self.elevation;
        let turns =
            |[low, high]: [f64; 2]| (-360.0..=0.0).contains(&low) && (0.0..=360.0).contains(&high);
        -90.0 <= low && low <= high && high <= 90.0 && self.turn.is_none_or(turns)
    }
}

impl Viewpoint {
    /// The camera at this viewpoint, for a picture of `size` px.
    pub fn camera(&self, size: UVec2) -> Camera {
        let focal = size.y as f32 / (2.0 * (self.fov.to_radians() / 2.0).tan() as f32);
        let lens = Camera { focal: Vec2::splat(focal), ..Camera::at_origin(1.0, size) };
        let [eye, target, up] = [self.eye, self.target, self.up].map(|v| DVec3::from(v).as_vec3());
        lens.with_look_at(eye, target, up)
    }

    /// True when a camera can look from here: the numbers fit an `f32`, and distance and angles are
    /// possible.
    pub fn is_possible(&self) -> bool {
        let fits = |v: [f64; 3]| DVec3::from(v).as_vec3().is_finite();
        let placed = [self.eye, self.target, self.up].into_iter().all(fits);
        let distance = self.distance();
        let angle = self.fov.to_radians() as f32;
        let opens = angle > 0.0 && self.fov < 180.0 && distance > 0.0 && distance.is_finite();
        let bounded = self.orbit.is_none_or(|orbit| orbit.is_possible());
        placed && opens && bounded && self.camera(UVec2::ONE).rotation.is_finite()
    }

    /// The turn and elevation of an offset from the target, rad: 0 is the turn of the eye, and more
    /// is counter-clockwise seen from above. `None` for an eye right above the target.
    pub fn direction(&self, offset: DVec3) -> Option<[f64; 2]> {
        let up = DVec3::from(self.up);
        let start =
            (DVec3::from(self.eye) - DVec3::from(self.target)).reject_from(up).try_normalize()?;
        let turn = libm::atan2(offset.dot(up.cross(start)), offset.dot(start));
        let elevation = libm::asin(offset.try_normalize()?.dot(up).clamp(-1.0, 1.0));
        (turn.is_finite() && elevation.is_finite()).then_some([turn, elevation])
    }

    /// Distance from the viewer to the target.
    pub fn distance(&self) -> f32 {
        DVec3::from(self.eye).distance(DVec3::from(self.target)) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Camera = Camera {
        rotation: Mat3::IDENTITY,
        translation: Vec3::ZERO,
        focal: Vec2::splat(100.0),
        center: Vec2::splat(50.0),
        size: UVec2::splat(100),
    };

    #[test]
    fn a_camera_looks_at_its_target_with_up_upwards() {
        let eye = Vec3::new(3.0, -2.0, 1.0);
        let target = Vec3::new(0.5, 0.25, -1.0);
        let camera = CAMERA.with_look_at(eye, target, Vec3::NEG_Y);
        assert!((camera.position() - eye).length() < 1e-5);
        assert!((camera.rotation.determinant() - 1.0).abs() < 1e-5);
        let seen = camera.rotation * target + camera.translation;
        assert!(seen.truncate().length() < 1e-5 && seen.z > 0.0, "{seen}");
        assert!((camera.rotation * Vec3::NEG_Y).y < 0.0, "up is towards smaller rows");
        assert!(
            CAMERA
                .with_look_at(Vec3::ZERO, Vec3::NEG_Y, Vec3::NEG_Y)
                .validate(&Limits::DEFAULT)
                .is_ok(),
            "straight up"
        );
    }

    #[test]
    fn a_view_matrix_gives_the_camera_that_looks_so() {
        let eye = Vec3::new(3.0, -2.0, 1.0);
        let target = Vec3::new(0.5, 0.25, -1.0);
        let looking = Camera::look_at(eye, target, Vec3::Y, 1.0, [64, 48]);
        let viewing = Camera::from_view(
            glam::camera::rh::view::look_at_mat4(eye, target, Vec3::Y),
            1.0,
            [64, 48],
        );
        assert!(looking.rotation.abs_diff_eq(viewing.rotation, 1e-5));
        assert!(looking.translation.abs_diff_eq(viewing.translation, 1e-5));
        assert_eq!((looking.focal, looking.size), (viewing.focal, UVec2::new(64, 48)));
    }

    #[test]
    fn a_camera_of_too_many_pixels_is_refused() {
        for size in [UVec2::splat(65_535), UVec2::splat(u32::MAX), UVec2::new(1, 70_000)] {
            let focal = Vec2::splat(size.max_element() as f32);
            let camera = Camera { size, focal, center: size.as_vec2() / 2.0, ..CAMERA };
            let message = camera.validate(&Limits::DEFAULT).unwrap_err().to_string();
            assert!(message.starts_with("camera: ") && message.contains("`limit` "), "{message}");
        }
        assert!(
            Camera { size: UVec2::new(9504, 6336), ..CAMERA }.validate(&Limits::DEFAULT).is_ok()
        );
    }

    #[test]
    fn the_focus_is_what_all_look_at() {
        let target = Vec3::new(1.0, 2.0, 3.0);
        let eyes = [Vec3::ZERO, Vec3::X * 4.0, Vec3::new(-2.0, 5.0, 1.0)];
        let cameras = eyes.map(|eye| CAMERA.with_look_at(eye, target, Vec3::NEG_Y));
        assert!(focus(cameras.iter()).is_some_and(|f| f.distance(target) < 1e-4));
        let away = eyes.map(|eye| CAMERA.with_look_at(eye, 2.0 * eye - target, Vec3::NEG_Y));
        assert_eq!(focus(away.iter()), None, "it is behind them");
        assert_eq!(focus([CAMERA; 3].iter()), None, "parallel axes");
        assert_eq!(focus([].iter()), None);
    }
}
