//! A sphere of triangles: an octahedron whose faces are repeatedly subdivided into four.

use glam::Vec3;
use std::collections::HashMap;

/// Number of triangles of a sphere after `subdivisions`.
pub const fn face_count(subdivisions: u32) -> u64 {
    8 << (2 * subdivisions)
}

/// Corners on the unit sphere, and faces, counter-clockwise from outside. `[V]`, `[8 · 4^subdivisions]`
pub fn octasphere(subdivisions: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut corners = vec![Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z];
    let mut faces: Vec<[u32; 3]> = (0..8u32)
        .map(|octant| {
            let [x, y, z] = [0, 1, 2].map(|axis| if octant >> axis & 1 == 0 { axis } else { axis + 3 });
            if octant.count_ones() % 2 == 0 { [x, y, z] } else { [x, z, y] }
        })
        .collect();
    for _ in 0..subdivisions {
        let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
        let mut middle = |a: u32, b: u32, corners: &mut Vec<Vec3>| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                corners.push((corners[a as usize] + corners[b as usize]).normalize());
                corners.len() as u32 - 1
            })
        };
        faces = faces
            .into_iter()
            .flat_map(|[a, b, c]| {
                let (ab, bc) = (middle(a, b, &mut corners), middle(b, c, &mut corners));
                let ca = middle(c, a, &mut corners);
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    (corners, faces)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sphere_is_closed_and_of_the_promised_size() {
        for subdivisions in 0..4 {
            let (corners, faces) = octasphere(subdivisions);
            assert_eq!(faces.len() as u64, face_count(subdivisions));
            // Euler: a closed surface without handles.
            assert_eq!(corners.len() + faces.len(), 3 * faces.len() / 2 + 2);
            for [a, b, c] in faces.iter().map(|face| face.map(|i| corners[i as usize])) {
                assert!((b - a).cross(c - a).dot(a) > 0.0, "outward");
            }
        }
    }
}
