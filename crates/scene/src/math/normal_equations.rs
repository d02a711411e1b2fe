//! Small systems of normal equations.

/// The solution of `matrix` · x = `wanted` for a sum of squares, by elimination. Unknowns that the matrix does not
/// determine are 0.
pub fn solved<const N: usize>(mut matrix: [[f64; N]; N], mut wanted: [f64; N]) -> [f64; N] {
    let least = 1e-9 * (0..N).map(|k| matrix[k][k]).fold(0.0, f64::max);
    let mut out = [0.0; N];
    // A matrix of squares needs no exchange of rows.
    for k in 0..N {
        if matrix[k][k] <= least {
            matrix.iter_mut().for_each(|row| row[k] = 0.0);
            continue;
        }
        for row in k + 1..N {
            let share = matrix[row][k] / matrix[k][k];
            let above = matrix[k];
            matrix[row].iter_mut().zip(above).for_each(|(x, above)| *x -= share * above);
            wanted[row] -= share * wanted[k];
        }
    }
    for k in (0..N).rev().filter(|k| matrix[*k][*k] > least) {
        let known: f64 = (k + 1..N).map(|column| matrix[k][column] * out[column]).sum();
        out[k] = (wanted[k] - known) / matrix[k][k];
    }
    out
}

/// Adds `weight` · row · rowᵀ to `matrix`, and `weight` · row · `wanted` to `right`.
pub fn add<const N: usize>(
    matrix: &mut [[f64; N]; N],
    right: &mut [f64; N],
    row: &[f64; N],
    wanted: f64,
    weight: f64,
) {
    for ((line, right), a) in matrix.iter_mut().zip(right).zip(row) {
        let scaled = weight * a;
        *right += scaled * wanted;
        line.iter_mut().zip(row).for_each(|(sum, b)| *sum += scaled * b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn least_squares_are_found_and_what_nothing_determines_stays_zero() {
        let (mut matrix, mut right) = ([[0.0; 3]; 3], [0.0; 3]);
        // y = 2 a - b at three places; the third unknown is in no equation.
        for (a, b) in [(1.0, 0.0), (0.5, 2.0), (-1.0, 3.0)] {
            add(&mut matrix, &mut right, &[a, b, 0.0], 2.0 * a - b, 0.7);
        }
        let found = solved(matrix, right);
        assert!((found[0] - 2.0).abs() < 1e-12 && (found[1] + 1.0).abs() < 1e-12, "{found:?}");
        assert_eq!(found[2], 0.0);
        assert_eq!(solved([[0.0; 2]; 2], [1.0, 2.0]), [0.0; 2]);
    }
}
