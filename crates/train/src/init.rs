//! The first triangles: one per point of the sparse cloud, as large as the gap to its neighbours
//! (Held et al. 2025, section 3.3).
//!
//! ```text
//! v_i = q + k · d · u_i      d: mean distance to the three nearest points, u_i: uniform on the unit sphere
//! ```

use super::options::InitOptions;
use glam::Vec3;
use trisplat_scene::math::geometry::bounds;
use trisplat_scene::math::lists::median;
use trisplat_scene::{Rng, Soup, parallel, sh0_from_rgb};

/// First opacity (0.28, supplement).
pub(super) const FIRST_OPACITY: f32 = 0.28;
/// First σ (1.16, supplement).
pub(super) const FIRST_SIGMA: f32 = 1.16;

/// A coloured point of the sparse cloud, in training space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct InitPoint {
    /// Position.
    pub position: Vec3,
    /// Colour, sRGB-encoded, in [0, 1].
    pub rgb: [f32; 3],
}

/// The first soup, SH degree 0. Points that are not finite are left out.
pub(crate) fn first_soup(points: &[InitPoint], options: &InitOptions, seed: u64) -> Soup {
    let points: Vec<InitPoint> = points.iter().copied().filter(|p| p.position.is_finite()).collect();
    let distances = mean_distances(&points.iter().map(|p| p.position).collect::<Vec<_>>());
    // A point without neighbours, or at the same place as these, gets the median size.
    let typical =
        median(distances.iter().copied().filter(|d| *d > 0.0).collect(), f32::total_cmp).unwrap_or(0.05);
    let radii: Vec<f32> = distances
        .iter()
        .map(|&d| options.size as f32 * if d > 1e-4 * typical { d } else { typical })
        .collect();

    let rng = Rng::new(seed, "init", 0);
    let n = points.len();
    Soup {
        vertices: (0..n)
            .map(|i| {
                std::array::from_fn(|c| points[i].position + radii[i] * rng.on_sphere((3 * i + c) as u64))
            })
            .collect(),
        opacity: vec![FIRST_OPACITY; n],
        sigma: vec![FIRST_SIGMA; n],
        sh: points.iter().map(|p| p.rgb.map(sh0_from_rgb)).collect(),
        sh_degree: 0,
        ..Soup::default()
    }
}

/// Points in a leaf.
const LEAF: usize = 8;

/// The mean distance of every point to its three nearest neighbours, in the points' order. With fewer than
/// four points the mean is over all others; a lone point gets 0.
pub(crate) fn mean_distances(points: &[Vec3]) -> Vec<f32> {
    nearest::<3, _>(points, |_, found| match found.len() {
        0 => 0.0,
        count => found.iter().map(|(d, _)| d.sqrt()).sum::<f32>() / count as f32,
    })
}

/// Calls `each` with every point and its up to `N` nearest neighbours: squared distance and index, nearest first.
pub(crate) fn nearest<const N: usize, T: Send>(
    points: &[Vec3],
    each: impl Fn(usize, &[(f32, u32)]) -> T + Sync,
) -> Vec<T> {
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    let mut axes = vec![0; points.len()];
    build(points, &mut order, &mut axes);
    let tree = KdTree { points, order: &order, axes: &axes };
    parallel::collect(points.len(), 1, |i| {
        let mut best = [(f32::INFINITY, u32::MAX); N];
        tree.search(i as u32, points[i], &mut best);
        let found = best.iter().take_while(|(d, _)| d.is_finite()).count();
        each(i, &best[..found])
    })
}

/// A node is a run of `order`: its middle entry splits the rest along the axis stored at the same place.
#[derive(Clone, Copy)]
struct KdTree<'a> {
    points: &'a [Vec3],
    order: &'a [u32],
    axes: &'a [u8],
}

/// Puts the median along the widest axis in the middle, then recurses into both halves.
fn build(points: &[Vec3], order: &mut [u32], axes: &mut [u8]) {
    if order.len() <= LEAF {
        return;
    }
    let axis = widest_axis(points, order);
    let middle = order.len() / 2;
    let key = |i: &u32| (points[*i as usize][axis], *i);
    order.select_nth_unstable_by(middle, |a, b| {
        let (a, b) = (key(a), key(b));
        a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
    });
    let (left, right) = order.split_at_mut(middle);
    let (left_axes, right_axes) = axes.split_at_mut(middle);
    right_axes[0] = axis as u8;
    build(points, left, left_axes);
    build(points, &mut right[1..], &mut right_axes[1..]);
}

/// The axis along which these points spread most.
fn widest_axis(points: &[Vec3], order: &[u32]) -> usize {
    let [low, high] = bounds(order.iter().map(|&i| points[i as usize])).unwrap_or_default();
    (high - low).max_position()
}

impl KdTree<'_> {
    /// Keeps the smallest squared distances in `best`, ascending.
    fn search(self, me: u32, p: Vec3, best: &mut [(f32, u32)]) {
        if self.order.len() <= LEAF {
            self.order.iter().for_each(|&i| self.offer(i, me, p, best));
            return;
        }
        let middle = self.order.len() / 2;
        let axis = usize::from(self.axes[middle]);
        let offset = p[axis] - self.points[self.order[middle] as usize][axis];
        let (left, right) = (self.part(0..middle), self.part(middle + 1..self.order.len()));
        let (near, far) = if offset < 0.0 { (left, right) } else { (right, left) };
        near.search(me, p, best);
        self.offer(self.order[middle], me, p, best);
        if offset * offset < best[best.len() - 1].0 {
            far.search(me, p, best);
        }
    }

    fn offer(self, i: u32, me: u32, p: Vec3, best: &mut [(f32, u32)]) {
        let d = self.points[i as usize].distance_squared(p);
        let last = best.len() - 1;
        if i != me && d < best[last].0 {
            best[last] = (d, i);
            best.sort_by(|a, b| a.0.total_cmp(&b.0));
        }
    }

    fn part(self, range: std::ops::Range<usize>) -> Self {
        Self { order: &self.order[range.clone()], axes: &self.axes[range], ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(n: u64) -> Vec<InitPoint> {
        let rng = Rng::new(9, "grid", 0);
        (0..n)
            .map(|i| InitPoint {
                position: Vec3::new(rng.uniform(3 * i), rng.uniform(3 * i + 1), rng.uniform(3 * i + 2)),
                rgb: [0.5, 0.25, 1.0],
            })
            .collect()
    }

    #[test]
    fn corners_lie_on_spheres_around_the_points() {
        let (points, options) = (grid(200), InitOptions::default());
        let distances = mean_distances(&points.iter().map(|p| p.position).collect::<Vec<_>>());
        let soup = first_soup(&points, &options, 1);
        soup.validate().unwrap();
        assert_eq!(soup.len(), 200);
        for (i, corners) in soup.vertices.iter().enumerate() {
            for corner in corners {
                let radius = corner.distance(points[i].position);
                assert!((radius / (2.2 * distances[i]) - 1.0).abs() < 1e-3, "{radius}");
            }
        }
        assert!((soup.rgb(0)[1] - 0.25).abs() < 1e-6);
        assert_eq!(soup, first_soup(&points, &options, 1));
        assert_ne!(soup, first_soup(&points, &options, 2));
    }

    #[test]
    fn odd_clouds_give_valid_soups() {
        let options = InitOptions::default();
        let same = vec![InitPoint { position: Vec3::ONE, rgb: [0.0; 3] }; 5];
        let mut broken = grid(10);
        broken[3].position.x = f32::NAN;
        for (points, least) in [(vec![], 0), (grid(1), 1), (grid(2), 2), (same, 5), (broken, 9)] {
            let soup = first_soup(&points, &options, 0);
            soup.validate().unwrap();
            assert!(soup.len() >= least);
        }
    }
}

#[cfg(test)]
mod neighbours_tests {
    use super::*;
    use trisplat_scene::Rng;

    #[test]
    fn equals_brute_force() {
        let rng = Rng::new(1, "points", 0);
        let points: Vec<Vec3> = (0..700u64)
            .map(|i| {
                let p = Vec3::new(rng.uniform(3 * i), rng.uniform(3 * i + 1), 0.1 * rng.uniform(3 * i + 2));
                if i % 50 == 0 {
                    p * 1e4
                } else if i % 17 == 0 {
                    Vec3::splat(0.5)
                } else {
                    p
                }
            })
            .collect();
        let fast = mean_distances(&points);
        for (i, p) in points.iter().enumerate() {
            let mut all: Vec<f32> =
                points.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, q)| q.distance(*p)).collect();
            all.sort_by(f32::total_cmp);
            let mean = all[..3].iter().sum::<f32>() / 3.0;
            assert!((fast[i] - mean).abs() <= 1e-5 * mean.max(1e-3), "{i}: {} {mean}", fast[i]);
        }
    }

    #[test]
    fn few_points() {
        assert!(mean_distances(&[]).is_empty());
        assert_eq!(mean_distances(&[Vec3::ONE]), [0.0]);
        assert_eq!(mean_distances(&[Vec3::ZERO, Vec3::X]), [1.0, 1.0]);
    }
}
