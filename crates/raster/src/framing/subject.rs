//! The subject of a scene: an object alone, the object that its photos look at, or its dense middle without photos.

use glam::Vec3;
use trisplat_scene::{
    camera::{self, Camera},
    math::median::median,
};

/// Most points to sample.
pub(super) const MOST_POINTS: usize = 20_000;
/// Most cameras to use.
const MOST_CAMERAS: usize = 100;
/// A point belongs to the subject if at least this share of the most framed point's pictures show it ...
const FRAMED: f32 = 0.5;
/// ... and if it is within this distance of the point that the cameras look at, as a share of their median
/// distance.
const WITHIN: f32 = 0.8;
/// Share of its points within the subject's radius.
const RADIUS_QUANTILE: f32 = 0.9;
/// Without photos: share of all points within the radius, ...
const ALL_QUANTILE: f32 = 0.95;
/// ... but at most this many times their median distance, because farther points surround the subject.
const CORE: f32 = 2.5;
/// Points are one object with a long part, such as the neck of a guitar, when this share of them ends ...
const OBJECT_QUANTILE: f32 = 0.995;
/// ... within this many times their median distance, so that nothing surrounds them, ...
const OBJECT: f32 = 5.0;
/// ... and this little beyond where `ALL_QUANTILE` of them end: surroundings thin out.
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
    /// Of a scene with `points`, the middles of its triangles, and the cameras of its photos, if known.
    /// `None` without extent.
    pub fn of(points: &[Vec3], cameras: &[Camera]) -> Option<Self> {
        let step = points.len().div_ceil(MOST_POINTS).max(1);
        let points: Vec<Vec3> = points.iter().copied().step_by(step).filter(|p| p.is_finite()).collect();
        let outside = |object: &Self| cameras.iter().all(|camera| !object.holds(camera.position()));
        let alone = (!cameras.is_empty()).then(|| object(&points).filter(outside)).flatten();
        alone.or_else(|| photographed(&points, cameras)).or_else(|| dense(&points))
    }

    /// The ball around the box of `points`; `None` without extent.
    pub fn around(points: &[Vec3]) -> Option<Self> {
        let (low, high) = points.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), point| {
            (low.min(*point), high.max(*point))
        });
        let center = (low + high) / 2.0;
        let radius = points.iter().map(|point| point.distance(center)).fold(0.0, f32::max);
        (radius > 0.0 && radius.is_finite()).then_some(Self { center, radius, is_alone: false })
    }

    /// Whether a point is in it.
    pub fn holds(&self, point: Vec3) -> bool {
        point.distance_squared(self.center) <= self.radius * self.radius
    }
}

/// The object that most of `cameras` frame, near their common focus; `None` without one.
fn photographed(points: &[Vec3], cameras: &[Camera]) -> Option<Subject> {
    let step = cameras.len().div_ceil(MOST_CAMERAS).max(1);
    let cameras: Vec<Camera> = cameras.iter().copied().step_by(step).collect();
    let focus = camera::focus(cameras.iter())?;
    let away = median(cameras.iter().map(|c| c.position().distance(focus)).collect(), f32::total_cmp)?;
    let near: Vec<Vec3> = points.iter().copied().filter(|p| p.distance(focus) <= WITHIN * away).collect();
    let frames = |point: &Vec3| cameras.iter().filter(|camera| camera.frames(*point)).count();
    let counts: Vec<usize> = near.iter().map(frames).collect();
    let least = FRAMED * counts.iter().copied().max()? as f32;
    let subject = near.iter().zip(&counts).filter(|(_, count)| **count as f32 >= least).map(|(p, _)| *p);
    ball(&subject.collect::<Vec<_>>(), RADIUS_QUANTILE)
}

/// All of an object that nothing surrounds; `None` where something does.
fn object(points: &[Vec3]) -> Option<Subject> {
    let [half, all] = [0.5, ALL_QUANTILE].map(|share| ball(points, share).map(|ball| ball.radius));
    let ends = (OBJECT * half?).min(SHARP_END * all?);
    let whole = ball(points, OBJECT_QUANTILE).filter(|whole| whole.radius <= ends)?;
    let around = Subject::around(&points.iter().copied().filter(|p| whole.holds(*p)).collect::<Vec<_>>())?;
    Some(Subject { is_alone: true, ..around })
}

/// The dense middle.
fn dense(points: &[Vec3]) -> Option<Subject> {
    let all = ball(points, ALL_QUANTILE)?;
    let half = ball(points, 0.5).map_or(all.radius, |half| half.radius);
    let core = CORE * half;
    if core <= 0.0 || all.radius <= core {
        return Some(all);
    }
    Some(object(points).unwrap_or(Subject { radius: core, ..all }))
}

/// The ball around the median of `points` that contains this share of them.
fn ball(points: &[Vec3], share: f32) -> Option<Subject> {
    let along = |axis: usize| median(points.iter().map(|p| p[axis]).collect(), f32::total_cmp);
    let center = Vec3::new(along(0)?, along(1)?, along(2)?);
    let mut distances: Vec<f32> = points.iter().map(|p| p.distance(center)).collect();
    let last = distances.len() - 1;
    let at = (last as f32 * share) as usize;
    let radius = *distances.select_nth_unstable_by(at, f32::total_cmp).1;
    (radius > 0.0 && radius.is_finite()).then_some(Subject { center, radius, is_alone: false })
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
            center + half * (2.0 * Vec3::from([0, 1, 2].map(|axis| rng.uniform(3 * i + axis))) - 1.0)
        })
    }

    #[test]
    fn the_subject_is_what_the_photos_look_at_not_the_many_points_behind_it() {
        let target = Vec3::new(3.0, 1.0, -2.0);
        let eyes = [0.0f32, 1.3, 2.6, 3.9, 5.2].map(|a| target + 4.0 * Vec3::new(a.cos(), 0.4, a.sin()));
        let cameras = eyes.map(|eye| LENS.looking(eye, target, Vec3::Y));
        let points: Vec<Vec3> = cube(target, 0.5, 2000).chain(cube(target + 20.0, 15.0, 8000)).collect();
        let subject = Subject::of(&points, &cameras).expect("there is one");
        assert!(subject.center.distance(target) < 0.2, "{subject:?}");
        assert!((0.4..1.0).contains(&subject.radius), "{subject:?}");
        // Without cameras only the densest place is known.
        let dense = Subject::of(&points, &[]).expect("there is one");
        assert!(dense.center.distance(target + 20.0) < 10.0 && dense.holds(target + 20.0), "{dense:?}");
    }

    #[test]
    fn surroundings_are_no_part_of_a_dense_middle() {
        let points: Vec<Vec3> = cube(Vec3::ZERO, 1.0, 4000).chain(cube(Vec3::ZERO, 40.0, 2000)).collect();
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
            LENS.looking(distance * Vec3::new(turn.cos(), 0.2, turn.sin()), Vec3::ZERO, Vec3::Y)
        };
        assert_eq!(Subject::of(&points, &[(0.5, 7.0), (2.0, 8.0), (4.0, 9.0)].map(camera)), Some(subject));
        assert_ne!(Subject::of(&points, &[(0.5, 0.7), (2.0, 8.0), (4.0, 9.0)].map(camera)), Some(subject));
    }
}
