//! The trained scene: N unconnected triangles in the world.

use crate::error::{Error, Result};
use crate::kept_rows::KeptRows;
use crate::math::lists::{all_finite, all_in_unit, all_positive};
use crate::parallel::{self, GRAIN};
use glam::Vec3;

/// Coefficients of spherical harmonics up to `degree`: (degree + 1)².
pub const fn sh_count(degree: u8) -> usize {
    (degree as usize + 1).pow(2)
}

/// The SH degree 0 basis function, 1 / (2 sqrt(pi)), in eight digits: one unit in the last place
/// below the kernels' constant in f32, and part of the bits of every baked colour.
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
    /// True for triangles of the shell, which closes a trained scene where it has no points; empty
    /// without a shell. `[N]`
    pub shell: Vec<bool>,
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
        sh_count(self.sh_degree)
    }

    /// sRGB-encoded colour of SH degree 0, not clamped.
    pub fn rgb(&self, triangle: usize) -> [f32; 3] {
        self.sh[triangle * self.sh_count()].map(rgb_from_sh0)
    }

    /// True for a triangle of the shell, which belongs to the backdrop instead of the scene.
    pub fn is_shell(&self, triangle: usize) -> bool {
        self.shell.get(triangle).is_some_and(|shell| *shell)
    }

    /// Triangles of the shell.
    pub fn shell_count(&self) -> usize {
        self.shell.iter().filter(|shell| **shell).count()
    }

    /// Flags exactly these triangles as the shell.
    pub fn set_shell(&mut self, triangles: std::ops::Range<usize>) {
        let count = self.len();
        self.shell = if triangles.start < triangles.end.min(count) {
            (0..count).map(|i| triangles.contains(&i)).collect()
        } else {
            Vec::new()
        };
    }

    /// Takes the triangles of the shell out of the soup.
    pub fn take_shell(&mut self) -> Soup {
        let flags = std::mem::take(&mut self.shell);
        let of_shell: Vec<usize> = (0..flags.len()).filter(|i| flags[*i]).collect();
        let mut shell = self.subset(&of_shell);
        shell.set_shell(0..shell.len());
        if !of_shell.is_empty() {
            self.retain(|i| !flags[i]);
        }
        shell
    }

    /// Puts the triangles of the shell first, the order unchanged otherwise; returns how many they
    /// are.
    pub fn put_shell_first(&mut self) -> usize {
        let count = self.shell_count();
        if self.shell.iter().take(count).any(|shell| !shell) {
            let mut order: Vec<usize> = (0..self.len()).collect();
            order.sort_by_key(|i| !self.shell[*i]);
            *self = self.subset(&order);
        }
        count
    }

    /// Appends `other`; the lower SH degree of the two is kept.
    pub fn append(&mut self, mut other: Soup) {
        if self.is_empty() {
            *self = other;
            return;
        }
        if !self.shell.is_empty() || !other.shell.is_empty() {
            self.shell.resize(self.len(), false);
            other.shell.resize(other.len(), false);
            self.shell.append(&mut other.shell);
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
        let from = self.sh_count();
        let to = sh_count(degree);
        for i in 0..self.len() {
            self.sh.copy_within(i * from..i * from + to, i * to);
        }
        self.sh.truncate(self.len() * to);
        self.sh_degree = degree;
    }

    /// The triangles of these indices, in this order.
    pub fn subset(&self, order: &[usize]) -> Soup {
        let k = self.sh_count();
        let mut sh = vec![[0.0; 3]; k * order.len()];
        parallel::for_each(
            sh.chunks_mut(k * GRAIN).zip(order.chunks(GRAIN)),
            |_, (rows, order)| {
                for (row, &i) in rows.chunks_exact_mut(k).zip(order) {
                    row.copy_from_slice(&self.sh[k * i..k * (i + 1)]);
                }
            },
        );
        let n = order.len();
        Soup {
            vertices: parallel::collect(n, GRAIN, |at| self.vertices[order[at]]),
            opacity: parallel::collect(n, GRAIN, |at| self.opacity[order[at]]),
            sigma: parallel::collect(n, GRAIN, |at| self.sigma[order[at]]),
            sh,
            sh_degree: self.sh_degree,
            shell: if self.shell.is_empty() {
                Vec::new()
            } else {
                order.iter().map(|&i| self.shell[i]).collect()
            },
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
            shell: if self.shell.is_empty() { Vec::new() } else { self.shell.split_off(at) },
        }
    }

    /// Keeps the triangles for which `keep` returns true, in order.
    pub fn retain(&mut self, keep: impl Fn(usize) -> bool) {
        let kept = KeptRows::new(self.len(), keep);
        let k = self.sh_count();
        kept.keep_in(&mut self.vertices, 1);
        kept.keep_in(&mut self.opacity, 1);
        kept.keep_in(&mut self.sigma, 1);
        kept.keep_in(&mut self.sh, k);
        kept.keep_if_present(&mut self.shell);
    }

    /// True when every number of triangle `i` is finite.
    pub fn is_finite(&self, i: usize) -> bool {
        let k = self.sh_count();
        self.vertices[i].iter().all(|v| v.is_finite())
            && self.opacity[i].is_finite()
            && self.sigma[i].is_finite()
            && self.sh[i * k..(i + 1) * k].iter().flatten().all(|x| x.is_finite())
    }

    /// Keeps triangles with finite numbers, in order; returns how many were dropped.
    pub fn retain_finite(&mut self) -> usize {
        let keep: Vec<bool> = (0..self.len()).map(|i| self.is_finite(i)).collect();
        let gone = keep.iter().filter(|kept| !**kept).count();
        if gone > 0 {
            self.retain(|i| keep[i]);
        }
        gone
    }

    /// Checks the lengths against the numbers of triangles and coefficients.
    pub fn validate_shape(&self) -> Result<()> {
        let n = self.len();
        if self.sh_degree > 3 {
            return Err(Error::invalid("soup SH degree", self.sh_degree, "0, 1, 2 or 3"));
        }
        if self.opacity.len() != n || self.sigma.len() != n || self.sh.len() != n * self.sh_count()
        {
            return Err(Error::invalid_data(format!(
                "a soup needs equally many triangles, opacities and sigmas, and {} SH coefficients for each; \
                 this one has {n}, {}, {} and {} in all",
                self.sh_count(),
                self.opacity.len(),
                self.sigma.len(),
                self.sh.len()
            )));
        }
        if !self.shell.is_empty() && self.shell.len() != n {
            return Err(Error::invalid(
                "soup shell flags",
                self.shell.len(),
                format!("none, or {n}"),
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
            let opacity = self.opacity[i];
            let sigma = self.sigma[i];
            let sh = &self.sh[i * k..(i + 1) * k];
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
                let wants = "a finite number above 0 (if these are raw parameters, apply 0.01 + exp(raw) first)";
                return error("sigma", sigma.to_string(), wants);
            }
            if !sh.iter().flatten().all(|x| x.is_finite()) {
                return error("SH coefficients", format!("{sh:?}"), "finite numbers");
            }
        }
        Error::invalid_data("the soup has values that are not finite or out of range")
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
    use super::*;

    /// Triangles named by their opacity; some of them are the shell.
    fn soup(names: &[f32], shell: &[bool]) -> Soup {
        Soup {
            vertices: vec![[Vec3::ZERO, Vec3::X, Vec3::Y]; names.len()],
            opacity: names.to_vec(),
            sigma: vec![1.0; names.len()],
            sh: vec![[0.0; 3]; names.len()],
            sh_degree: 0,
            shell: shell.to_vec(),
        }
    }

    #[test]
    fn flags_of_the_shell_stay_with_their_triangles() {
        let all = soup(&[0.0, 0.1, 0.2, 0.3], &[false, true, false, true]);
        let shell_of = |soup: &Soup| -> Vec<f32> {
            soup.validate().unwrap();
            (0..soup.len()).filter(|i| soup.is_shell(*i)).map(|i| soup.opacity[i]).collect()
        };
        assert_eq!(shell_of(&all), [0.1, 0.3]);
        assert_eq!(shell_of(&all.subset(&[3, 2, 1])), [0.3, 0.1]);
        let mut kept = all.clone();
        kept.retain(|i| i != 1);
        assert_eq!((kept.len(), shell_of(&kept)), (3, vec![0.3]));
        let mut first = all.clone();
        let mut ordered = all.clone();
        let rest = first.split_off(2);
        assert_eq!((shell_of(&first), shell_of(&rest)), (vec![0.1], vec![0.3]));
        assert_eq!(ordered.put_shell_first(), 2);
        assert_eq!(
            (ordered.opacity.clone(), shell_of(&ordered)),
            (vec![0.1, 0.3, 0.0, 0.2], vec![0.1, 0.3])
        );
        let plain = soup(&[0.5], &[]);
        for (a, b) in [(&all, &plain), (&plain, &all)] {
            let mut both = a.clone();
            both.append(b.clone());
            assert_eq!((both.len(), shell_of(&both)), (5, vec![0.1, 0.3]));
        }
        let mut rest = all.clone();
        let taken = rest.take_shell();
        assert_eq!((taken.opacity.clone(), shell_of(&taken)), (vec![0.1, 0.3], vec![0.1, 0.3]));
        assert_eq!((rest.opacity.clone(), shell_of(&rest)), (vec![0.0, 0.2], vec![]));
        rest.set_shell(1..2);
        assert_eq!(shell_of(&rest), [0.2]);
        assert!(soup(&[0.1], &[true, false]).validate().is_err());
    }

    #[test]
    fn triangles_that_are_not_finite_are_left_out() {
        let mut soup = Soup {
            vertices: vec![[Vec3::X, Vec3::Y, Vec3::Z]; 6],
            opacity: vec![0.1, 0.2, 0.3, 0.4, 0.5, 0.6],
            sigma: vec![1.0; 6],
            sh: vec![[0.5; 3]; 6],
            sh_degree: 0,
            shell: Vec::new(),
        };
        assert_eq!(soup.clone().retain_finite(), 0);
        soup.vertices[1][2].y = f32::INFINITY;
        soup.sigma[3] = f32::NAN;
        soup.sh[4][0] = f32::NEG_INFINITY;
        assert_eq!(soup.retain_finite(), 3);
        assert_eq!(soup.opacity, [0.1, 0.3, 0.6]);
        soup.validate().unwrap();
    }
}
