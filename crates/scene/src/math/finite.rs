//! Range checks of long lists of numbers, in parallel.

const CHUNK: usize = 1 << 16;
use crate::parallel;
const EXPONENT: u32 = 0x7f80_0000;

/// True when no value is NaN or infinite.
pub fn all_finite(values: &[f32]) -> bool {
    // No early exit inside a chunk, so that the loop is vectorised.
    all_chunks(values, |chunk| chunk.iter().fold(true, |all, x| all & (x.to_bits() & EXPONENT != EXPONENT)))
}

/// True when every value lies in [0, 1].
pub fn all_in_unit(values: &[f32]) -> bool {
    all_chunks(values, |chunk| chunk.iter().fold(true, |all, x| all & (*x >= 0.0) & (*x <= 1.0)))
}

/// True when every value is above 0 and finite.
pub fn all_positive(values: &[f32]) -> bool {
    all_chunks(values, |chunk| chunk.iter().fold(true, |all, x| all & (*x > 0.0) & (*x <= f32::MAX)))
}

fn all_chunks(values: &[f32], valid: impl Fn(&[f32]) -> bool + Sync) -> bool {
    parallel::map(values.chunks(CHUNK), |_, chunk| valid(chunk)).into_iter().all(|valid| valid)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_bad_value_is_found_at_any_index() {
        let good = vec![0.5f32; 3 * CHUNK + 7];
        for at in [0, 1, CHUNK - 1, CHUNK, 3 * CHUNK + 6] {
            for bad in
                [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, -f32::MIN_POSITIVE, 2.0, -0.0, 1e-45]
            {
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
