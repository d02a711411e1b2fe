//! The viewpoints for drawing a scene: the cameras that it stores and others between them, or
//! chosen ones around an object or within surroundings.
//!
//! Of chosen ones both kinds are tried. Candidates that show too little, or with an obstacle in
//! front, are discarded. Of the rest, the set that sees more of the scene's triangles wins.
//! Triangles that no good candidate sees are ignored, because a scene is only valid where it was
//! photographed.

use super::splat_views;
use super::survey::{Survey, ViewCoverage, camera, direction};
use glam::{Mat3, Quat, UVec2, Vec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::HashSet;
use trisplat_scene::camera::Camera;
use trisplat_scene::math::lists::quantile;
use trisplat_scene::{ImportedScene, Soup, Splats};

/// Origin of viewpoints.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ViewpointKind {
    /// The cameras that the scene stores, and cameras between them.
    #[default]
    Stored,
    /// Chosen around an object.
    Around,
    /// Chosen inside a scene that has surroundings.
    Inside,
}

/// The viewpoints for a scene, in the frame of its file.
#[derive(Debug, Clone, PartialEq)]
pub struct Viewpoints {
    /// Their origin.
    pub kind: ViewpointKind,
    /// One camera per picture.
    pub cameras: Vec<Camera>,
}

impl Viewpoints {
    /// Viewpoints of `scene`: all stored cameras, with others between them up to `max_bytes` of
    /// 8-bit pictures, or chosen ones. `None` without stored cameras and without visible triangles.
    pub fn of(scene: &ImportedScene, max_bytes: u64) -> Option<Self> {
        if scene.cameras.is_empty() {
            Search::new(scene, false)?.viewpoints(PICTURES)
        } else {
            Some(Self::stored(with_between(&scene.cameras, max_bytes)))
        }
    }

    /// Viewpoints of Gaussians, the most telling first: all `stored` cameras, or chosen ones;
    /// `stand_in` has triangles in the place of the Gaussians. Around an object `count` cameras are
    /// chosen, which look at it from all sides, from below too, and have pictures of `longer_px`
    /// that it fills. `None` where nothing is seen.
    pub fn of_splats(
        splats: &Splats,
        stand_in: &ImportedScene,
        stored: &[Camera],
        (count, longer_px): (usize, u32),
    ) -> Option<Self> {
        if stored.is_empty() {
            Search::new(stand_in, true)?.of_splats(splats, count, longer_px)
        } else {
            Some(Self::stored(stored.to_vec()))
        }
    }

    fn stored(cameras: Vec<Camera>) -> Self {
        Self { kind: ViewpointKind::Stored, cameras }
    }

    /// Chosen viewpoints; `None` without any.
    fn of_kind(kind: ViewpointKind, cameras: Vec<Camera>) -> Option<Self> {
        (!cameras.is_empty()).then_some(Self { kind, cameras })
    }
}

/// Number of pictures of a soft scene, and of trial cameras around it.
const PICTURES: usize = 60;
/// Width and height of the pictures, px.
const SIDE: u32 = 360;
/// Field of view of cameras around the scene, degrees.
const AROUND_FOV: f32 = 45.0;
/// Field of view of cameras within the scene, degrees.
const INSIDE_FOV: f32 = 75.0;
/// Elevations of the rings around an object, degrees: most of them from above, because objects
/// stand on something.
const RINGS: [f32; 5] = [-20.0, 5.0, 25.0, 45.0, 70.0];
/// Distances of inner viewpoints from the middle, in units of the scene.
const INSIDE_RADII: [f32; 4] = [0.0, 0.6, 1.2, 2.0];
/// Number of directions of inner viewpoints from the middle.
const INSIDE_DIRECTIONS: usize = 12;
/// Number of viewing directions of an inner viewpoint.
const LOOKS: usize = 10;
/// Minimum distance of a viewpoint from surfaces, in units of the scene.
const CLEARANCE: f32 = 0.25;
/// Largest share of a picture that nearer surfaces cover.
const MAX_CLOSE_SHARE: f32 = 0.1;
/// Largest share of the triangles that is nearer to an inner viewpoint.
const MAX_NEARER_SHARE: f32 = 1e-3;
/// Minimum covered share of a picture from within.
const MIN_COVERED: f32 = 0.9;
/// Minimum covered share of a picture from around.
const MIN_COVERED_AROUND: f32 = 0.02;
/// Minimum ratio of triangles visible from within to those visible from around: the surface of an
/// object is visible from both of its sides.
const MORE_INSIDE: f32 = 1.2;
/// Minimum number of views from within.
const MIN_VIEWS_INSIDE: usize = 8;
/// The quantile of distances from the middle that the rings show.
const IN_VIEW: f32 = 0.95;

/// A search for places to look from at a scene that stores no cameras.
#[derive(Debug)]
struct Search {
    survey: Survey,
    unit: Unit,
    up: Vec3,
    /// Look from below as often as from above, because up is unknown.
    any_side: bool,
}

impl Search {
    /// Prepares to look at `scene`; `None` when it has no extent.
    /// `any_side`: look from below as often as from above, unless the scene stores its up axis.
    fn new(scene: &ImportedScene, any_side: bool) -> Option<Self> {
        let mut soup = scene.scene.to_soup();
        soup.truncate_sh(0);
        let unit = Unit::of(&soup)?;
        unit.shrink(&mut soup);
        let up = scene.provenance.up_axis().to_y_up().transpose() * glam::DVec3::Y;
        let any_side = any_side && scene.provenance.up.is_none();
        Some(Self { survey: Survey::new(soup), unit, up: up.as_vec3(), any_side })
    }

    /// The same for Gaussians in whose place the scene has triangles: at most `count`, with
    /// pictures of `longer_px`, unless they are surroundings, whose pictures are as large as the
    /// Gaussians are sharp.
    fn of_splats(mut self, splats: &Splats, count: usize, longer_px: u32) -> Option<Viewpoints> {
        let Unit { middle, length, reach } = self.unit;
        let up = self.up;
        let from = around(reach, self.up, true);
        let around = from.iter().map(|c| self.unit.to_scene(c)).collect::<Vec<_>>();
        if !splat_views::are_surroundings(splats, &around, middle, reach * length) {
            let viewpoints = self.viewpoints(count);
            // Thin rods cover too little of a picture for the search, but are seen from around;
            // points are not.
            if viewpoints.is_none()
                && !splats.scales.iter().any(|scale| scale.max_element() > f32::EPSILON * length)
            {
                return None;
            }
            let inside = viewpoints.filter(|viewpoints| viewpoints.kind == ViewpointKind::Inside);
            let Some(Viewpoints { kind, cameras }) = inside else {
                return Viewpoints::of_kind(
                    ViewpointKind::Around,
                    splat_views::around(splats, up, count, longer_px),
                );
            };
            let cameras = cameras.iter().map(|c| c.resized(UVec2::splat(longer_px))).collect();
            return Viewpoints::of_kind(kind, cameras);
        }
        let places = splat_views::places(splats, length, self.up);
        let view = |place: &Camera| {
            let camera = self.unit.camera(place);
            self.survey.look(&camera, CLEARANCE);
            GoodView { visible: self.survey.visible_middles(&camera), camera: *place }
        };
        let cameras = most_telling(places.iter().map(view).collect(), places.len());
        Viewpoints::of_kind(ViewpointKind::Inside, cameras)
    }

    /// At most `count` viewpoints; `None` if the scene shows nothing from anywhere.
    fn viewpoints(self, count: usize) -> Option<Viewpoints> {
        let Self { mut survey, unit, up, any_side } = self;
        let around = good_views(&mut survey, around(unit.reach, up, any_side), |coverage| {
            coverage.covered >= MIN_COVERED_AROUND && coverage.crowded <= MAX_CLOSE_SHARE
        });
        let mut inside = Vec::new();
        for eye in free_eyes(survey.middles()) {
            let looks =
                (0..LOOKS).map(|i| camera(eye, eye + direction(i, LOOKS), up, INSIDE_FOV, SIDE));
            let mut surrounded = 0;
            let views = good_views(&mut survey, looks.collect(), |coverage| {
                surrounded += usize::from(coverage.covered >= MIN_COVERED);
                coverage.covered >= MIN_COVERED && coverage.crowded <= MAX_CLOSE_SHARE
            });
            // A viewpoint behind a wall sees nothing else.
            if 2 * surrounded > LOOKS {
                inside.extend(views);
            }
        }
        let surrounded =
            inside.len() >= MIN_VIEWS_INSIDE && union(&inside) > MORE_INSIDE * union(&around);
        let views = if surrounded { inside } else { around };
        let cameras: Vec<Camera> =
            most_telling(views, count).iter().map(|c| unit.to_scene(c)).collect();
        Viewpoints::of_kind(
            if surrounded { ViewpointKind::Inside } else { ViewpointKind::Around },
            cameras,
        )
    }
}

/// The middle of a scene, and its unit: the median distance from it.
#[derive(Debug)]
struct Unit {
    middle: Vec3,
    length: f32,
    /// Radius of most of the scene, in units.
    reach: f32,
}

impl Unit {
    /// `None` for a scene without extent.
    fn of(soup: &Soup) -> Option<Self> {
        let middles = soup.vertices.iter().map(|[a, b, c]| (*a + *b + *c) / 3.0);
        let middles: Vec<Vec3> = middles.filter(|middle| middle.is_finite()).collect();
        let along = |axis: usize| quantile(middles.iter().map(|m| m[axis]).collect(), 0.5);
        let middle = Vec3::new(along(0)?, along(1)?, along(2)?);
        let mut distances: Vec<f32> = middles.iter().map(|m| m.distance(middle)).collect();
        if distances.iter().all(|distance| *distance == 0.0) {
            // A lone triangle, or several in one place.
            distances =
                soup.vertices.iter().flatten().map(|corner| corner.distance(middle)).collect();
        }
        let length = quantile(distances.clone(), 0.5)?;
        let reach = quantile(distances, IN_VIEW)?;
        (length > 0.0 && reach.is_finite()).then_some(Self {
            middle,
            length,
            reach: reach / length,
        })
    }

    /// Moves `soup` to the middle and to this unit; drops triangles that are not finite there.
    fn shrink(&self, soup: &mut Soup) {
        for corner in soup.vertices.iter_mut().flatten() {
            *corner = (*corner - self.middle) / self.length;
        }
        let finite: Vec<bool> =
            soup.vertices.iter().map(|t| t.iter().all(|v| v.is_finite())).collect();
        soup.retain(|i| finite[i]);
    }

    /// A camera in the frame of the scene's file in this unit.
    fn camera(&self, camera: &Camera) -> Camera {
        let eye = (camera.position() - self.middle) / self.length;
        Camera { translation: -(camera.rotation * eye), ..*camera }
    }

    /// A camera of this unit in the frame of the scene.
    fn to_scene(&self, camera: &Camera) -> Camera {
        let eye = camera.position() * self.length + self.middle;
        Camera { translation: -(camera.rotation * eye), ..*camera }
    }
}

/// Rings of cameras that show everything within `reach`, or cameras on all sides.
fn around(reach: f32, up: Vec3, any_side: bool) -> Vec<Camera> {
    let distance = reach / (AROUND_FOV.to_radians() / 2.0).sin();
    if any_side {
        let from = |i| camera(direction(i, PICTURES) * distance, Vec3::ZERO, up, AROUND_FOV, SIDE);
        return (0..PICTURES).map(from).collect();
    }
    let x = up.any_orthonormal_vector();
    let per_ring = PICTURES / RINGS.len();
    let y = up.cross(x);
    let place = |(ring, k): (usize, usize)| {
        // Every other ring is turned by half a step.
        let turn = (k as f32 + 0.5 * (ring % 2) as f32) / per_ring as f32 * std::f32::consts::TAU;
        let (sin, cos) = RINGS[ring].to_radians().sin_cos();
        let eye = (up * sin + (x * turn.cos() + y * turn.sin()) * cos) * distance;
        camera(eye, Vec3::ZERO, up, AROUND_FOV, SIDE)
    };
    (0..RINGS.len()).flat_map(|ring| (0..per_ring).map(move |k| (ring, k))).map(place).collect()
}

/// Places around the middle that are free of `middles` of triangles.
fn free_eyes(middles: &[Vec3]) -> Vec<Vec3> {
    let free = |eye: &Vec3| {
        let near =
            middles.iter().filter(|m| m.distance_squared(*eye) < CLEARANCE * CLEARANCE).count();
        (near as f32) < MAX_NEARER_SHARE * middles.len() as f32
    };
    let eyes = INSIDE_RADII.iter().flat_map(|&radius| {
        let count = if radius == 0.0 { 1 } else { INSIDE_DIRECTIONS };
        (0..count).map(move |i| direction(i, count) * radius)
    });
    eyes.filter(free).collect()
}

/// A camera and its visible triangles.
struct GoodView {
    camera: Camera,
    visible: Vec<bool>,
}

/// The `candidates` with a `good` view.
fn good_views(
    survey: &mut Survey,
    candidates: Vec<Camera>,
    mut good: impl FnMut(&ViewCoverage) -> bool,
) -> Vec<GoodView> {
    let look = |camera: Camera| {
        let coverage = survey.look(&camera, CLEARANCE);
        good(&coverage).then(|| GoodView { camera, visible: survey.visible_middles(&camera) })
    };
    candidates.into_iter().filter_map(look).collect()
}

/// Number of triangles visible in any of `views`.
fn union(views: &[GoodView]) -> f32 {
    let Some(first) = views.first() else { return 0.0 };
    let by_any = |i: &usize| views.iter().any(|view| view.visible[*i]);
    (0..first.visible.len()).filter(by_any).count() as f32
}

/// At most `count` of `views`; each next one shows the triangles that the others show least.
fn most_telling(mut views: Vec<GoodView>, count: usize) -> Vec<Camera> {
    let mut times = vec![0u32; views.first().map_or(0, |view| view.visible.len())];
    let mut chosen = Vec::new();
    while chosen.len() < count && !views.is_empty() {
        let score = |view: &GoodView| {
            let visible = view.visible.iter().zip(&times).filter(|(visible, _)| **visible);
            visible.map(|(_, times)| 1.0 / f64::from(1 + times)).sum::<f64>()
        };
        let scores: Vec<f64> = views.iter().map(score).collect();
        let best = (0..views.len()).max_by(|a, b| scores[*a].total_cmp(&scores[*b])).unwrap_or(0);
        let view = views.swap_remove(best);
        for (times, visible) in times.iter_mut().zip(&view.visible) {
            *times += u32::from(*visible);
        }
        chosen.push(view.camera);
    }
    chosen
}

/// Cameras are only averaged with one of their nearest neighbours, because a wall may be between
/// distant ones.
const NEIGHBOURS: usize = 2;
/// Views with a larger angle do not show the same surface; cosine of the angle.
const MIN_COSINE: f32 = 0.5;

/// The cameras themselves, then those half way to each one's nearest neighbours, up to the limit.
fn with_between(cameras: &[Camera], max_bytes: u64) -> Vec<Camera> {
    let mut left = max_bytes.saturating_sub(cameras.iter().map(picture_bytes).sum());
    let mut fits = |camera: &Camera| {
        let needed = picture_bytes(camera);
        let fits = needed <= left;
        left -= if fits { needed } else { 0 };
        fits
    };
    [cameras.to_vec(), between(cameras).into_iter().filter(|camera| fits(camera)).collect()]
        .concat()
}

/// Bytes of the 8-bit picture that a camera takes.
pub(super) fn picture_bytes(camera: &Camera) -> u64 {
    3 * u64::from(camera.size.x) * u64::from(camera.size.y)
}

/// Cameras half way from each of `cameras` to its nearest neighbours; those to the very nearest
/// come first.
pub fn between(cameras: &[Camera]) -> Vec<Camera> {
    // A pair of mutual neighbours has one middle.
    let mut seen = HashSet::new();
    let pairs = (0..NEIGHBOURS).flat_map(|rank| (0..cameras.len()).map(move |i| (rank, i)));
    let middle = |(rank, i): (usize, usize)| {
        let other = neighbour(cameras, i, rank)?;
        seen.insert((i.min(other), i.max(other))).then(|| middle(&cameras[i], &cameras[other]))
    };
    pairs.filter_map(middle).collect()
}

/// The `rank`-th nearest camera to camera `i` with a similar direction.
fn neighbour(cameras: &[Camera], i: usize, rank: usize) -> Option<usize> {
    let position = cameras[i].position();
    let forward = cameras[i].rotation.row(2);
    let alike = |j: &usize| *j != i && cameras[*j].rotation.row(2).dot(forward) >= MIN_COSINE;
    let mut others: Vec<usize> = (0..cameras.len()).filter(alike).collect();
    let distance = |j: &usize| cameras[*j].position().distance_squared(position);
    others.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    others.get(rank).copied()
}

/// A camera half way between two, with the lens of the first.
fn middle(a: &Camera, b: &Camera) -> Camera {
    let rotation =
        Mat3::from_quat(Quat::from_mat3(&a.rotation).slerp(Quat::from_mat3(&b.rotation), 0.5));
    let position = (a.position() + b.position()) / 2.0;
    Camera { rotation, translation: -(rotation * position), ..*a }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::{ImportedSplats, Provenance, Rng};

    #[test]
    fn thin_rods_are_seen_from_around() {
        let splats = Splats {
            positions: (0..5).map(|i| direction(i, 5)).collect(),
            scales: vec![Vec3::new(0.3, 0.006, 0.006); 5],
            rotations: (0..5)
                .map(|i| Quat::from_rotation_arc(Vec3::X, direction(4 - i, 5)))
                .collect(),
            opacity: vec![0.99; 5],
            sh: vec![[1.0; 3]; 5],
            ..Splats::default()
        };
        let provenance = Provenance::default();
        let loaded =
            ImportedSplats { splats, provenance, warnings: Vec::new(), cameras: Vec::new() };
        let found =
            Viewpoints::of_splats(&loaded.splats, &loaded.stand_in(), &[], (12, 100)).unwrap();
        assert_eq!((found.kind, found.cameras.len()), (ViewpointKind::Around, 12));
    }

    /// Opaque triangles of about `size` at `places`.
    fn soup(places: impl Iterator<Item = Vec3>, size: f32) -> Soup {
        let rng = Rng::new(3, "test triangle", 0);
        let corner = |i: u64| {
            Vec3::new(rng.uniform(3 * i), rng.uniform(3 * i + 1), rng.uniform(3 * i + 2)) - 0.5
        };
        let vertices: Vec<[Vec3; 3]> = places
            .zip(0u64..)
            .map(|(p, i)| [0, 1, 2].map(|k| p + size * corner(3 * i + k)))
            .collect();
        let n = vertices.len();
        Soup {
            vertices,
            opacity: vec![0.95; n],
            sigma: vec![0.1; n],
            sh: vec![[0.3; 3]; n],
            sh_degree: 0,
            ..Soup::default()
        }
    }

    #[test]
    fn a_thing_is_seen_from_around() {
        let thing =
            soup((0..2000).map(|i| direction(i, 2000) * Vec3::new(1.0, 2.0, 0.5) + 7.0), 0.2);
        let Some(chosen) =
            Search::new(&thing.into(), false).and_then(|search| search.viewpoints(PICTURES))
        else {
            panic!("a thing can be looked at")
        };
        assert!(chosen.kind == ViewpointKind::Around && chosen.cameras.len() == PICTURES);
        assert!(chosen.cameras.iter().all(|c| c.position().distance(Vec3::splat(7.0)) > 2.0));
        // All of it is in every picture.
        let in_view = |c: &Camera| (c.rotation * Vec3::new(7.0, 9.0, 7.0) + c.translation).z > 0.0;
        assert!(chosen.cameras.iter().all(in_view));
    }

    #[test]
    fn nothing_can_be_seen_of_points() {
        let points =
            Soup { vertices: vec![[Vec3::ONE; 3]; 5], ..soup((0..5).map(|_| Vec3::ZERO), 1.0) };
        assert!(
            Search::new(&points.into(), false)
                .and_then(|search| search.viewpoints(PICTURES))
                .is_none()
        );
        assert!(Search::new(&Soup::default().into(), false).is_none());
    }
}

#[cfg(test)]
mod stored_tests {
    use super::*;
    use glam::{UVec2, Vec2, Vec3};

    /// Cameras on a line that look ahead, one step apart, and a last one that looks back.
    fn line(count: usize) -> Vec<Camera> {
        let camera = |i: usize| Camera {
            rotation: if i + 1 == count {
                Mat3::from_rotation_y(std::f32::consts::PI)
            } else {
                Mat3::IDENTITY
            },
            translation: Vec3::X * -(i as f32),
            focal: Vec2::splat(10.0),
            center: Vec2::splat(5.0),
            size: UVec2::splat(10),
        };
        (0..count).map(camera).collect()
    }

    #[test]
    fn pictures_lie_between_neighbours_that_look_the_same_way() {
        let cameras = line(5);
        let all = with_between(&cameras, u64::MAX);
        assert_eq!(all[..5], cameras[..]);
        let mut between: Vec<f32> = all[5..].iter().map(|camera| camera.position().x).collect();
        between.sort_by(f32::total_cmp);
        // Nearest neighbours one step apart, and at the ends two; none beside the one that looks
        // back.
        assert_eq!(between, [0.5, 1.0, 1.5, 2.0, 2.5]);
        assert!(
            all[5..].iter().all(|camera| camera.validate(&trisplat_scene::Limits::DEFAULT).is_ok())
        );
    }

    #[test]
    fn no_more_pictures_than_fit() {
        let cameras = line(5);
        assert_eq!(with_between(&cameras, 7 * 300).len(), 7);
        assert_eq!(with_between(&cameras, 0).len(), 5, "its own cameras always");
    }
}
