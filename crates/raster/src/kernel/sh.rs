//! View-dependent colour: real spherical harmonics of degree 0 to 3 (as in Kerbl et al. 2023).
#![allow(clippy::excessive_precision, reason = "as published")]

use glam::{DMat3, DVec3};
use trisplat_scene::math::real::{Real, V3};
use trisplat_scene::math::wgsl::{constant, constants};
use trisplat_scene::mesh::Mesh;
use trisplat_scene::{FaceSh, Soup};

/// Largest number of coefficients, (3 + 1)².
pub const MAX_COEFFICIENTS: usize = 16;

/// Factor of degree 0: 1 / (2 sqrt(pi)).
pub const SH_C0: f64 = 0.282_094_791_773_878_14;
/// Degree 1: sqrt(3 / (4 pi)).
const SH_C1: f64 = 0.488_602_511_902_919_9;
/// Degree 2: xy, yz, 3z²-1, xz, x²-y².
const SH_C2: [f64; 5] = [
    1.092_548_430_592_079_2,
    -1.092_548_430_592_079_2,
    0.315_391_565_252_520_05,
    -1.092_548_430_592_079_2,
    0.546_274_215_296_039_6,
];
/// Degree 3: y(3x²-y²), xyz, y(5z²-1), z(5z²-3), x(5z²-1), z(x²-y²), x(x²-3y²).
const SH_C3: [f64; 7] = [
    -0.590_043_589_926_643_5,
    2.890_611_442_640_554,
    -0.457_045_799_464_465_74,
    0.373_176_332_590_115_4,
    -0.457_045_799_464_465_74,
    1.445_305_721_320_277,
    -0.590_043_589_926_643_5,
];

/// The functions of this file in WGSL, and their constants.
pub fn wgsl() -> String {
    let mut out = String::new();
    constant(&mut out, "SH_C0", SH_C0);
    constant(&mut out, "SH_C1", SH_C1);
    constants(&mut out, "SH_C2", &SH_C2);
    constants(&mut out, "SH_C3", &SH_C3);
    out + include_str!("sh.wgsl")
}

/// The basis functions up to `degree` in unit direction `v`; the rest is 0.
#[inline(always)]
pub fn basis<R: Real>(degree: u8, v: V3<R>) -> [R; MAX_COEFFICIENTS] {
    let of = R::of;
    let mut out = [of(0.0); MAX_COEFFICIENTS];
    out[0] = of(SH_C0);
    if degree < 1 {
        return out;
    }
    let V3 { x, y, z } = v;
    out[1] = of(-SH_C1) * y;
    out[2] = of(SH_C1) * z;
    out[3] = of(-SH_C1) * x;
    if degree < 2 {
        return out;
    }
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    out[4] = of(SH_C2[0]) * x * y;
    out[5] = of(SH_C2[1]) * y * z;
    out[6] = of(SH_C2[2]) * (zz + zz - xx - yy);
    out[7] = of(SH_C2[3]) * x * z;
    out[8] = of(SH_C2[4]) * (xx - yy);
    if degree < 3 {
        return out;
    }
    let four = of(4.0) * zz - xx - yy;
    out[9] = of(SH_C3[0]) * y * (of(3.0) * xx - yy);
    out[10] = of(SH_C3[1]) * x * y * z;
    out[11] = of(SH_C3[2]) * y * four;
    out[12] = of(SH_C3[3]) * z * (zz + zz - of(3.0) * (xx + yy));
    out[13] = of(SH_C3[4]) * x * four;
    out[14] = of(SH_C3[5]) * z * (xx - yy);
    out[15] = of(SH_C3[6]) * x * (xx - of(3.0) * yy);
    out
}

/// The coefficients of turned harmonics, up to degree 3: `turned` of them in a direction is `own`
/// of them in the direction before `rotation`. Coefficients of a degree mix only with each other,
/// so each degree is solved for as many directions as it has coefficients.
pub struct ShRotation {
    /// Of degree 1, 2 and 3. `[2l + 1][2l + 1]`
    degrees: [Vec<Vec<f64>>; 3],
}

impl ShRotation {
    /// From the directions before a rotation to those after it.
    pub fn new(rotation: DMat3) -> Self {
        Self { degrees: [1, 2, 3].map(|l| Self::of_degree(l, rotation)) }
    }

    /// Solves Y(rotation d_i) x = Y(d_i) for directions d_i that are spread over the sphere.
    fn of_degree(l: usize, rotation: DMat3) -> Vec<Vec<f64>> {
        let count = 2 * l + 1;
        let own = |direction: DVec3| {
            let DVec3 { x, y, z } = direction;
            basis::<f64>(3, V3 { x, y, z })[l * l..][..count].to_vec()
        };
        // A spiral from pole to pole, of twice as many directions: least squares.
        let directions = (0..4 * count).map(|i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / (4 * count) as f64;
            let (sin, cos) = libm::sincos(GOLDEN_ANGLE * i as f64);
            DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
        });
        let mut system = vec![vec![0.0; 2 * count]; count];
        for direction in directions {
            let after = own(rotation * direction);
            let before = own(direction);
            for (row, value) in system.iter_mut().zip(&after) {
                for k in 0..count {
                    row[k] += value * after[k];
                    row[count + k] += value * before[k];
                }
            }
        }
        solve(&mut system);
        system.into_iter().map(|row| row[count..].to_vec()).collect()
    }

    /// Turns the harmonics of a mesh whose positions were turned by `rotation`.
    pub fn turn(mesh: &mut Mesh, rotation: DMat3) {
        if let Some(sh) = &mut mesh.sh {
            Self::turn_harmonics(sh, rotation);
        }
    }

    /// Turns the harmonics of faces.
    pub fn turn_harmonics(sh: &mut FaceSh, rotation: DMat3) {
        if rotation != DMat3::IDENTITY {
            let turn = Self::new(rotation);
            sh.map_faces(|coefficients| turn.apply(coefficients));
        }
    }

    /// The same of a soup whose corners were turned.
    pub fn turn_soup(soup: &mut Soup, rotation: DMat3) {
        if soup.sh_degree > 0 {
            let turn = Self::new(rotation);
            let width = soup.sh_count();
            soup.sh.chunks_mut(width).for_each(|coefficients| turn.apply(coefficients));
        }
    }

    /// Turns the coefficients of a face, by degree and channel; the first, of degree 0, stays.
    pub fn apply(&self, coefficients: &mut [[f32; 3]]) {
        for (l, matrix) in (1..).zip(&self.degrees) {
            let Some(band) = coefficients.get_mut(l * l..(l + 1) * (l + 1)) else { return };
            let own = band.to_vec();
            for (out, row) in band.iter_mut().zip(matrix) {
                for c in 0..3 {
                    let sum: f64 = row.iter().zip(&own).map(|(m, own)| m * f64::from(own[c])).sum();
                    out[c] = sum as f32;
                }
            }
        }
    }
}

/// Turn from one direction of a spiral to the next, radians.
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// Solves a symmetric positive definite system with several right sides, in place (Gauss-Jordan).
fn solve(system: &mut [Vec<f64>]) {
    for pivot in 0..system.len() {
        let per = 1.0 / system[pivot][pivot];
        for value in &mut system[pivot] {
            *value *= per;
        }
        let own = system[pivot].clone();
        for (i, row) in system.iter_mut().enumerate() {
            if i != pivot {
                let factor = row[pivot];
                for (value, own) in row.iter_mut().zip(&own) {
                    *value -= factor * own;
                }
            }
        }
    }
}

/// Σ d_k ∂basis_k/∂v: the gradient of the direction for gradients `d` of the basis.
#[inline(always)]
pub fn basis_grad<R: Real>(degree: u8, v: V3<R>, d: &[R; MAX_COEFFICIENTS]) -> V3<R> {
    let of = R::of;
    let mut out = V3::zero();
    if degree < 1 {
        return out;
    }
    let V3 { x, y, z } = v;
    out = V3::new(of(-SH_C1) * d[3], of(-SH_C1) * d[1], of(SH_C1) * d[2]);
    if degree < 2 {
        return out;
    }
    let [c0, c1, c2, c3, c4] = SH_C2.map(of);
    let two = of(2.0);
    out.x = out.x + c0 * y * d[4] - two * c2 * x * d[6] + c3 * z * d[7] + two * c4 * x * d[8];
    out.y = out.y + c0 * x * d[4] + c1 * z * d[5] - two * c2 * y * d[6] - two * c4 * y * d[8];
    out.z = out.z + c1 * y * d[5] + of(4.0) * c2 * z * d[6] + c3 * x * d[7];
    if degree < 3 {
        return out;
    }
    let [k0, k1, k2, k3, k4, k5, k6] = SH_C3.map(of);
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    let three = of(3.0);
    let six = of(6.0);
    let eight = of(8.0);
    let four = of(4.0) * zz - xx - yy;
    out.x = out.x + k0 * six * x * y * d[9] + k1 * y * z * d[10]
        - two * k2 * x * y * d[11]
        - six * k3 * x * z * d[12]
        + k4 * (four - two * xx) * d[13]
        + two * k5 * x * z * d[14]
        + three * k6 * (xx - yy) * d[15];
    out.y =
        out.y + three * k0 * (xx - yy) * d[9] + k1 * x * z * d[10] + k2 * (four - two * yy) * d[11]
            - six * k3 * y * z * d[12]
            - two * k4 * x * y * d[13]
            - two * k5 * y * z * d[14]
            - six * k6 * x * y * d[15];
    out.z = out.z
        + k1 * x * y * d[10]
        + eight * k2 * y * z * d[11]
        + k3 * (six * zz - three * (xx + yy)) * d[12]
        + eight * k4 * x * z * d[13]
        + k5 * (xx - yy) * d[14];
    out
}

/// Gradient of a vector for the gradient `d` of its unit vector `unit`; `length` is its length.
#[inline(always)]
pub fn normalize_grad<R: Real>(unit: V3<R>, length: R, d: V3<R>) -> V3<R> {
    (d - unit.scale(unit.dot(d))).scale(R::of(1.0) / length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sh_rotation_turns_coefficients_as_directions() {
        let turn = DMat3::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.3);
        let value = |coefficients: &[[f32; 3]], d: DVec3| -> f64 {
            let basis = basis::<f64>(3, V3 { x: d.x, y: d.y, z: d.z });
            coefficients.iter().zip(basis).map(|(c, y)| f64::from(c[1]) * y).sum()
        };
        let own: Vec<[f32; 3]> = (0..16).map(|i| [0.0, (i as f32 * 0.7).sin(), 1.0]).collect();
        for width in [4, 9, 16] {
            let mut turned = own[..width].to_vec();
            ShRotation::new(turn).apply(&mut turned);
            for i in 0..20 {
                let d = DVec3::new((i as f64).sin(), (2.7 * i as f64).cos(), 0.3).normalize();
                let difference = value(&turned, turn * d) - value(&own[..width], d);
                assert!(difference.abs() < 1e-6, "{width} {i} {difference}");
            }
        }
    }

    #[test]
    fn sh_constant_of_soups_equals_the_kernels_to_one_ulp() {
        let exact = SH_C0 as f32;
        let soup = trisplat_scene::SH_C0;
        assert!(soup == exact || soup.next_up() == exact);
    }
}
