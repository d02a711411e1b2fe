//! PatchMatch propagation: tracked points spread over the surfaces around them, where photos agree.
//!
//! In each photo planes go from cell to neighbouring cell, the best match first (Goesele et al.
//! 2007, Furukawa and Ponce 2010). Depth and tilt of each follow the normalised correlation with
//! other photos. Depth maps of photos give planes to begin with, and planes where pictures have no
//! texture to match.

use super::gray_image::{GrayImage, ray};
use glam::{Mat3, UVec2, Vec2, Vec3};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use trisplat_scene::camera::Camera;

/// Offsets of a patch's samples, px: every second one of 7 by 7.
const REACH: i32 = 3;
const SAMPLES: usize = 25;
/// Minimum standard deviation of the grays of a patch, in [0, 1].
const MIN_DEVIATION: f32 = 0.012;
/// Difference from the gray of the middle at which a sample has the weight e^-0.5.
const GRAY_SIGMA: f32 = 0.12;
/// Minimum correlation of a match.
const MIN_CORRELATION: f32 = 0.8;
/// Maximum number of planes that a cell tries from its neighbours.
const MAX_TRIALS: u8 = 3;
/// Minimum cosine between a plane's normal and the direction to its photo.
const MIN_VIEW_COSINE: f32 = 0.25;
/// Trial changes of depth, as shares, one after the other.
const DEPTH_CHANGES: [f32; 2] = [0.01, 0.004];
/// Trial change of the normal.
const TILT: f32 = 0.25;

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
    /// Correlation with other photos; 0 of a plane that only a depth map knows.
    pub(super) score: f32,
}

impl PatchPlane {
    /// True if no picture confirms it.
    pub(super) fn is_measured(&self) -> bool {
        self.score == 0.0
    }

    /// Depth on the ray `to`, if `depth` is the depth on the ray `from`.
    pub(super) fn depth_on(&self, from: Vec3, to: Vec3) -> f32 {
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
    pub(super) fn new(camera: &Camera, side: u32) -> Self {
        Self { size: camera.size / side, side }
    }

    pub(super) fn len(&self) -> usize {
        self.size.element_product() as usize
    }

    pub(super) fn middle(&self, cell: u32) -> Vec2 {
        let at = UVec2::new(cell % self.size.x, cell / self.size.x);
        (at.as_vec2() + 0.5) * self.side as f32
    }

    pub(super) fn at(&self, at: Vec2) -> Option<u32> {
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
    pub(super) fn new(
        photos: &'a [GrayImage],
        own: usize,
        neighbours: &[usize],
        side: u32,
    ) -> Self {
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
    pub(super) fn seed_planes(&mut self, seeds: &[SeedPoint]) {
        let camera = &self.own.camera;
        for seed in seeds {
            let Some((at, depth)) = camera.project(seed.position) else { continue };
            let Some(cell) = self.cells.at(at) else { continue };
            let normal = -ray(camera, at).normalize();
            self.try_plane(cell, PatchPlane { depth, normal, score: 0.0 });
        }
    }

    /// Spreads planes from cell to cell; returns the plane of each.
    pub(super) fn run(mut self) -> Vec<Option<PatchPlane>> {
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
        self.fill_measured();
        self.planes
    }

    /// Tries the measured depth of each cell.
    pub(super) fn seed_measured(&mut self) {
        for cell in 0..self.planes.len() as u32 {
            if let Some(plane) = self.measured_plane(cell) {
                self.try_plane(cell, plane);
            }
        }
    }

    /// Gives cells without a plane their measured one.
    fn fill_measured(&mut self) {
        for cell in 0..self.planes.len() as u32 {
            if self.planes[cell as usize].is_none() {
                self.planes[cell as usize] = self.measured_plane(cell);
            }
        }
    }

    /// The plane of a cell that faces its photo at the measured depth.
    fn measured_plane(&self, cell: u32) -> Option<PatchPlane> {
        let at = self.cells.middle(cell);
        let depth = self.own.measured_depth(at).filter(|_| self.own.is_unmasked(at))?;
        Some(PatchPlane { depth, normal: -ray(&self.own.camera, at).normalize(), score: 0.0 })
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
