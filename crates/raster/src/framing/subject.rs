//! The subject of a scene: an object alone, the object that its photos look at, or its dense middle
//! without photos; its visibility from a camera, and the range of its photos around it.

use crate::solid::{NO_FACE, SolidRasterOptions, SolidRasterizer};
use glam::{DVec3, UVec2, Vec3};
use std::f64::consts::TAU;
use trisplat_scene::camera::{self, Camera, OrbitRange, Viewpoint};
use trisplat_scene::math::geometry::{bounds, central, centroid};
use trisplat_scene::math::lists::{median, quantile};
use trisplat_scene::mesh::{Colors, Mesh};

/// Maximum number of sampled points.
pub(super) const MAX_POINTS: usize = 20_000;
/// Maximum number of cameras.
const MAX_CAMERAS: usize = 100;
/// Minimum number of pictures that show a point of the subject, as a share of those of the point
/// that most pictures show.
const MIN_PICTURE_SHARE: f32 = 0.5;
/// Largest distance of a point of the subject from the focus of the cameras, as a share of their
/// median distance.
const MAX_FOCUS_DISTANCE: f32 = 0.8;
/// Share of the subject's points within its radius.
const RADIUS_QUANTILE: f32 = 0.9;
/// Share of all points within the radius, without photos.
const ALL_QUANTILE: f32 = 0.95;
/// Largest radius without photos, in median distances of the points: farther ones surround the
/// subject.
const MAX_CORE_RADIUS: f32 = 2.5;
/// Share of the points within the radius of one object with a long part, such as a guitar's neck.
const OBJECT_QUANTILE: f32 = 0.995;
/// Largest radius of such an object, in median distances of its points: nothing surrounds them.
const MAX_OBJECT_RADIUS: f32 = 5.0;
/// Largest radius of such an object, in radii of `ALL_QUANTILE` of it: surroundings thin out.
const SHARP_END: f32 = 1.25;

/// A ball around the subject of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Subject {
    /// Its middle.
    pub center: Vec3,
    /// Its radius, above 0.
    pub radius: f32,
    /// Nothing surrounds it.
    pub is_alone: bool,
}

impl Subject {
    /// The subject of a scene with `points`, the middles of its triangles, and the cameras of its
    /// photos, if any. `None` without extent.
    pub fn of(points: &[Vec3], cameras: &[Camera]) -> Option<Self> {
        let step = points.len().div_ceil(MAX_POINTS).max(1);
        let points: Vec<Vec3> =
            points.iter().copied().step_by(step).filter(|p| p.is_finite()).collect();
        let outside = |object: &Self| cameras.iter().all(|camera| !object.holds(camera.position()));
        let alone = (!cameras.is_empty()).then(|| object(&points).filter(outside)).flatten();
        alone.or_else(|| photographed(&points, cameras)).or_else(|| dense(&points))
    }

    /// The ball around the box of `points`; `None` without extent.
    pub fn around(points: &[Vec3]) -> Option<Self> {
        let [low, high] = bounds(points.iter().copied())?;
        let center = (low + high) / 2.0;
        let radius = points.iter().map(|point| point.distance(center)).fold(0.0, f32::max);
        (radius > 0.0 && radius.is_finite()).then_some(Self { center, radius, is_alone: false })
    }

    /// True for a point in the ball.
    pub fn holds(&self, point: Vec3) -> bool {
        point.distance_squared(self.center) <= self.radius * self.radius
    }
}

/// The object that most of `cameras` frame, near their common focus; `None` without one.
fn photographed(points: &[Vec3], cameras: &[Camera]) -> Option<Subject> {
    let step = cameras.len().div_ceil(MAX_CAMERAS).max(1);
    let cameras: Vec<Camera> = cameras.iter().copied().step_by(step).collect();
    let focus = camera::focus(cameras.iter())?;
    let away =
        median(cameras.iter().map(|c| c.position().distance(focus)).collect(), f32::total_cmp)?;
    let near: Vec<Vec3> =
        points.iter().copied().filter(|p| p.distance(focus) <= MAX_FOCUS_DISTANCE * away).collect();
    let frames =
        |point: &Vec3| cameras.iter().filter(|camera| camera.is_in_frustum(*point)).count();
    let counts: Vec<usize> = near.iter().map(frames).collect();
    let min_pictures = MIN_PICTURE_SHARE * counts.iter().copied().max()? as f32;
    let subject = near
        .iter()
        .zip(&counts)
        .filter(|(_, count)| **count as f32 >= min_pictures)
        .map(|(p, _)| *p);
    ball(&subject.collect::<Vec<_>>(), RADIUS_QUANTILE)
}

/// An object that nothing surrounds; `None` where something does.
fn object(points: &[Vec3]) -> Option<Subject> {
    let [half, all] = [0.5, ALL_QUANTILE].map(|share| ball(points, share).map(|ball| ball.radius));
    let ends = (MAX_OBJECT_RADIUS * half?).min(SHARP_END * all?);
    let whole = ball(points, OBJECT_QUANTILE).filter(|whole| whole.radius <= ends)?;
    let around =
        Subject::around(&points.iter().copied().filter(|p| whole.holds(*p)).collect::<Vec<_>>())?;
    Some(Subject { is_alone: true, ..around })
}

/// The dense middle.
fn dense(points: &[Vec3]) -> Option<Subject> {
    let all = ball(points, ALL_QUANTILE)?;
    let half = ball(points, 0.5).map_or(all.radius, |half| half.radius);
    let core = MAX_CORE_RADIUS * half;
    if core <= 0.0 || all.radius <= core {
        return Some(all);
    }
    Some(object(points).unwrap_or(Subject { radius: core, ..all }))
}

/// The ball around the median of `points` that contains this share of them.
fn ball(points: &[Vec3], share: f32) -> Option<Subject> {
    let center = central(points)?;
    let radius = quantile(points.iter().map(|p| p.distance(center)).collect(), share)?;
    (radius > 0.0 && radius.is_finite()).then_some(Subject { center, radius, is_alone: false })
}

/// Largest scene that is not thinned.
const MAX_FACES: usize = 8000;
/// Largest factor by which a triangle of a thinned scene grows to replace the others.
const MAX_GROWTH: f32 = 6.0;
/// The longer side of the pictures, px.
const SIDE: u32 = 96;
/// Distance of obstacles, as a share of the subject's: nearer surfaces count.
const OBSTACLE_DISTANCE: f32 = 0.3;
/// Near plane, in radii of the subject.
const NEAR: f32 = 0.01;

/// Draws small pictures of a scene, to measure the visibility of its subject.
#[derive(Debug)]
pub(super) struct VisibilityProbe {
    mesh: Mesh,
    subject: Subject,
    /// Flags of the subject's faces. `[F]`
    of_subject: Vec<bool>,
    solid: SolidRasterizer,
}

/// Visibility of the subject from a camera, in shares from 0 to 1.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct SubjectVisibility {
    /// Visible share of the subject's triangles.
    pub(super) visible: f32,
    /// Share of the subject's triangles within the picture, hidden or not.
    pub(super) in_frame: f32,
    /// Share of the picture that shows the subject.
    pub(super) coverage: f32,
    /// Share of the picture with obstacles in front of the camera.
    pub(super) obstruction: f32,
}

impl VisibilityProbe {
    /// A probe of the triangles `corners`, without the far shell.
    pub(super) fn new(
        corners: &dyn Fn(usize) -> [Vec3; 3],
        is_single_sided: &dyn Fn(usize) -> bool,
        count: usize,
        subject: Subject,
    ) -> Self {
        let step = count.div_ceil(MAX_FACES).max(1);
        let growth = (step as f32).sqrt().min(MAX_GROWTH);
        let mut positions = Vec::new();
        let mut of_subject = Vec::new();
        let mut single_sided = Vec::new();
        for face in (0..count).step_by(step) {
            let corners = corners(face);
            if corners.iter().all(|p| p.is_finite()) {
                let middle = centroid(corners);
                positions.extend(corners.map(|p| middle + (p - middle) * growth));
                of_subject.push(subject.holds(middle));
                single_sided.push(is_single_sided(face));
            }
        }
        let colors = Colors::Face(vec![[0.0; 3]; of_subject.len()]);
        Self {
            mesh: Mesh { positions, colors, single_sided, ..Mesh::default() },
            subject,
            of_subject,
            solid: SolidRasterizer::new(),
        }
    }

    /// Measures the visibility from `camera`, for any size of its picture.
    pub(super) fn measure(&mut self, camera: &Camera) -> SubjectVisibility {
        let longest = camera.size.max_element() as f32;
        let size = (camera.size.as_vec2() / longest * SIDE as f32).as_uvec2().max(UVec2::ONE);
        let camera = camera.resized(size);
        let near = (NEAR * self.subject.radius).max(f32::MIN_POSITIVE);
        let options = SolidRasterOptions { near, ..SolidRasterOptions::default() };
        let drawn = self.solid.visibility(&self.mesh, &camera, &options);
        let depth = (camera.rotation * self.subject.center + camera.translation).z;
        let mut is_visible = vec![false; self.of_subject.len()];
        let mut filled = 0;
        let mut blocked = 0;
        for (face, z) in drawn.face.iter().zip(&drawn.depth).filter(|(face, _)| **face != NO_FACE) {
            let face = *face as usize;
            is_visible[face] = true;
            filled += usize::from(self.of_subject[face]);
            blocked += usize::from(*z < OBSTACLE_DISTANCE * depth && !self.of_subject[face]);
        }
        let mut all = 0usize;
        let mut shown = 0usize;
        let mut framed = 0usize;
        for face in (0..self.of_subject.len()).filter(|face| self.of_subject[*face]) {
            all += 1;
            shown += usize::from(is_visible[face]);
            framed += usize::from(camera.is_in_frustum(self.mesh.centroid(face)));
        }
        let of = |part: usize, whole: usize| part as f32 / whole.max(1) as f32;
        let pixels = drawn.face.len();
        SubjectVisibility {
            visible: of(shown, all),
            in_frame: of(framed, all),
            coverage: of(filled, pixels),
            obstruction: of(blocked, pixels),
        }
    }
}

/// Margin of an orbit beyond the photos, rad: less than the angle between most neighbouring photos.
const MARGIN: f64 = 0.26;
/// Widest gap between photos that surround the target, rad.
const MAX_GAP: f64 = std::f64::consts::FRAC_PI_2;
/// Minimum number of photos of the target that limit the orbit.
const MIN_PHOTOS: usize = 3;

/// The range of the photos taken by `cameras` around the target of `viewpoint`. `None` if fewer
/// than half of them show the target, as in a room that is photographed from its middle.
pub(super) fn orbit_range(viewpoint: &Viewpoint, cameras: &[Camera]) -> Option<OrbitRange> {
    let target = DVec3::from(viewpoint.target);
    let here = viewpoint.direction(DVec3::from(viewpoint.eye) - target)?;
    let of_photo = |camera: &Camera| {
        let shows = camera.is_in_frustum(target.as_vec3());
        shows.then(|| viewpoint.direction(camera.position().as_dvec3() - target)).flatten()
    };
    let photos: Vec<[f64; 2]> = cameras.iter().filter_map(of_photo).collect();
    if photos.len() < MIN_PHOTOS || 2 * photos.len() < cameras.len() {
        return None;
    }
    let elevations = photos.iter().map(|photo| photo[1]).chain([here[1]]);
    let (low, high) =
        elevations.fold((f64::MAX, f64::MIN), |(low, high), e| (low.min(e), high.max(e)));
    let upright = std::f64::consts::FRAC_PI_2;
    let elevation =
        [(low - MARGIN).max(-upright), (high + MARGIN).min(upright)].map(f64::to_degrees);
    let turn = turn(photos.iter().map(|photo| photo[0]).collect());
    Some(OrbitRange { turn: turn.map(|turn| turn.map(f64::to_degrees)), elevation })
}

/// Minimum and maximum turn of the photos and of the viewpoint, which is at 0; `None` if they
/// surround the target.
fn turn(mut photos: Vec<f64>) -> Option<[f64; 2]> {
    photos.push(0.0);
    photos.sort_unstable_by(f64::total_cmp);
    let after = |i: usize| photos.get(i + 1).copied().unwrap_or(photos[0] + TAU);
    let gap = |i: usize| after(i) - photos[i];
    let widest = (0..photos.len()).reduce(|a, b| if gap(b) > gap(a) { b } else { a })?;
    // From the end of the widest gap to its beginning, with the viewpoint's 0 between them.
    let low = photos[(widest + 1) % photos.len()];
    let high = photos[widest];
    let low = if low > 0.0 { low - TAU } else { low };
    let high = if high < 0.0 { high + TAU } else { high };
    (gap(widest) > MAX_GAP).then_some([low - MARGIN, high + MARGIN])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::framing::LENS;
    use trisplat_scene::Rng;

    /// Points spread evenly in a cube of this half side around a centre.
    fn cube(center: Vec3, half: f32, count: u64) -> impl Iterator<Item = Vec3> {
        let rng = Rng::new(5, "cube", count);
        (0..count).map(move |i| {
            center
                + half * (2.0 * Vec3::from([0, 1, 2].map(|axis| rng.uniform(3 * i + axis))) - 1.0)
        })
    }

    #[test]
    fn subject_is_where_photos_look() {
        let target = Vec3::new(3.0, 1.0, -2.0);
        let eyes =
            [0.0f32, 1.3, 2.6, 3.9, 5.2].map(|a| target + 4.0 * Vec3::new(a.cos(), 0.4, a.sin()));
        let cameras = eyes.map(|eye| LENS.with_look_at(eye, target, Vec3::Y));
        let points: Vec<Vec3> =
            cube(target, 0.5, 2000).chain(cube(target + 20.0, 15.0, 8000)).collect();
        let subject = Subject::of(&points, &cameras).expect("there is one");
        assert!(subject.center.distance(target) < 0.2, "{subject:?}");
        assert!((0.4..1.0).contains(&subject.radius), "{subject:?}");
        // Without cameras only the densest place is known.
        let dense = Subject::of(&points, &[]).expect("there is one");
        assert!(
            dense.center.distance(target + 20.0) < 10.0 && dense.holds(target + 20.0),
            "{dense:?}"
        );
    }

    #[test]
    fn surroundings_are_no_part_of_a_dense_middle() {
        let points: Vec<Vec3> =
            cube(Vec3::ZERO, 1.0, 4000).chain(cube(Vec3::ZERO, 40.0, 2000)).collect();
        let subject = Subject::of(&points, &[]).expect("there is one");
        assert!(subject.center.length() < 0.3 && subject.radius < 8.0, "{subject:?}");
        assert_eq!(Subject::of(&[Vec3::ONE; 9], &[]), None);
        assert_eq!(Subject::of(&[], &[]), None);
    }

    #[test]
    fn a_long_part_of_an_object_belongs_to_it() {
        // A body, and a neck of a third as many points that ends four units away.
        let neck = (0..1200).map(|i| Vec3::Y * (1.0 + 3.0 * i as f32 / 1200.0));
        let points: Vec<Vec3> = cube(Vec3::ZERO, 1.0, 4000).chain(neck.clone()).collect();
        let subject = Subject::of(&points, &[]).expect("there is one");
        let held = neck.filter(|point| subject.holds(*point)).count();
        assert!(held > 1150 && subject.radius < 3.0, "{held} {subject:?}");
        // Nor do cameras that look at the body cut the neck off, if none of them stands in it.
        let camera = |(turn, distance): (f32, f32)| {
            LENS.with_look_at(
                distance * Vec3::new(turn.cos(), 0.2, turn.sin()),
                Vec3::ZERO,
                Vec3::Y,
            )
        };
        assert_eq!(
            Subject::of(&points, &[(0.5, 7.0), (2.0, 8.0), (4.0, 9.0)].map(camera)),
            Some(subject)
        );
        assert_ne!(
            Subject::of(&points, &[(0.5, 0.7), (2.0, 8.0), (4.0, 9.0)].map(camera)),
            Some(subject)
        );
    }
}

#[cfg(test)]
mod orbit_range_tests {
    use super::*;
    use crate::framing::LENS;
    use glam::{Mat3, Vec3};

    const VIEWPOINT: Viewpoint = Viewpoint {
        eye: [0.0, 1.0, 4.0],
        target: [0.0, 1.0, 0.0],
        up: [0.0, 1.0, 0.0],
        fov: 50.0,
        radius: None,
        orbit: None,
    };

    /// A camera at some degrees around the target and above it, which looks at it.
    fn at(turn: f32, elevation: f32) -> Camera {
        let turn = turn.to_radians();
        let elevation = elevation.to_radians();
        let away =
            Vec3::new(turn.sin() * elevation.cos(), elevation.sin(), turn.cos() * elevation.cos());
        LENS.with_look_at(Vec3::Y + 3.0 * away, Vec3::Y, Vec3::Y)
    }

    fn range(turns: &[f32]) -> Option<OrbitRange> {
        let cameras: Vec<Camera> = turns.iter().map(|turn| at(*turn, 20.0)).collect();
        orbit_range(&VIEWPOINT, &cameras)
    }

    #[test]
    fn photos_of_one_side_bound_the_orbit() {
        let margin = MARGIN.to_degrees();
        for (turns, wants) in [
            (&[-40.0, -10.0, 30.0][..], [-40.0, 30.0]),
            (&[10.0, 20.0, 35.0], [0.0, 35.0]),
            (&[-100.0, -50.0, 60.0, 120.0], [-100.0, 120.0]),
            // Past half a turn.
            (&[60.0, 120.0, 190.0], [0.0, 190.0]),
        ] {
            let OrbitRange { turn, elevation } = range(turns).unwrap();
            let turn = turn.unwrap();
            let off = [turn[0] - wants[0] + margin, turn[1] - wants[1] - margin];
            assert!(off.iter().all(|off| off.abs() < 0.01), "{turns:?}: {turn:?}");
            // The viewpoint itself is level.
            assert!(
                (elevation[0] + margin).abs() < 0.01 && (elevation[1] - 20.0 - margin).abs() < 0.01
            );
        }
    }

    #[test]
    fn photos_all_around_leave_the_turn_free() {
        let all: Vec<f32> = (0..8).map(|i| 45.0 * i as f32).collect();
        assert_eq!(range(&all).unwrap().turn, None);
    }

    #[test]
    fn photos_of_something_else_leave_the_orbit_free() {
        assert_eq!(range(&[0.0, 10.0]), None, "few");
        let away = |camera: Camera| {
            let turned = Mat3::from_rotation_y(3.0) * camera.rotation;
            Camera { rotation: turned, translation: -(turned * camera.position()), ..camera }
        };
        let cameras: Vec<Camera> = (0..9)
            .map(|i| at(10.0 * i as f32, 0.0))
            .enumerate()
            .map(|(i, c)| if i < 4 { c } else { away(c) })
            .collect();
        assert_eq!(orbit_range(&VIEWPOINT, &cameras), None);
        let above = Viewpoint { eye: [0.0, 9.0, 0.0], ..VIEWPOINT };
        assert_eq!(
            orbit_range(&above, &[at(0.0, 0.0); 5]),
            None,
            "an eye right above has no direction"
        );
    }
}
