//! Lists of numbers: quantiles, an even choice, disjoint sets and range checks.

use crate::parallel;
use std::cmp::Ordering;

/// The median, the upper of two middle values; `None` of no values. `order` is `f32::total_cmp` or
/// `f64::total_cmp`.
pub fn median<T: Copy>(mut values: Vec<T>, order: fn(&T, &T) -> Ordering) -> Option<T> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, order).1)
}

/// The value below which this share of `values` lies; `None` of no values.
pub fn quantile(mut values: Vec<f32>, share: f32) -> Option<f32> {
    let last = values.len().checked_sub(1)?;
    Some(*values.select_nth_unstable_by((last as f32 * share) as usize, f32::total_cmp).1)
}

// ---- A selection that is spread over a list -----------------------------------------------------

/// At most `count` of `len` indices, evenly spaced from 0 on.
pub fn evenly_spaced(len: usize, count: usize) -> impl Iterator<Item = usize> {
    let count = count.min(len);
    (0..count).map(move |i| i * len / count)
}

// ---- Disjoint sets of numbers, which are joined one by one --------------------------------------

/// Disjoint sets of the numbers below a count; each number begins in a set of its own.
#[derive(Debug)]
pub struct Sets(Vec<u32>);

impl Sets {
    /// `count` sets of one number each.
    pub fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    /// The smallest number of the set of `number`. Paths to it are halved on the way.
    pub fn first(&mut self, mut number: u32) -> u32 {
        let Self(parents) = self;
        while parents[number as usize] != number {
            let above = parents[parents[number as usize] as usize];
            parents[number as usize] = above;
            number = above;
        }
        number
    }

    /// Joins the sets of `a` and `b`.
    pub fn join(&mut self, a: u32, b: u32) {
        let a = self.first(a);
        let b = self.first(b);
        self.0[a.max(b) as usize] = a.min(b);
    }
}

// ---- Range checks of long lists of numbers, in parallel -----------------------------------------

const CHUNK: usize = 1 << 16;
const EXPONENT: u32 = 0x7f80_0000;

/// True when no value is NaN or infinite.
pub fn all_finite(values: &[f32]) -> bool {
    // No early exit inside a chunk, so that the loop is vectorised.
    all_chunks(values, |chunk| {
        chunk.iter().fold(true, |all, x| all & (x.to_bits() & EXPONENT != EXPONENT))
    })
}

/// True when every value lies in [0, 1].
pub(crate) fn all_in_unit(values: &[f32]) -> bool {
    all_chunks(values, |chunk| chunk.iter().fold(true, |all, x| all & (*x >= 0.0) & (*x <= 1.0)))
}

/// True when every value is above 0 and finite.
pub(crate) fn all_positive(values: &[f32]) -> bool {
    all_chunks(values, |chunk| {
        chunk.iter().fold(true, |all, x| all & (*x > 0.0) & (*x <= f32::MAX))
    })
}

fn all_chunks(values: &[f32], valid: impl Fn(&[f32]) -> bool + Sync) -> bool {
    parallel::map(values.chunks(CHUNK), |_, chunk| valid(chunk)).into_iter().all(|valid| valid)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_of_the_values_lie_on_each_side() {
        assert_eq!(median(vec![3.0, -1.0, 2.0], f32::total_cmp), Some(2.0));
        assert_eq!(median(vec![3.0, -1.0, 2.0, 2.5], f64::total_cmp), Some(2.5));
        assert_eq!(median(Vec::new(), f32::total_cmp), None);
    }
}

#[cfg(test)]
mod evenly_spaced_tests {
    use super::*;

    #[test]
    fn all_where_there_are_fewer_and_none_twice() {
        let chosen = |len, count| evenly_spaced(len, count).collect::<Vec<_>>();
        assert_eq!((chosen(0, 3), chosen(3, 0), chosen(3, 5)), (vec![], vec![], vec![0, 1, 2]));
        assert_eq!((chosen(7, 3), chosen(8, 4)), (vec![0, 2, 4], vec![0, 2, 4, 6]));
    }
}

#[cfg(test)]
mod sets_tests {
    use super::*;

    #[test]
    fn joined_sets_have_their_least_number() {
        let mut sets = Sets::new(8);
        for (a, b) in [(7, 3), (6, 5), (3, 6), (2, 1), (1, 2)] {
            sets.join(a, b);
        }
        let firsts: Vec<u32> = (0..8).map(|number| sets.first(number)).collect();
        assert_eq!(firsts, [0, 1, 1, 3, 4, 3, 3, 3]);
    }
}

#[cfg(test)]
mod finite_tests {
    use super::*;

    #[test]
    fn one_bad_value_is_found_at_any_index() {
        let good = vec![0.5f32; 3 * CHUNK + 7];
        for at in [0, 1, CHUNK - 1, CHUNK, 3 * CHUNK + 6] {
            for bad in [
                f32::NAN,
                f32::INFINITY,
                f32::NEG_INFINITY,
                -1.0,
                -f32::MIN_POSITIVE,
                2.0,
                -0.0,
                1e-45,
            ] {
                let mut values = good.clone();
                values[at] = bad;
                assert_eq!(all_finite(&values), bad.is_finite(), "{bad}");
                assert_eq!(all_in_unit(&values), (0.0..=1.0).contains(&bad), "{bad}");
                assert_eq!(all_positive(&values), bad > 0.0 && bad.is_finite(), "{bad}");
            }
        }
        assert!(all_finite(&[]) && all_in_unit(&[]) && all_positive(&[]));
    }
}
