//! Nearest neighbours of points, by a k-d tree.

use super::geometry::bounds;
use crate::parallel;
use glam::Vec3;

/// Points in a leaf.
const LEAF: usize = 8;

/// The mean distance of every point to its three nearest neighbours, in the points' order. With
/// fewer than four points the mean is over all others; a lone point gets 0.
pub fn mean_distances(points: &[Vec3]) -> Vec<f32> {
    nearest::<3, _>(points, |_, found| match found.len() {
        0 => 0.0,
        count => found.iter().map(|(d, _)| d.sqrt()).sum::<f32>() / count as f32,
    })
}

/// Calls `each` with every point and its up to `N` nearest neighbours: squared distance and index,
/// nearest first.
pub fn nearest<const N: usize, T: Send>(
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
        let count = best.iter().take_while(|(d, _)| d.is_finite()).count();
        each(i, &best[..count])
    })
}

/// A node is a run of `order`: its middle entry splits the rest along the axis stored at the same
/// place.
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
        let a = key(a);
        let b = key(b);
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
            for &i in self.order {
                self.insert_if_nearer(i, me, p, best);
            }
            return;
        }
        let middle = self.order.len() / 2;
        let axis = usize::from(self.axes[middle]);
        let offset = p[axis] - self.points[self.order[middle] as usize][axis];
        let left = self.part(0..middle);
        let right = self.part(middle + 1..self.order.len());
        let (near, far) = if offset < 0.0 { (left, right) } else { (right, left) };
        near.search(me, p, best);
        self.insert_if_nearer(self.order[middle], me, p, best);
        if offset * offset < best[best.len() - 1].0 {
            far.search(me, p, best);
        }
    }

    fn insert_if_nearer(self, i: u32, me: u32, p: Vec3, best: &mut [(f32, u32)]) {
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
    use crate::Rng;

    #[test]
    fn equals_brute_force() {
        let rng = Rng::new(1, "points", 0);
        let points: Vec<Vec3> = (0..700u64)
            .map(|i| {
                let p = Vec3::new(
                    rng.uniform(3 * i),
                    rng.uniform(3 * i + 1),
                    0.1 * rng.uniform(3 * i + 2),
                );
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
            let mut all: Vec<f32> = points
                .iter()
                .enumerate()
                .filter(|(j, _)| *j != i)
                .map(|(_, q)| q.distance(*p))
                .collect();
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
