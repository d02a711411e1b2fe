//! Patch match: every pixel takes the best of its own plane, those of its neighbours and random changes.
//! Pixels are coloured like a chequerboard. Those of one colour only read the other colour, so all of them
//! can change at once, in any order.

use super::patch::{Patch, WORST};
use super::picture::WorkPicture;
use super::plane::{Plane, ray};
use super::warp::Warp;
use crate::math::lanes::{Lanes, Work, dispatch};
use crate::rng::Rng;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// A plane per pixel of a picture, and its cost: the mean of the best 1 - NCC.
#[derive(Debug, Clone)]
pub(super) struct Planes {
    /// `[height * width]`
    pub(super) plane: Vec<Plane>,
    /// Infinite where it is not known yet. `[height * width]`
    pub(super) cost: Vec<f32>,
}

/// A photo to compare with the reference.
#[derive(Debug)]
pub(super) struct Other<'a> {
    pub(super) picture: &'a WorkPicture,
    pub(super) there: Warp,
    pub(super) back: Warp,
    /// Its planes, when depths must agree too.
    pub(super) planes: Option<&'a [Plane]>,
}

/// The inputs of the search for one photo's planes.
#[derive(Debug)]
pub(super) struct Sweep<'a> {
    pub(super) reference: &'a WorkPicture,
    pub(super) others: Vec<Other<'a>>,
    /// Least and largest 1/depth.
    pub(super) range: [f32; 2],
    pub(super) rng: Rng,
    /// Random changes of a plane, as a share of depth and in radians.
    pub(super) change: f32,
    /// Whether distant and random planes are tried too.
    pub(super) restart: bool,
}

/// Regions of candidate planes: each offers its pixel with the least cost. All are of the other colour.
const REGIONS: [[(i32, i32); 4]; 8] = [
    [(0, -1), (-1, -2), (1, -2), (0, -3)],
    [(0, 1), (-1, 2), (1, 2), (0, 3)],
    [(-1, 0), (-2, -1), (-2, 1), (-3, 0)],
    [(1, 0), (2, -1), (2, 1), (3, 0)],
    [(0, -5), (0, -7), (0, -9), (0, -11)],
    [(0, 5), (0, 7), (0, 9), (0, 11)],
    [(-5, 0), (-7, 0), (-9, 0), (-11, 0)],
    [(5, 0), (7, 0), (9, 0), (11, 0)],
];
/// The first of these are near.
const NEAR_REGIONS: usize = 4;
/// Weight of a pixel of disagreement between depths, against 1 - NCC.
const DISAGREEMENT: f32 = 0.15;
/// Largest disagreement that counts, px.
const MOST_DISAGREEMENT: f32 = 3.0;
/// Planes with smaller differences, as a share of 1/depth here and 8 px away, count as equal.
const SAME: f32 = 2e-4;
/// Number of random changes at each pixel; the first ones are small.
const CHANGES: u64 = 5;
const SMALL_CHANGES: u64 = 3;
/// Random numbers kept for each pixel of a sweep.
const NUMBERS: u64 = 4 * CHANGES;

/// The result for one pixel.
type Found = (usize, Plane, f32);

impl Sweep<'_> {
    /// Updates the pixels of one colour, 0 or 1.
    pub(super) fn half(&self, planes: &mut Planes, color: usize) {
        let rows: Vec<Vec<Found>> = (0..self.reference.height)
            .into_par_iter()
            .map(|y| dispatch(Row { sweep: self, planes, color, y }))
            .collect();
        for (pixel, plane, cost) in rows.into_iter().flatten() {
            planes.plane[pixel] = plane;
            planes.cost[pixel] = cost;
        }
    }

    /// The cost of a plane at a pixel: the mean over the better half of the photos, so that photos that hide
    /// the surface do not count.
    #[inline(always)]
    fn cost<L: Lanes>(&self, patch: &Patch<L>, place: Vec2, plane: Plane) -> f32 {
        let best = self.others.len().div_ceil(2);
        let mut costs = [f32::INFINITY; super::options::MOST_NEIGHBORS];
        for (k, other) in self.others.iter().enumerate() {
            let mut cost = patch.dissimilarity(other.picture, &other.there.homography(place, plane));
            if cost < WORST {
                cost += DISAGREEMENT * other.disagreement(place, plane.inverse);
            }
            // Insertion keeps them in order.
            let mut at = k;
            while at > 0 && costs[at - 1] > cost {
                costs[at] = costs[at - 1];
                at -= 1;
            }
            costs[at] = cost;
        }
        let mut sum = 0.0;
        for cost in &costs[..best] {
            sum += cost;
        }
        sum / best as f32
    }

    #[inline(always)]
    fn permits(&self, plane: Plane, ray: Vec3) -> bool {
        plane.inverse >= self.range[0]
            && plane.inverse <= self.range[1]
            && plane.is_visible(ray, self.reference.camera.focal)
    }

    /// One of the random changes of a plane.
    #[inline(always)]
    fn changed(&self, plane: Plane, ray: Vec3, change: u64, numbers: [f32; 4]) -> Plane {
        let focal = self.reference.camera.focal;
        let factor = 1.0 + self.change * (2.0 * numbers[3] - 1.0);
        let moved = Plane { inverse: plane.inverse * factor, slope: plane.slope * factor };
        let random = self.random(ray, [numbers[0], numbers[1], numbers[2]]);
        let tilt = (Vec3::new(numbers[0], numbers[1], numbers[2]) * 2.0 - 1.0) * (2.0 * self.change);
        let turned = |plane: Plane| {
            Plane::facing(plane.inverse, (plane.normal(ray, focal) + tilt).normalize(), ray, focal)
        };
        match change {
            0 => moved,
            1 => turned(plane),
            2 => turned(moved),
            3 => random,
            _ => {
                let scale = plane.inverse / random.inverse;
                Plane { inverse: plane.inverse, slope: random.slope * scale }
            }
        }
    }

    /// A random plane: any depth, and any normal not at a grazing angle.
    #[inline(always)]
    pub(super) fn random(&self, ray: Vec3, numbers: [f32; 3]) -> Plane {
        let inverse = self.range[0] + (self.range[1] - self.range[0]) * numbers[0];
        let towards = -ray.normalize();
        let tilt = Vec3::new(2.0 * numbers[1] - 1.0, 2.0 * numbers[2] - 1.0, 0.0);
        let normal = (towards + tilt).normalize();
        let normal = if normal.dot(towards) > 0.3 { normal } else { towards };
        Plane::facing(inverse, normal, ray, self.reference.camera.focal)
    }
}

impl Other<'_> {
    /// Reprojection distance of a point of the reference through its depth in this photo, px; 0 if depths
    /// need not agree.
    #[inline(always)]
    fn disagreement(&self, place: Vec2, inverse: f32) -> f32 {
        let Some(planes) = self.planes else { return 0.0 };
        let p = self.there.place(place, inverse);
        let at = p.truncate() / p.z;
        let (x, y) = (at.x as usize, at.y as usize);
        if !(p.z > 0.0 && at.x >= 0.0 && at.y >= 0.0 && x < self.picture.width && y < self.picture.height) {
            return MOST_DISAGREEMENT;
        }
        let plane = planes[y * self.picture.width + x];
        let seen = plane.at(at - Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
        let back = self.back.place(at, seen.inverse);
        let distance = (back.truncate() / back.z - place).length();
        if back.z > 0.0 { distance.min(MOST_DISAGREEMENT) } else { MOST_DISAGREEMENT }
    }
}

/// The pixels of one colour in one row.
struct Row<'a> {
    sweep: &'a Sweep<'a>,
    planes: &'a Planes,
    color: usize,
    y: usize,
}

impl Work for Row<'_> {
    type Output = Vec<Found>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Vec<Found> {
        let width = self.sweep.reference.width;
        let mut found = Vec::with_capacity(width.div_ceil(2));
        for x in ((self.y + self.color) % 2..width).step_by(2) {
            let pixel = self.y * width + x;
            if self.sweep.reference.counts(pixel) {
                let (plane, cost) = self.pixel::<L>(x, pixel);
                found.push((pixel, plane, cost));
            }
        }
        found
    }
}

/// The best candidate for a pixel.
struct Best<L> {
    patch: Patch<L>,
    place: Vec2,
    ray: Vec3,
    plane: Plane,
    cost: f32,
}

impl<L: Lanes> Best<L> {
    #[inline(always)]
    fn try_plane(&mut self, sweep: &Sweep<'_>, plane: Plane) {
        let limit = SAME * self.plane.inverse;
        let change = plane.slope - self.plane.slope;
        let same =
            (plane.inverse - self.plane.inverse).abs() < limit && 8.0 * change.abs().max_element() < limit;
        if same || !sweep.permits(plane, self.ray) {
            return;
        }
        let cost = sweep.cost(&self.patch, self.place, plane);
        if cost < self.cost {
            (self.plane, self.cost) = (plane, cost);
        }
    }
}

impl Row<'_> {
    #[inline(always)]
    fn pixel<L: Lanes>(&self, x: usize, pixel: usize) -> (Plane, f32) {
        let (sweep, y) = (self.sweep, self.y);
        let camera = &sweep.reference.camera;
        let patch = Patch::<L>::new(sweep.reference, x, y);
        let place = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
        let ray = ray(camera, x, y);
        let (plane, cost) = (self.planes.plane[pixel], self.planes.cost[pixel]);
        let mut best = Best { patch, place, ray, plane, cost };
        if !cost.is_finite() {
            best.cost = if sweep.permits(plane, ray) { sweep.cost(&patch, place, plane) } else { WORST };
        }
        for region in &REGIONS[..if sweep.restart { REGIONS.len() } else { NEAR_REGIONS }] {
            if let Some((plane, offset)) = self.fittest(region, x) {
                best.try_plane(sweep, plane.at(offset));
            }
        }
        // One call in a loop: the search is inlined at each place that calls it.
        for change in 0..if sweep.restart { CHANGES } else { SMALL_CHANGES } {
            let numbers: [f32; 4] =
                std::array::from_fn(|k| sweep.rng.uniform(pixel as u64 * NUMBERS + 4 * change + k as u64));
            best.try_plane(sweep, sweep.changed(best.plane, ray, change, numbers));
        }
        (best.plane, best.cost)
    }

    /// The plane of a region with the least cost at its own pixel, and the offset of that pixel.
    #[inline(always)]
    fn fittest(&self, region: &[(i32, i32); 4], x: usize) -> Option<(Plane, Vec2)> {
        let (width, height) = (self.sweep.reference.width as i32, self.sweep.reference.height as i32);
        let mut best: Option<(usize, f32, (i32, i32))> = None;
        for (dx, dy) in region {
            let (column, row) = (x as i32 + dx, self.y as i32 + dy);
            if column < 0 || row < 0 || column >= width || row >= height {
                continue;
            }
            let pixel = (row * width + column) as usize;
            let cost = self.planes.cost[pixel];
            if best.is_none_or(|(_, least, _)| cost < least) {
                best = Some((pixel, cost, (*dx, *dy)));
            }
        }
        best.map(|(pixel, _, (dx, dy))| (self.planes.plane[pixel], -Vec2::new(dx as f32, dy as f32)))
    }
}
