//! The layout of parameters on the card: number j of triangle i of N at j · N + i, so that neighbouring
//! invocations read neighbouring numbers. A large scene is in chunks, each with rows of its own.
//!
//! ```text
//! corners (9), opacity's logit, σ's logarithm, SH (3 per coefficient)
//! ```

use crate::params::Params;
use glam::Vec3;
use std::ops::Range;
use trisplat_scene::parallel::{self, GRAIN};

/// Rows before the SH.
const GEOMETRY_ROWS: usize = 11;

/// Numbers per triangle.
pub(super) fn row_count(sh_count: usize) -> usize {
    GEOMETRY_ROWS + 3 * sh_count
}

/// The rows of a chunk of `params`. `[11 + 3 K, N]`
pub(super) fn from_params(params: &Params, chunk: Range<usize>) -> Vec<f32> {
    let (n, k) = (chunk.len(), params.sh_count());
    let (vertices, sh) = (&params.vertices[chunk.clone()], &params.sh[chunk.start * k..chunk.end * k]);
    let mut rows = vec![0.0; row_count(k) * n];
    parallel::for_each(rows.chunks_mut(n.max(1)), |j, row| match j {
        0..9 => row.iter_mut().zip(vertices).for_each(|(x, v)| *x = v[j / 3][j % 3]),
        9 => row.copy_from_slice(&params.opacity[chunk.clone()]),
        10 => row.copy_from_slice(&params.sigma[chunk.clone()]),
        _ => {
            let (k_at, c) = ((j - GEOMETRY_ROWS) / 3, (j - GEOMETRY_ROWS) % 3);
            row.iter_mut().zip(sh.chunks_exact(k)).for_each(|(x, sh)| *x = sh[k_at][c]);
        }
    });
    rows
}

/// Appends a chunk of `n` to `params`.
pub(super) fn append(params: &mut Params, rows: &[f32], n: usize) {
    let k = params.sh_count();
    let at = |j: usize, i: usize| rows[j * n + i];
    let corner = |i: usize, c: usize| Vec3::new(at(3 * c, i), at(3 * c + 1, i), at(3 * c + 2, i));
    let coefficient = |m: usize| {
        let (i, first) = (m / k, GEOMETRY_ROWS + 3 * (m % k));
        [at(first, i), at(first + 1, i), at(first + 2, i)]
    };
    parallel::extend(&mut params.vertices, n, GRAIN, |i| [corner(i, 0), corner(i, 1), corner(i, 2)]);
    params.opacity.extend_from_slice(&rows[9 * n..10 * n]);
    params.sigma.extend_from_slice(&rows[10 * n..11 * n]);
    parallel::extend(&mut params.sh, n * k, GRAIN, coefficient);
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::Rng;

    #[test]
    fn rows_hold_every_number_once() {
        for degree in 0..=3u8 {
            let rng = Rng::new(5, "rows", 0);
            let (n, k) = (7, (usize::from(degree) + 1).pow(2));
            let number = |i: usize| rng.uniform(i as u64);
            let params = Params {
                vertices: (0..n).map(|i| [0, 1, 2].map(|c| Vec3::splat(number(3 * i + c)))).collect(),
                opacity: (0..n).map(|i| number(100 + i)).collect(),
                sigma: (0..n).map(|i| number(200 + i)).collect(),
                sh: (0..n * k).map(|m| [0, 1, 2].map(|c| number(300 + 3 * m + c))).collect(),
                sh_degree: degree,
            };
            let mut back = Params { sh_degree: degree, ..Params::default() };
            for chunk in [0..3, 3..5, 5..n] {
                let rows = from_params(&params, chunk.clone());
                assert_eq!(rows.len(), row_count(k) * chunk.len());
                append(&mut back, &rows, chunk.len());
            }
            assert_eq!(back, params);
        }
    }
}
