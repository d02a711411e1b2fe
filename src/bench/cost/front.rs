//! The Pareto front: what no other beats.

/// One quantity of a setting; less is better.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Quantity {
    /// Seconds, bytes, or an error.
    pub(super) value: f64,
    /// How far apart runs of one setting lie; 0 when every run gives the same, or there was one.
    pub(super) spread: f64,
}

/// Whether `a` beats `b`: it is worse in no quantity, and better in one by more than the spread of both.
pub(super) fn beats(a: &[Quantity], b: &[Quantity]) -> bool {
    let worse = a.iter().zip(b).any(|(a, b)| !(a.value <= b.value));
    let better = |a: &Quantity, b: &Quantity| b.value - a.value > a.spread.max(b.spread);
    !worse && a.iter().zip(b).any(|(a, b)| better(a, b))
}

/// For every point the one that beats it with the least of the first quantity; `None` on the front. Points have equally
/// many quantities.
pub(super) fn front(points: &[Vec<Quantity>]) -> Vec<Option<usize>> {
    let least = |point: &usize| points[*point].first().map_or(0.0, |q| q.value);
    let beaten_by = |point: &Vec<Quantity>| {
        let better = (0..points.len()).filter(|other| beats(&points[*other], point));
        better.min_by(|a, b| least(a).total_cmp(&least(b)))
    };
    points.iter().map(beaten_by).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(values: &[(f64, f64)], spread: f64) -> Vec<Vec<Quantity>> {
        values.iter().map(|&(a, b)| [a, b].map(|value| Quantity { value, spread }).to_vec()).collect()
    }

    #[test]
    fn what_nothing_beats_is_on_the_front() {
        // Seconds and error: (3, 3) costs more than (2, 2) and errs more.
        let found = front(&points(&[(1.0, 4.0), (2.0, 2.0), (3.0, 3.0), (4.0, 1.0), (5.0, 1.0)], 0.0));
        assert_eq!(found, [None, None, Some(1), None, Some(3)]);
        assert_eq!(front(&[]), []);
    }

    #[test]
    fn the_cheapest_of_those_that_beat_a_point_is_named() {
        assert_eq!(front(&points(&[(9.0, 9.0), (2.0, 8.0), (1.0, 8.5)], 0.0))[0], Some(2));
    }

    #[test]
    fn equal_points_do_not_beat_each_other() {
        assert_eq!(front(&points(&[(1.0, 1.0), (1.0, 1.0)], 0.0)), [None, None]);
    }

    #[test]
    fn differences_within_the_spread_beat_nothing() {
        let close = [(1.0, 1.0), (1.05, 1.05)];
        assert_eq!(front(&points(&close, 0.1)), [None, None]);
        assert_eq!(front(&points(&close, 0.01)), [None, Some(0)]);
    }

    #[test]
    fn what_was_not_measured_beats_nothing() {
        let nan = points(&[(1.0, f64::NAN), (2.0, 2.0)], 0.0);
        assert_eq!(front(&nan), [None, None]);
    }
}
