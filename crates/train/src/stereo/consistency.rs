//! Points on which photos agree, from the planes in each.

use super::color_agreement::{MAX_COLOR_DEVIATION, color_deviations};
use super::gray_image::{GrayImage, ray};
use super::propagation::{DepthCells, PatchPlane};
use glam::{Vec2, Vec3};
use trisplat_scene::parallel;

/// Minimum number of photos that agree on a point.
pub(super) const MIN_PHOTOS: usize = 3;
/// Largest difference of the depths of one surface in two depth maps, as a share: phones measure
/// up to 1% off, and twice the deviation of a difference is 3%.
pub(super) const MEASURED_TOLERANCE: f32 = 0.03;

/// A point of a surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SurfacePoint {
    /// Place, in training space.
    pub(crate) position: Vec3,
    /// sRGB-encoded colour.
    pub(crate) rgb: [u8; 3],
    /// Unit normal, towards a photo.
    pub(crate) normal: Vec3,
}

/// A point and the photos that show it.
#[derive(Debug)]
pub(crate) struct MatchedPoint {
    pub(crate) point: SurfacePoint,
    /// In rising order.
    pub(crate) photos: Vec<u32>,
    /// True for the place of depth maps, false for that of matched pictures.
    pub(super) is_measured: bool,
}

/// Points on which three photos agree up to `tolerance` of a depth, a share; each once. Matched
/// pictures go first: depth maps are less exact.
pub(super) fn consistent_points(
    photos: &[GrayImage],
    maps: &[Vec<Option<PatchPlane>>],
    side: u32,
    tolerance: impl Fn(f32) -> f32,
) -> Vec<MatchedPoint> {
    let cells: Vec<DepthCells> =
        photos.iter().map(|photo| DepthCells::new(&photo.camera, side)).collect();
    let planes = PhotoPlanes { photos, maps, cells };
    let mut used: Vec<Vec<bool>> = maps.iter().map(|map| vec![false; map.len()]).collect();
    let mut matched = Vec::new();
    let has_depth = photos.iter().any(|photo| photo.depth.is_some());
    let passes = if has_depth { &[false, true][..] } else { &[false] };
    for &is_measured in passes {
        for own in 0..photos.len() {
            for cell in 0..maps[own].len() as u32 {
                let unused = maps[own][cell as usize].filter(|_| !used[own][cell as usize]);
                let Some(plane) = unused.filter(|plane| plane.is_measured() == is_measured) else {
                    continue;
                };
                let own = planes.own(own, cell, plane);
                let shown = planes.same_surface(&own, &tolerance);
                if shown.len() + 1 < MIN_PHOTOS {
                    continue;
                }
                for same in &shown {
                    used[same.photo][same.cell as usize] = true;
                }
                matched.push(planes.point(&own, &shown));
            }
        }
    }
    matched
}

/// The depth of each cell of each photo; 0 where no other photo has the same surface up to
/// `tolerance`. Two are enough: each plane correlates with two more photos.
pub(super) fn consistent_depths(
    photos: &[GrayImage],
    maps: &[Vec<Option<PatchPlane>>],
    side: u32,
    tolerance: impl Fn(f32) -> f32 + Sync,
) -> Vec<Vec<f32>> {
    let cells = photos.iter().map(|photo| DepthCells::new(&photo.camera, side)).collect();
    let planes = PhotoPlanes { photos, maps, cells };
    parallel::collect(photos.len(), 1, |photo| {
        let depth = |(cell, plane): (usize, &Option<PatchPlane>)| {
            let plane = plane.filter(|plane| !plane.is_measured())?;
            let own = planes.own(photo, cell as u32, plane);
            (!planes.same_surface(&own, &tolerance).is_empty()).then_some(plane.depth)
        };
        maps[photo].iter().enumerate().map(|cell| depth(cell).unwrap_or(0.0)).collect()
    })
}

/// The planes of the cells of all photos.
struct PhotoPlanes<'a> {
    photos: &'a [GrayImage],
    maps: &'a [Vec<Option<PatchPlane>>],
    cells: Vec<DepthCells>,
}

/// A point on the plane of a cell of a photo.
struct PlanePoint {
    photo: usize,
    cell: u32,
    plane: PatchPlane,
    position: Vec3,
    /// Depth of the point.
    depth: f32,
}

impl PhotoPlanes<'_> {
    /// The middle of a cell.
    fn own(&self, photo: usize, cell: u32, plane: PatchPlane) -> PlanePoint {
        let position = self.position(photo, self.cells[photo].middle(cell), plane.depth);
        PlanePoint { photo, cell, plane, position, depth: plane.depth }
    }

    /// The point at a pixel and a depth.
    fn position(&self, photo: usize, at: Vec2, depth: f32) -> Vec3 {
        let camera = &self.photos[photo].camera;
        camera.rotation.transpose() * (ray(camera, at) * depth - camera.translation)
    }

    /// The surface of a point in other photos.
    fn same_surface(&self, own: &PlanePoint, tolerance: &impl Fn(f32) -> f32) -> Vec<PlanePoint> {
        let same = |other: usize| {
            let camera = &self.photos[other].camera;
            let (at, depth) = camera.project(own.position)?;
            let cell = self.cells[other].at(at)?;
            let plane = self.maps[other][cell as usize]?;
            let depth_there = if plane.is_measured() {
                self.photos[other].measured_depth(at)?
            } else {
                let from = ray(camera, self.cells[other].middle(cell));
                plane.depth_on(from, ray(camera, at))
            };
            let is_measured = own.plane.is_measured() || plane.is_measured();
            let least = if is_measured { MEASURED_TOLERANCE } else { 0.0 };
            let position = self.position(other, at, depth_there);
            ((depth_there / depth - 1.0).abs() < tolerance(depth).max(least))
                .then_some(PlanePoint { photo: other, cell, plane, position, depth: depth_there })
        };
        (0..self.photos.len()).filter(|other| *other != own.photo).filter_map(same).collect()
    }

    /// The point that a photo and `shown` agree on.
    fn point(&self, own: &PlanePoint, shown: &[PlanePoint]) -> MatchedPoint {
        let mut photos: Vec<u32> =
            shown.iter().map(|same| same.photo as u32).chain([own.photo as u32]).collect();
        photos.sort_unstable();
        let GrayImage { camera, photo, .. } = &self.photos[own.photo];
        let at = self.cells[own.photo].middle(own.cell);
        let is_measured = own.plane.is_measured();
        let point = SurfacePoint {
            position: if is_measured { mean_position(own, shown) } else { own.position },
            rgb: photo.rgb[self.photos[own.photo].index(at)],
            normal: camera.rotation.transpose() * own.plane.normal,
        };
        MatchedPoint { point, photos, is_measured }
    }
}

/// Mean place of a point in several photos. Errors of depth maps grow with the distance, so that
/// each has the inverse of its square as weight.
fn mean_position(own: &PlanePoint, shown: &[PlanePoint]) -> Vec3 {
    let mut sum = Vec3::ZERO;
    let mut total = 0.0;
    for PlanePoint { position, depth, .. } in shown.iter().chain([own]) {
        let weight = 1.0 / (depth * depth);
        sum += weight * *position;
        total += weight;
    }
    sum / total
}

/// The points without those of depth maps on whose colour the photos do not agree.
pub(super) fn of_one_color(
    mut points: Vec<MatchedPoint>,
    images: &[GrayImage],
) -> Vec<MatchedPoint> {
    if !points.iter().any(|point| point.is_measured) {
        return points;
    }
    let positions: Vec<Vec3> = points.iter().map(|point| point.point.position).collect();
    let mut rays: Vec<(u32, u32)> = Vec::new();
    for (number, point) in (0..).zip(&points) {
        rays.extend(point.photos.iter().map(|&photo| (photo, number)));
    }
    let mut deviations = color_deviations(&positions, &rays, images).into_iter();
    points.retain(|point| {
        let deviation = deviations.next().unwrap_or(f32::INFINITY);
        !point.is_measured || deviation <= MAX_COLOR_DEVIATION
    });
    points
}
