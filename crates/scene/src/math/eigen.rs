//! Eigenvectors of a symmetric 3×3 matrix.

use glam::{DMat3, DVec3};

/// Sweeps over the three off-diagonal elements; each squares the error, so five suffice for f64.
const SWEEPS: usize = 12;

/// Eigenvalues, smallest first, and their orthonormal eigenvectors, by Jacobi's rotations. The signs of the
/// vectors are arbitrary.
pub fn symmetric_eigen(matrix: DMat3) -> [(f64, DVec3); 3] {
    let mut a = matrix.to_cols_array_2d();
    let mut v = DMat3::IDENTITY.to_cols_array_2d();
    for _ in 0..SWEEPS {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] == 0.0 {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            // Square roots are rounded alike everywhere; `hypot` differs in its last bit from one C library to the next.
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            for row in &mut a {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
            for rows in [&mut a, &mut v] {
                let (x, y) = (rows[p], rows[q]);
                rows[p] = std::array::from_fn(|k| c * x[k] - s * y[k]);
                rows[q] = std::array::from_fn(|k| s * x[k] + c * y[k]);
            }
        }
    }
    let mut pairs = [0, 1, 2].map(|i| (a[i][i], DVec3::from(v[i])));
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outer(v: DVec3) -> DMat3 {
        DMat3::from_cols(v * v.x, v * v.y, v * v.z)
    }

    #[test]
    fn a_matrix_is_put_together_again_from_its_eigenvectors() {
        let axes = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(-1.9);
        for values in [[1.0, 2.0, 5.0], [0.0, 0.0, 3.0], [-2.0, 1e-9, 1e6], [4.0, 4.0, 4.0]] {
            let parts = [0, 1, 2].map(|i| outer(axes.col(i)) * values[i]);
            let matrix = parts[0] + parts[1] + parts[2];
            let found = symmetric_eigen(matrix);
            let scale = values[2].abs();
            for (found, value) in found.iter().zip(values) {
                assert!((found.0 - value).abs() < 1e-12 * scale, "{found:?} is not {value}");
                assert!((matrix * found.1 - found.1 * found.0).length() < 1e-12 * scale);
            }
            let basis = DMat3::from_cols(found[0].1, found[1].1, found[2].1);
            assert!((basis.transpose() * basis).abs_diff_eq(DMat3::IDENTITY, 1e-12));
        }
        assert_eq!(symmetric_eigen(DMat3::ZERO).map(|pair| pair.0), [0.0; 3]);
    }
}
