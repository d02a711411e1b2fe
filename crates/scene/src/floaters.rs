//! Floaters: Gaussians that hang alone in the air, far from the scene.
//!
//! An optimiser leaves Gaussians where no photo shows that nothing is there. One in a hundred of
//! them, twenty radii away, makes the box of an object thousands of times as large as the object.
//! Counts and distances cannot tell them from the neck of a guitar, but touching can: Gaussians of
//! a surface overlap, because one alone does not show it. So the scene is
//!
//! 1. the groups of Gaussians that touch each other, the heaviest first, up to half of all opacity;
//! 2. every group that is in the ball around these, or nearer to it than the group is wide, again
//!    and again.
//!
//! All else floats.

use crate::math::geometry::bounds;
use crate::math::lists::{Sets, median};
use crate::math::neighbours::nearest;
use crate::splats::Splats;
use glam::Vec3;

/// Minimum opacity of a Gaussian that shows where the scene is.
pub(crate) const MIN_OPACITY: f32 = 0.1;
/// Number of nearest neighbours that are tested for touching: two on each side along each of the
/// two axes of a surface.
const NEIGHBOURS: usize = 8;
/// Distance from the middle at which an opaque Gaussian ends, in standard deviations.
const REACH: f32 = 3.0;

/// The ball that holds a scene, and the Gaussians outside it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Floaters {
    /// Flags of the Gaussians that float. `[N]`
    pub is_floater: Vec<bool>,
    /// The centre of the scene.
    pub center: Vec3,
    /// Its radius.
    pub radius: f32,
}

impl Floaters {
    /// Number of Gaussians that float.
    pub fn count(&self) -> usize {
        self.is_floater.iter().filter(|floats| **floats).count()
    }

    /// A sentence for whoever gave `splats`; `None` where none of them floats.
    pub fn warning(&self, splats: &Splats) -> Option<String> {
        let count = self.count();
        let floating = (0..splats.len()).filter(|i| self.is_floater[*i]);
        let farthest =
            floating.map(|i| splats.positions[i].distance(self.center)).fold(0.0, f32::max);
        (count > 0).then(|| {
            format!(
                "{count} of {} splats float alone, up to {:.3} from the middle of a scene with a radius of {:.3}: they are left out",
                splats.len(),
                farthest,
                self.radius
            )
        })
    }
}

/// A group of Gaussians that touch each other, or several in one ball.
#[derive(Debug, Clone, Copy)]
struct Group {
    opacity: f64,
    center: Vec3,
    radius: f32,
}

impl Group {
    /// The gap between the balls of two groups; below 0 where they overlap.
    fn gap(&self, other: &Self) -> f32 {
        self.center.distance(other.center) - self.radius - other.radius
    }

    /// The smallest ball around two groups.
    fn union(self, other: Self) -> Self {
        let distance = self.center.distance(other.center);
        let opacity = self.opacity + other.opacity;
        if distance + other.radius <= self.radius {
            return Self { opacity, ..self };
        }
        if distance + self.radius <= other.radius {
            return Self { opacity, ..other };
        }
        let radius = (distance + self.radius + other.radius) / 2.0;
        let center = self.center.lerp(other.center, (radius - self.radius) / distance);
        Self { opacity, center, radius }
    }
}

impl Splats {
    /// Separate the scene from the Gaussians that float around it.
    pub fn floaters(&self) -> Floaters {
        let visible: Vec<usize> = (0..self.len())
            .filter(|i| self.opacity[*i] >= MIN_OPACITY && self.is_placed(*i))
            .collect();
        let Some(scene) = ball(self.groups(&visible)) else {
            return Floaters { is_floater: vec![false; self.len()], ..Floaters::default() };
        };
        let is_outside = |i: usize| self.positions[i].distance(scene.center) > scene.radius;
        Floaters {
            is_floater: (0..self.len()).map(is_outside).collect(),
            center: scene.center,
            radius: scene.radius,
        }
    }

    fn is_placed(&self, i: usize) -> bool {
        self.positions[i].is_finite() && self.scales[i].is_finite()
    }

    /// Groups of the `visible` Gaussians that touch each other, the heaviest first.
    fn groups(&self, visible: &[usize]) -> Vec<Group> {
        let places: Vec<Vec3> = visible.iter().map(|i| self.positions[*i]).collect();
        let links = nearest::<NEIGHBOURS, _>(&places, |i, found| {
            let mut links = [(f32::INFINITY, 0); NEIGHBOURS];
            for (link, (_, j)) in links.iter_mut().zip(found) {
                *link = (self.separation(visible[i], visible[*j as usize]), *j);
            }
            links
        });
        // In a file with small Gaussians, as of a cloud of points, most are as far apart as some of
        // their neighbours.
        let widest =
            links.iter().map(|links| links[NEIGHBOURS - 1].0).filter(|gap| gap.is_finite());
        let touching = median(widest.collect(), f32::total_cmp).unwrap_or(1.0).max(1.0);
        let mut sets = Sets::new(visible.len());
        for (i, links) in (0..).zip(&links) {
            for (_, j) in links.iter().filter(|(gap, _)| *gap <= touching) {
                sets.join(i, *j);
            }
        }
        let mut members: Vec<(u32, usize)> =
            (0..).zip(visible).map(|(k, i)| (sets.first(k), *i)).collect();
        members.sort_unstable();
        let groups = members.chunk_by(|a, b| a.0 == b.0);
        let mut groups: Vec<Group> = groups.filter_map(|group| self.group(group)).collect();
        groups.sort_by(|a, b| b.opacity.total_cmp(&a.opacity));
        groups
    }

    /// Distance of the middles of two Gaussians, as a multiple of the distance at which they begin
    /// to overlap.
    fn separation(&self, i: usize, j: usize) -> f32 {
        let offset = self.positions[j] - self.positions[i];
        let along = offset.normalize_or_zero();
        let deviation = |k: usize| (self.rotations[k].inverse() * along * self.scales[k]).length();
        let reach = REACH * (deviation(i) + deviation(j));
        if reach > 0.0 { offset.length() / reach } else { 0.0 }
    }

    fn group(&self, members: &[(u32, usize)]) -> Option<Group> {
        let [low, high] = bounds(members.iter().map(|(_, i)| self.positions[*i]))?;
        let center = low.midpoint(high);
        let ends = members.iter().map(|(_, i)| {
            self.positions[*i].distance(center) + REACH * self.scales[*i].max_element()
        });
        let opacity = members.iter().map(|(_, i)| f64::from(self.opacity[*i])).sum();
        Some(Group { opacity, center, radius: ends.fold(0.0, f32::max) })
    }
}

/// The ball around the scene of `groups`, the heaviest first; `None` of none.
fn ball(groups: Vec<Group>) -> Option<Group> {
    let half = groups.iter().map(|group| group.opacity).sum::<f64>() / 2.0;
    let mut rest = groups.into_iter();
    let mut scene = rest.next()?;
    while scene.opacity < half {
        scene = scene.union(rest.next()?);
    }
    let mut rest: Vec<Group> = rest.collect();
    loop {
        let count = rest.len();
        rest.retain(|group| {
            let is_near = group.gap(&scene) <= 2.0 * group.radius;
            if is_near {
                scene = scene.union(*group);
            }
            !is_near
        });
        if rest.len() == count {
            return Some(scene);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;
    use glam::Quat;

    /// Small Gaussians at these places, with their radius.
    fn splats(places: Vec<Vec3>, radius: f32) -> Splats {
        let n = places.len();
        Splats {
            positions: places,
            scales: vec![Vec3::splat(radius / REACH); n],
            rotations: vec![Quat::IDENTITY; n],
            opacity: vec![0.9; n],
            sh: vec![[0.3; 3]; n],
            ..Splats::default()
        }
    }

    /// A ball of radius 1 with a neck that ends 4 units away, in which three of four Gaussians lie
    /// in the ball.
    fn guitar() -> Vec<Vec3> {
        let rng = Rng::new(7, "guitar", 0);
        let body = (0..3000).map(|i| rng.on_sphere(i));
        let neck = (0..1000).map(|i| Vec3::X * (1.0 + 0.003 * i as f32));
        body.chain(neck).collect()
    }

    /// Places 3 to 20 radii of the guitar away.
    fn far(count: u64) -> impl Iterator<Item = Vec3> {
        let rng = Rng::new(8, "floaters", 0);
        (0..count).map(move |i| rng.on_sphere(i) * 2.5 * (3.0 + 17.0 * rng.uniform(9 * i)))
    }

    #[test]
    fn what_hangs_alone_floats_and_the_neck_does_not() {
        for count in [0, 40, 400, 1500] {
            let splats = splats(guitar().into_iter().chain(far(count)).collect(), 0.1);
            let floaters = splats.floaters();
            assert_eq!(floaters.count(), count as usize);
            assert!(floaters.is_floater[4000..].iter().all(|floats| *floats));
            assert!((floaters.center - Vec3::X * 1.5).length() < 0.2, "{floaters:?}");
            assert!((2.4..2.9).contains(&floaters.radius), "{}", floaters.radius);
            assert_eq!(floaters.warning(&splats).is_some(), count > 0);
        }
    }

    #[test]
    fn a_second_object_beside_the_first_belongs_to_the_scene() {
        let second = (0..400).map(|i| Vec3::new(9.0, 0.0, 0.01 * i as f32));
        let splats = splats(guitar().into_iter().chain(second).collect(), 0.1);
        let floaters = splats.floaters();
        assert_eq!(floaters.count(), 0);
        assert!(floaters.radius > 5.0);
    }

    #[test]
    fn points_that_touch_nothing_are_all_the_scene() {
        let floaters = splats(guitar(), 1e-6).floaters();
        assert!(floaters.count() == 0, "{}", floaters.count());
        for places in [vec![], vec![Vec3::ONE], vec![Vec3::NAN; 3], vec![Vec3::ONE; 30]] {
            let few = splats(places, 0.1);
            assert!(few.floaters().count() == 0 && few.floaters().warning(&few).is_none());
        }
    }

    #[test]
    fn a_ball_holds_both_of_its_balls() {
        let group = |x: f32, radius: f32| Group { opacity: 1.0, center: Vec3::X * x, radius };
        let both = group(0.0, 1.0).union(group(5.0, 2.0));
        assert_eq!((both.center, both.radius), (Vec3::X * 3.0, 4.0));
        assert_eq!(group(0.0, 5.0).union(group(1.0, 2.0)).radius, 5.0);
        assert_eq!(group(1.0, 2.0).union(group(0.0, 5.0)).center, Vec3::ZERO);
    }
}
