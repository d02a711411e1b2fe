//! From posed photos to a depth map for each: patch match on small pictures, then on larger ones; first for
//! each photo alone, then with agreement between depths. Only depths that agree are kept.

use super::agree::{agreed, uncontradicted};
use super::depth_map::DepthMap;
use super::neighbors::{Surroundings, surroundings};
use super::options::StereoOptions;
use super::picture::WorkPicture;
use super::plane::{Plane, ray};
use super::smooth::smooth;
use super::sweep::{Other, Planes, Sweep};
use super::warp::Warp;
use crate::dataset::{Point, View};
use crate::error::Result;
use crate::image::Pixels;
use crate::report::StageProgress;
use crate::rng::Rng;
use glam::{UVec2, Vec2};
use rayon::prelude::*;

/// Longest side of the smallest pictures, px.
const SMALLEST: u32 = 160;
/// Least shorter side of a picture, px.
const LEAST_SIDE: u32 = 24;
/// Most pixels of all pictures together; many photos are compared at a smaller size.
const MOST_PIXELS: f64 = 32e6;
/// Sweeps for each photo alone, on the smallest pictures.
const SWEEPS_ALONE: u32 = 6;
/// Sweeps on each size in which depths must agree with the others' previous ones.
const ROUNDS: u32 = 2;
/// Random changes of the first sweep on the smallest pictures, as a share of depth and in radians; of the first on each size.
const FIRST_CHANGE: f32 = 0.2;
/// The changes of the next sweep, as a share of those of the last.
const CALMER: f32 = 0.6;
/// Pixels around a point of the cloud that begin with its depth, px.
const SEED_RADIUS: i32 = 2;

/// Depth, normal and confidence of each of `views`, in their order. `points` tell which photos show the same
/// surface, and its distance; without points the poses do.
///
/// Errors: options out of range, photos that cannot be decoded.
pub fn estimate(
    views: &[&View],
    points: &[Point],
    options: &StereoOptions,
    progress: &mut StageProgress<'_>,
) -> Result<Vec<DepthMap>> {
    options.validate()?;
    let sizes = sizes(views, options);
    let around = surroundings(views, points);
    let photos = (0..views.len()).into_par_iter().map(|i| Ok(views[i].photo.decode()?.downscaled(sizes[i])));
    let photos: Vec<Pixels> = photos.collect::<Result<_>>()?;
    let levels = levels(&sizes);
    let work = Work { views, around: &around, photos: &photos, options };
    let mut planes: Vec<Planes> = Vec::new();
    let mut pictures: Vec<WorkPicture> = Vec::new();
    for level in (0..levels).rev() {
        let next: Vec<WorkPicture> =
            (0..views.len()).into_par_iter().map(|i| work.picture(i, level)).collect();
        planes = match pictures.is_empty() {
            true => (0..views.len()).into_par_iter().map(|i| work.first(i, &next[i])).collect(),
            false => {
                (0..views.len()).into_par_iter().map(|i| larger(&planes[i], &pictures[i], &next[i])).collect()
            }
        };
        pictures = next;
        if level + 1 == levels {
            work.alone(&pictures, &mut planes);
        }
        for round in 0..ROUNDS {
            planes = work.together(&pictures, planes, level, round);
        }
        // The cost of a level is in proportion to its pixels.
        progress.set(1, 1 << (2 * level));
    }
    let map = |i: usize| {
        let others = work.others(&pictures, Some(&planes), i, work.around[i].neighbors.len());
        let map = DepthMap::unknown(pictures[i].camera, photos[i].rgb.clone());
        agreed(map, &planes[i], &others, options)
    };
    let maps: Vec<DepthMap> = (0..views.len()).into_par_iter().map(map).collect();
    let kept = |i: usize| smooth(uncontradicted(&maps, i, &around[i].neighbors));
    Ok((0..views.len()).into_par_iter().map(kept).collect())
}

/// Data shared by all levels.
struct Work<'a> {
    views: &'a [&'a View],
    around: &'a [Surroundings],
    photos: &'a [Pixels],
    options: &'a StereoOptions,
}

impl Work<'_> {
    fn picture(&self, i: usize, level: u32) -> WorkPicture {
        let photo = &self.photos[i];
        let size = (photo.size / (1 << level)).max(UVec2::ONE);
        WorkPicture::new(photo, &self.views[i].camera, size)
    }

    /// The neighbours of photo `i`.
    fn others<'p>(
        &self,
        pictures: &'p [WorkPicture],
        planes: Option<&'p [Planes]>,
        i: usize,
        most: usize,
    ) -> Vec<Other<'p>> {
        let camera = &pictures[i].camera;
        let other = |k: &usize| Other {
            picture: &pictures[*k],
            there: Warp::new(camera, &pictures[*k].camera),
            back: Warp::new(&pictures[*k].camera, camera),
            planes: planes.map(|planes| planes[*k].plane.as_slice()),
        };
        self.around[i].neighbors.iter().take(most).map(other).collect()
    }

    fn sweep<'p>(&self, pictures: &'p [WorkPicture], planes: Option<&'p [Planes]>, i: usize) -> Sweep<'p> {
        Sweep {
            reference: &pictures[i],
            others: self.others(pictures, planes, i, self.options.neighbors as usize),
            range: self.around[i].range,
            rng: Rng::new(self.options.stereo_seed, "stereo", i as u64),
            change: FIRST_CHANGE,
            restart: false,
        }
    }

    /// Random planes, and planes through the points of the cloud.
    fn first(&self, i: usize, picture: &WorkPicture) -> Planes {
        let Surroundings { range, points, .. } = &self.around[i];
        let sweep = Sweep {
            reference: picture,
            others: Vec::new(),
            range: *range,
            rng: Rng::new(self.options.stereo_seed, "first planes", i as u64),
            change: 0.0,
            restart: false,
        };
        let camera = &picture.camera;
        let random = |pixel: usize| {
            let number = |k: u64| sweep.rng.uniform(3 * pixel as u64 + k);
            sweep.random(
                ray(camera, pixel % picture.width, pixel / picture.width),
                [number(0), number(1), number(2)],
            )
        };
        let mut plane: Vec<Plane> = (0..picture.grey.len()).map(random).collect();
        let mut nearest = vec![0.0f32; plane.len()];
        for point in points {
            let v = camera.rotation * *point + camera.translation;
            let at = v.truncate() / v.z * camera.focal + camera.center;
            for dy in -SEED_RADIUS..=SEED_RADIUS {
                for dx in -SEED_RADIUS..=SEED_RADIUS {
                    let (x, y) = (at.x as i32 + dx, at.y as i32 + dy);
                    let inside = x >= 0 && y >= 0 && x < picture.width as i32 && y < picture.height as i32;
                    // The nearest of several points is in front.
                    let pixel = (y.max(0) as usize * picture.width) + x.max(0) as usize;
                    if inside && v.z > 0.0 && nearest[pixel] < 1.0 / v.z {
                        nearest[pixel] = 1.0 / v.z;
                        let scale = nearest[pixel] / plane[pixel].inverse;
                        plane[pixel] = Plane { inverse: nearest[pixel], slope: plane[pixel].slope * scale };
                    }
                }
            }
        }
        Planes { cost: vec![f32::INFINITY; plane.len()], plane }
    }

    /// Sweeps each photo by itself.
    fn alone(&self, pictures: &[WorkPicture], planes: &mut [Planes]) {
        planes.par_iter_mut().enumerate().for_each(|(i, planes)| {
            let mut sweep = self.sweep(pictures, None, i);
            sweep.restart = true;
            for step in 0..SWEEPS_ALONE {
                self.once(&mut sweep, planes, i, u64::from(step));
                sweep.change *= CALMER;
            }
        });
    }

    /// Sweeps each photo for depths that agree with the present ones of the others.
    fn together(&self, pictures: &[WorkPicture], before: Vec<Planes>, level: u32, round: u32) -> Vec<Planes> {
        let next = |i: usize| {
            let mut sweep = self.sweep(pictures, Some(&before), i);
            let mut planes = before[i].clone();
            // Costs change with the others' depths.
            planes.cost.fill(f32::INFINITY);
            sweep.change *= CALMER.powi(2 + round as i32);
            self.once(&mut sweep, &mut planes, i, u64::from(level) << 16 | u64::from(round + 1) << 8);
            planes
        };
        (0..before.len()).into_par_iter().map(next).collect()
    }

    /// One sweep over both colours.
    fn once(&self, sweep: &mut Sweep<'_>, planes: &mut Planes, i: usize, step: u64) {
        if sweep.others.is_empty() {
            return;
        }
        for color in 0..2 {
            let step = step << 1 | color;
            sweep.rng = Rng::new(self.options.stereo_seed, "stereo", (i as u64) << 32 | step);
            sweep.half(planes, color as usize);
        }
    }
}

/// The size at which each photo is compared: within that of the options, and all together within [`MOST_PIXELS`].
fn sizes(views: &[&View], options: &StereoOptions) -> Vec<UVec2> {
    let within =
        |longest: u32| -> Vec<UVec2> { views.iter().map(|v| v.camera.within(longest).size).collect() };
    let wanted = within(options.stereo_size);
    let pixels: f64 = wanted.iter().map(|s| f64::from(s.x) * f64::from(s.y)).sum();
    let share = (MOST_PIXELS / pixels.max(1.0)).sqrt().min(1.0);
    within((f64::from(options.stereo_size) * share) as u32)
}

/// Sizes of compared pictures, each half the last.
fn levels(sizes: &[UVec2]) -> u32 {
    let longest = sizes.iter().map(|s| s.max_element()).max().unwrap_or(1);
    let shortest = sizes.iter().map(|s| s.min_element()).min().unwrap_or(1);
    (0..).find(|level| longest >> level <= SMALLEST || shortest >> (level + 1) < LEAST_SIDE).unwrap_or(0) + 1
}

/// Planes of a smaller picture, converted to a larger one.
fn larger(planes: &Planes, from: &WorkPicture, to: &WorkPicture) -> Planes {
    let ratio = Vec2::new(from.width as f32 / to.width as f32, from.height as f32 / to.height as f32);
    let plane = |pixel: usize| {
        let at = Vec2::new((pixel % to.width) as f32 + 0.5, (pixel / to.width) as f32 + 0.5) * ratio;
        let (x, y) = ((at.x as usize).min(from.width - 1), (at.y as usize).min(from.height - 1));
        let moved = planes.plane[y * from.width + x].at(at - Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
        Plane { inverse: moved.inverse, slope: moved.slope * ratio }
    };
    let plane: Vec<Plane> = (0..to.grey.len()).map(plane).collect();
    Planes { cost: vec![f32::INFINITY; plane.len()], plane }
}
