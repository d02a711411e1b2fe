//! Filters the planes of each photo: keeps depths that match the photos, agree with depths and normals of
//! other photos, and do not hide surfaces of others.

use super::depth_map::DepthMap;
use super::options::StereoOptions;
use super::plane::{Plane, ray};
use super::sweep::{Other, Planes};
use glam::{Vec2, Vec3};

/// Largest mean 1 - NCC of a kept depth.
const MOST_COST: f32 = 0.4;
/// Largest reprojection distance of a pixel through the other photo's depth, px.
const MOST_DISTANCE: f32 = 1.0;
/// Cosine of the largest angle between two normals that agree: 20 degrees.
const SAME_NORMAL: f32 = 0.94;
/// Agreeing photos that give full confidence.
const SURE: f32 = 4.0;
/// Depths of adjacent pixels that differ by less are on one surface, as a share.
const SAME_SURFACE: f32 = 0.02;
/// A depth hides another that is larger by this factor.
const CLEARLY_BEHIND: f32 = 1.05;
/// Smaller surfaces are noise, px.
const LEAST_PIXELS: usize = 24;

/// Keeps depths that agree with the `others`, which have planes.
pub(super) fn agreed(
    mut map: DepthMap,
    planes: &Planes,
    others: &[Other<'_>],
    options: &StereoOptions,
) -> DepthMap {
    let camera = map.camera;
    let width = camera.size.x as usize;
    let to_world = camera.rotation.transpose();
    for (pixel, (plane, cost)) in planes.plane.iter().zip(&planes.cost).enumerate() {
        let (x, y) = (pixel % width, pixel / width);
        let ray = ray(&camera, x, y);
        if !(*cost < MOST_COST && plane.is_visible(ray, camera.focal)) {
            continue;
        }
        let normal = to_world * plane.normal(ray, camera.focal);
        let place = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
        let agrees = |other: &&Other<'_>| agrees(other, place, *plane, normal, options.depth_tolerance);
        let count = others.iter().filter(agrees).count();
        let confidence = (1.0 - cost).max(0.0) * (count as f32 / SURE.min(others.len() as f32)).min(1.0);
        let enough = count >= (options.min_agreeing as usize).min(others.len()).max(1);
        if enough && confidence >= options.min_confidence {
            map.depth[pixel] = 1.0 / plane.inverse;
            map.normal[pixel] = normal;
            map.confidence[pixel] = confidence;
        }
    }
    map
}

/// Whether another photo's plane agrees with that of a pixel.
fn agrees(other: &Other<'_>, place: Vec2, plane: Plane, normal: Vec3, tolerance: f32) -> bool {
    let Some(planes) = other.planes else { return false };
    let p = other.there.place(place, plane.inverse);
    let at = p.truncate() / p.z;
    let camera = &other.picture.camera;
    if !(p.z > 0.0 && at.cmpge(Vec2::ZERO).all() && at.cmplt(camera.size.as_vec2()).all()) {
        return false;
    }
    let (x, y) = (at.x as usize, at.y as usize);
    let seen = planes[y * other.picture.width + x];
    let there = seen.at(at - Vec2::new(x as f32 + 0.5, y as f32 + 0.5)).inverse;
    let back = other.back.place(at, there);
    // Depth of the other photo's surface in the reference, compared with the reference's own.
    let ratio = back.z * plane.inverse / there;
    let own = camera.rotation.transpose() * seen.normal(ray(camera, x, y), camera.focal);
    there > 0.0
        && back.z > 0.0
        && (back.truncate() / back.z - place).length() <= MOST_DISTANCE
        && (ratio - 1.0).abs() <= tolerance
        && own.dot(normal) >= SAME_NORMAL
}

/// Removes depths of `maps[own]` that hide surfaces of other maps, unless more maps agree with them. The
/// `others` may show the same surface.
pub(super) fn uncontradicted(maps: &[DepthMap], own: usize, others: &[usize]) -> DepthMap {
    let mut map = maps[own].clone();
    for pixel in 0..map.depth.len() {
        let Some(point) = map.point(pixel) else { continue };
        let (mut same, mut through) = (0, 0);
        for other in others {
            let Some((there, depth)) = maps[*other].pixel(point) else { continue };
            let seen = maps[*other].depth[there];
            same += u32::from(maps[*other].is_known(there) && (seen / depth - 1.0).abs() < SAME_SURFACE);
            through += u32::from(seen > CLEARLY_BEHIND * depth);
        }
        if through > same || (through > 0 && same < 2) {
            map.forget(pixel);
        }
    }
    remove_specks(&mut map);
    map
}

/// Removes small isolated surfaces.
fn remove_specks(map: &mut DepthMap) {
    let (width, height) = (map.camera.size.x as usize, map.camera.size.y as usize);
    let mut seen = vec![false; map.depth.len()];
    let mut surface = Vec::new();
    for start in 0..map.depth.len() {
        if seen[start] || !map.is_known(start) {
            continue;
        }
        surface.clear();
        surface.push(start);
        seen[start] = true;
        let mut next = 0;
        while let Some(&pixel) = surface.get(next) {
            next += 1;
            let (x, y) = (pixel % width, pixel / width);
            let around = [
                (x > 0).then(|| pixel - 1),
                (x + 1 < width).then(|| pixel + 1),
                (y > 0).then(|| pixel - width),
                (y + 1 < height).then(|| pixel + width),
            ];
            for other in around.into_iter().flatten() {
                let near = (map.depth[other] - map.depth[pixel]).abs() < SAME_SURFACE * map.depth[pixel];
                if !seen[other] && map.is_known(other) && near {
                    seen[other] = true;
                    surface.push(other);
                }
            }
        }
        if surface.len() < LEAST_PIXELS {
            surface.iter().for_each(|pixel| map.forget(*pixel));
        }
    }
}
