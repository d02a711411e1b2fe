//! Matching of photos: which are compared, and the points on which three agree.

use super::consistency::{
    MEASURED_TOLERANCE, MatchedPoint, consistent_depths, consistent_points, of_one_color,
};
use super::gray_image::{GrayImage, ray};
use super::propagation::{DepthCells, PatchPlane, Propagation, SeedPoint};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Maximum number of photos that a patch is compared with.
const MAX_NEIGHBOURS: usize = 4;
/// Best angle between two photos that show a point, radians: 10 degrees.
const BEST_ANGLE: f32 = 0.17;
/// Largest difference of the depths of one surface in two photos, as a share.
const DEPTH_TOLERANCE: f32 = 0.007;
/// Minimum side of a cell, px.
const MIN_CELL_SIDE: u32 = 3;
/// Cells of all photos per triangle of the scene: about a tenth become points.
const CELLS_PER_TRIANGLE: u64 = 4;
/// Pixels per side of a depth map that choose the photos to compare its photo with.
const SHARED_POINTS_PER_SIDE: u32 = 5;

/// The points on which three photos agree, for a scene of this many triangles.
pub(crate) fn propagate(
    photos: &[GrayImage],
    seeds: &[SeedPoint],
    triangles: u64,
) -> Vec<MatchedPoint> {
    let of_photo = group_by_photo(photos.len(), seeds);
    let begin = |photo: &mut Propagation<'_>, own: usize| photo.seed_planes(&of_photo[own]);
    propagate_planes(
        photos,
        &neighbours(photos, &of_photo),
        CELLS_PER_TRIANGLE.saturating_mul(triangles),
        begin,
        |_| DEPTH_TOLERANCE,
    )
}

pub(super) fn group_by_photo(count: usize, seeds: &[SeedPoint]) -> Vec<Vec<SeedPoint>> {
    let mut of_photo: Vec<Vec<SeedPoint>> = vec![Vec::new(); count];
    for seed in seeds {
        of_photo[seed.photo as usize].push(*seed);
    }
    of_photo
}

/// Spreads planes within each photo, from those of `begin`, over at most `max_cells` cells of all
/// photos; returns the points on which three photos agree, up to `tolerance` of a depth, as a share.
pub(super) fn propagate_planes(
    photos: &[GrayImage],
    neighbours: &[Vec<usize>],
    max_cells: u64,
    begin: impl Fn(&mut Propagation<'_>, usize) + Sync,
    tolerance: impl Fn(f32) -> f32,
) -> Vec<MatchedPoint> {
    let count = |side: u32| {
        photos.iter().map(|photo| DepthCells::new(&photo.camera, side).len() as u64).sum::<u64>()
    };
    let side = (MIN_CELL_SIDE..).find(|side| count(*side) <= max_cells).unwrap_or(u32::MAX);
    let maps = plane_maps(photos, neighbours, side, begin);
    of_one_color(consistent_points(photos, &maps, side, tolerance), photos)
}

/// The planes of cells of `side` px of each photo, spread from those of `begin`.
fn plane_maps(
    photos: &[GrayImage],
    neighbours: &[Vec<usize>],
    side: u32,
    begin: impl Fn(&mut Propagation<'_>, usize) + Sync,
) -> Vec<Vec<Option<PatchPlane>>> {
    let of_photo = |own: usize| {
        let mut photo = Propagation::new(photos, own, &neighbours[own], side);
        begin(&mut photo, own);
        photo.seed_measured();
        photo.run()
    };
    (0..photos.len()).into_par_iter().map(of_photo).collect()
}

/// The depth of each cell of `side` px of each photo, spread from `seeds`; 0 where no other photo
/// has the same surface.
pub(super) fn propagate_depths(
    photos: &[GrayImage],
    seeds: &[SeedPoint],
    side: u32,
) -> Vec<Vec<f32>> {
    let of_photo = group_by_photo(photos.len(), seeds);
    let begin = |photo: &mut Propagation<'_>, own: usize| photo.seed_planes(&of_photo[own]);
    let maps = plane_maps(photos, &neighbours(photos, &of_photo), side, begin);
    consistent_depths(photos, &maps, side, |_| DEPTH_TOLERANCE)
}

/// Chooses the photos to compare each photo with: they share most of its points, from an angle near
/// the best.
pub(super) fn neighbours(photos: &[GrayImage], of_photo: &[Vec<SeedPoint>]) -> Vec<Vec<usize>> {
    let points = of_photo.iter().flatten().map(|seed| seed.point as usize + 1).max().unwrap_or(0);
    let mut shown_by: Vec<Vec<usize>> = vec![Vec::new(); points];
    for seed in of_photo.iter().flatten() {
        shown_by[seed.point as usize].push(seed.photo as usize);
    }
    let eyes: Vec<Vec3> = photos.iter().map(|photo| photo.camera.position()).collect();
    let best = |own: usize| {
        let mut weights = vec![0.0f32; photos.len()];
        for SeedPoint { point, position, .. } in &of_photo[own] {
            for &other in shown_by[*point as usize].iter().filter(|other| **other != own) {
                let angle = (eyes[own] - position).angle_between(eyes[other] - position).max(1e-3);
                weights[other] += (angle / BEST_ANGLE).min(BEST_ANGLE / angle);
            }
        }
        let mut order: Vec<usize> =
            (0..photos.len()).filter(|other| weights[*other] > 0.0).collect();
        order.sort_by(|a, b| weights[*b].total_cmp(&weights[*a]).then(a.cmp(b)));
        order.truncate(MAX_NEIGHBOURS);
        order
    };
    (0..photos.len()).map(best).collect()
}

/// Points of depth maps with each photo whose own map agrees, numbered from `first`.
pub(super) fn shared_points(images: &[GrayImage], first: usize) -> Vec<SeedPoint> {
    let mut seeds = Vec::new();
    let mut point = first as u32;
    for own in images.iter().filter(|image| image.depth.is_some()) {
        for i in 0..SHARED_POINTS_PER_SIDE * SHARED_POINTS_PER_SIDE {
            let place = Vec2::new(
                (i % SHARED_POINTS_PER_SIDE) as f32 + 0.5,
                (i / SHARED_POINTS_PER_SIDE) as f32 + 0.5,
            );
            let at = place / SHARED_POINTS_PER_SIDE as f32 * own.camera.size.as_vec2();
            let Some(depth) = own.measured_depth(at) else { continue };
            let in_camera = ray(&own.camera, at) * depth - own.camera.translation;
            let position = own.camera.rotation.transpose() * in_camera;
            let shows = |photo: &usize| {
                let other = &images[*photo];
                other.camera.project(position).is_some_and(|(at, depth)| {
                    let measured = other.measured_depth(at);
                    measured.is_some_and(|z| (z / depth - 1.0).abs() < MEASURED_TOLERANCE)
                })
            };
            let shown = (0..images.len()).filter(shows);
            seeds.extend(shown.map(|photo| SeedPoint { photo: photo as u32, point, position }));
            point += 1;
        }
    }
    seeds
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stereo::consistency::MIN_PHOTOS;
    use std::sync::Arc;
    use trisplat_scene::camera::Camera;
    use trisplat_scene::image::RgbImage;

    /// A photo of the plane z = 4 + x / 5 with a pattern on it, from `eye`.
    fn photo(eye: Vec3) -> GrayImage {
        let camera = Camera::look_at(eye, Vec3::new(0.0, 0.0, 4.0), Vec3::NEG_Y, 0.8, [96, 72]);
        let back = camera.rotation.transpose();
        let color = |i: u32| {
            let at = Vec2::new((i % 96) as f32, (i / 96) as f32) + 0.5;
            let way = back * ray(&camera, at);
            let place = eye + way * ((4.0 + eye.x / 5.0 - eye.z) / (way.z - way.x / 5.0));
            let waves = (5.0 * place.x).sin()
                + (7.0 * place.y + 2.0 * place.x).sin()
                + (11.0 * (place.x - place.y)).sin();
            [(128.0 + 40.0 * waves) as u8; 3]
        };
        let rgb = (0..96 * 72).map(color).collect();
        GrayImage::new(&camera, Arc::new(RgbImage { size: camera.size, rgb, alpha: None }))
    }

    fn eyes() -> Vec<Vec3> {
        [-0.6, -0.2, 0.2, 0.6].map(|x| Vec3::new(x, 0.3 * x * x, 0.0)).to_vec()
    }

    #[test]
    fn one_point_spreads_over_its_surface() {
        let photos: Vec<GrayImage> = eyes().into_iter().map(photo).collect();
        let position = Vec3::new(0.1, 0.05, 4.02);
        let seeds: Vec<SeedPoint> =
            (0..4).map(|photo| SeedPoint { photo, point: 0, position }).collect();
        let matched = propagate(&photos, &seeds, 10_000);
        assert!(matched.len() > 200, "{}", matched.len());
        let error = |point: &MatchedPoint| {
            let p = point.point.position;
            (p.z - 4.0 - p.x / 5.0).abs() / p.z
        };
        let correct = matched.iter().filter(|point| error(point) < 0.01).count();
        assert!(correct as f64 > 0.97 * matched.len() as f64, "{correct} of {}", matched.len());
        for MatchedPoint { point, photos, .. } in &matched {
            assert!(photos.len() >= MIN_PHOTOS && photos.is_sorted());
            assert!(point.normal.z < -0.5, "{point:?}");
        }
    }

    #[test]
    fn nothing_spreads_without_texture_or_from_a_wrong_place() {
        let mut photos: Vec<GrayImage> = eyes().into_iter().map(photo).collect();
        let seeds = |position| {
            (0..4).map(|photo| SeedPoint { photo, point: 0, position }).collect::<Vec<_>>()
        };
        assert_eq!(propagate(&photos, &seeds(Vec3::new(0.1, 0.05, 2.5)), 10_000).len(), 0);
        for photo in &mut photos {
            photo.value.fill(0.5);
        }
        assert_eq!(propagate(&photos, &seeds(Vec3::new(0.1, 0.05, 4.02)), 10_000).len(), 0);
        assert_eq!(propagate(&photos, &[], 10_000).len(), 0);
    }

    #[test]
    fn few_triangles_get_few_cells() {
        let photos: Vec<GrayImage> = eyes().into_iter().map(photo).collect();
        let position = Vec3::new(0.1, 0.05, 4.02);
        let seeds: Vec<SeedPoint> =
            (0..4).map(|photo| SeedPoint { photo, point: 0, position }).collect();
        let count = |triangles| propagate(&photos, &seeds, triangles).len();
        assert!(count(20) < count(10_000) / 4);
        assert_eq!(count(0), 0);
    }
}
