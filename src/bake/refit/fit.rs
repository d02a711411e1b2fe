//! The 3 x 3 systems, one a triangle, and the colours that solve them.

use super::RefitColors;
use crate::math::color::{linear_from_srgb, srgb_from_linear};
use crate::mesh::{Colors, Mesh};
use rayon::prelude::*;

/// The colours a scene came with count as if they had been seen on this many pixels.
const PRIOR_PX: f32 = 0.25;
/// Faces a task of the thread pool.
const AT_ONCE: usize = 1 << 12;

/// What photos say about one triangle.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Sums {
    /// Σ b_i b_j over samples, px: 00 01 02 11 12 22.
    mass: [f32; 6],
    /// Σ b_k times what the sample is pulled to. `[corner][channel]`
    pull: [[f32; 3]; 3],
}

impl Sums {
    /// Adds a sample that counts as `share` of a pixel.
    #[inline(always)]
    pub(super) fn add(&mut self, weights: &[f32; 3], pull: &[f32; 3], share: f32) {
        let [a, b, c] = *weights;
        let products = [a * a, a * b, a * c, b * b, b * c, c * c];
        for i in 0..6 {
            self.mass[i] += share * products[i];
        }
        for k in 0..3 {
            for c in 0..3 {
                self.pull[k][c] += share * weights[k] * pull[c];
            }
        }
    }

    fn plus(&mut self, other: &Self) {
        for i in 0..6 {
            self.mass[i] += other.mass[i];
        }
        for k in 0..3 {
            for c in 0..3 {
                self.pull[k][c] += other.pull[k][c];
            }
        }
    }

    /// Pixels on which the triangle is seen: the corners' weights sum to 1.
    fn area(&self) -> f32 {
        let [a, b, c, d, e, f] = self.mass;
        a + d + f + 2.0 * (b + c + e)
    }

    /// Σ of what the samples are pulled to.
    fn total(&self, channel: usize) -> f32 {
        self.pull[0][channel] + self.pull[1][channel] + self.pull[2][channel]
    }

    /// Solves (mass + λ) x = right for the three corners; mass is positive semi-definite and λ > 0.
    fn solve(&self, lambda: f32, right: [f32; 3]) -> [f32; 3] {
        let [a, b, c, d, e, f] = self.mass.map(f64::from);
        let lambda = f64::from(lambda);
        let (a, d, f) = (a + lambda, d + lambda, f + lambda);
        let (m00, m01, m02) = (d * f - e * e, c * e - b * f, b * e - c * d);
        let (m11, m12, m22) = (a * f - c * c, b * c - a * e, a * d - b * b);
        let per = 1.0 / (a * m00 + b * m01 + c * m02);
        let r = right.map(f64::from);
        [
            ((m00 * r[0] + m01 * r[1] + m02 * r[2]) * per) as f32,
            ((m01 * r[0] + m11 * r[1] + m12 * r[2]) * per) as f32,
            ((m02 * r[0] + m12 * r[1] + m22 * r[2]) * per) as f32,
        ]
    }
}

/// All systems and their present solution.
#[derive(Debug, Clone)]
pub(super) struct Fit {
    sums: Vec<Sums>,
    /// Pixels a face was seen on when its mass was taken. `[F]`
    flatness: f32,
    /// Colours the scene came with, sRGB-encoded. `[F]`
    prior: Vec<[f32; 3]>,
    /// Mean colour of each triangle, sRGB-encoded. `[F]`
    mean: Vec<[f32; 3]>,
    /// Colours of the corners, sRGB-encoded. `[F][corner][channel]`
    encoded: Vec<[[f32; 3]; 3]>,
    /// The same in linear light.
    linear: Vec<[[f32; 3]; 3]>,
}

impl Fit {
    /// Nothing seen yet. `flatness` is λ, px.
    pub(super) fn new(mesh: &Mesh, flatness: f32) -> Self {
        let prior: Vec<[f32; 3]> = (0..mesh.face_count())
            .into_par_iter()
            .map(|f| {
                let corners = mesh.corner_colors(f);
                std::array::from_fn(|c| srgb_from_linear((0..3).map(|k| corners[k][c]).sum::<f32>() / 3.0))
            })
            .collect();
        let encoded: Vec<[[f32; 3]; 3]> = prior.iter().map(|c| [*c; 3]).collect();
        let linear = (0..mesh.face_count()).map(|f| mesh.corner_colors(f)).collect();
        Self {
            sums: vec![Sums::default(); prior.len()],
            // A triangle seen edge-on has a mass of rank one.
            flatness: flatness.max(1e-3),
            mean: prior.clone(),
            prior,
            encoded,
            linear,
        }
    }

    /// Linear colour of a face where its corners have these weights.
    #[inline(always)]
    pub(super) fn linear(&self, face: u32, weights: &[f32; 3]) -> [f32; 3] {
        let [a, b, c] = &self.linear[face as usize];
        let mut mixed = [0.0; 3];
        for i in 0..3 {
            mixed[i] = weights[0] * a[i] + weights[1] * b[i] + weights[2] * c[i];
        }
        mixed
    }

    /// Adds sums of some faces, each named once.
    pub(super) fn add(&mut self, sums: &[(u32, Sums)]) {
        for (face, sums) in sums {
            self.sums[*face as usize].plus(sums);
        }
    }

    /// Forgets what samples were pulled to and on how many; keeps the solution.
    pub(super) fn clear(&mut self) {
        self.sums.fill(Sums::default());
    }

    /// Number of triangles that photos saw.
    pub(super) fn fitted(&self) -> usize {
        self.sums.iter().filter(|s| s.area() > 0.0).count()
    }

    /// The colours that meet the photos best, each sample on its own.
    pub(super) fn solve(&mut self, which: RefitColors) {
        let flatness = self.flatness;
        self.each(|sums, prior, mean, encoded| {
            let area = sums.area();
            if !(area > 0.0) {
                return;
            }
            for c in 0..3 {
                mean[c] = ((sums.total(c) + PRIOR_PX * prior[c]) / (area + PRIOR_PX)).clamp(0.0, 1.0);
                let corners = match which {
                    RefitColors::Corner => {
                        let right = std::array::from_fn(|k| sums.pull[k][c] + flatness * mean[c]);
                        sums.solve(flatness, right)
                    }
                    _ => [mean[c]; 3],
                };
                (0..3).for_each(|k| encoded[k][c] = corners[k].clamp(0.0, 1.0));
            }
        });
    }

    /// Moves the colours by what the photos still lack.
    pub(super) fn improve(&mut self, which: RefitColors) {
        let flatness = self.flatness;
        self.each(|sums, _, mean, encoded| {
            let area = sums.area();
            if !(area > 0.0) {
                return;
            }
            for c in 0..3 {
                let step = match which {
                    RefitColors::Corner => {
                        let right =
                            std::array::from_fn(|k| sums.pull[k][c] + flatness * (mean[c] - encoded[k][c]));
                        sums.solve(flatness, right)
                    }
                    _ => [sums.total(c) / (area + PRIOR_PX); 3],
                };
                (0..3).for_each(|k| encoded[k][c] = (encoded[k][c] + step[k]).clamp(0.0, 1.0));
                mean[c] = (encoded[0][c] + encoded[1][c] + encoded[2][c]) / 3.0;
            }
        });
    }

    fn each(&mut self, change: impl Fn(&Sums, &[f32; 3], &mut [f32; 3], &mut [[f32; 3]; 3]) + Sync + Send) {
        let known = self.sums.par_iter().zip(&self.prior);
        let sought = self.mean.par_iter_mut().zip(&mut self.encoded).zip(&mut self.linear);
        known.zip(sought).with_min_len(AT_ONCE).for_each(|((sums, prior), ((mean, encoded), linear))| {
            change(sums, prior, mean, encoded);
            *linear = encoded.map(|corner| corner.map(linear_from_srgb));
        });
    }

    /// The solution as colours of the mesh it was made for.
    pub(super) fn colors(&self, which: RefitColors) -> Colors {
        match which {
            RefitColors::Corner => Colors::Vertex(self.linear.as_flattened().to_vec()),
            _ => Colors::Face(self.linear.iter().map(|corners| corners[0]).collect()),
        }
    }
}
