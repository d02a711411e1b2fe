//! Smooths normals and depths over neighbouring pixels of one surface, because patch match finds each alone.

use super::depth_map::DepthMap;
use super::plane::{Plane, ray};
use glam::{Mat3, Vec2, Vec3};

/// Radius of the pixels for fitting a plane, px.
const RADIUS: i32 = 3;
/// Largest relative distance from the pixel's plane for depths of one surface.
const SAME_SURFACE: f32 = 0.015;
/// Least pixels for fitting a plane.
const LEAST_PIXELS: u32 = 12;

/// The same map, with depths and normals of planes fitted to the pixels around.
pub(super) fn smooth(mut map: DepthMap) -> DepthMap {
    let fitted: Vec<Option<Plane>> = (0..map.depth.len()).map(|pixel| fit(&map, pixel)).collect();
    let to_world = map.camera.rotation.transpose();
    let width = map.camera.size.x as usize;
    for (pixel, plane) in fitted.into_iter().enumerate() {
        let Some(plane) = plane else { continue };
        map.depth[pixel] = 1.0 / plane.inverse;
        map.normal[pixel] =
            to_world * plane.normal(ray(&map.camera, pixel % width, pixel / width), map.camera.focal);
    }
    map
}

/// The plane around a pixel, by least squares; `None` if too few pixels belong to one surface.
fn fit(map: &DepthMap, pixel: usize) -> Option<Plane> {
    if !map.is_known(pixel) {
        return None;
    }
    let camera = &map.camera;
    let (width, height) = (camera.size.x as i32, camera.size.y as i32);
    let (x, y) = (pixel as i32 % width, pixel as i32 / width);
    let ray = ray(camera, x as usize, y as usize);
    let own = Plane::facing(1.0 / map.depth[pixel], camera.rotation * map.normal[pixel], ray, camera.focal);
    let (mut count, mut matrix, mut right) = (0, Mat3::ZERO, Vec3::ZERO);
    for row in (y - RADIUS).max(0)..(y + RADIUS + 1).min(height) {
        for column in (x - RADIUS).max(0)..(x + RADIUS + 1).min(width) {
            let other = (row * width + column) as usize;
            let offset = Vec2::new((column - x) as f32, (row - y) as f32);
            let near = (own.at(offset).inverse * map.depth[other] - 1.0).abs() < SAME_SURFACE;
            if map.is_known(other) && near {
                let (at, weight) = (offset.extend(1.0), map.confidence[other]);
                count += 1;
                matrix += Mat3::from_cols(at * at.x, at * at.y, at) * weight;
                right += at * (weight / map.depth[other]);
            }
        }
    }
    if count < LEAST_PIXELS || !(matrix.determinant() > 1e-3) {
        return None;
    }
    let solved = matrix.inverse() * right;
    let plane = Plane { inverse: solved.z, slope: solved.truncate() };
    plane.is_visible(ray, camera.focal).then_some(plane)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use glam::UVec2;

    #[test]
    fn a_noisy_plane_becomes_even_and_a_step_stays() {
        let camera = Camera {
            rotation: Mat3::IDENTITY,
            translation: Vec3::ZERO,
            focal: Vec2::splat(60.0),
            center: Vec2::splat(10.0),
            size: UVec2::splat(20),
        };
        let mut map = DepthMap::unknown(camera, vec![[0; 3]; 400]);
        for pixel in 0..400 {
            // Two walls, the right one farther away; every second depth is 0.4% off.
            let wall = if pixel % 20 < 10 { 2.0 } else { 3.0 };
            map.depth[pixel] = wall * (1.0 + 0.004 * ((pixel * 7919 % 3) as f32 - 1.0));
            map.normal[pixel] = Vec3::NEG_Z;
            map.confidence[pixel] = 1.0;
        }
        let smooth = smooth(map);
        for pixel in 0..400 {
            let wall = if pixel % 20 < 10 { 2.0 } else { 3.0 };
            assert!((smooth.depth[pixel] / wall - 1.0).abs() < 0.0025, "{pixel}: {}", smooth.depth[pixel]);
        }
    }
}
