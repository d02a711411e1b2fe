//! Gains and falloff from photos and drawings of a scene from their cameras; exposures from points that several photos show.
//!
//! Both pictures are compared in cells, by the ratio of their sums of linear light, which noise and small
//! displacements hardly change. Its logarithm is linear in the unknowns, so weighted least squares have a
//! closed form, with less weight for cells that do not match. The falloff of a camera comes first, from the
//! residuals of each photo's mean, then the means.

use super::correction::{Exposures, Rings, Solved};
use glam::{UVec2, Vec2};
use std::collections::HashMap;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::linear_of_srgb8;
use trisplat_scene::math::lists::median;

/// Cells along each side of a picture.
const GRID: u32 = 16;
/// Range of compared codes: smaller ones are noise, larger ones may be saturated.
const COMPARED: std::ops::RangeInclusive<u8> = 6..=248;
/// Least share of compared pixels in a cell.
const LEAST_SHARE: f32 = 0.5;
/// Rounds of new weights.
const ROUNDS: usize = 12;
/// Least residual that halves a cell's weight, as a logarithm.
const LEAST_SCALE: f32 = 0.02;
/// Errors are larger than for independent cells by this factor, because neighbouring cells correlate, most of
/// all in an untrained scene.
const DEPENDENCE: f32 = 4.0;

/// The comparison of a photo and a drawing.
#[derive(Debug, Clone, Default)]
pub struct Cells {
    cells: Vec<Cell>,
    camera: UVec2,
}

#[derive(Debug, Clone, Copy)]
struct Cell {
    /// Logarithm of the photo's light over that of the drawing, per channel.
    log: [f32; 3],
    weight: [f32; 3],
    /// Of its middle.
    r2: f32,
}

impl Cells {
    /// Compares a photo with a drawing of the same size. `camera` is the size of the whole photo: photos of
    /// one size share a camera.
    pub fn new(photo: &RgbImage, drawn: &RgbImage, camera: UVec2) -> Self {
        let size = photo.size;
        let rings = Rings::new(size);
        let side = |i: u32, all: u32| (i * all / GRID, (i + 1) * all / GRID);
        let cell = |k: u32| {
            let ((left, right), (top, bottom)) = (side(k % GRID, size.x), side(k / GRID, size.y));
            let pixels = (top..bottom).flat_map(|y| (left..right).map(move |x| (y * size.x + x) as usize));
            let r2 = rings.square(Vec2::new((left + right) as f32, (top + bottom) as f32) / 2.0);
            Cell::new(photo, drawn, pixels, r2)
        };
        let cells = (0..GRID * GRID).filter_map(cell).collect();
        Self { cells, camera: UVec2::new(camera.max_element(), camera.min_element()) }
    }
}

impl Cell {
    fn new(photo: &RgbImage, drawn: &RgbImage, pixels: impl Iterator<Item = usize>, r2: f32) -> Option<Self> {
        let light = linear_of_srgb8();
        let (mut sums, mut compared, mut all) = ([[0.0f32; 2]; 3], [0.0f32; 3], 0.0f32);
        for i in pixels {
            all += 1.0;
            if photo.alpha.as_ref().is_some_and(|alpha| alpha[i] < 128) {
                continue;
            }
            for c in 0..3 {
                let (a, b) = (photo.rgb[i][c], drawn.rgb[i][c]);
                if COMPARED.contains(&a) && COMPARED.contains(&b) {
                    sums[c][0] += light[usize::from(a)];
                    sums[c][1] += light[usize::from(b)];
                    compared[c] += 1.0;
                }
            }
        }
        let counts = |c: usize| compared[c] > 0.0 && compared[c] >= LEAST_SHARE * all;
        if !(0..3).any(counts) {
            return None;
        }
        let log = [0, 1, 2].map(|c| if counts(c) { (sums[c][0] / sums[c][1]).ln() } else { 0.0 });
        // An error of a code is a larger part of little light.
        let mean = |c: usize| (sums[c][0] * sums[c][1]).sqrt() / compared[c];
        let weight = [0, 1, 2].map(|c| if counts(c) { compared[c] / all * mean(c).powf(0.8) } else { 0.0 });
        Some(Self { log, weight, r2 })
    }
}

/// The exposures that best explain the differences between photos and drawings; a photo without cells has the
/// mean one.
pub fn solve(photos: &[Cells]) -> Solved {
    let mut gains: Vec<[f32; 3]> = photos.iter().map(Cells::start).collect();
    let mut falloff = vec![0.0f32; photos.len()];
    let mut errors = Vec::new();
    let mut cameras: Vec<[u32; 2]> = photos.iter().map(|photo| photo.camera.to_array()).collect();
    cameras.sort_unstable();
    cameras.dedup();
    for _ in 0..ROUNDS {
        let sums: Vec<[Sums; 3]> = (0..photos.len()).map(|i| photos[i].sums(gains[i], falloff[i])).collect();
        for camera in &cameras {
            let of_camera = || (0..photos.len()).filter(|i| photos[*i].camera.to_array() == *camera);
            let all = of_camera().flat_map(|i| &sums[i]);
            let (above, below) =
                all.fold((0.0, 0.0), |(above, below), s| (above - s.covariance(), below + s.variance()));
            let k = if below > 0.0 { (above / below) as f32 } else { 0.0 };
            of_camera().for_each(|i| falloff[i] = k);
        }
        for ((gains, sums), k) in gains.iter_mut().zip(&sums).zip(&falloff) {
            *gains = [0, 1, 2].map(|c: usize| sums[c].gain(*k));
        }
        errors = sums.iter().map(|sums| [0, 1, 2].map(|c: usize| sums[c].error())).collect();
    }
    for c in 0..3 {
        let known = || (0..photos.len()).filter(|i| errors[*i][c].is_finite());
        let sum: f64 = known().map(|i| f64::from(gains[i][c])).sum();
        let mean = (sum / known().count().max(1) as f64) as f32;
        for (gains, errors) in gains.iter_mut().zip(&errors) {
            gains[c] = if errors[c].is_finite() { gains[c] - mean } else { 0.0 };
        }
    }
    Solved { exposures: Exposures { gains, falloff }, errors }
}

impl Cells {
    /// The median of each channel.
    fn start(&self) -> [f32; 3] {
        [0, 1, 2].map(|c: usize| {
            let logs = self.cells.iter().filter(|cell| cell.weight[c] > 0.0).map(|cell| cell.log[c]);
            median(logs.collect(), f32::total_cmp).unwrap_or(0.0)
        })
    }

    /// Sums over the cells, with less weight for larger residuals of the last solution.
    fn sums(&self, gains: [f32; 3], falloff: f32) -> [Sums; 3] {
        [0, 1, 2].map(|c: usize| {
            let left = |cell: &Cell| cell.log[c] - gains[c] + falloff * cell.r2;
            let cells = || self.cells.iter().filter(|cell| cell.weight[c] > 0.0);
            let spread = median(cells().map(|cell| left(cell).abs()).collect(), f32::total_cmp);
            let scale = LEAST_SCALE.max(1.5 * spread.unwrap_or(0.0));
            let mut sums = Sums::default();
            cells().for_each(|cell| {
                let left = left(cell);
                sums.add(cell.weight[c] / (1.0 + (left / scale).powi(2)), cell.log[c], cell.r2, left);
            });
            sums
        })
    }
}

/// Weighted sums over the cells of a photo in one channel.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    one: f64,
    log: f64,
    r2: f64,
    r4: f64,
    log_r2: f64,
    /// Of squared weights and errors.
    square: f64,
}

impl Sums {
    fn add(&mut self, weight: f32, log: f32, r2: f32, left: f32) {
        let [w, log, r2, left] = [weight, log, r2, left].map(f64::from);
        self.one += w;
        self.log += w * log;
        self.r2 += w * r2;
        self.r4 += w * r2 * r2;
        self.log_r2 += w * log * r2;
        self.square += (w * left).powi(2);
    }

    /// Of r² within the photo.
    fn variance(&self) -> f64 {
        if self.one > 0.0 { self.r4 - self.r2 * self.r2 / self.one } else { 0.0 }
    }

    /// Of r² and the logarithm within the photo.
    fn covariance(&self) -> f64 {
        if self.one > 0.0 { self.log_r2 - self.log * self.r2 / self.one } else { 0.0 }
    }

    /// The gain for this falloff.
    fn gain(&self, falloff: f32) -> f32 {
        if self.one > 0.0 { ((self.log + f64::from(falloff) * self.r2) / self.one) as f32 } else { 0.0 }
    }

    /// The standard error of the gain; infinite without cells.
    fn error(&self) -> f32 {
        if self.one > 0.0 { DEPENDENCE * (self.square.sqrt() / self.one) as f32 } else { f32::INFINITY }
    }
}

/// Usable 8-bit codes: brighter ones are clipped, darker ones mostly noise.
const USEFUL: std::ops::RangeInclusive<u8> = 8..=247;
/// Fewest points that two photos share for a comparison.
const LEAST: usize = 20;
/// Photos that each photo of a point is compared with, at most.
const BESIDE: usize = 8;
/// Squared error of a median of one value, in squared median deviations.
const ERROR_OF_MEDIAN: f64 = 1.4826 * 1.4826 * std::f64::consts::FRAC_PI_2;

/// Brightness of a point in a photo.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Observation {
    photo: usize,
    point: usize,
    /// Stops.
    light: f64,
}

impl Observation {
    /// From an sRGB-encoded grey code; `None` outside the usable codes.
    pub(crate) fn of_code(photo: usize, point: usize, code: u8) -> Option<Self> {
        let encoded = f64::from(code) / 255.0;
        let linear =
            if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) };
        USEFUL.contains(&code).then(|| Self { photo, point, light: linear.log2() })
    }
}

/// Standard deviation of the photos' exposures, stops, by the points that two photos both show: errors of such pairs do not add up along
/// a chain of photos. `None` where no two photos share enough points.
pub(crate) fn spread_of_points(mut observations: Vec<Observation>) -> Option<f64> {
    observations.sort_by_key(|seen| (seen.point, seen.photo));
    let mut pairs: HashMap<[usize; 2], Vec<f64>> = HashMap::new();
    for (i, one) in observations.iter().enumerate() {
        for other in observations[i + 1..].iter().take_while(|other| other.point == one.point).take(BESIDE) {
            pairs.entry([one.photo, other.photo]).or_default().push(other.light - one.light);
        }
    }
    pairs.retain(|_, stops| stops.len() >= LEAST);
    // Of the square, less that of the error of the median.
    let variance = |stops: &Vec<f64>| {
        let apart = median(stops.clone(), f64::total_cmp).unwrap_or(0.0);
        let off = median(stops.iter().map(|stops| (stops - apart).abs()).collect(), f64::total_cmp);
        apart * apart - ERROR_OF_MEDIAN * off.unwrap_or(0.0).powi(2) / stops.len() as f64
    };
    let mut variances: Vec<([usize; 2], f64)> =
        pairs.iter().map(|(pair, stops)| (*pair, variance(stops))).collect();
    variances.sort_unstable_by_key(|one| one.0);
    let sum: f64 = variances.iter().map(|one| one.1).sum();
    // Two photos differ by twice the variance of one.
    (!variances.is_empty()).then(|| (sum / (2 * variances.len()) as f64).max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::Rng;
    use trisplat_scene::math::color::srgb_from_linear;

    /// A picture of `size` with light from 0.05 to 0.3, the same for every photo, as `gains` and `falloff` make it.
    fn picture(gains: [f32; 3], falloff: f32, noise: &Rng, size: UVec2) -> RgbImage {
        let rings = Rings::new(size);
        let pixel = |i: u32| {
            let (x, y) = ((i % size.x) as f32 + 0.5, (i / size.x) as f32 + 0.5);
            std::array::from_fn(|c| {
                let scene = 0.17 + 0.12 * (0.11 * x + c as f32).sin() * (0.07 * y).cos();
                let light = scene * (gains[c] - falloff * rings.square(Vec2::new(x, y))).exp();
                let code = 255.0 * srgb_from_linear(light) + noise.normal(u64::from(3 * i) + c as u64);
                code.round().clamp(0.0, 255.0) as u8
            })
        };
        RgbImage { size, rgb: (0..size.element_product()).map(pixel).collect(), alpha: None }
    }

    #[test]
    fn what_was_done_is_found() {
        let size = UVec2::new(160, 120);
        let truth: Vec<[f32; 3]> =
            vec![[0.5, 0.45, 0.4], [-0.3, -0.35, -0.2], [0.0, 0.1, -0.1], [-0.2, -0.2, -0.1]];
        let drawn = picture([0.0; 3], 0.0, &Rng::new(1, "drawn", 0), size);
        let photos: Vec<Cells> = (0..4)
            .map(|i| {
                let mut photo = picture(truth[i], 0.4, &Rng::new(1, "photo", i as u64), size);
                // Somebody walks by.
                for y in 30..60 {
                    photo.rgb[160 * y + 20 * i..160 * y + 20 * i + 30].fill([20, 200, 90]);
                }
                Cells::new(&photo, &drawn, size)
            })
            .collect();
        let solved = solve(&photos);
        for (i, truth) in truth.iter().enumerate() {
            for (c, truth) in truth.iter().enumerate() {
                let off = solved.exposures.gains[i][c] - truth;
                assert!(off.abs() < 0.01, "{i} {c}: {off}");
                assert!((1e-5..0.02).contains(&solved.errors[i][c]), "{}", solved.errors[i][c]);
            }
            assert!((solved.exposures.falloff[i] - 0.4).abs() < 0.02, "{:?}", solved.exposures.falloff);
        }
    }

    #[test]
    fn a_photo_that_shows_nothing_has_the_mean_gain() {
        let size = UVec2::new(64, 64);
        let black = RgbImage { size, rgb: vec![[0; 3]; 64 * 64], alpha: None };
        let grey = RgbImage { rgb: vec![[100; 3]; 64 * 64], ..black.clone() };
        let solved = solve(&[Cells::new(&black, &grey, size), Cells::new(&grey, &grey, size)]);
        assert_eq!(solved.exposures.gains, [[0.0; 3]; 2]);
        assert!(solved.errors[0][0].is_infinite() && solved.errors[1][0].is_finite());
        assert_eq!(solve(&[]), Solved::default());
    }

    /// Photos with these stops in a chain, each sharing points with its neighbours, whose light differs by `noise`.
    fn chain(truth: &[f64], noise: f64) -> Vec<Observation> {
        let rng = Rng::new(3, "chain", 0);
        let light = |(photo, stops): (usize, &f64)| {
            let stops = *stops;
            let noise = |i| noise * f64::from(rng.normal(i));
            (30 * photo..30 * photo + 120).map(move |point| {
                let light = -4.0 + (point as f64 * 0.37).sin() + stops + noise((200 * photo + point) as u64);
                Observation { photo, point, light }
            })
        };
        truth.iter().enumerate().flat_map(light).collect()
    }

    #[test]
    fn the_spread_of_exposures_is_found_and_drift_is_none() {
        let truth: Vec<f64> = (0..40).map(|i| 0.4 * f64::from(i % 4)).collect();
        // The standard deviation of 0, 0.4, 0.8, 1.2.
        for noise in [0.0, 0.3] {
            let found = spread_of_points(chain(&truth, noise)).unwrap();
            assert!((found - 0.447).abs() < 0.1, "{noise}: {found}");
            assert!(spread_of_points(chain(&[0.0; 40], noise)).unwrap() < 0.02);
        }
        // Each pair is off by 0.04 stops, which makes 1.6 along the chain.
        let drift: Vec<f64> = (0..40).map(|i| 0.04 * f64::from(i)).collect();
        assert!(spread_of_points(chain(&drift, 0.1)).unwrap() < 0.1);
        assert_eq!(spread_of_points(chain(&[0.0], 0.1)), None);
        assert!(Observation::of_code(0, 0, 255).is_none() && Observation::of_code(0, 0, 0).is_none());
        let stops = |code| Observation::of_code(0, 0, code).unwrap().light;
        assert!((stops(188) - stops(137) - 1.0).abs() < 0.02, "twice the light");
    }
}
