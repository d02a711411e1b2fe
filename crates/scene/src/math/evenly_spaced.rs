//! A selection that is spread over a list.

/// At most `count` of `len` indices, evenly spaced from 0 on.
pub fn evenly_spaced(len: usize, count: usize) -> impl Iterator<Item = usize> {
    let count = count.min(len);
    (0..count).map(move |i| i * len / count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_where_there_are_fewer_and_none_twice() {
        let chosen = |len, count| evenly_spaced(len, count).collect::<Vec<_>>();
        assert_eq!((chosen(0, 3), chosen(3, 0), chosen(3, 5)), (vec![], vec![], vec![0, 1, 2]));
        assert_eq!((chosen(7, 3), chosen(8, 4)), (vec![0, 2, 4], vec![0, 2, 4, 6]));
    }
}
