//! Cuts space repeatedly into halves of equal count: a complete k-d tree.

/// The cells of a complete binary tree of cuts. The number of a cell is the path to it, one bit for each cut,
/// with the first cut highest.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Cells {
    /// Axis and place of every cut; the cuts below cut i are 2 i + 1 and 2 i + 2. Points at a cut or above it
    /// are in the upper half.
    cuts: Vec<(u8, f32)>,
    depth: u32,
}

impl Cells {
    /// Cuts `depth` times, each cell at the median of its points along the axis of their largest extent.
    pub(super) fn new(points: &[[f32; 3]], depth: u32) -> Self {
        let mut cuts = vec![(0, f32::INFINITY); (1 << depth) - 1];
        let mut points = points.to_vec();
        cut(&mut points, 0, &mut cuts);
        Self { cuts, depth }
    }

    /// The cell of a point.
    pub(super) fn of(&self, point: [f32; 3]) -> u64 {
        let (mut at, mut cell) = (0, 0);
        for _ in 0..self.depth {
            let (axis, place) = self.cuts[at];
            let upper = u64::from(point[usize::from(axis)] >= place);
            cell = 2 * cell + upper;
            at = 2 * at + 1 + upper as usize;
        }
        cell
    }
}

fn cut(points: &mut [[f32; 3]], at: usize, cuts: &mut [(u8, f32)]) {
    if at >= cuts.len() || points.is_empty() {
        return;
    }
    let extent = |axis: usize| {
        let values = points.iter().map(|point| point[axis]);
        values.clone().fold(f32::NEG_INFINITY, f32::max) - values.fold(f32::INFINITY, f32::min)
    };
    let axis = (1..3).fold(0, |best, axis| if extent(axis) > extent(best) { axis } else { best });
    let middle = points.len() / 2;
    points.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis]));
    let place = points[middle][axis];
    cuts[at] = (axis as u8, place);
    // Points in the middle that also lie at the cut belong to the upper half.
    points.sort_unstable_by_key(|point| point[axis] >= place);
    let (lower, upper) = points.split_at_mut(points.partition_point(|point| point[axis] < place));
    cut(lower, 2 * at + 1, cuts);
    cut(upper, 2 * at + 2, cuts);
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::Rng;

    #[test]
    fn cells_hold_equal_counts_of_points_that_lie_apart() {
        let rng = Rng::new(2, "cells", 0);
        let points: Vec<[f32; 3]> = (0..4096)
            .map(|i| [0, 1, 2].map(|k| rng.uniform(3 * i + k) * [5.0, 1.0, 0.1][k as usize]))
            .collect();
        let cells = Cells::new(&points, 4);
        let mut counts = [0; 16];
        points.iter().for_each(|point| counts[cells.of(*point) as usize] += 1);
        assert!(counts.iter().all(|count| (250..=262).contains(count)), "{counts:?}");
        // The order of the points does not matter.
        let backwards: Vec<[f32; 3]> = points.iter().rev().copied().collect();
        assert_eq!(Cells::new(&backwards, 4), cells);
    }

    #[test]
    fn equal_points_and_no_points_have_cells_too() {
        assert_eq!(Cells::new(&[], 6).of([1.0; 3]), 0);
        let cells = Cells::new(&[[1.0, 2.0, 3.0]; 50], 6);
        assert_eq!(cells.of([1.0, 2.0, 3.0]), cells.of([1.0, 2.0, 3.0]));
        assert_eq!(Cells::new(&[[1.0; 3]; 9], 0).of([7.0; 3]), 0);
    }
}
