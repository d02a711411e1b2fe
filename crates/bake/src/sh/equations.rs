//! Normal equations of a face's harmonics, and the coefficients that solve them.
//!
//! A photo that shows a face with the barycentric weights b of its corners has the residual
//! Σ_j c_j y_j there, with y_j = Σ_k b_k Y_j(d_k) and d_k the direction to corner k. So the sums
//! over pixels of b_k b_l and of b_k times the residual, which the fit of colours needs as well,
//! give the equations of all c_j: Σ y yᵀ and Σ y r.

use crate::refit::Equations;
use rayon::prelude::*;
use std::ops::Range;
use trisplat_raster::kernel::sh::MAX_COEFFICIENTS;
use trisplat_scene::sh_count;

/// Pull of the coefficient of degree 0 to 0, px: it only keeps the equations solvable.
const DAMPING_PX: f64 = 0.02;
/// Consecutive faces whose harmonics are pulled to common ones. Those of the 8 nearest faces gain
/// less (docs/benchmarks/bake.md).
const GROUP: usize = 32;
/// Faces per task of the thread pool.
const TASK_FACES: usize = 1 << 10;

/// Coefficients of a face; those beyond its degree are 0. `[coefficient][channel]`
type Coefficients = [[f32; 3]; MAX_COEFFICIENTS];

/// Degree and pull of a solution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Regularization {
    /// Degree of the harmonics.
    pub(super) degree: u8,
    /// λ: pull of the coefficients of degree 1 and more to those of a group of faces, and of these
    /// to 0, px.
    pub(super) ridge: f64,
}

/// The equations of all faces, of some photos.
#[derive(Debug, Clone)]
pub(super) struct ShEquations {
    /// Largest degree of the harmonics.
    degree: u8,
    /// Coefficients per face.
    width: usize,
    /// Upper triangles of Σ y yᵀ, px. `[F * width (width + 1) / 2]`
    matrices: Vec<f32>,
    /// Σ y r, px. `[F * width][channel]`
    rights: Vec<[f32; 3]>,
}

/// Numbers of the upper triangle of a symmetric matrix.
fn packed(width: usize) -> usize {
    width * (width + 1) / 2
}

/// Bytes of the equations of `faces` up to `degree`.
pub(super) fn bytes(degree: u8, faces: usize) -> u64 {
    let width = sh_count(degree);
    ((packed(width) + 3 * width) * size_of::<f32>() * faces) as u64
}

impl ShEquations {
    /// Empty sums up to `degree`.
    pub(super) fn new(degree: u8, faces: usize) -> Self {
        let width = sh_count(degree);
        Self {
            degree,
            width,
            matrices: vec![0.0; faces * packed(width)],
            rights: vec![[0.0; 3]; faces * width],
        }
    }

    /// Adds the sums of a photo that sees the corners of `face` in directions with these harmonics.
    pub(super) fn add(
        &mut self,
        face: usize,
        harmonics: &[[f32; MAX_COEFFICIENTS]; 3],
        sums: &Equations,
    ) {
        let width = self.width;
        let [m00, m01, m02, m11, m12, m22] = sums.matrix();
        let rows = [[m00, m01, m02], [m01, m11, m12], [m02, m12, m22]];
        let mut weighted = [[0.0f32; MAX_COEFFICIENTS]; 3];
        for (weighted, row) in weighted.iter_mut().zip(rows) {
            for (j, out) in weighted[..width].iter_mut().enumerate() {
                *out =
                    row[0] * harmonics[0][j] + row[1] * harmonics[1][j] + row[2] * harmonics[2][j];
            }
        }
        let mut out = self.matrices[face * packed(width)..][..packed(width)].iter_mut();
        let [a, b, c] = harmonics;
        for (i, ((a, b), c)) in a.iter().zip(b).zip(c).take(width).enumerate() {
            for (j, sum) in (i..width).zip(&mut out) {
                *sum += a * weighted[0][j] + b * weighted[1][j] + c * weighted[2][j];
            }
        }
        for (j, sums_of_j) in self.rights[face * width..][..width].iter_mut().enumerate() {
            for (corner, right) in sums.right().iter().enumerate() {
                for (sum, right) in sums_of_j.iter_mut().zip(right) {
                    *sum += harmonics[corner][j] * right;
                }
            }
        }
    }

    /// Adds the sums of other photos.
    pub(super) fn merge(&mut self, other: &Self) {
        let add = |sums: &mut [f32], others: &[f32]| {
            for (sum, other) in sums.iter_mut().zip(others) {
                *sum += other;
            }
        };
        add(&mut self.matrices, &other.matrices);
        add(self.rights.as_flattened_mut(), other.rights.as_flattened());
    }

    fn face(&self, face: usize) -> FaceEquations<'_> {
        FaceEquations {
            width: self.width,
            matrix: &self.matrices[face * packed(self.width)..][..packed(self.width)],
            right: &self.rights[face * self.width..][..self.width],
        }
    }

    pub(super) fn face_count(&self) -> usize {
        self.rights.len() / self.width
    }

    /// Largest degree of the harmonics.
    pub(super) fn degree(&self) -> u8 {
        self.degree
    }

    /// Coefficients of all faces: few photos of a face say little, so those of degree 1 and more
    /// are pulled to what fits a group of faces together. `[F * (degree + 1)²][channel]`
    pub(super) fn solve(&self, how: Regularization) -> Vec<[f32; 3]> {
        let width = sh_count(how.degree);
        let mut solved = vec![[0.0; 3]; self.face_count() * width];
        solved.par_chunks_mut(GROUP * width).enumerate().for_each(|(group, out)| {
            let first = group * GROUP;
            let common = self.solve_together(first..first + out.len() / width, how);
            for (i, out) in out.chunks_mut(width).enumerate() {
                let of_face = self.face(first + i).solve(how, &common);
                out.copy_from_slice(&of_face[..width]);
            }
        });
        solved
    }

    /// Coefficients of degree 1 and more that fit all of `faces`; each face keeps its own
    /// constant.
    fn solve_together(&self, faces: Range<usize>, how: Regularization) -> Coefficients {
        let mut matrix = vec![0.0f32; packed(self.width)];
        let mut right = vec![[0.0f32; 3]; self.width];
        // The constants are eliminated; the equation of a common one says that it is 0.
        matrix[0] = 1.0;
        for face in faces.map(|face| self.face(face)) {
            if face.matrix[0] <= 0.0 {
                continue;
            }
            let per = 1.0 / (face.matrix[0] + DAMPING_PX as f32);
            let mut place = self.width;
            for (i, sums) in right.iter_mut().enumerate().skip(1) {
                let share = face.matrix[i] * per;
                for j in i..self.width {
                    matrix[place] += face.matrix[place] - share * face.matrix[j];
                    place += 1;
                }
                let rights = face.right[i].iter().zip(face.right[0]);
                for (sum, (own, constant)) in sums.iter_mut().zip(rights) {
                    *sum += own - share * constant;
                }
            }
        }
        let all = FaceEquations { width: self.width, matrix: &matrix, right: &right };
        all.solve(how, &[[0.0; 3]; MAX_COEFFICIENTS])
    }

    /// By how much these coefficients lower the sum of squared residuals of the photos of `self`,
    /// px.
    /// `[F * (degree + 1)²][channel]`
    pub(super) fn gain(&self, degree: u8, coefficients: &[[f32; 3]]) -> f64 {
        let width = sh_count(degree);
        let of_task = |(task, faces): (usize, &[[f32; 3]])| -> f64 {
            let of_face = |(i, own)| self.face(task * TASK_FACES + i).gain(own);
            faces.chunks(width).enumerate().map(of_face).sum()
        };
        let tasks = coefficients.par_chunks(TASK_FACES * width).enumerate();
        // Summed in order, so that the result does not depend on the number of threads.
        tasks.map(of_task).collect::<Vec<f64>>().iter().sum()
    }
}

/// The equations of one face.
struct FaceEquations<'a> {
    width: usize,
    matrix: &'a [f32],
    right: &'a [[f32; 3]],
}

impl FaceEquations<'_> {
    /// Number of row `i` and column `j` ≥ `i`.
    fn at(&self, i: usize, j: usize) -> f64 {
        let before = i * self.width - i * (i + 1) / 2;
        f64::from(self.matrix[before + j])
    }

    /// Solves by Cholesky factors for the difference from `common`, whose constant is 0. Harmonics
    /// of a lower degree are the first ones, so their equations are the first rows and columns.
    fn solve(&self, how: Regularization, common: &Coefficients) -> Coefficients {
        let width = sh_count(how.degree);
        if self.matrix[0] <= 0.0 {
            return [[0.0; 3]; MAX_COEFFICIENTS];
        }
        let mut out = *common;
        let mut right = [[0.0f64; 3]; MAX_COEFFICIENTS];
        for (i, right) in right[..width].iter_mut().enumerate() {
            for (channel, right) in right.iter_mut().enumerate() {
                let of_common =
                    |j: usize| self.at(i.min(j), i.max(j)) * f64::from(common[j][channel]);
                *right = f64::from(self.right[i][channel]) - (1..width).map(of_common).sum::<f64>();
            }
        }
        let mut lower = [[0.0f64; MAX_COEFFICIENTS]; MAX_COEFFICIENTS];
        for i in 0..width {
            for j in 0..=i {
                let mut sum = self.at(j, i);
                if i == j {
                    sum += if i == 0 { DAMPING_PX } else { how.ridge };
                }
                sum -= (0..j).map(|k| lower[i][k] * lower[j][k]).sum::<f64>();
                // Rounded sums of few pixels may be slightly indefinite.
                lower[i][j] = if i == j { sum.max(1e-9).sqrt() } else { sum / lower[j][j] };
            }
        }
        for c in 0..3 {
            let mut x = [0.0f64; MAX_COEFFICIENTS];
            for i in 0..width {
                let sum: f64 = (0..i).map(|k| lower[i][k] * x[k]).sum();
                x[i] = (right[i][c] - sum) / lower[i][i];
            }
            for i in (0..width).rev() {
                let sum: f64 = (i + 1..width).map(|k| lower[k][i] * x[k]).sum();
                x[i] = (x[i] - sum) / lower[i][i];
            }
            for (out, x) in out.iter_mut().zip(x) {
                out[c] += x as f32;
            }
        }
        out
    }

    /// 2 cᵀ b - cᵀ A c, over the channels.
    fn gain(&self, coefficients: &[[f32; 3]]) -> f64 {
        let mut gain = 0.0;
        for c in 0..3 {
            for (i, own) in coefficients.iter().enumerate() {
                let own = f64::from(own[c]);
                let mut product = self.at(i, i) * own;
                for (j, other) in coefficients.iter().enumerate().skip(i + 1) {
                    product += 2.0 * self.at(i, j) * f64::from(other[c]);
                }
                gain += own * (2.0 * f64::from(self.right[i][c]) - product);
            }
        }
        gain
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use trisplat_raster::solid::direction_basis;
    use trisplat_scene::Rng;

    /// Equations of one face whose photos show harmonics `truth` of degree 2, from 60 directions.
    fn equations(truth: &[[f32; 3]; 9]) -> ShEquations {
        let rng = Rng::new(3, "sh", 0);
        let mut sums = ShEquations::new(2, 1);
        for i in 0..60 {
            let eye = Vec3::from([0, 1, 2].map(|c| rng.uniform(3 * i + c) * 8.0 - 4.0));
            let corners = [Vec3::ZERO, Vec3::X * 0.1, Vec3::Y * 0.1];
            let harmonics = corners.map(|corner| direction_basis(2, corner, eye));
            let weights = [0.2, 0.5, 0.3];
            let residual = [0, 1, 2].map(|c| {
                let of = |j: usize| -> f32 {
                    truth[j][c] * (0..3).map(|k| weights[k] * harmonics[k][j]).sum::<f32>()
                };
                (0..9).map(of).sum::<f32>()
            });
            let mut of_photo = Equations::default();
            of_photo.add(&weights, &residual, &[0.0; 3], 5.0);
            sums.add(0, &harmonics, &of_photo);
        }
        sums
    }

    #[test]
    fn solve_without_noise_finds_the_harmonics() {
        let truth = std::array::from_fn(|j| [0.3 - 0.05 * j as f32, 0.1, -0.2]);
        let solved = equations(&truth).solve(Regularization { degree: 2, ridge: 1e-6 });
        for (found, truth) in solved.iter().zip(&truth) {
            for c in 0..3 {
                assert!((found[c] - truth[c]).abs() < 2e-3, "{found:?} {truth:?}");
            }
        }
    }

    #[test]
    fn gain_of_the_truth_is_the_whole_error_and_a_strong_ridge_gains_less() {
        let truth = std::array::from_fn(|j| [0.3 - 0.05 * j as f32, 0.1, -0.2]);
        let sums = equations(&truth);
        let best = sums.gain(2, &truth);
        let of = |ridge, degree| {
            let how = Regularization { degree, ridge };
            sums.gain(degree, &sums.solve(how))
        };
        assert!(best > 0.0 && (of(1e-6, 2) - best).abs() < 1e-3 * best);
        assert!(of(50.0, 2) < of(1.0, 2) && of(1e-6, 1) < of(1e-6, 2));
        assert!(of(50.0, 2) > 0.0);
    }

    #[test]
    fn a_face_that_few_pixels_show_shines_like_its_group() {
        let truth = std::array::from_fn(|j| [0.2 - 0.03 * j as f32, 0.1, -0.1]);
        let rich = equations(&truth);
        let mut both = ShEquations::new(2, 2);
        both.matrices[..45].copy_from_slice(&rich.matrices);
        both.rights[..9].copy_from_slice(&rich.rights);
        both.matrices[45] = 1e-3;
        let solved = both.solve(Regularization { degree: 2, ridge: 1e-4 });
        for j in 1..9 {
            assert!((solved[9 + j][0] - truth[j][0]).abs() < 5e-3, "{:?}", &solved[9..]);
        }
    }

    #[test]
    fn faces_without_photos_stay_plain() {
        let solved = ShEquations::new(3, 2).solve(Regularization { degree: 3, ridge: 1.0 });
        assert_eq!(solved, vec![[0.0; 3]; 32]);
    }
}
