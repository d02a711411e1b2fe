//! The camera that the user controls: orbit around a pivot, or fly.

use glam::{DVec3, Mat3, Quat, UVec2, Vec2, Vec3};
use std::collections::HashSet;
use std::f32::consts::FRAC_PI_2;
use trisplat_scene::camera::{Camera, OrbitRange, Viewpoint};
use trisplat_scene::{Placement, frames};
use winit::keyboard::KeyCode;

/// A drag across the whole height of the window turns the camera by this, rad.
const DRAG_ANGLE: f32 = 3.0;
/// Minimum angle between the view and straight up or down, rad.
const POLE_MARGIN: f32 = 0.02;
/// A drag by this share of the height of the window leaves a third of the roll.
const LEVEL_DRAG: f32 = 0.06;
/// Vertical field of view when no photo's camera is used, rad.
const FIELD_OF_VIEW: f32 = 0.9;

/// Largest distance of a view, as a share of the distance to the walls or shell that close the
/// scene.
const ROOM: f32 = 0.9;
/// The sine of half the angle of the widest lens.
const MAX_SINE: f32 = 0.85;

/// Position, direction and intrinsics of the camera.
#[derive(Debug, Clone)]
pub(super) struct CameraControls {
    /// World to camera rotation: rows are right, down and forward.
    rotation: Mat3,
    position: Vec3,
    /// Distance to the pivot, the point ahead at the centre of orbits.
    pivot_distance: f32,
    up: Vec3,
    /// Focal lengths, centre and size, to be scaled to the window.
    intrinsics: Camera,
    /// Size of the scene: the unit of speed and of the near plane.
    extent: f32,
    /// Middle of what the photos show; orbits stay there.
    range: Option<(Viewpoint, OrbitRange)>,
}

impl CameraControls {
    /// A camera that sees `bounds` from a little above; `up` is the world's axis that points up.
    pub(super) fn new(bounds: &[Vec3; 2], up: Vec3) -> Self {
        let up = up.normalize_or(Vec3::Y);
        let ahead = up.any_orthonormal_vector() - 0.45 * up;
        let intrinsics = Camera::look_at(Vec3::ZERO, ahead, up, FIELD_OF_VIEW, UVec2::splat(1000));
        let mut controls = Self {
            rotation: intrinsics.rotation,
            position: Vec3::ZERO,
            pivot_distance: 1.0,
            up,
            intrinsics,
            extent: 1.0,
            range: None,
        };
        controls.frame(bounds);
        controls
    }

    /// Moves back along the view until `bounds` is visible, with the default field of view.
    pub(super) fn frame(&mut self, bounds: &[Vec3; 2]) {
        let [min, max] = bounds.map(|corner| corner.as_dvec3());
        let radius = (0.5 * (max - min).length()) as f32;
        let finite = radius.is_finite() && radius > 0.0;
        self.extent = if finite { radius } else { 1.0 };
        let target = if finite { (0.5 * (min + max)).as_vec3() } else { Vec3::ZERO };
        self.intrinsics =
            Camera::look_at(Vec3::ZERO, Vec3::Z, self.up, FIELD_OF_VIEW, UVec2::splat(1000));
        self.pivot_distance = self.extent / (FIELD_OF_VIEW / 2.0).sin();
        self.position = target - self.forward() * self.pivot_distance;
    }

    /// Moves back along the view until a ball is visible. If the scene is closed, it stays within
    /// `room` of the ball's middle and widens the lens instead.
    pub(super) fn frame_ball(&mut self, target: Vec3, radius: f32, room: f32) {
        self.frame(&[target - radius / 3f32.sqrt(), target + radius / 3f32.sqrt()]);
        let room = ROOM * room;
        if self.pivot_distance > room {
            let half_sine = (radius / room).min(MAX_SINE);
            let tangent = half_sine / (1.0 - half_sine * half_sine).sqrt();
            self.intrinsics.focal = Vec2::splat(500.0 / tangent);
            self.pivot_distance = room;
            self.position = target - self.forward() * room;
        }
    }

    /// Sets the pivot straight ahead, at the distance of a point of the scene.
    pub(super) fn orbit_at_depth_of(&mut self, point: Vec3) {
        self.set_pivot_distance((point - self.position).dot(self.forward()));
    }

    /// Takes the pose and the intrinsics of a camera.
    pub(super) fn move_to(&mut self, camera: &Camera) {
        self.rotation = camera.rotation;
        self.position = camera.position();
        self.intrinsics = *camera;
        // The subject of photos is usually about as far away as the scene is large.
        self.pivot_distance = self.pivot_distance.min(self.extent).max(0.1 * self.extent);
    }

    /// Keeps its place in the world when the placement of the file changes.
    pub(super) fn change_frame(&mut self, from: &Placement, to: &Placement) {
        if from == to {
            return;
        }
        let translation = -(self.rotation * self.position);
        let camera = Camera { rotation: self.rotation, translation, ..self.intrinsics };
        let origin = DVec3::from(from.center);
        let camera = frames::to_file(&frames::to_world(&camera, from, origin), to, origin);
        self.rotation = camera.rotation;
        self.position = camera.position();
        let scale = (to.scale / from.scale) as f32;
        self.pivot_distance *= scale;
        self.extent *= scale;
    }

    /// Sets the distance to the pivot, for example to a clicked point.
    pub(super) fn set_pivot_distance(&mut self, distance: f32) {
        if distance.is_finite() && distance > 0.0 {
            self.pivot_distance = distance;
        }
    }

    /// The camera for a window of `size`: its whole picture is visible, in the middle of `pane`.
    pub(super) fn camera(&self, size: UVec2, pane: Pane) -> Camera {
        let scale = (pane.size / self.intrinsics.size.as_vec2()).min_element();
        let off_center = self.intrinsics.center - 0.5 * self.intrinsics.size.as_vec2();
        Camera {
            rotation: self.rotation,
            translation: -(self.rotation * self.position),
            focal: self.intrinsics.focal * scale,
            center: pane.min + 0.5 * pane.size + off_center * scale,
            size,
        }
    }

    /// The part of the window for the picture.
    pub(super) fn picture(&self, pane: Pane) -> Pane {
        let size = self.intrinsics.size.as_vec2()
            * (pane.size / self.intrinsics.size.as_vec2()).min_element();
        Pane { min: pane.min + 0.5 * (pane.size - size), size }
    }

    /// Minimum depth that is drawn.
    pub(super) fn near(&self) -> f32 {
        (1e-3 * self.extent.min(self.pivot_distance)).max(f32::MIN_POSITIVE)
    }

    /// The point ahead at the centre of orbits.
    pub(super) fn pivot(&self) -> Vec3 {
        self.position + self.forward() * self.pivot_distance
    }

    /// Keeps orbits where photos looked, as `viewpoint` says.
    pub(super) fn stay_within(&mut self, viewpoint: &Viewpoint) {
        self.range = viewpoint.orbit.map(|orbit| (*viewpoint, orbit));
    }

    /// A drag, shortened so that an orbit by it stays where photos looked, or goes no farther if it
    /// is beyond.
    fn within_range(&self, drag: Vec2) -> Vec2 {
        let Some((viewpoint, orbit)) = self.range else { return drag };
        let Some(angles) = viewpoint.direction(-self.forward().as_dvec3()) else { return drag };
        let [turn, elevation] = angles.map(|angle| angle.to_degrees() as f32);
        let drag_angle = DRAG_ANGLE.to_degrees();
        let moved = |now: f32, by: f32, range: [f64; 2]| {
            let [low, high] = range.map(|end| end as f32);
            ((now + by * drag_angle).clamp(low.min(now), high.max(now)) - now) / drag_angle
        };
        let x = orbit.turn.map_or(drag.x, |range| {
            // By whole turns nearest to the range.
            let middle = 0.5 * (range[0] + range[1]) as f32;
            -moved((turn - middle + 180.0).rem_euclid(360.0) - 180.0 + middle, -drag.x, range)
        });
        let y = moved(elevation, drag.y, orbit.elevation);
        Vec2::new(x, y)
    }

    /// Orbits around the pivot by a drag, in heights of the window.
    pub(super) fn orbit(&mut self, drag: Vec2) {
        let pivot = self.pivot();
        self.turn(-self.within_range(drag));
        self.position = pivot - self.forward() * self.pivot_distance;
    }

    /// Turns in place by a drag, in heights of the window. A tilted horizon comes level during the
    /// drag.
    pub(super) fn turn(&mut self, drag: Vec2) {
        let forward = self.forward();
        let level = forward.cross(self.up).try_normalize().unwrap_or(self.right());
        let roll = f32::atan2(self.right().dot(forward.cross(level)), self.right().dot(level));
        let elevation = forward.dot(self.up).clamp(-1.0, 1.0).asin();
        let rise = (elevation + DRAG_ANGLE * drag.y)
            .clamp(POLE_MARGIN - FRAC_PI_2, FRAC_PI_2 - POLE_MARGIN)
            - elevation;
        let turned = Quat::from_axis_angle(self.up, DRAG_ANGLE * drag.x)
            * Quat::from_axis_angle(level, rise);
        // Many small turns would add up their rounding errors.
        let forward = (turned * forward).normalize();
        let rolled = Quat::from_axis_angle(forward, roll * (-drag.length() / LEVEL_DRAG).exp());
        let right = (rolled * turned * level).reject_from(forward).normalize();
        self.rotation = Mat3::from_cols(right, forward.cross(right), forward).transpose();
    }

    /// Pans by a drag, in heights of the window, so that the pivot follows it.
    pub(super) fn pan(&mut self, drag: Vec2) {
        let height = self.pivot_distance * self.intrinsics.size.y as f32 / self.intrinsics.focal.y;
        self.position -= (self.right() * drag.x + self.down() * drag.y) * height;
    }

    /// Moves towards the pivot by steps of the wheel.
    pub(super) fn zoom(&mut self, steps: f32) {
        let nearer = self.pivot_distance * (1.0 - 0.85f32.powf(steps));
        self.position += self.forward() * nearer;
        // Close to the pivot, the wheel pushes it ahead, so that the camera can always move on.
        self.pivot_distance = (self.pivot_distance - nearer).max(0.02 * self.extent);
    }

    /// Flies for `secs` while these keys are held.
    pub(super) fn fly(&mut self, held: &HashSet<KeyCode>, secs: f32) {
        let along = |to: KeyCode, back: KeyCode| {
            f32::from(i8::from(held.contains(&to)) - i8::from(held.contains(&back)))
        };
        let direction = self.right() * along(KeyCode::KeyD, KeyCode::KeyA)
            + self.up * along(KeyCode::KeyE, KeyCode::KeyQ)
            + self.forward() * along(KeyCode::KeyW, KeyCode::KeyS);
        let is_fast = held.contains(&KeyCode::ShiftLeft) || held.contains(&KeyCode::ShiftRight);
        let speed = if is_fast { 2.0 } else { 0.5 } * self.extent;
        self.position += direction.normalize_or_zero() * speed * secs.min(0.1);
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
}

/// A part of the window, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pane {
    /// Left upper corner.
    pub(super) min: Vec2,
    /// Width and height.
    pub(super) size: Vec2,
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOX: [Vec3; 2] = [Vec3::new(-1.0, 0.0, 2.0), Vec3::new(3.0, 1.0, 4.0)];
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
            let camera = CameraControls::new(&BOX, up).camera(SIZE, PANE);
            camera.validate(&trisplat_scene::Limits::DEFAULT).unwrap();
            for i in 0..8 {
                let pick = |bit: usize, axis: usize| BOX[i >> bit & 1][axis];
                let at = pixel(&camera, Vec3::new(pick(0, 0), pick(1, 1), pick(2, 2)));
                assert!(at.cmpge(Vec2::ZERO).all() && at.cmple(SIZE.as_vec2()).all(), "{at}");
            }
            assert!((camera.rotation * up).y < 0.0, "up is up");
        }
        CameraControls::new(&[Vec3::INFINITY, Vec3::NEG_INFINITY], Vec3::Y)
            .camera(SIZE, PANE)
            .validate(&trisplat_scene::Limits::DEFAULT)
            .unwrap();
    }

    #[test]
    fn framing_the_subject_stays_inside_the_shell() {
        let target = Vec3::new(1.0, 2.0, 3.0);
        let radius = 0.5;
        for room in [f32::INFINITY, 4.0, 1.0, 0.6] {
            let mut controls = CameraControls::new(&BOX, Vec3::Y);
            controls.frame_ball(target, radius, room);
            assert!(controls.position.distance(target) <= 0.91 * room);
            assert!(controls.pivot().distance(target) < 1e-4);
            let camera = controls.camera(SIZE, PANE);
            for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
                assert!(camera.is_in_frustum(target + 0.7 * radius * axis), "{room}");
            }
        }
    }

    #[test]
    fn an_orbit_keeps_the_pivot_in_the_middle_and_never_turns_over() {
        let mut controls = CameraControls::new(&BOX, Vec3::Y);
        let target = 0.5 * (BOX[0] + BOX[1]);
        for i in 0..400 {
            controls.orbit(Vec2::new(0.03, if i < 200 { 0.05 } else { -0.07 }));
            let camera = controls.camera(SIZE, PANE);
            assert!(pixel(&camera, target).distance(SIZE.as_vec2() / 2.0) < 0.5);
            assert!((camera.rotation * Vec3::Y).y < 0.0, "turned over");
            assert!((camera.rotation.determinant() - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn an_orbit_stays_where_photos_looked() {
        let eye = [0.0, 1.0, 5.0];
        let range = OrbitRange { turn: Some([-30.0, 50.0]), elevation: [0.0, 40.0] };
        let mut viewpoint = Viewpoint {
            eye,
            target: [0.0; 3],
            up: [0.0, 1.0, 0.0],
            fov: 50.0,
            radius: None,
            orbit: Some(range),
        };
        let mut controls = CameraControls::new(&BOX, Vec3::Y);
        let mut look = |viewpoint: &Viewpoint| {
            controls.move_to(&viewpoint.camera(SIZE));
            controls.set_pivot_distance(viewpoint.distance());
            controls.stay_within(viewpoint);
            let ends = [Vec2::new(-0.05, 0.05), Vec2::new(0.05, -0.05)].map(|drag| {
                for _ in 0..60 {
                    controls.orbit(drag);
                }
                let away = (controls.position - controls.pivot()).normalize();
                [f32::atan2(away.x, away.z), away.y.asin()].map(|angle| angle.to_degrees().round())
            });
            assert!(controls.pivot().length() < 1e-3, "the pivot stays");
            ends
        };
        assert_eq!(look(&viewpoint), [[50.0, 40.0], [-30.0, 0.0]]);
        viewpoint.orbit = Some(OrbitRange { turn: None, ..range });
        assert_eq!(look(&viewpoint).map(|[_, elevation]| elevation), [40.0, 0.0]);
        // From beyond the range the way back is free, and no other.
        controls.stay_within(&Viewpoint {
            orbit: Some(OrbitRange { elevation: [20.0, 40.0], ..range }),
            ..viewpoint
        });
        let low = controls.position.y;
        controls.orbit(Vec2::new(0.0, -0.05));
        assert!((controls.position.y - low).abs() < 1e-3);
        controls.orbit(Vec2::new(0.0, 0.05));
        assert!(controls.position.y > low + 0.1);
    }

    #[test]
    fn page_levels_a_tilted_horizon_by_an_orbit() {
        let level = CameraControls::new(&BOX, Vec3::Y).camera(SIZE, PANE);
        for degrees in [-90.0f32, -20.0, 0.0, 35.0, 180.0] {
            let roll = Mat3::from_rotation_z(degrees.to_radians());
            let photo = Camera {
                rotation: roll * level.rotation,
                translation: roll * level.translation,
                ..level
            };
            let mut controls = CameraControls::new(&BOX, Vec3::Y);
            controls.move_to(&photo);
            let shown = controls.camera(SIZE, PANE).rotation;
            assert!(shown.abs_diff_eq(photo.rotation, 1e-5), "the photo is shown as it was taken");
            controls.orbit(Vec2::new(0.001, 0.0));
            let shown = controls.camera(SIZE, PANE).rotation;
            assert!(shown.abs_diff_eq(photo.rotation, 0.06), "nothing jumps, {degrees}: {shown}");
            for _ in 0..40 {
                controls.orbit(Vec2::new(0.01, 0.002));
            }
            let shown = controls.camera(SIZE, PANE).rotation;
            assert!(
                (shown * Vec3::Y).x.abs() < 0.01 && (shown * Vec3::Y).y < 0.0,
                "{degrees}: {shown}"
            );
            assert!((shown.determinant() - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn dragging_to_the_right_shows_what_was_on_the_left() {
        let mut controls = CameraControls::new(&BOX, Vec3::Y);
        let before = controls.camera(SIZE, PANE);
        let point = BOX[0];
        controls.orbit(Vec2::new(0.01, 0.0));
        let near = controls.position + (0.5 * (BOX[0] + BOX[1]) - controls.position) * 0.5;
        let moved = pixel(&controls.camera(SIZE, PANE), near).x - pixel(&before, near).x;
        assert!(moved > 0.0, "what is in front follows the mouse, not {moved}");
        let mut panned = CameraControls::new(&BOX, Vec3::Y);
        panned.pan(Vec2::new(0.1, 0.05));
        let target = 0.5 * (BOX[0] + BOX[1]);
        let at = pixel(&panned.camera(SIZE, PANE), target) - SIZE.as_vec2() / 2.0;
        assert!(at.distance(Vec2::new(60.0, 30.0)) < 1.0, "{at}");
        assert!(pixel(&before, point).is_finite());
    }

    #[test]
    fn a_photos_camera_shows_its_picture_in_the_pane() {
        let lens = Camera {
            rotation: Mat3::IDENTITY,
            translation: Vec3::new(0.1, 0.2, 3.0),
            focal: Vec2::new(500.0, 510.0),
            center: Vec2::new(310.0, 250.0),
            size: UVec2::new(640, 480),
        };
        let mut controls = CameraControls::new(&BOX, Vec3::Y);
        controls.move_to(&lens);
        let pane = Pane { min: Vec2::new(200.0, 0.0), size: Vec2::new(600.0, 600.0) };
        let camera = controls.camera(SIZE, pane);
        let picture = controls.picture(pane);
        assert_eq!(picture.size, Vec2::new(600.0, 450.0));
        for point in [Vec3::new(0.3, -0.4, 1.0), Vec3::new(-1.0, 0.2, 2.0)] {
            let wants = picture.min + pixel(&lens, point) * (600.0 / 640.0);
            assert!(pixel(&camera, point).distance(wants) < 1e-3);
        }
        let before = controls.position;
        controls.fly(&HashSet::from([KeyCode::KeyW]), 0.05);
        assert!((controls.position - before).dot(Vec3::Z) > 0.0);
    }

    #[test]
    fn a_scene_that_is_placed_otherwise_is_seen_as_before() {
        let mut controls = CameraControls::new(&BOX, Vec3::Y);
        controls.orbit(Vec2::new(0.2, 0.1));
        let pane = Pane { min: Vec2::ZERO, size: SIZE.as_vec2() };
        let before = controls.camera(SIZE, pane);
        let pivot = controls.pivot();
        let from = Placement { center: [1e6, 2.0, 3.0], ..Placement::IDENTITY };
        let to = Placement {
            scale: 2.0,
            rotate: 30.0,
            center: [1e6 + 5.0, 1.0, 0.0],
            ..Placement::IDENTITY
        };
        controls.change_frame(&from, &to);
        let moved = |p: Vec3| {
            (to.rotation() * to.scale * (from.to_world_f64(p) - DVec3::from(to.center))).as_vec3()
        };
        for point in [Vec3::ZERO, Vec3::new(0.3, -0.2, 0.5)] {
            let after = pixel(&controls.camera(SIZE, pane), moved(point));
            assert!(
                after.distance(pixel(&before, point)) < 1e-2,
                "{after} {}",
                pixel(&before, point)
            );
        }
        assert!(controls.pivot().distance(moved(pivot)) < 1e-3);
    }

    #[test]
    fn the_wheel_never_stops_or_passes_infinity() {
        let mut controls = CameraControls::new(&BOX, Vec3::Y);
        let start = controls.position;
        for _ in 0..100 {
            controls.zoom(1.0);
        }
        assert!(controls.position.distance(start) > 4.0);
        for _ in 0..100 {
            controls.zoom(-1.0);
        }
        assert!(controls.position.is_finite() && controls.near() > 0.0);
    }
}
