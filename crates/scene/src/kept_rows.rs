//! Rows of lists that stay when others are dropped.

use std::ops::Range;

/// The rows that stay, as ascending runs.
pub(crate) struct KeptRows(Vec<Range<usize>>);

impl KeptRows {
    /// Of `count` rows those for which `keep` returns true.
    pub(crate) fn new(count: usize, keep: impl Fn(usize) -> bool) -> Self {
        let mut runs: Vec<Range<usize>> = Vec::new();
        for row in (0..count).filter(|row| keep(*row)) {
            match runs.last_mut() {
                Some(run) if run.end == row => run.end += 1,
                _ => runs.push(row..row + 1),
            }
        }
        Self(runs)
    }

    /// Drops the other rows of `list`, which has `width` values in each. A run moves at once.
    pub(crate) fn keep_in<T: Copy>(&self, list: &mut Vec<T>, width: usize) {
        let mut end = 0;
        for run in &self.0 {
            let values = run.start * width..run.end * width;
            let next_end = end + values.len();
            if values.start > end {
                list.copy_within(values, end);
            }
            end = next_end;
        }
        list.truncate(end);
        // Where most rows are dropped, their memory is given back.
        if end < list.capacity() / 2 {
            list.shrink_to_fit();
        }
    }

    /// [`KeptRows::keep_in`] for a list that may be empty instead of having a value for each row.
    pub(crate) fn keep_if_present<T: Copy>(&self, list: &mut Vec<T>) {
        if !list.is_empty() {
            self.keep_in(list, 1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_stay_in_their_order() {
        let kept_of = |kept: &[usize]| {
            let mut list: Vec<usize> = (0..12).collect();
            KeptRows::new(6, |row| kept.contains(&row)).keep_in(&mut list, 2);
            list
        };
        assert_eq!(kept_of(&[0, 2, 3, 5]), [0, 1, 4, 5, 6, 7, 10, 11]);
        assert_eq!(kept_of(&[4, 5]), [8, 9, 10, 11]);
        assert_eq!(kept_of(&[0, 1, 2, 3, 4, 5]), (0..12).collect::<Vec<_>>());
        assert!(kept_of(&[]).is_empty());
    }
}
