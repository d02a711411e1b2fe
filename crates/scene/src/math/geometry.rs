//! Geometry: extents of points, a sphere of triangles, eigenvectors of a matrix, and an order of
//! points along a curve.

use super::lists::median;
use glam::{DMat3, DVec3, Vec3};
use std::collections::HashMap;

/// The middle of a triangle's corners.
pub fn centroid([a, b, c]: [Vec3; 3]) -> Vec3 {
    (a + b + c) / 3.0
}

/// Lowest and highest corner of the box around points; `None` of no points.
pub fn bounds(points: impl Iterator<Item = Vec3>) -> Option<[Vec3; 2]> {
    points
        .map(|point| [point, point])
        .reduce(|[low, high], [point, _]| [low.min(point), high.max(point)])
}

/// The mean of points; the origin without any.
pub fn mean(points: impl ExactSizeIterator<Item = Vec3>) -> Vec3 {
    let count = points.len().max(1) as f32;
    points.sum::<Vec3>() / count
}

/// The median of points along each axis, which a few far ones do not move; `None` of no points.
pub fn central(points: &[Vec3]) -> Option<Vec3> {
    let along =
        |axis: usize| median(points.iter().map(|point| point[axis]).collect(), f32::total_cmp);
    Some(Vec3::new(along(0)?, along(1)?, along(2)?))
}

/// The middle of points, and their mean distance from it.
pub fn spread(points: &[Vec3]) -> (DVec3, f64) {
    let count = points.len().max(1) as f64;
    let middle = points.iter().map(|point| point.as_dvec3()).sum::<DVec3>() / count;
    (middle, points.iter().map(|point| point.as_dvec3().distance(middle)).sum::<f64>() / count)
}

// ---- A sphere of triangles: an octahedron whose faces are repeatedly subdivided into four -------

/// Number of triangles of a sphere after `subdivisions`.
pub const fn face_count(subdivisions: u32) -> u64 {
    8 << (2 * subdivisions)
}

/// Corners on the unit sphere, and faces, counter-clockwise from outside. `[V]`, `[8 ·
/// 4^subdivisions]`
pub fn octasphere(subdivisions: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut corners = vec![Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z];
    let mut faces: Vec<[u32; 3]> = (0..8u32)
        .map(|octant| {
            let [x, y, z] =
                [0, 1, 2].map(|axis| if octant >> axis & 1 == 0 { axis } else { axis + 3 });
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
                let ab = middle(a, b, &mut corners);
                let bc = middle(b, c, &mut corners);
                let ca = middle(c, a, &mut corners);
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    (corners, faces)
}

// ---- Eigenvectors of a symmetric 3×3 matrix -----------------------------------------------------

/// Sweeps over the three off-diagonal elements; each squares the error, so five suffice for f64.
const SWEEPS: usize = 12;

/// The bits of a place: equal for corners that touch, as 0 and -0 are one place.
pub fn place_bits(place: Vec3) -> [u32; 3] {
    (place + 0.0).to_array().map(f32::to_bits)
}

/// The minors of the symmetric matrix with the rows (a b c), (b d e) and (c e f), and the inverse of
/// its determinant: their products are the inverse matrix, in the same order.
pub fn symmetric_minors([a, b, c, d, e, f]: [f64; 6]) -> ([f64; 6], f64) {
    let m00 = d * f - e * e;
    let m01 = c * e - b * f;
    let m02 = b * e - c * d;
    let m11 = a * f - c * c;
    let m12 = b * c - a * e;
    let m22 = a * d - b * b;
    ([m00, m01, m02, m11, m12, m22], 1.0 / (a * m00 + b * m01 + c * m02))
}

/// The weighted mean of v vᵀ.
pub fn scatter_matrix(vectors: impl Iterator<Item = (DVec3, f64)>) -> DMat3 {
    let mut sum = DMat3::ZERO;
    let mut weights = 0.0;
    for (v, weight) in vectors {
        sum += DMat3::from_cols(v * v.x, v * v.y, v * v.z) * weight;
        weights += weight;
    }
    sum * (1.0 / f64::max(weights, 1e-300))
}

/// Eigenvalues, smallest first, and their orthonormal eigenvectors, by Jacobi's rotations. The
/// signs of the vectors are arbitrary.
pub fn symmetric_eigen(matrix: DMat3) -> [(f64, DVec3); 3] {
    let mut a = matrix.to_cols_array_2d();
    let mut v = DMat3::IDENTITY.to_cols_array_2d();
    for _ in 0..SWEEPS {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] == 0.0 {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            // Square roots are rounded alike everywhere; `hypot` differs in its last bit from one C
            // library to the next.
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            for row in &mut a {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
            for rows in [&mut a, &mut v] {
                let x = rows[p];
                let y = rows[q];
                rows[p] = std::array::from_fn(|k| c * x[k] - s * y[k]);
                rows[q] = std::array::from_fn(|k| s * x[k] + c * y[k]);
            }
        }
    }
    let mut pairs = [0, 1, 2].map(|i| (a[i][i], DVec3::from(v[i])));
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    pairs
}

// ---- An order in which points that are near in space are near in a list -------------------------

/// The points along a Morton curve through their bounding box (meshoptimizer's spatial sort); equal
/// points keep their order, and points that are not finite count as a corner of the box. Entry i is
/// the i-th point of the order. `[N]`
pub fn along_curve(points: &[DVec3]) -> Vec<u32> {
    let finite = || points.iter().filter(|p| p.is_finite());
    let (min, max) = finite()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), &p| (min.min(p), max.max(p)));
    // In the unit cube, because meshoptimizer works in f32, where the extent of a huge scene is
    // infinite.
    let size = (max - min).max_element();
    let scale = if size > 0.0 { 1.0 / size } else { 0.0 };
    let in_cube = |p: &DVec3| {
        if p.is_finite() { ((*p - min) * scale).as_vec3().to_array() } else { [0.0; 3] }
    };
    let unit: Vec<[f32; 3]> = points.iter().map(in_cube).collect();
    let mut order = vec![0; unit.len()];
    for (point, to) in (0..).zip(meshopt::spatial_sort_remap_decoder(&unit)) {
        order[to as usize] = point;
    }
    order
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

#[cfg(test)]
mod eigen_tests {
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

#[cfg(test)]
mod curve_tests {
    use super::*;

    #[test]
    fn a_row_of_points_comes_from_end_to_end() {
        let at = |i: u32| DVec3::X * f64::from(i * 7 % 16) * 1e200;
        let points: Vec<DVec3> = (0..16).map(at).collect();
        let order = along_curve(&points);
        let along: Vec<f64> = order.iter().map(|&i| points[i as usize].x).collect();
        assert!(along.is_sorted(), "{along:?}");
    }

    #[test]
    fn every_point_comes_once_even_if_it_is_nowhere() {
        let nowhere = DVec3::new(f64::NAN, f64::INFINITY, 0.0);
        for points in
            [vec![], vec![nowhere], vec![DVec3::ONE, nowhere, DVec3::ONE, DVec3::ZERO, -nowhere]]
        {
            let mut order = along_curve(&points);
            order.sort_unstable();
            assert!(order.iter().copied().eq(0..points.len() as u32), "{order:?}");
        }
    }
}
