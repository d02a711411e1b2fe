//! The median.

use std::cmp::Ordering;

/// The median, the upper of two middle values; `None` of no values. `order` is `f32::total_cmp` or `f64::total_cmp`.
pub fn median<T: Copy>(mut values: Vec<T>, order: fn(&T, &T) -> Ordering) -> Option<T> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, order).1)
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
