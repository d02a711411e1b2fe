//! Colours of corners as a camera sees them, of faces with spherical harmonics.

use crate::kernel::sh::basis;
use glam::Vec3;
use trisplat_scene::math::color::{linear_from_srgb, srgb_from_linear};
use trisplat_scene::math::real::V3;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::parallel::{self, GRAIN};

/// Linear colours of all corners of `mesh`, seen from `eye`; `None` without spherical harmonics. An
/// engine computes the same for every vertex: see [`trisplat_scene::FaceSh`]. `[3 F]`
pub fn view_colors(mesh: &Mesh, eye: Vec3) -> Option<Colors> {
    let sh = mesh.sh.as_ref()?;
    let degree = sh.degree();
    let of_face = |face: usize| {
        let corners = mesh.corners(face);
        let own = mesh.corner_colors(face);
        let coefficients = sh.face(face);
        [0, 1, 2].map(|corner| {
            let basis = direction_basis(degree, corners[corner], eye);
            [0, 1, 2].map(|channel| {
                let mut code = srgb_from_linear(own[corner][channel]);
                for (coefficient, basis) in coefficients.iter().zip(basis) {
                    code += coefficient[channel] * basis;
                }
                linear_from_srgb(code.clamp(0.0, 1.0))
            })
        })
    };
    Some(Colors::Vertex(parallel::collect(mesh.face_count(), GRAIN, of_face).into_flattened()))
}

/// The harmonics up to `degree` in the direction from `eye` to `corner`; at the eye, those of +z.
#[inline(always)]
pub fn direction_basis(degree: u8, corner: Vec3, eye: Vec3) -> [f32; 16] {
    let Vec3 { x, y, z } = (corner - eye).normalize_or(Vec3::Z);
    basis(degree, V3 { x, y, z })
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::FaceSh;

    #[test]
    fn degree_one_brightens_from_one_side_only() {
        let triangle = [[Vec3::new(-0.1, 0.0, 0.0), Vec3::X * 0.1, Vec3::Y * 0.1]];
        let mut mesh = Mesh::from_triangles(&triangle, &[[0.2, 0.2, 0.2]]).unwrap();
        assert_eq!(view_colors(&mesh, Vec3::Z), None);
        // Y_2 is 0.4886 z: seen along -z, from +z, it is negative.
        let coefficients = vec![[0.0; 3], [0.0; 3], [0.2, 0.0, 0.0], [0.0; 3]];
        mesh.sh = Some(FaceSh::new(1, coefficients).unwrap());
        let of = |eye| match view_colors(&mesh, eye) {
            Some(Colors::Vertex(colors)) => colors[0],
            other => panic!("{other:?}"),
        };
        let code = srgb_from_linear(0.2);
        for (eye, sign) in [(Vec3::Z * 50.0, -1.0), (Vec3::Z * -50.0, 1.0)] {
            let [red, green, _] = of(eye);
            assert!((srgb_from_linear(red) - (code + sign * 0.2 * 0.488_602_5)).abs() < 1e-4);
            assert!((green - 0.2).abs() < 1e-5);
        }
    }
}
