//! An order in which points that are near in space are near in a list.

use glam::DVec3;

/// The points along a Morton curve through their bounding box (meshoptimizer's spatial sort); equal points
/// keep their order, and points that are not finite count as a corner of the box. Entry i is the i-th point
/// of the order. `[N]`
pub fn along_curve(points: &[DVec3]) -> Vec<u32> {
    let finite = || points.iter().filter(|p| p.is_finite());
    let (min, max) =
        finite().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), &p| (min.min(p), max.max(p)));
    // In the unit cube, because meshoptimizer works in f32, where the extent of a huge scene is infinite.
    let size = (max - min).max_element();
    let scale = if size > 0.0 { 1.0 / size } else { 0.0 };
    let in_cube =
        |p: &DVec3| if p.is_finite() { ((*p - min) * scale).as_vec3().to_array() } else { [0.0; 3] };
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
        for points in [vec![], vec![nowhere], vec![DVec3::ONE, nowhere, DVec3::ONE, DVec3::ZERO, -nowhere]] {
            let mut order = along_curve(&points);
            order.sort_unstable();
            assert!(order.iter().copied().eq(0..points.len() as u32), "{order:?}");
        }
    }
}
