//! Depths measured in photos: they replace the depths that the scene draws there, and count more
//! beside them, where drawn ones without texture become flat.

use crate::flatten::flatten;
use crate::picture::{DepthPicture, UNKNOWN};
use glam::Vec2;
use trisplat_scene::camera::PhotoDepths;
use trisplat_scene::parallel::{self, GRAIN};

/// Weight of a measured depth; a drawn one has 1.
const MEASURED_WEIGHT: f32 = 4.0;
/// Largest ratio of two depths of one surface, two cells apart.
const SAME_SURFACE: f32 = 1.02;
/// Cells to each side of a gap up to which a measured depth bridges it, ...
const REACH: i32 = 8;
/// ... if the drawn depth differs by at most this share: a wider gap may show what is behind.
const MAX_DRAWN_DIFFERENCE: f32 = 0.03;
/// Largest ratio of depths bridged in different directions.
const MAX_BRIDGE_RATIO: f32 = 1.01;

/// Adds measured depths to the drawn ones: `depths` has a map for each of `pictures`, or none.
pub(super) fn add_measured(pictures: &mut Vec<DepthPicture>, depths: &[PhotoDepths]) {
    if depths.len() != pictures.len() {
        return;
    }
    let measured = |picture: usize| {
        let PhotoDepths { camera, rgb, .. } = &depths[picture];
        let depth = bridge_gaps(&depths[picture], &pictures[picture]);
        DepthPicture { camera: *camera, depth, rgb: rgb.clone(), weight: MEASURED_WEIGHT }
    };
    let measured = parallel::collect(depths.len(), 1, measured);
    for (picture, measured) in pictures.iter_mut().zip(&measured) {
        flatten(picture, measured);
        forget(picture, measured);
    }
    pictures.extend(measured);
}

/// Forgets the drawn depths of pixels whose depth is measured: the scene may be wrong there.
fn forget(picture: &mut DepthPicture, measured: &DepthPicture) {
    let ratio = measured.camera.focal / picture.camera.focal;
    for pixel in 0..picture.depth.len() {
        let cell = measured.pixel_at(picture.middle(pixel) * ratio);
        if cell.is_some_and(|cell| measured.depth[cell] != UNKNOWN) {
            picture.depth[pixel] = UNKNOWN;
        }
    }
}

/// The depths of a map, also in gaps between opposite depths of one surface: of two cells around
/// one, or of any that the `drawn` depth confirms.
fn bridge_gaps(map: &PhotoDepths, drawn: &DepthPicture) -> Vec<f32> {
    let size = map.camera.size.as_ivec2();
    let ratio = drawn.camera.focal / map.camera.focal;
    let depth = |x: i32, y: i32| {
        let is_inside = x >= 0 && y >= 0 && x < size.x && y < size.y;
        if is_inside { map.depth[(y * size.x + x) as usize] } else { UNKNOWN }
    };
    parallel::collect(map.depth.len(), GRAIN, |cell| {
        let x = cell as i32 % size.x;
        let y = cell as i32 / size.x;
        if depth(x, y) != UNKNOWN {
            return depth(x, y);
        }
        let middle = Vec2::new(x as f32, y as f32) + Vec2::splat(0.5);
        let drawn_depth = drawn.depth[drawn.nearest(middle * ratio)];
        // The first depth in a direction, and its distance in steps.
        let first = |dx: i32, dy: i32| {
            let at = |k: i32| (depth(x + k * dx, y + k * dy), k as f32);
            (1..=REACH).map(at).find(|(depth, _)| *depth != UNKNOWN)
        };
        let bridge = |(dx, dy): (i32, i32)| {
            let (a, i) = first(dx, dy)?;
            let (b, j) = first(-dx, -dy)?;
            // 1/z is linear on a plane.
            let between = (i + j) * a * b / (j * b + i * a);
            let is_closed = i + j == 2.0 && a.max(b) < SAME_SURFACE * a.min(b);
            let is_confirmed = (drawn_depth / between - 1.0).abs() < MAX_DRAWN_DIFFERENCE;
            (is_closed || is_confirmed).then_some(between)
        };
        let bridges = [(1, 0), (0, 1), (1, 1), (1, -1)].map(bridge);
        let found = || bridges.iter().flatten().copied();
        let low = found().fold(f32::INFINITY, f32::min);
        let high = found().fold(0.0, f32::max);
        if high > 0.0 && high < MAX_BRIDGE_RATIO * low {
            found().sum::<f32>() / found().count() as f32
        } else {
            UNKNOWN
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use trisplat_scene::camera::Camera;

    fn camera(size: [u32; 2]) -> Camera {
        Camera::look_at(Vec3::ZERO, Vec3::Z, Vec3::NEG_Y, 0.8, size)
    }

    #[test]
    fn measured_depths_replace_drawn_ones_and_count_more() {
        let drawn = || DepthPicture {
            camera: camera([16, 12]),
            depth: vec![2.0; 16 * 12],
            rgb: vec![[9; 3]; 16 * 12],
            weight: 1.0,
        };
        let mut depth = vec![UNKNOWN; 8 * 6];
        depth[..16].fill(3.0);
        let map = PhotoDepths { camera: camera([8, 6]), depth, rgb: vec![[7; 3]; 8 * 6] };
        let mut pictures = vec![drawn()];
        add_measured(&mut pictures, &[map.clone(), map.clone()]);
        assert_eq!(pictures.len(), 1, "maps of other photos say nothing");
        add_measured(&mut pictures, &[map]);
        assert!(pictures[0].depth[..16 * 4].iter().all(|depth| *depth == UNKNOWN));
        assert!(pictures[0].depth[16 * 4..].iter().all(|depth| *depth == 2.0));
        assert!(pictures[1].weight > 1.0 && pictures[1].depth[0] == 3.0);
    }

    #[test]
    fn gaps_are_bridged_on_one_surface_or_where_the_drawing_confirms_it() {
        // Unknown columns: one on a surface, one at an outline, three on a surface.
        let of_column = |x: usize| match x {
            2 | 6 | 9..12 => UNKNOWN,
            0..6 => 2.0,
            _ => 5.0,
        };
        let depth: Vec<f32> = (0..14 * 5).map(|cell| of_column(cell % 14)).collect();
        let map = PhotoDepths { camera: camera([14, 5]), depth, rgb: vec![[0; 3]; 14 * 5] };
        let drawn = |depth: f32| DepthPicture {
            camera: camera([28, 10]),
            depth: vec![depth; 28 * 10],
            rgb: vec![[0; 3]; 28 * 10],
            weight: 1.0,
        };
        let row = |drawn: &DepthPicture| bridge_gaps(&map, drawn)[2 * 14..3 * 14].to_vec();
        let far = row(&drawn(9.0));
        assert_eq!(far[2], 2.0);
        assert!([6, 9, 10, 11].iter().all(|x| far[*x] == UNKNOWN), "{far:?}");
        let near = row(&drawn(5.1));
        assert_eq!(near[6], UNKNOWN, "an outline");
        assert!((9..12).all(|x| (near[x] - 5.0).abs() < 1e-5), "{near:?}");
    }
}
