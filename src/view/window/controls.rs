//! Where the viewer stands and looks: orbit around a point, or fly.

use super::super::layout::Bounds;
use crate::camera::Camera;
use glam::{Mat3, Quat, UVec2, Vec2, Vec3};
use std::f32::consts::FRAC_PI_2;

/// A full drag across the window's height turns by this, rad.
const TURN: f32 = 3.0;
/// How near to straight up and down the view may come, rad.
const POLE: f32 = 0.02;
/// Height of view when no photo's camera is used, rad.
const HEIGHT_OF_VIEW: f32 = 0.9;

/// The viewer's place, direction and lens.
#[derive(Debug, Clone)]
pub struct Controls {
    /// World to camera rotation: rows are right, down and forward.
    rotation: Mat3,
    eye: Vec3,
    /// How far ahead the point is that an orbit turns about.
    reach: f32,
    up: Vec3,
    /// Focal lengths, centre and size to be fitted into the window.
    lens: Camera,
    /// Size of the scene: the unit of speed and of the near plane.
    extent: f32,
}

/// The keys that are down, each axis in -1, 0, 1.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Keys {
    /// D - A.
    pub right: f32,
    /// E - Q.
    pub up: f32,
    /// W - S.
    pub forward: f32,
    /// Shift: faster.
    pub fast: bool,
}

impl Keys {
    /// Whether a key moves the viewer.
    pub fn any(&self) -> bool {
        self.right != 0.0 || self.up != 0.0 || self.forward != 0.0
    }
}

impl Controls {
    /// A viewer who has `bounds` in view from a little above; `up` is the world's axis that points up.
    pub fn new(bounds: &Bounds, up: Vec3) -> Self {
        let size = UVec2::splat(1000);
        let focal = Vec2::splat(500.0 / (HEIGHT_OF_VIEW / 2.0).tan());
        let (rotation, translation) = (Mat3::IDENTITY, Vec3::ZERO);
        let lens = Camera { rotation, translation, focal, center: size.as_vec2() / 2.0, size };
        let up = up.normalize_or(Vec3::Y);
        let mut controls = Self { rotation, eye: Vec3::ZERO, reach: 1.0, up, lens, extent: 1.0 };
        let ahead = up.any_orthonormal_vector();
        controls.turn_to(ahead - 0.45 * up);
        controls.frame(bounds);
        controls
    }

    /// Steps back along the view until `bounds` is in it, with the lens of no photo.
    pub fn frame(&mut self, bounds: &Bounds) {
        let (min, max) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
        let radius = (0.5 * (max - min).length()) as f32;
        let finite = radius.is_finite() && radius > 0.0;
        self.extent = if finite { radius } else { 1.0 };
        let target = if finite { (0.5 * (min + max)).as_vec3() } else { Vec3::ZERO };
        let size = UVec2::splat(1000);
        let focal = Vec2::splat(500.0 / (HEIGHT_OF_VIEW / 2.0).tan());
        self.lens = Camera { focal, center: size.as_vec2() / 2.0, size, ..self.lens };
        self.reach = self.extent / (HEIGHT_OF_VIEW / 2.0).sin();
        self.eye = target - self.forward() * self.reach;
    }

    /// Stands where a camera stands, looks as it looks, through its lens.
    pub fn jump(&mut self, camera: &Camera) {
        self.rotation = camera.rotation;
        self.eye = camera.position();
        self.lens = *camera;
        // What photos look at is usually about as far away as the scene is large.
        self.reach = self.reach.min(self.extent).max(0.1 * self.extent);
    }

    /// Sets the distance to what a click has hit: the next orbit turns about it.
    pub fn reach_to(&mut self, distance: f32) {
        if distance.is_finite() && distance > 0.0 {
            self.reach = distance;
        }
    }

    /// The camera for a window of `size`: the whole lens is in view, in the middle of `pane`.
    pub fn camera(&self, size: UVec2, pane: Pane) -> Camera {
        let scale = (pane.size / self.lens.size.as_vec2()).min_element();
        let off_center = self.lens.center - 0.5 * self.lens.size.as_vec2();
        Camera {
            rotation: self.rotation,
            translation: -(self.rotation * self.eye),
            focal: self.lens.focal * scale,
            center: pane.min + 0.5 * pane.size + off_center * scale,
            size,
        }
    }

    /// Where the lens' picture lies in the window.
    pub fn picture(&self, pane: Pane) -> Pane {
        let size = self.lens.size.as_vec2() * (pane.size / self.lens.size.as_vec2()).min_element();
        Pane { min: pane.min + 0.5 * (pane.size - size), size }
    }

    /// Depth in front of which nothing is drawn.
    pub fn near(&self) -> f32 {
        (1e-3 * self.extent.min(self.reach)).max(f32::MIN_POSITIVE)
    }

    /// Turns about the point ahead by a drag, in heights of the window.
    pub fn orbit(&mut self, drag: Vec2) {
        let pivot = self.eye + self.forward() * self.reach;
        self.look(-drag);
        self.eye = pivot - self.forward() * self.reach;
    }

    /// Turns on the spot by a drag, in heights of the window.
    pub fn look(&mut self, drag: Vec2) {
        let forward = self.forward();
        let elevation = forward.dot(self.up).clamp(-1.0, 1.0).asin();
        let rise = (elevation + TURN * drag.y).clamp(POLE - FRAC_PI_2, FRAC_PI_2 - POLE) - elevation;
        let yaw = Quat::from_axis_angle(self.up, TURN * drag.x);
        let pitch = Quat::from_axis_angle(self.right(), rise);
        self.rotation = orthonormal(
            self.rotation * Mat3::from_quat(pitch).transpose() * Mat3::from_quat(yaw).transpose(),
        );
    }

    /// Moves across the view by a drag, in heights of the window, so that the point ahead follows it.
    pub fn pan(&mut self, drag: Vec2) {
        let height = self.reach * self.lens.size.y as f32 / self.lens.focal.y;
        self.eye -= (self.right() * drag.x + self.down() * drag.y) * height;
    }

    /// Comes nearer by steps of the wheel.
    pub fn zoom(&mut self, steps: f32) {
        let nearer = self.reach * (1.0 - 0.85f32.powf(steps));
        self.eye += self.forward() * nearer;
        // Close to the point ahead the wheel pushes it on, so that one is never stuck before it.
        self.reach = (self.reach - nearer).max(0.02 * self.extent);
    }

    /// Flies for `secs`.
    pub fn fly(&mut self, keys: &Keys, secs: f32) {
        let way = self.right() * keys.right + self.up * keys.up + self.forward() * keys.forward;
        let speed = if keys.fast { 2.0 } else { 0.5 } * self.extent;
        self.eye += way.normalize_or_zero() * speed * secs.min(0.1);
    }

    /// Where the viewer stands.
    pub fn eye(&self) -> Vec3 {
        self.eye
    }

    fn right(&self) -> Vec3 {
        self.rotation.row(0)
    }

    fn down(&self) -> Vec3 {
        self.rotation.row(1)
    }

    fn forward(&self) -> Vec3 {
        self.rotation.row(2)
    }

    fn turn_to(&mut self, forward: Vec3) {
        self.rotation = self.lens.looking(Vec3::ZERO, forward, self.up).rotation;
    }
}

/// A part of the window, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pane {
    /// Left upper corner.
    pub min: Vec2,
    /// Width and height.
    pub size: Vec2,
}

/// The rotation nearest to a product of rotations that has gathered rounding.
fn orthonormal(rotation: Mat3) -> Mat3 {
    Mat3::from_quat(Quat::from_mat3(&rotation).normalize())
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOX: Bounds = Bounds { min: Vec3::new(-1.0, 0.0, 2.0), max: Vec3::new(3.0, 1.0, 4.0) };
    const PANE: Pane = Pane { min: Vec2::ZERO, size: Vec2::new(800.0, 600.0) };
    const SIZE: UVec2 = UVec2::new(800, 600);

    fn pixel(camera: &Camera, point: Vec3) -> Vec2 {
        let seen = camera.rotation * point + camera.translation;
        assert!(seen.z > 0.0);
        seen.truncate() / seen.z * camera.focal + camera.center
    }

    #[test]
    fn framing_has_every_corner_of_the_box_in_view() {
        for up in [Vec3::Y, Vec3::NEG_Y, Vec3::Z] {
            let camera = Controls::new(&BOX, up).camera(SIZE, PANE);
            camera.validate().unwrap();
            for i in 0..8 {
                let pick =
                    |bit: usize, axis: usize| if i >> bit & 1 == 0 { BOX.min[axis] } else { BOX.max[axis] };
                let at = pixel(&camera, Vec3::new(pick(0, 0), pick(1, 1), pick(2, 2)));
                assert!(at.cmpge(Vec2::ZERO).all() && at.cmple(SIZE.as_vec2()).all(), "{at}");
            }
            assert!((camera.rotation * up).y < 0.0, "up is up");
        }
        Controls::new(&Bounds::EMPTY, Vec3::Y).camera(SIZE, PANE).validate().unwrap();
    }

    #[test]
    fn an_orbit_keeps_the_point_ahead_in_the_middle_and_never_turns_over() {
        let mut controls = Controls::new(&BOX, Vec3::Y);
        let target = 0.5 * (BOX.min + BOX.max);
        for i in 0..400 {
            controls.orbit(Vec2::new(0.03, if i < 200 { 0.05 } else { -0.07 }));
            let camera = controls.camera(SIZE, PANE);
            assert!(pixel(&camera, target).distance(SIZE.as_vec2() / 2.0) < 0.5);
            assert!((camera.rotation * Vec3::Y).y < 0.0, "turned over");
            assert!((camera.rotation.determinant() - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn dragging_to_the_right_shows_what_was_on_the_left() {
        let mut controls = Controls::new(&BOX, Vec3::Y);
        let (before, point) = (controls.camera(SIZE, PANE), BOX.min);
        controls.orbit(Vec2::new(0.01, 0.0));
        let near = controls.eye() + (0.5 * (BOX.min + BOX.max) - controls.eye()) * 0.5;
        let moved = pixel(&controls.camera(SIZE, PANE), near).x - pixel(&before, near).x;
        assert!(moved > 0.0, "what is in front follows the mouse, not {moved}");
        let mut panned = Controls::new(&BOX, Vec3::Y);
        panned.pan(Vec2::new(0.1, 0.05));
        let target = 0.5 * (BOX.min + BOX.max);
        let at = pixel(&panned.camera(SIZE, PANE), target) - SIZE.as_vec2() / 2.0;
        assert!(at.distance(Vec2::new(60.0, 30.0)) < 1.0, "{at}");
        assert!(pixel(&before, point).is_finite());
    }

    #[test]
    fn a_jump_shows_the_photos_picture_in_the_pane() {
        let lens = Camera {
            rotation: Mat3::IDENTITY,
            translation: Vec3::new(0.1, 0.2, 3.0),
            focal: Vec2::new(500.0, 510.0),
            center: Vec2::new(310.0, 250.0),
            size: UVec2::new(640, 480),
        };
        let mut controls = Controls::new(&BOX, Vec3::Y);
        controls.jump(&lens);
        let pane = Pane { min: Vec2::new(200.0, 0.0), size: Vec2::new(600.0, 600.0) };
        let camera = controls.camera(SIZE, pane);
        let picture = controls.picture(pane);
        assert_eq!(picture.size, Vec2::new(600.0, 450.0));
        for point in [Vec3::new(0.3, -0.4, 1.0), Vec3::new(-1.0, 0.2, 2.0)] {
            let wants = picture.min + pixel(&lens, point) * (600.0 / 640.0);
            assert!(pixel(&camera, point).distance(wants) < 1e-3);
        }
        let before = controls.eye();
        controls.fly(&Keys { forward: 1.0, ..Keys::default() }, 0.05);
        assert!((controls.eye() - before).dot(Vec3::Z) > 0.0);
        assert!(!Keys::default().any());
    }

    #[test]
    fn the_wheel_never_stops_or_passes_infinity() {
        let mut controls = Controls::new(&BOX, Vec3::Y);
        let start = controls.eye();
        for _ in 0..100 {
            controls.zoom(1.0);
        }
        assert!(controls.eye().distance(start) > 4.0);
        for _ in 0..100 {
            controls.zoom(-1.0);
        }
        assert!(controls.eye().is_finite() && controls.near() > 0.0);
    }
}
