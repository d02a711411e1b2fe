//! Gaussian splats (Kerbl et al. 2023): N ellipsoids that fade outwards.

use crate::error::{Error, Result};
use crate::kept_rows::KeptRows;
use crate::math::lists::{all_finite, all_in_unit};
use crate::soup::{Soup, rgb_from_sh0, sh_count};
use glam::{Quat, Vec3};

/// Standard deviations from a Gaussian's middle to the corners of its triangle: the triangle then
/// covers about the visible part of the Gaussian.
const CORNER_SIGMAS: f32 = 2.2;

/// N Gaussians. Values are physical, never logits or logarithms.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Splats {
    /// Their middles, world units. `[N]`
    pub positions: Vec<Vec3>,
    /// Standard deviations along their own axes, world units, 0 or more; a disc has a third one of
    /// 0. `[N]`
    pub scales: Vec<Vec3>,
    /// From their own axes to the world; of length one. `[N]`
    pub rotations: Vec<Quat>,
    /// Opacity in the middle, in [0, 1]. `[N]`
    pub opacity: Vec<f32>,
    /// Spherical harmonics, degree 0 first; rgb = `0.5 + C0 * sh[0]`, sRGB-encoded. `[N * K]`
    pub sh: Vec<[f32; 3]>,
    /// Degree 0..=3; K = (degree + 1)^2 coefficients per Gaussian.
    pub sh_degree: u8,
    /// Blur on the screen.
    pub filter: ScreenFilter,
}

/// The blur of projected Gaussians, which keeps thin ones from falling between pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScreenFilter {
    /// Added to the variances on the screen, px².
    pub variance: f32,
    /// True when a Gaussian that the blur widens becomes fainter, so that its light stays the same.
    pub keeps_light: bool,
}

impl ScreenFilter {
    /// 3D Gaussian Splatting: blurred ones keep their opacity.
    pub const DILATED: Self = Self { variance: 0.3, keeps_light: false };
    /// gsplat and SPZ call it antialiased.
    pub const ANTIALIASED: Self = Self { variance: 0.3, keeps_light: true };
    /// Mip-Splatting (Yu et al. 2024).
    pub const MIP: Self = Self { variance: 0.1, keeps_light: true };
}

impl Default for ScreenFilter {
    fn default() -> Self {
        Self::DILATED
    }
}

impl Splats {
    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// True when there are none.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Coefficients per Gaussian: K = (degree + 1)^2.
    pub fn sh_count(&self) -> usize {
        sh_count(self.sh_degree)
    }

    /// sRGB-encoded colour of SH degree 0, not clamped.
    pub fn rgb(&self, splat: usize) -> [f32; 3] {
        self.sh[splat * self.sh_count()].map(rgb_from_sh0)
    }

    /// True when every number of Gaussian `i` is finite.
    pub fn is_finite(&self, i: usize) -> bool {
        let k = self.sh_count();
        self.positions[i].is_finite()
            && self.scales[i].is_finite()
            && self.rotations[i].is_finite()
            && self.opacity[i].is_finite()
            && self.sh[i * k..(i + 1) * k].iter().flatten().all(|x| x.is_finite())
    }

    /// Keeps the Gaussians for which `keep` returns true, in order.
    pub fn retain(&mut self, keep: impl Fn(usize) -> bool) {
        let kept = KeptRows::new(self.len(), keep);
        let k = self.sh_count();
        kept.keep_in(&mut self.positions, 1);
        kept.keep_in(&mut self.scales, 1);
        kept.keep_in(&mut self.rotations, 1);
        kept.keep_in(&mut self.opacity, 1);
        kept.keep_in(&mut self.sh, k);
    }

    /// Checks the lengths of the lists, and the SH degree.
    pub fn validate_shape(&self) -> Result<()> {
        let n = self.len();
        let lengths = [self.scales.len(), self.rotations.len(), self.opacity.len()];
        if self.sh_degree > 3 || lengths != [n; 3] || self.sh.len() != n * self.sh_count() {
            return Err(Error::invalid_data(format!(
                "{n} positions of Gaussians come with {} scales, {} rotations, {} opacities and {} coefficients of degree {}; \
                 give one of each per Gaussian, SH degree 0 to 3",
                lengths[0],
                lengths[1],
                lengths[2],
                self.sh.len(),
                self.sh_degree
            )));
        }
        Ok(())
    }

    /// Checks that all numbers are finite and in range; the error names the first Gaussian that is
    /// not.
    pub fn validate(&self) -> Result<()> {
        self.validate_shape()?;
        let numbers: [&[f32]; 3] = [
            bytemuck::cast_slice(&self.positions),
            bytemuck::cast_slice(&self.scales),
            bytemuck::cast_slice(&self.sh),
        ];
        let in_range = |i: usize| {
            self.scales[i].min_element() >= 0.0
                && (self.rotations[i].length_squared() - 1.0).abs() < 1e-3
        };
        let fine = numbers.into_iter().all(all_finite)
            && all_in_unit(&self.opacity)
            && (0..self.len()).all(in_range);
        if fine {
            return Ok(());
        }
        let bad = |i: &usize| {
            !self.is_finite(*i) || !in_range(*i) || !(0.0..=1.0).contains(&self.opacity[*i])
        };
        let first = (0..self.len()).find(bad).unwrap_or(0);
        Err(Error::invalid_data(format!(
            "Gaussian {first} is out of range; \
             give finite numbers, opacity in [0, 1], scales of 0 or more, rotations of length one"
        )))
    }

    /// Triangles in place of the `chosen` Gaussians, each in the plane of the two longer axes:
    /// where the scene is and how large its parts are, but not how it looks.
    pub fn to_soup(&self, chosen: impl IntoIterator<Item = usize>) -> Soup {
        let mut soup = Soup::default();
        for i in chosen {
            soup.vertices.push(self.triangle(i));
            soup.opacity.push(self.opacity[i]);
            soup.sigma.push(1.0);
            soup.sh.push(self.sh[i * self.sh_count()]);
        }
        soup
    }

    fn triangle(&self, i: usize) -> [Vec3; 3] {
        let scales = self.scales[i].to_array();
        let mut axes = [0, 1, 2];
        axes.sort_by(|a, b| scales[*b].total_cmp(&scales[*a]));
        let axis = |a: usize| self.rotations[i] * Vec3::AXES[a] * (scales[a] * CORNER_SIGMAS);
        let long = axis(axes[0]);
        let short = axis(axes[1]);
        let down = 3f32.sqrt() / 2.0;
        let half = 0.5;
        [long, short * down - long * half, -short * down - long * half]
            .map(|corner| self.positions[i] + corner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn splats(count: usize) -> Splats {
        Splats {
            positions: (0..count).map(|i| Vec3::X * i as f32).collect(),
            scales: vec![Vec3::new(0.1, 0.3, 0.2); count],
            rotations: vec![Quat::IDENTITY; count],
            opacity: vec![0.5; count],
            sh: (0..4 * count).map(|i| [i as f32 * 0.01; 3]).collect(),
            sh_degree: 1,
            ..Splats::default()
        }
    }

    #[test]
    fn numbers_out_of_range_are_refused_by_the_first_gaussian() {
        assert!(splats(3).validate().is_ok());
        let damages: [fn(&mut Splats); 6] = [
            |s| s.positions[1].x = f32::NAN,
            |s| s.scales[1].y = -1.0,
            |s| s.rotations[1] = Quat::from_xyzw(0.0, 0.0, 0.0, 2.0),
            |s| s.rotations[1] = Quat::from_xyzw(0.0, f32::NAN, 0.0, 1.0),
            |s| s.opacity[1] = 1.5,
            |s| s.sh[7][2] = f32::INFINITY,
        ];
        for damage in damages {
            let mut broken = splats(3);
            damage(&mut broken);
            let message = broken.validate().expect_err("out of range").to_string();
            assert!(message.contains("Gaussian 1 "), "{message}");
        }
        let short = Splats { opacity: vec![0.5], ..splats(3) };
        assert!(short.validate().is_err());
    }

    #[test]
    fn what_is_kept_keeps_its_coefficients() {
        let mut kept = splats(3);
        kept.retain(|i| i != 1);
        assert_eq!((kept.len(), kept.sh[4]), (2, splats(3).sh[8]));
        assert!(kept.validate().is_ok());
    }

    #[test]
    fn a_triangle_lies_in_the_plane_of_the_two_longer_axes() {
        let soup = splats(1).to_soup([0]);
        let [a, b, c] = soup.vertices[0];
        assert!((a.y - 0.3 * CORNER_SIGMAS).abs() < 1e-6, "{a}");
        assert!([a, b, c].iter().all(|corner| corner.x.abs() < 1e-6));
        assert!(((a + b + c) / 3.0).length() < 1e-6 && (b.z - c.z).abs() > 0.7);
    }
}
