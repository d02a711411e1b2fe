//! The first viewpoint of a scene: the place of a photo, or around the subject, that shows the
//! subject best: whole, large, level, unobstructed, from somewhat above.

use super::candidates::{ViewpointCandidate, half_tangent, photo_candidates, ring};
use super::subject::{MAX_POINTS, Subject, SubjectVisibility, VisibilityProbe, orbit_range};
use glam::{DVec3, UVec2, Vec2, Vec3};
use std::f32::consts::TAU;
use trisplat_scene::camera::{Camera, Viewpoint};
use trisplat_scene::math::geometry::centroid;

/// Share of the picture from which a subject counts as large.
const LARGE_COVERAGE: f32 = 0.25;
/// Sine of the best elevation, 20 degrees.
const BEST_ELEVATION: f32 = 0.342;
/// Difference of the elevation's sine that halves the score.
const ELEVATION_SPREAD: f32 = 0.5;
/// Sines of the elevations of viewpoints around the subject; the first is tried in all directions.
const ELEVATIONS: [f32; 3] = [0.342, 0.643, 0.087];
/// Distances around the subject, relative to the distance that shows it whole; nearer ones for
/// enclosed subjects.
const RELATIVE_DISTANCES: [f32; 3] = [1.0, 0.6, 0.35];
/// Minimum ratio of scores that a nearer place needs.
const NEARER_GAIN: f32 = 1.5;
/// Radius of a modelled surface, in radii of the ball that holds most of its area: it is seen whole.
const SURFACE_RADIUS: f32 = 1.1;
/// Largest distance from the target, as a share of the distance to the far shell.
const MAX_ENCLOSURE_SHARE: f32 = 0.9;

/// The viewpoint of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChosenViewpoint {
    /// Eye, target and lens.
    pub viewpoint: Viewpoint,
    /// The number of the photo taken there, if any.
    pub photo: Option<usize>,
    /// Share of the picture that shows the subject.
    pub coverage: f64,
}

/// A scene in which a viewpoint is chosen.
#[derive(Clone, Copy)]
pub struct ViewpointInput<'a> {
    /// Corners of a triangle, by its number.
    pub corners: &'a dyn Fn(usize) -> [Vec3; 3],
    /// True for a triangle that is drawn from its front only.
    pub is_single_sided: &'a dyn Fn(usize) -> bool,
    /// Number of triangles, without the far shell.
    pub count: usize,
    /// True for a modelled surface. Its triangles are not smaller where more is to be seen, as
    /// those of a trained scene are: areas count in place of triangles. And it is seen from its
    /// front: the inside of a closed thing is no viewpoint.
    pub is_surface: bool,
    /// Cameras of its photos, if any.
    pub cameras: &'a [Camera],
    /// Up direction.
    pub up: Vec3,
    /// Distance from a place to the far shell; infinite without one.
    pub enclosure_distance: &'a dyn Fn(Vec3) -> f32,
}

/// The first viewpoint of a scene; `None` without extent.
pub fn viewpoint(input: &ViewpointInput<'_>) -> Option<ChosenViewpoint> {
    let middle = |face: usize| centroid((input.corners)(face));
    // The subject needs no more points.
    let step = input.count.div_ceil(MAX_POINTS).max(1);
    let points = if input.is_surface {
        spread_points(input.corners, input.count)
    } else {
        (0..input.count).step_by(step).map(middle).collect()
    };
    // The middle of a single triangle has no extent, its corners have.
    let corners = || (0..input.count).step_by(step).flat_map(input.corners).collect::<Vec<_>>();
    let mut subject =
        Subject::of(&points, input.cameras).or_else(|| Subject::around(&corners()))?;
    if input.is_surface {
        subject.radius *= SURFACE_RADIUS;
    }
    let is_single_sided = |face: usize| input.is_surface || (input.is_single_sided)(face);
    let mut probe = VisibilityProbe::new(input.corners, &is_single_sided, input.count, subject);
    let mut score_candidate = |candidate: ViewpointCandidate| {
        let visibility = probe.measure(&candidate.camera);
        ScoredCandidate {
            candidate,
            visibility,
            score: score(&candidate.camera, &visibility, input.up),
        }
    };
    let photos = photo_candidates(input.cameras, subject, input.up);
    let best = match best(photos.into_iter().map(&mut score_candidate)) {
        Some(photo) if photo.score > 0.0 => photo,
        _ => best_around(subject, input, &mut score_candidate)?,
    };
    let ScoredCandidate { candidate, visibility, .. } = best;
    let viewpoint = viewpoint_of(&candidate.camera, subject, input.up);
    let viewpoint = Viewpoint { orbit: orbit_range(&viewpoint, input.cameras), ..viewpoint };
    Some(ChosenViewpoint {
        viewpoint,
        photo: candidate.photo,
        coverage: f64::from(visibility.coverage),
    })
}

/// Points spread evenly over the area of triangles; none without area.
fn spread_points(corners: &dyn Fn(usize) -> [Vec3; 3], count: usize) -> Vec<Vec3> {
    let area = |face: usize| {
        let [a, b, c] = corners(face);
        let area = (b - a).cross(c - a).length();
        if area.is_finite() { f64::from(area) } else { 0.0 }
    };
    let total: f64 = (0..count).map(area).sum();
    let mut points = Vec::new();
    let mut end = 0.0;
    for face in 0..count {
        end += area(face);
        while points.len() < MAX_POINTS
            && (points.len() as f64 + 0.5) * total < end * MAX_POINTS as f64
        {
            points.push(point_of(corners(face), points.len()));
        }
    }
    points
}

/// The point of a triangle that a number chooses: points of successive numbers spread evenly (the
/// R2 sequence, whose steps are powers of the inverse plastic number).
fn point_of([a, b, c]: [Vec3; 3], number: usize) -> Vec3 {
    const STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];
    let [u, v] = STEPS.map(|step| (0.5 + step * number as f64).fract() as f32);
    let [u, v] = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
    a + u * (b - a) + v * (c - a)
}

/// A candidate and its view.
struct ScoredCandidate {
    candidate: ViewpointCandidate,
    visibility: SubjectVisibility,
    score: f32,
}

/// The best place around the subject.
fn best_around(
    subject: Subject,
    input: &ViewpointInput<'_>,
    score_candidate: &mut impl FnMut(ViewpointCandidate) -> ScoredCandidate,
) -> Option<ScoredCandidate> {
    let max_distance = MAX_ENCLOSURE_SHARE * (input.enclosure_distance)(subject.center);
    let ring = |sine, nearer| ring(subject, input.up, sine, nearer, max_distance);
    let mut chosen: Option<(usize, ScoredCandidate)> = None;
    for nearer in RELATIVE_DISTANCES {
        let scored: Vec<ScoredCandidate> =
            ring(ELEVATIONS[0], nearer).into_iter().map(&mut *score_candidate).collect();
        let best_of_ring = scored
            .into_iter()
            .enumerate()
            .reduce(|a, b| if b.1.score > a.1.score { b } else { a })?;
        if chosen
            .as_ref()
            .is_none_or(|(_, before)| best_of_ring.1.score > NEARER_GAIN * before.score)
        {
            let higher = ELEVATIONS[1..]
                .iter()
                .map(|sine| score_candidate(ring(*sine, nearer)[best_of_ring.0]));
            let best = higher.fold(best_of_ring.1, |a, b| if b.score > a.score { b } else { a });
            chosen = Some((best_of_ring.0, best));
        }
    }
    chosen.map(|(_, scored)| scored)
}

/// The first of the best.
fn best(scored: impl Iterator<Item = ScoredCandidate>) -> Option<ScoredCandidate> {
    scored.reduce(|a, b| if b.score > a.score { b } else { a })
}

/// Score of a camera's view of the subject, 0 or more.
fn score(camera: &Camera, visibility: &SubjectVisibility, up: Vec3) -> f32 {
    let sine = -camera.rotation.row(2).dot(up);
    let off = (sine - BEST_ELEVATION) / ELEVATION_SPREAD;
    let elevation = 1.0 / (1.0 + off * off);
    let large = (visibility.coverage / LARGE_COVERAGE).min(1.0);
    let clear = (1.0 - visibility.obstruction).powi(2);
    visibility.visible * visibility.in_frame * visibility.in_frame * large * clear * elevation
}

/// The viewpoint of a camera. It orbits the subject, or a point ahead if it looks elsewhere.
fn viewpoint_of(camera: &Camera, subject: Subject, up: Vec3) -> Viewpoint {
    let eye = camera.position();
    let forward = camera.rotation.row(2);
    let depth = (subject.center - eye).dot(forward);
    let target = eye + forward * if depth > 0.0 { depth } else { subject.radius };
    let [eye, target, up] = [eye, target, up].map(|v| v.as_dvec3().to_array());
    let [wide, high] = [
        camera.size.x as f32 / (2.0 * camera.focal.x),
        camera.size.y as f32 / (2.0 * camera.focal.y),
    ];
    // A window may be narrower than the photo, so the photo's horizontal angle becomes the vertical
    // one. Nothing is missing beyond it where nothing surrounds the subject.
    let needed = half_tangent(subject.radius, depth.max(subject.radius), MAX_SINE);
    let half_tangent = if subject.is_alone { needed } else { needed.min(wide) };
    let fov = 2.0 * libm::atan(f64::from(high.max(half_tangent)));
    Viewpoint {
        eye,
        target,
        up,
        fov: fov.to_degrees(),
        radius: Some(f64::from(subject.radius)),
        orbit: None,
    }
}

/// The camera of a viewpoint for a picture of `size` that shows the whole subject, independent of
/// the viewpoint's lens.
fn camera_with_subject(viewpoint: &Viewpoint, size: UVec2) -> Camera {
    let camera = viewpoint.camera(size);
    let Some(radius) = viewpoint.radius else { return camera };
    let needed = half_tangent(radius as f32, viewpoint.distance(), MAX_SINE);
    let max_focal = size.min_element() as f32 / (2.0 * needed);
    Camera { focal: camera.focal.min(Vec2::splat(max_focal)), ..camera }
}

/// `count` cameras for pictures of `size` on the circle that begins at `viewpoint` and goes around
/// its subject. All of the subject stays in the picture. `up` is the up direction;
/// `enclosure_distance` gives the distance from the target to the far shell in a direction: a
/// camera behind the shell moves closer.
pub fn orbit(
    viewpoint: &Viewpoint,
    up: Vec3,
    enclosure_distance: &dyn Fn(Vec3) -> f32,
    size: UVec2,
    count: u32,
) -> Vec<Camera> {
    let target = DVec3::from(viewpoint.target).as_vec3();
    let from = DVec3::from(viewpoint.eye).as_vec3() - target;
    let height = from.dot(up);
    let start = from.reject_from(up);
    let x = start.try_normalize().unwrap_or_else(|| up.any_orthonormal_vector());
    let y = up.cross(x);
    let lens = camera_with_subject(viewpoint, size);
    let place = |k: u32| {
        let (sin, cos) = (TAU * k as f32 / count as f32).sin_cos();
        let on_circle = target + up * height + (x * cos + y * sin) * start.length();
        let away = lens.with_look_at(on_circle, target, up).position() - target;
        let way = away.normalize_or(up.any_orthonormal_vector());
        let eye = target + way * away.length().min(MAX_ENCLOSURE_SHARE * enclosure_distance(way));
        let moved = Viewpoint { eye: eye.as_dvec3().to_array(), ..*viewpoint };
        camera_with_subject(&moved, size).with_look_at(eye, target, up)
    };
    (0..count).map(place).collect()
}

/// Widest lens for a narrow picture: the sine of half its angle.
const MAX_SINE: f32 = 0.85;

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Mat3;

    const LENS: Camera = Camera {
        rotation: Mat3::IDENTITY,
        translation: Vec3::ZERO,
        focal: Vec2::splat(100.0),
        center: Vec2::splat(60.0),
        size: UVec2::splat(120),
    };

    /// A ball of small triangles, radius 1.
    fn ball() -> Vec<[Vec3; 3]> {
        let (corners, faces) = trisplat_scene::math::geometry::octasphere(4);
        faces.iter().map(|face| face.map(|i| corners[i as usize])).collect()
    }

    fn of(triangles: &[[Vec3; 3]], cameras: &[Camera]) -> ChosenViewpoint {
        of_kind(triangles, cameras, false)
    }

    fn of_kind(triangles: &[[Vec3; 3]], cameras: &[Camera], is_surface: bool) -> ChosenViewpoint {
        let corners = |face: usize| triangles[face];
        let count = triangles.len();
        let enclosure_distance = |_: Vec3| f32::INFINITY;
        viewpoint(&ViewpointInput {
            corners: &corners,
            is_single_sided: &|_| false,
            count,
            is_surface,
            cameras,
            up: Vec3::Y,
            enclosure_distance: &enclosure_distance,
        })
        .expect("it has extent")
    }

    #[test]
    fn one_triangle_is_seen() {
        let chosen = of(&[[Vec3::ZERO, Vec3::X, Vec3::Y]], &[]);
        let camera = chosen.viewpoint.camera(UVec2::new(120, 120));
        assert!(
            camera.is_in_frustum(Vec3::new(0.4, 0.4, 0.0)) && chosen.coverage > 0.1,
            "{chosen:?}"
        );
    }

    #[test]
    fn the_first_view_is_the_photo_that_shows_the_subject_best() {
        let away = |angle: f32, distance: f32, height: f32| {
            let eye = Vec3::new(distance * angle.cos(), height, distance * angle.sin());
            LENS.with_look_at(eye, Vec3::ZERO, Vec3::Y)
        };
        // Past it, from far away, tilted by a quarter turn, from right above, and last the best.
        let past = LENS.with_look_at(Vec3::new(3.0, 1.0, 0.0), Vec3::new(2.0, 0.5, 4.0), Vec3::Y);
        let tilted = LENS.with_look_at(Vec3::new(0.0, 0.2, 9.0), Vec3::ZERO, Vec3::X);
        let cameras =
            [past, away(1.0, 14.0, 4.0), tilted, away(2.0, 0.3, 4.0), away(3.0, 3.3, 1.2)];
        let chosen = of(&ball(), &cameras);
        assert_eq!(chosen.photo, Some(4), "{chosen:?}");
        let camera = chosen.viewpoint.camera(UVec2::new(120, 120));
        assert!(camera.position().distance(cameras[4].position()) < 1e-4);
        assert!((camera.rotation * Vec3::Y).x.abs() < 1e-4, "level");
        assert!(chosen.viewpoint.radius.is_some_and(|r| (0.5..1.5).contains(&r)), "{chosen:?}");
    }

    #[test]
    fn an_obstacle_before_one_photo_leaves_the_others() {
        let mut triangles = ball();
        // A wall right before the first camera.
        let wall = |x: f32, y: f32| Vec3::new(0.3 * x, 0.3 * y, 3.0);
        triangles.extend([[wall(-9.0, -9.0), wall(9.0, -9.0), wall(0.0, 9.0)]; 3]);
        let eyes = [Vec3::new(0.0, 0.8, 3.4), Vec3::new(3.4, 0.8, 0.0), Vec3::new(0.1, 0.8, 3.4)];
        let cameras = eyes.map(|eye| LENS.with_look_at(eye, Vec3::ZERO, Vec3::Y));
        assert_eq!(of(&triangles, &cameras).photo, Some(1));
    }

    #[test]
    fn viewpoint_without_photos_shows_the_subject_from_above() {
        let chosen = of(&ball(), &[]);
        assert_eq!(chosen.photo, None);
        let Viewpoint { eye, target, .. } = chosen.viewpoint;
        let sine = (eye[1] - target[1]) / f64::from(chosen.viewpoint.distance());
        assert!((0.05..0.7).contains(&sine), "{chosen:?}");
        let camera = chosen.viewpoint.camera(UVec2::new(400, 300));
        assert!(ball().iter().flatten().all(|p| camera.is_in_frustum(*p)), "{chosen:?}");
        assert!(chosen.coverage > 0.2, "{chosen:?}");
    }

    #[test]
    fn a_surface_is_seen_whole_however_small_the_triangles_of_a_part_are() {
        // The ball on a table of two triangles.
        let corner = |x: f32, z: f32| Vec3::new(x, -1.0, z);
        let [a, b] = [corner(-6.0, -4.0), corner(6.0, -4.0)];
        let [c, d] = [corner(6.0, 4.0), corner(-6.0, 4.0)];
        let triangles = [ball(), vec![[a, b, c], [a, c, d]]].concat();
        let holds_table = |is_surface: bool| {
            let viewpoint = of_kind(&triangles, &[], is_surface).viewpoint;
            let camera = viewpoint.camera(UVec2::new(400, 300));
            [a, b, c, d].iter().all(|corner| camera.is_in_frustum(*corner))
        };
        assert!(holds_table(true));
        assert!(!holds_table(false));
    }

    #[test]
    fn a_closed_surface_is_seen_from_outside() {
        // The nearest places to try are just inside of a ball of so few triangles.
        let at = |a: u32, b: u32| {
            let (down, turn) = (a as f32 * TAU / 16.0, b as f32 * TAU / 16.0);
            let ring = down.sin();
            Vec3::new(ring * turn.cos(), down.cos(), ring * turn.sin())
        };
        let part = |a, b| [at(a, b), at(a, b + 1), at(a + 1, b + 1), at(a + 1, b)];
        let parts = (0..8).flat_map(|a| (0..16).map(move |b| part(a, b)));
        let triangles: Vec<[Vec3; 3]> =
            parts.flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let eye = DVec3::from(of_kind(&triangles, &[], true).viewpoint.eye);
        assert!(eye.length() > 1.5, "{eye}");
    }

    #[test]
    fn a_narrow_picture_holds_the_subject_too() {
        let chosen = of(&ball(), &[]);
        for size in [UVec2::new(390, 844), UVec2::new(844, 390), UVec2::new(400, 300)] {
            let camera = camera_with_subject(&chosen.viewpoint, size);
            assert!(ball().iter().flatten().all(|p| camera.is_in_frustum(*p)), "{size}");
        }
    }

    #[test]
    fn a_scene_without_extent_has_none() {
        let corners = |_: usize| [Vec3::ONE; 3];
        let enclosure_distance = |_: Vec3| f32::INFINITY;
        let is_single_sided = &|_| false;
        let input = ViewpointInput {
            corners: &corners,
            is_single_sided,
            count: 5,
            is_surface: true,
            cameras: &[LENS],
            up: Vec3::Y,
            enclosure_distance: &enclosure_distance,
        };
        assert_eq!(viewpoint(&input), None);
        assert_eq!(viewpoint(&ViewpointInput { count: 0, ..input }), None);
    }
}

#[cfg(test)]
mod orbit_tests {
    use super::*;

    const VIEWPOINT: Viewpoint = Viewpoint {
        eye: [3.0, 2.0, 1.0],
        target: [1.0, 0.5, 0.0],
        up: [0.0, 1.0, 0.0],
        fov: 60.0,
        radius: None,
        orbit: None,
    };

    #[test]
    fn an_orbit_of_a_viewpoint_begins_there() {
        let orbit = orbit(&VIEWPOINT, Vec3::Y, &|_| f32::INFINITY, UVec2::new(400, 300), 4);
        assert_eq!((orbit.len(), orbit[0].size), (4, UVec2::new(400, 300)));
        assert!(orbit[0].position().distance(Vec3::new(3.0, 2.0, 1.0)) < 1e-5);
        assert!(
            orbit[2].position().distance(Vec3::new(-1.0, 2.0, -1.0)) < 1e-5,
            "opposite, as high"
        );
        assert!(
            orbit.iter().all(|c| (c.rotation * Vec3::Y).x.abs() < 1e-6),
            "the horizon is level"
        );
    }

    #[test]
    fn orbit_keeps_the_subject_in_view_inside_the_shell() {
        let target = Vec3::new(1.0, 0.5, 0.0);
        let radius = 0.8;
        let viewpoint = Viewpoint { radius: Some(0.8), fov: 20.0, ..VIEWPOINT };
        for (room, size) in [(f32::INFINITY, UVec2::new(400, 300)), (1.5, UVec2::new(150, 300))] {
            for camera in orbit(&viewpoint, Vec3::Y, &|_| room, size, 9) {
                assert!(camera.position().distance(target) <= 0.91 * room);
                for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
                    let inside = |p: Vec3| camera.is_in_frustum(p);
                    assert!(
                        inside(target + 0.7 * radius * axis)
                            && inside(target - 0.7 * radius * axis),
                        "{room} {size}"
                    );
                }
            }
        }
    }

    #[test]
    fn orbit_comes_nearer_only_before_a_wall() {
        // A subject on a wall: behind it there is half a unit of room.
        let room = |way: Vec3| if way.x < 0.0 { 0.5 } else { 9.0 };
        let orbit = orbit(&VIEWPOINT, Vec3::Y, &room, UVec2::new(400, 300), 4);
        let away: Vec<f32> = orbit
            .iter()
            .map(|camera| camera.position().distance(Vec3::new(1.0, 0.5, 0.0)))
            .collect();
        assert!(
            (away[0] - 7.25_f32.sqrt()).abs() < 1e-5 && (away[2] - 0.45).abs() < 1e-5,
            "{away:?}"
        );
    }
}
