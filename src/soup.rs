//! The trained scene: N unconnected triangles in the world.

use crate::error::{Error, Result};
use crate::math::finite::{all_finite, all_in_unit, all_positive};
use glam::Vec3;
use rayon::prelude::*;

/// The SH degree 0 basis function, 1 / (2 sqrt(pi)), in eight digits: one unit in the last place below the
/// kernels' constant in f32, and part of the bits of every baked colour.
pub const SH_C0: f32 = 0.282_094_79;

/// N unconnected triangles. Values are physical, never logits.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Soup {
    /// Corners in world units. `[N, 3]`
    pub vertices: Vec<[Vec3; 3]>,
    /// Opacity o in [0, 1]. `[N]`
    pub opacity: Vec<f32>,
    /// Window exponent σ > 0; towards 0 the triangle is solid (Held et al. 2025, eq. 1). `[N]`
    pub sigma: Vec<f32>,
    /// Spherical harmonics, degree 0 first; rgb = `0.5 + C0 * sh[0]`, sRGB-encoded. `[N * K]`
    pub sh: Vec<[f32; 3]>,
    /// Degree 0..=3; K = (degree + 1)^2 coefficients per triangle.
    pub sh_degree: u8,
}

impl Soup {
    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.vertices.len()
    }

    /// True when it has no triangles.
    pub fn is_empty(&self) -> bool {
        self.vertices.is_empty()
    }

    /// Coefficients per triangle: K = (degree + 1)^2.
    pub fn sh_count(&self) -> usize {
        (self.sh_degree as usize + 1).pow(2)
    }

    /// sRGB-encoded colour of SH degree 0, not clamped.
    pub fn rgb(&self, triangle: usize) -> [f32; 3] {
        self.sh[triangle * self.sh_count()].map(rgb_from_sh0)
    }

    /// Appends `other`; the lower SH degree of the two is kept.
    pub fn append(&mut self, mut other: Soup) {
        if self.is_empty() {
            *self = other;
            return;
        }
        let degree = self.sh_degree.min(other.sh_degree);
        self.truncate_sh(degree);
        other.truncate_sh(degree);
        self.vertices.append(&mut other.vertices);
        self.opacity.append(&mut other.opacity);
        self.sigma.append(&mut other.sigma);
        self.sh.append(&mut other.sh);
    }

    /// Drops the coefficients above `degree`.
    pub fn truncate_sh(&mut self, degree: u8) {
        if degree >= self.sh_degree {
            return;
        }
        let (from, to) = (self.sh_count(), (degree as usize + 1).pow(2));
        for i in 0..self.len() {
            self.sh.copy_within(i * from..i * from + to, i * to);
        }
        self.sh.truncate(self.len() * to);
        self.sh_degree = degree;
    }

    /// The triangles of these indices, in this order.
    pub fn picked(&self, order: &[usize]) -> Soup {
        let k = self.sh_count();
        let mut sh = vec![[0.0; 3]; k * order.len()];
        let rows = sh.par_chunks_exact_mut(k).zip(order);
        rows.for_each(|(row, &i)| row.copy_from_slice(&self.sh[k * i..k * (i + 1)]));
        Soup {
            vertices: order.par_iter().map(|&i| self.vertices[i]).collect(),
            opacity: order.par_iter().map(|&i| self.opacity[i]).collect(),
            sigma: order.par_iter().map(|&i| self.sigma[i]).collect(),
            sh,
            sh_degree: self.sh_degree,
        }
    }

    /// Takes the triangles from index `at` on out of the soup.
    pub fn split_off(&mut self, at: usize) -> Soup {
        let at = at.min(self.len());
        let sh = self.sh.split_off(at * self.sh_count());
        Soup {
            vertices: self.vertices.split_off(at),
            opacity: self.opacity.split_off(at),
            sigma: self.sigma.split_off(at),
            sh,
            sh_degree: self.sh_degree,
        }
    }

    /// Keeps the triangles for which `keep` returns true, in order.
    pub fn retain(&mut self, keep: impl Fn(usize) -> bool) {
        let k = self.sh_count();
        let (mut to, mut i) = (0, 0);
        while i < self.len() {
            // Runs of triangles that stay are moved at once.
            let start = i;
            while i < self.len() && keep(i) {
                i += 1;
            }
            if start != to {
                self.vertices.copy_within(start..i, to);
                self.opacity.copy_within(start..i, to);
                self.sigma.copy_within(start..i, to);
                self.sh.copy_within(start * k..i * k, to * k);
            }
            to += i - start;
            i += 1;
        }
        self.vertices.truncate(to);
        self.opacity.truncate(to);
        self.sigma.truncate(to);
        self.sh.truncate(to * k);
    }

    /// Checks that the numbers of values agree with the numbers of triangles and coefficients.
    pub fn validate_shape(&self) -> Result<()> {
        let n = self.len();
        if self.sh_degree > 3 {
            return Err(Error::invalid("soup SH degree", self.sh_degree, "0, 1, 2 or 3"));
        }
        if self.opacity.len() != n || self.sigma.len() != n || self.sh.len() != n * self.sh_count() {
            return Err(Error::invalid(
                "soup",
                format!("{n} / {} / {} / {}", self.opacity.len(), self.sigma.len(), self.sh.len()),
                "equally many vertices, opacities, sigmas and SH rows",
            ));
        }
        Ok(())
    }

    /// Checks shapes and ranges: equal lengths, finite values, opacity in [0, 1], σ > 0.
    /// Readers call it always, stages in debug builds; a valid soup costs one parallel scan.
    pub fn validate(&self) -> Result<()> {
        self.validate_shape()?;
        let valid = all_finite(bytemuck::cast_slice(&self.vertices))
            && all_in_unit(&self.opacity)
            && all_positive(&self.sigma)
            && all_finite(bytemuck::cast_slice(&self.sh));
        if valid { Ok(()) } else { Err(self.first_error()) }
    }

    /// The error of the first triangle that is not valid.
    fn first_error(&self) -> Error {
        let k = self.sh_count();
        for (i, corners) in self.vertices.iter().enumerate() {
            let (opacity, sigma, sh) = (self.opacity[i], self.sigma[i], &self.sh[i * k..(i + 1) * k]);
            let error = |what: &str, value: String, wants: &str| {
                Error::invalid(format!("soup {what} of triangle {i}"), value, wants)
            };
            if !corners.iter().all(|v| v.is_finite()) {
                return error("vertex", format!("{corners:?}"), "finite numbers");
            }
            if !(0.0..=1.0).contains(&opacity) {
                let wants = "0 to 1 (if these are raw logits, apply the sigmoid first)";
                return error("opacity", opacity.to_string(), wants);
            }
            if !(sigma > 0.0 && sigma.is_finite()) {
                let wants =
                    "a finite number above 0 (if these are raw parameters, apply 0.01 + exp(raw) first)";
                return error("sigma", sigma.to_string(), wants);
            }
            if !sh.iter().flatten().all(|x| x.is_finite()) {
                return error("SH coefficients", format!("{sh:?}"), "finite numbers");
            }
        }
        Error::invalid("soup", "invalid values", "finite values in range")
    }
}

/// sRGB-encoded channel of an SH degree 0 coefficient.
pub fn rgb_from_sh0(coefficient: f32) -> f32 {
    0.5 + SH_C0 * coefficient
}

/// The SH degree 0 coefficient of an sRGB-encoded channel.
pub fn sh0_from_rgb(channel: f32) -> f32 {
    (channel - 0.5) / SH_C0
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_constant_is_the_kernels_to_one_unit_in_the_last_place() {
        let exact = crate::kernel::constants::SH_C0 as f32;
        assert!(super::SH_C0 == exact || super::SH_C0.next_up() == exact);
    }
}
