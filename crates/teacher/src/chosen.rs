//! Chooses viewpoints for a scene without cameras: around an object, or within surroundings.
//!
//! Both are tried. Candidates that show too little, or with an obstacle in front, are discarded. Of the rest,
//! the set that sees more of the scene's triangles wins. Triangles that no good candidate sees are ignored,
//! because a scene is only valid where it was photographed.

use super::framed;
use super::photographed;
use super::survey::{Survey, ViewCoverage, camera, direction};
use glam::{UVec2, Vec3};
use trisplat_scene::{ImportedScene, Soup, Splats, camera::Camera};

/// Pictures of a soft scene, and cameras around one that are tried.
pub(super) const PICTURES: usize = 60;
/// Their width and height, px.
const SIDE: u32 = 360;
/// Field of view of cameras around the scene, degrees.
const AROUND_FOV: f32 = 45.0;
/// Field of view of cameras within the scene, degrees.
const INSIDE_FOV: f32 = 75.0;
/// Elevations of the rings around an object, degrees: most of them from above, because objects stand on
/// something.
const RINGS: [f32; 5] = [-20.0, 5.0, 25.0, 45.0, 70.0];
/// Distances of inner viewpoints from the middle, in units of the scene, and their number of directions.
const INSIDE_RADII: [f32; 4] = [0.0, 0.6, 1.2, 2.0];
const INSIDE_DIRECTIONS: usize = 12;
/// Viewing directions of an inner viewpoint.
const LOOKS: usize = 10;
/// Least distance of a viewpoint from other surfaces, in units of the scene, ...
const CLEARANCE: f32 = 0.25;
/// ... except for this share of its picture.
const MOST_CROWDED: f32 = 0.1;
/// Share of the triangles that may be nearer.
const MOST_NEAR: f32 = 1e-3;
/// Least covered share of a picture from within.
const LEAST_COVERED: f32 = 0.9;
/// Least covered share of a picture from around.
const LEAST_SHOWN: f32 = 0.02;
/// Views from within must see this many times more triangles than those from around, because the surface of
/// an object is visible from both of its sides.
const MORE_INSIDE: f32 = 1.2;
/// Least number of views from within.
const LEAST_INSIDE: usize = 8;
/// The quantile of distances from the middle that the rings show.
const IN_VIEW: f32 = 0.95;

/// Chosen cameras.
pub(super) struct Chosen {
    /// They stand within the scene, not around it.
    pub(super) inside: bool,
    /// In the frame of the scene's file.
    pub(super) cameras: Vec<Camera>,
}

/// A search for places to look from at a scene that stores no cameras.
#[derive(Debug)]
pub(super) struct Search {
    survey: Survey,
    unit: Unit,
    up: Vec3,
    /// Look from below as often as from above, because nobody knows where up is.
    any_side: bool,
}

impl Search {
    /// Prepares to look at `scene`; `None` when it has no extent.
    /// `any_side`: look from below as often as from above, unless the scene knows where up is.
    pub(super) fn new(scene: &ImportedScene, any_side: bool) -> Option<Self> {
        let (unit, soup) = in_units(scene)?;
        let up = scene.provenance.up.unwrap_or_default().to_y_up().transpose() * glam::DVec3::Y;
        let any_side = any_side && scene.provenance.up.is_none();
        Some(Self { survey: Survey::new(soup), unit, up: up.as_vec3(), any_side })
    }

    /// The same for Gaussians in whose place the scene has triangles: at most `count`, with pictures of `longer_px`, unless they are surroundings,
    /// whose pictures are as large as the Gaussians are sharp.
    pub(super) fn of_splats(mut self, splats: &Splats, count: usize, longer_px: u32) -> Option<Chosen> {
        let Unit { middle, length, reach } = self.unit;
        let (up, from) = (self.up, around(reach, self.up, true));
        let around = from.iter().map(|c| self.unit.to_scene(c)).collect::<Vec<_>>();
        if !photographed::surround(splats, &around, middle, reach * length) {
            let chosen = self.viewpoints(count)?;
            let cameras = match chosen.inside {
                true => chosen.cameras.iter().map(|c| c.resized(UVec2::splat(longer_px))).collect(),
                false => framed::around(splats, up, count, longer_px),
            };
            return Some(Chosen { cameras, ..chosen }).filter(|chosen| !chosen.cameras.is_empty());
        }
        let places = photographed::places(splats, length, self.up);
        let view = |place: &Camera| {
            let camera = self.unit.camera(place);
            self.survey.look(&camera, CLEARANCE);
            GoodView { seen: self.survey.seen(&camera), camera: *place }
        };
        let cameras = most_telling(places.iter().map(view).collect(), places.len());
        (!cameras.is_empty()).then_some(Chosen { inside: true, cameras })
    }

    /// Where to look from, at most `count` places; `None` when the scene shows nothing from anywhere.
    pub(super) fn viewpoints(self, count: usize) -> Option<Chosen> {
        let Self { mut survey, unit, up, any_side } = self;
        let around = good_views(&mut survey, around(unit.reach, up, any_side), |sight| {
            sight.covered >= LEAST_SHOWN && sight.crowded <= MOST_CROWDED
        });
        let mut inside = Vec::new();
        for eye in free_eyes(survey.middles()) {
            let looks = (0..LOOKS).map(|i| camera(eye, eye + direction(i, LOOKS), up, INSIDE_FOV, SIDE));
            let mut surrounded = 0;
            let views = good_views(&mut survey, looks.collect(), |sight| {
                surrounded += usize::from(sight.covered >= LEAST_COVERED);
                sight.covered >= LEAST_COVERED && sight.crowded <= MOST_CROWDED
            });
            // A viewpoint behind a wall sees nothing else.
            if 2 * surrounded > LOOKS {
                inside.extend(views);
            }
        }
        let surrounded = inside.len() >= LEAST_INSIDE && union(&inside) > MORE_INSIDE * union(&around);
        let views = if surrounded { inside } else { around };
        let cameras: Vec<Camera> = most_telling(views, count).iter().map(|c| unit.to_scene(c)).collect();
        (!cameras.is_empty()).then_some(Chosen { inside: surrounded, cameras })
    }
}

/// The triangles of `scene` in its own unit around its middle, without view-dependent colours; `None` without
/// extent.
fn in_units(scene: &ImportedScene) -> Option<(Unit, Soup)> {
    let mut soup = scene.scene.to_soup();
    soup.truncate_sh(0);
    let unit = Unit::of(&soup)?;
    unit.shrink(&mut soup);
    Some((unit, soup))
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
        let distances: Vec<f32> = middles.iter().map(|m| m.distance(middle)).collect();
        let (length, reach) = (quantile(distances.clone(), 0.5)?, quantile(distances, IN_VIEW)?);
        (length > 0.0 && reach.is_finite()).then_some(Self { middle, length, reach: reach / length })
    }

    /// Moves `soup` to the middle and to this unit; drops triangles that are not finite there.
    fn shrink(&self, soup: &mut Soup) {
        for corner in soup.vertices.iter_mut().flatten() {
            *corner = (*corner - self.middle) / self.length;
        }
        let finite: Vec<bool> = soup.vertices.iter().map(|t| t.iter().all(|v| v.is_finite())).collect();
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

/// The quantile of `values` for this share.
fn quantile(mut values: Vec<f32>, share: f32) -> Option<f32> {
    let last = values.len().checked_sub(1)?;
    Some(*values.select_nth_unstable_by((last as f32 * share) as usize, f32::total_cmp).1)
}

/// Rings of cameras that show everything within `reach`, or cameras on all sides.
fn around(reach: f32, up: Vec3, any_side: bool) -> Vec<Camera> {
    let distance = reach / (AROUND_FOV.to_radians() / 2.0).sin();
    if any_side {
        let from = |i| camera(direction(i, PICTURES) * distance, Vec3::ZERO, up, AROUND_FOV, SIDE);
        return (0..PICTURES).map(from).collect();
    }
    let (x, per_ring) = (up.any_orthonormal_vector(), PICTURES / RINGS.len());
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
        let near = middles.iter().filter(|m| m.distance_squared(*eye) < CLEARANCE * CLEARANCE).count();
        (near as f32) < MOST_NEAR * middles.len() as f32
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
    seen: Vec<bool>,
}

/// The `candidates` with a `good` view.
fn good_views(
    survey: &mut Survey,
    candidates: Vec<Camera>,
    mut good: impl FnMut(&ViewCoverage) -> bool,
) -> Vec<GoodView> {
    let look = |camera: Camera| {
        let sight = survey.look(&camera, CLEARANCE);
        good(&sight).then(|| GoodView { camera, seen: survey.seen(&camera) })
    };
    candidates.into_iter().filter_map(look).collect()
}

/// Number of triangles visible in any of `views`.
fn union(views: &[GoodView]) -> f32 {
    let Some(first) = views.first() else { return 0.0 };
    let by_any = |i: &usize| views.iter().any(|view| view.seen[*i]);
    (0..first.seen.len()).filter(by_any).count() as f32
}

/// At most `most` of `views`; each next one sees most of the triangles that the others have seen least.
fn most_telling(mut views: Vec<GoodView>, most: usize) -> Vec<Camera> {
    let mut times = vec![0u32; views.first().map_or(0, |view| view.seen.len())];
    let mut chosen = Vec::new();
    while chosen.len() < most && !views.is_empty() {
        let worth = |view: &GoodView| {
            let seen = view.seen.iter().zip(&times).filter(|(seen, _)| **seen);
            seen.map(|(_, times)| 1.0 / f64::from(1 + times)).sum::<f64>()
        };
        let worths: Vec<f64> = views.iter().map(worth).collect();
        let best = (0..views.len()).max_by(|a, b| worths[*a].total_cmp(&worths[*b])).unwrap_or(0);
        let view = views.swap_remove(best);
        times.iter_mut().zip(&view.seen).for_each(|(times, seen)| *times += u32::from(*seen));
        chosen.push(view.camera);
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::Rng;

    /// Opaque triangles of about `size` at `places`.
    fn soup(places: impl Iterator<Item = Vec3>, size: f32) -> Soup {
        let rng = Rng::new(3, "test triangle", 0);
        let corner =
            |i: u64| Vec3::new(rng.uniform(3 * i), rng.uniform(3 * i + 1), rng.uniform(3 * i + 2)) - 0.5;
        let vertices: Vec<[Vec3; 3]> =
            places.zip(0u64..).map(|(p, i)| [0, 1, 2].map(|k| p + size * corner(3 * i + k))).collect();
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
        let thing = soup((0..2000).map(|i| direction(i, 2000) * Vec3::new(1.0, 2.0, 0.5) + 7.0), 0.2);
        let Some(chosen) = Search::new(&thing.into(), false).and_then(|search| search.viewpoints(PICTURES))
        else {
            panic!("a thing can be looked at")
        };
        assert!(!chosen.inside && chosen.cameras.len() == PICTURES);
        assert!(chosen.cameras.iter().all(|c| c.position().distance(Vec3::splat(7.0)) > 2.0));
        // All of it is in every picture.
        let in_view = |c: &Camera| (c.rotation * Vec3::new(7.0, 9.0, 7.0) + c.translation).z > 0.0;
        assert!(chosen.cameras.iter().all(in_view));
    }

    #[test]
    fn nothing_can_be_seen_of_points() {
        let points = Soup { vertices: vec![[Vec3::ONE; 3]; 5], ..soup((0..5).map(|_| Vec3::ZERO), 1.0) };
        assert!(Search::new(&points.into(), false).and_then(|search| search.viewpoints(PICTURES)).is_none());
        assert!(Search::new(&Soup::default().into(), false).is_none());
    }
}
