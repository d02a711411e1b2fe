//! PatchMatch propagation: tracked points spread over the surfaces around them, where photos agree.
//!
//! In each photo planes go from cell to neighbouring cell, the best match first (Goesele et al.
//! 2007, Furukawa and Ponce 2010). Depth and tilt of each follow the normalised correlation with
//! other photos. A point stays where three photos agree on it.

use glam::{Mat3, UVec2, Vec2, Vec3};
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::Arc;
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;

/// Offsets of a patch's samples, px: every second one of 7 by 7.
const REACH: i32 = 3;
const SAMPLES: usize = 25;
/// Minimum standard deviation of the grays of a patch, in [0, 1].
const MIN_DEVIATION: f32 = 0.012;
/// Difference from the gray of the middle at which a sample has the weight e^-0.5.
const GRAY_SIGMA: f32 = 0.12;
/// Minimum correlation of a match.
const MIN_CORRELATION: f32 = 0.8;
/// Maximum number of photos that a patch is compared with.
const MAX_NEIGHBOURS: usize = 4;
/// Best angle between two photos that show a point, radians: 10 degrees.
const BEST_ANGLE: f32 = 0.17;
/// Maximum number of planes that a cell tries from its neighbours.
const MAX_TRIALS: u8 = 3;
/// Largest difference of the depths of one surface in two photos, as a share.
const DEPTH_TOLERANCE: f32 = 0.007;
/// Minimum number of photos that agree on a point.
const MIN_PHOTOS: usize = 3;
/// Minimum cosine between a plane's normal and the direction to its photo.
const MIN_VIEW_COSINE: f32 = 0.25;
/// Trial changes of depth, as shares, one after the other.
const DEPTH_CHANGES: [f32; 2] = [0.01, 0.004];
/// Trial change of the normal.
const TILT: f32 = 0.25;
/// Minimum side of a cell, px.
const MIN_CELL_SIDE: u32 = 3;
/// Cells of all photos per triangle of the scene: about a tenth become points.
const CELLS_PER_TRIANGLE: u64 = 4;

/// A tracked point in a photo.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SeedPoint {
    /// The photo.
    pub(crate) photo: u32,
    /// Number of the point.
    pub(crate) point: u32,
    /// Place, in training space.
    pub(crate) position: Vec3,
}

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
}

/// A photo in shades of gray.
#[derive(Debug)]
pub(crate) struct GrayImage {
    pub(super) camera: Camera,
    /// Greys in [0, 1]. `[H * W]`
    value: Vec<f32>,
    photo: Arc<RgbImage>,
}

impl GrayImage {
    /// `photo`, taken by `camera` at any size.
    pub(crate) fn new(camera: &Camera, photo: Arc<RgbImage>) -> Self {
        let gray = |[r, g, b]: [u8; 3]| {
            (0.299 * f32::from(r) + 0.587 * f32::from(g) + 0.114 * f32::from(b)) / 255.0
        };
        let value = photo.rgb.iter().map(|rgb| gray(*rgb)).collect();
        Self { camera: camera.resized(photo.size), value, photo }
    }

    /// Index of the pixel at a place within the photo.
    fn index(&self, at: Vec2) -> usize {
        let last = self.camera.size - 1;
        let at = at.as_uvec2().min(last);
        (at.y * self.camera.size.x + at.x) as usize
    }

    /// Colour of a place, if it is within the picture.
    pub(crate) fn color(&self, place: Vec3) -> Option<Vec3> {
        let (at, _) = self.camera.project(place)?;
        Some(Vec3::from(self.photo.rgb[self.index(at)].map(f32::from)) / 255.0)
    }

    /// True for a pixel that no mask excludes.
    pub(super) fn is_unmasked(&self, at: Vec2) -> bool {
        self.photo.alpha.as_ref().is_none_or(|alpha| alpha[self.index(at)] > 127)
    }

    /// Bilinear grays; `None` if one is outside.
    fn sample(&self, at: &[Vec2; SAMPLES]) -> Option<[f32; SAMPLES]> {
        let width = self.camera.size.x as usize;
        let last = self.camera.size.as_vec2() - 1.0;
        let mut out = [0.0; SAMPLES];
        for (out, at) in out.iter_mut().zip(at) {
            let p = *at - 0.5;
            if !(p.x >= 0.0 && p.y >= 0.0 && p.x < last.x && p.y < last.y) {
                return None;
            }
            let i = p.x as usize;
            let j = p.y as usize;
            let u = p.x - i as f32;
            let v = p.y - j as f32;
            let row = &self.value[j * width + i..][..2];
            let next = &self.value[(j + 1) * width + i..][..2];
            let top = row[0] + u * (row[1] - row[0]);
            let bottom = next[0] + u * (next[1] - next[0]);
            *out = top + v * (bottom - top);
        }
        Some(out)
    }
}

/// Offsets of a patch's samples from its middle, px.
fn offsets() -> [Vec2; SAMPLES] {
    let mut out = [Vec2::ZERO; SAMPLES];
    let square = (-REACH..=REACH).flat_map(|y| (-REACH..=REACH).map(move |x| (x, y)));
    let chosen = square.filter(|(x, y)| (x + y) % 2 == 0);
    for (out, (x, y)) in out.iter_mut().zip(chosen) {
        *out = Vec2::new(x as f32, y as f32);
    }
    out
}

/// The ray of a pixel, with z = 1.
pub(super) fn ray(camera: &Camera, at: Vec2) -> Vec3 {
    ((at - camera.center) / camera.focal).extend(1.0)
}

/// The grays around a pixel.
pub(super) struct PhotoPatch {
    /// Weights of the samples; they sum to 1.
    weights: [f32; SAMPLES],
    /// Weights times differences from the mean, as shares of the deviation.
    products: [f32; SAMPLES],
}

fn weighted(weights: &[f32; SAMPLES], values: &[f32; SAMPLES]) -> f32 {
    weights.iter().zip(values).map(|(weight, value)| weight * value).sum()
}

/// A plane through a surface, in the frame of a photo.
#[derive(Debug, Clone, Copy)]
pub(super) struct PatchPlane {
    pub(super) depth: f32,
    /// Unit normal towards the photo, in its axes.
    pub(super) normal: Vec3,
    /// Correlation with other photos.
    pub(super) score: f32,
}

impl PatchPlane {
    /// Depth on the ray `to`, if `depth` is the depth on the ray `from`.
    fn depth_on(&self, from: Vec3, to: Vec3) -> f32 {
        self.depth * self.normal.dot(from) / self.normal.dot(to)
    }
}

/// The cells of a photo, one plane each.
#[derive(Debug, Clone, Copy)]
pub(super) struct DepthCells {
    size: UVec2,
    side: u32,
}

impl DepthCells {
    fn new(camera: &Camera, side: u32) -> Self {
        Self { size: camera.size / side, side }
    }

    fn len(&self) -> usize {
        self.size.element_product() as usize
    }

    pub(super) fn middle(&self, cell: u32) -> Vec2 {
        let at = UVec2::new(cell % self.size.x, cell / self.size.x);
        (at.as_vec2() + 0.5) * self.side as f32
    }

    fn at(&self, at: Vec2) -> Option<u32> {
        let cell = at.as_uvec2() / self.side;
        cell.cmplt(self.size).all().then(|| cell.y * self.size.x + cell.x)
    }

    /// The cells at the four sides of a cell.
    fn around(self, cell: u32) -> impl Iterator<Item = u32> {
        let x = cell % self.size.x;
        let y = cell / self.size.x;
        let sides = [
            (x > 0).then(|| cell - 1),
            (x + 1 < self.size.x).then_some(cell + 1),
            (y > 0).then(|| cell.wrapping_sub(self.size.x)),
            (y + 1 < self.size.y).then_some(cell + self.size.x),
        ];
        sides.into_iter().flatten()
    }
}

/// A photo to compare with, and the transform into its frame.
struct NeighbourPhoto<'a> {
    photo: &'a GrayImage,
    turn: Mat3,
    shift: Vec3,
}

/// Propagation of planes within one photo.
pub(super) struct Propagation<'a> {
    pub(super) own: &'a GrayImage,
    neighbours: Vec<NeighbourPhoto<'a>>,
    pub(super) cells: DepthCells,
    offsets: [Vec2; SAMPLES],
    pub(super) planes: Vec<Option<PatchPlane>>,
    /// Cells to go on from, by the bits of their score, which is above 0: the best first, then the
    /// lowest index.
    queue: BinaryHeap<(u32, Reverse<u32>)>,
}

impl<'a> Propagation<'a> {
    fn new(photos: &'a [GrayImage], own: usize, neighbours: &[usize], side: u32) -> Self {
        let own = &photos[own];
        let to = |k: &usize| {
            let turn = photos[*k].camera.rotation * own.camera.rotation.transpose();
            let shift = photos[*k].camera.translation - turn * own.camera.translation;
            NeighbourPhoto { photo: &photos[*k], turn, shift }
        };
        let cells = DepthCells::new(&own.camera, side);
        Self {
            own,
            neighbours: neighbours.iter().map(to).collect(),
            cells,
            offsets: offsets(),
            planes: vec![None; cells.len()],
            queue: BinaryHeap::new(),
        }
    }

    /// Gives the cells of tracked points their first planes.
    fn seed_planes(&mut self, seeds: &[SeedPoint]) {
        let camera = &self.own.camera;
        for seed in seeds {
            let Some((at, depth)) = camera.project(seed.position) else { continue };
            let Some(cell) = self.cells.at(at) else { continue };
            let normal = -ray(camera, at).normalize();
            self.try_plane(cell, PatchPlane { depth, normal, score: 0.0 });
        }
    }

    /// Spreads planes from cell to cell; returns the plane of each.
    fn run(mut self) -> Vec<Option<PatchPlane>> {
        let camera = &self.own.camera;
        let mut trials = vec![0u8; self.planes.len()];
        while let Some((score, Reverse(cell))) = self.queue.pop() {
            let score = f32::from_bits(score);
            let Some(plane) = self.planes[cell as usize].filter(|plane| plane.score == score)
            else {
                continue;
            };
            let from = ray(camera, self.cells.middle(cell));
            let cells = self.cells;
            for next in cells.around(cell) {
                let is_better = self.planes[next as usize].is_none_or(|plane| plane.score < score);
                if !is_better || trials[next as usize] == MAX_TRIALS {
                    continue;
                }
                trials[next as usize] += 1;
                let depth = plane.depth_on(from, ray(camera, self.cells.middle(next)));
                self.try_plane(next, PatchPlane { depth, ..plane });
            }
        }
        self.planes
    }

    /// Refines a plane, and keeps it if it is the best of its cell.
    pub(super) fn try_plane(&mut self, cell: u32, plane: PatchPlane) {
        let at = self.cells.middle(cell);
        if !(plane.depth > 0.0 && self.own.is_unmasked(at)) {
            return;
        }
        let Some(patch) = self.patch(at) else { return };
        let plane = self.refined(at, plane, &patch);
        let is_best = self.planes[cell as usize].is_none_or(|before| before.score < plane.score);
        if plane.score > MIN_CORRELATION && is_best {
            self.planes[cell as usize] = Some(plane);
            self.queue.push((plane.score.to_bits(), Reverse(cell)));
        }
    }

    /// The grays around a pixel; `None` at the border and without texture.
    pub(super) fn patch(&self, at: Vec2) -> Option<PhotoPatch> {
        let mut grays = self.own.sample(&self.offsets.map(|offset| at + offset))?;
        // Weights favour the surface in the middle: across an outline another one lies at another
        // depth (Yoon and Kweon 2006).
        let middle = grays[SAMPLES / 2];
        let mut weights = grays.map(|gray| (-0.5 * ((gray - middle) / GRAY_SIGMA).powi(2)).exp());
        let total: f32 = weights.iter().sum();
        weights = weights.map(|weight| weight / total);
        let mean = weighted(&weights, &grays);
        grays = grays.map(|gray| gray - mean);
        let deviation =
            grays.iter().zip(&weights).map(|(d, weight)| weight * d * d).sum::<f32>().sqrt();
        let products = std::array::from_fn(|i| weights[i] * grays[i] / deviation);
        (deviation > MIN_DEVIATION).then_some(PhotoPatch { weights, products })
    }

    /// The best of a plane and its trial changes.
    fn refined(&self, at: Vec2, plane: PatchPlane, patch: &PhotoPatch) -> PatchPlane {
        let from = ray(&self.own.camera, at);
        let towards = -from.normalize();
        let (right, up) = towards.any_orthonormal_pair();
        let scored =
            |plane: PatchPlane| PatchPlane { score: self.score(from, plane, patch), ..plane };
        let better = |a: PatchPlane, b: PatchPlane| if b.score > a.score { b } else { a };
        let mut best = scored(plane);
        for by in DEPTH_CHANGES {
            let middle = best;
            for factor in [1.0 - by, 1.0 + by] {
                best = better(best, scored(PatchPlane { depth: middle.depth * factor, ..middle }));
            }
        }
        for tilt in [right, -right, up, -up] {
            let normal = (best.normal + TILT * tilt).normalize();
            if normal.dot(towards) > MIN_VIEW_COSINE {
                best = better(best, scored(PatchPlane { normal, ..best }));
            }
        }
        best
    }

    /// Mean of the two best correlations of a patch with other photos: one of them may be hidden.
    pub(super) fn score(&self, from: Vec3, plane: PatchPlane, patch: &PhotoPatch) -> f32 {
        let normal = plane.normal / (plane.depth * plane.normal.dot(from));
        let mut best = [-1.0f32; 2];
        for other in &self.neighbours {
            let NeighbourPhoto { photo, turn, shift } = other;
            let across =
                *turn + Mat3::from_cols(*shift * normal.x, *shift * normal.y, *shift * normal.z);
            let score = self.correlation(photo, &across, from, patch);
            if score > best[0] {
                best = [score, best[0]];
            } else if score > best[1] {
                best[1] = score;
            }
        }
        0.5 * (best[0] + best[1])
    }

    /// Normalised correlation of a patch with its image under the homography `across`; -1 outside
    /// the other photo.
    fn correlation(&self, other: &GrayImage, across: &Mat3, from: Vec3, patch: &PhotoPatch) -> f32 {
        let own = &self.own.camera;
        let camera = &other.camera;
        let middle = *across * from;
        let right = across.x_axis / own.focal.x;
        let down = across.y_axis / own.focal.y;
        if !(middle.z > 0.0) {
            return -1.0;
        }
        let at = self.offsets.map(|offset| {
            let ray = middle + right * offset.x + down * offset.y;
            ray.truncate() / ray.z * camera.focal + camera.center
        });
        let Some(grays) = other.sample(&at) else { return -1.0 };
        let mean = weighted(&patch.weights, &grays);
        let mut square = 1e-8f32;
        let mut product = 0.0f32;
        for ((value, weight), share) in grays.iter().zip(&patch.weights).zip(&patch.products) {
            let difference = value - mean;
            square += weight * difference * difference;
            product += share * difference;
        }
        product / square.sqrt()
    }
}

/// The points on which three photos agree, for a scene of this many triangles.
pub(crate) fn propagate(
    photos: &[GrayImage],
    seeds: &[SeedPoint],
    triangles: u64,
) -> Vec<MatchedPoint> {
    let of_photo = group_by_photo(photos.len(), seeds);
    let begin = |photo: &mut Propagation<'_>, own: usize| photo.seed_planes(&of_photo[own]);
    let is_same = |a: f32, b: f32| (a / b - 1.0).abs() < DEPTH_TOLERANCE;
    propagate_planes(
        photos,
        &neighbours(photos, &of_photo),
        CELLS_PER_TRIANGLE.saturating_mul(triangles),
        begin,
        is_same,
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
/// photos; returns the points on which three photos agree. `is_same` compares two depths in a photo.
pub(super) fn propagate_planes(
    photos: &[GrayImage],
    neighbours: &[Vec<usize>],
    max_cells: u64,
    begin: impl Fn(&mut Propagation<'_>, usize) + Sync,
    is_same: impl Fn(f32, f32) -> bool,
) -> Vec<MatchedPoint> {
    let count = |side: u32| {
        photos.iter().map(|photo| DepthCells::new(&photo.camera, side).len() as u64).sum::<u64>()
    };
    let side = (MIN_CELL_SIDE..).find(|side| count(*side) <= max_cells).unwrap_or(u32::MAX);
    let of_photo = |own: usize| {
        let mut photo = Propagation::new(photos, own, &neighbours[own], side);
        begin(&mut photo, own);
        photo.run()
    };
    let maps: Vec<Vec<Option<PatchPlane>>> =
        (0..photos.len()).into_par_iter().map(of_photo).collect();
    consistent_points(photos, &maps, side, is_same)
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

/// Points on which three photos agree, each once; `is_same` compares two depths in a photo.
fn consistent_points(
    photos: &[GrayImage],
    maps: &[Vec<Option<PatchPlane>>],
    side: u32,
    is_same: impl Fn(f32, f32) -> bool,
) -> Vec<MatchedPoint> {
    let cells: Vec<DepthCells> =
        photos.iter().map(|photo| DepthCells::new(&photo.camera, side)).collect();
    let mut used: Vec<Vec<bool>> = maps.iter().map(|map| vec![false; map.len()]).collect();
    let mut matched = Vec::new();
    for own in 0..photos.len() {
        let GrayImage { camera, photo, .. } = &photos[own];
        let back = camera.rotation.transpose();
        for cell in 0..maps[own].len() as u32 {
            let Some(plane) = maps[own][cell as usize].filter(|_| !used[own][cell as usize]) else {
                continue;
            };
            let at = cells[own].middle(cell);
            let position = back * (ray(camera, at) * plane.depth - camera.translation);
            // The same surface in other photos.
            let same = |other: usize| {
                let camera = &photos[other].camera;
                let (at, depth) = camera.project(position)?;
                let cell = cells[other].at(at)?;
                let plane = maps[other][cell as usize]?;
                let depth_there =
                    plane.depth_on(ray(camera, cells[other].middle(cell)), ray(camera, at));
                is_same(depth_there, depth).then_some((other, cell))
            };
            let shown: Vec<(usize, u32)> =
                (0..photos.len()).filter(|other| *other != own).filter_map(same).collect();
            if shown.len() + 1 < MIN_PHOTOS {
                continue;
            }
            for &(other, cell) in &shown {
                used[other][cell as usize] = true;
            }
            let mut photos_of_point: Vec<u32> =
                shown.iter().map(|(other, _)| *other as u32).chain([own as u32]).collect();
            photos_of_point.sort_unstable();
            let point = SurfacePoint {
                position,
                rgb: photo.rgb[photos[own].index(at)],
                normal: back * plane.normal,
            };
            matched.push(MatchedPoint { point, photos: photos_of_point });
        }
    }
    matched
}

#[cfg(test)]
mod tests {
    use super::*;

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
        for MatchedPoint { point, photos } in &matched {
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
