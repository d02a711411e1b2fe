//! Gains and falloff from the light of photos: at points that several photos show, or beside drawings of the scene.
//!
//! The light of a photo is photo + place - falloff · r², as logarithms. Photos, points and falloff are solved for in turn, channel by
//! channel, with less weight for what shines, moves or does not match. Beside a drawing, the light of the place is known.
//! Gains may drift along a chain of photos, so how far photos differ is measured between pairs that show the same points.

use super::correction::{Exposures, Rings, Solved};
use crate::posed::{Dataset, Point, View};
use glam::{UVec2, Vec2};
use std::collections::{BTreeMap, HashMap};
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::linear_of_srgb8;
use trisplat_scene::math::lists::{Sets, median};

/// Cells along each side of a picture.
const GRID: u32 = 16;
/// Range of compared codes: smaller ones are noise, larger ones may be saturated.
const COMPARED: std::ops::RangeInclusive<u8> = 8..=247;
/// Least share of compared pixels in a cell.
const LEAST_SHARE: f32 = 0.5;
/// Rounds of new weights, and of solving in each.
const ROUNDS: [usize; 2] = [10, 8];
/// Least residual that halves a light's weight, as a logarithm.
const LEAST_SCALE: f32 = 0.02;
/// Errors beside drawings are larger than for independent cells by this factor, because neighbouring cells correlate, most of
/// all in an untrained scene.
const DEPENDENCE: f32 = 4.0;
/// Fewest points that two photos share for a comparison.
const LEAST: usize = 20;
/// Photos that each photo of a point is compared with, at most.
const BESIDE: usize = 8;
/// Squared error of a median of one value, in squared median deviations.
const ERROR_OF_MEDIAN: f32 = 1.4826 * 1.4826 * std::f32::consts::FRAC_PI_2;
/// Lights at points that are solved for; more are thinned.
const MOST: usize = 150_000;
/// The number of a place whose light is known.
const DRAWN: u32 = u32::MAX;

/// The light of a photo at a place.
#[derive(Debug, Clone, Copy)]
pub struct Light {
    point: u32,
    /// Its logarithm, per channel; beside a drawing, less that of the drawing.
    log: [f32; 3],
    weight: [f32; 3],
    /// Squared distance from the middle of the photo, 1 in its corners.
    r2: f32,
}

impl Light {
    /// The light of points, by their numbers and their places as shares of the width and height of `photo`. Masked, clipped and dark ones
    /// are left out.
    pub fn at_points(photo: &RgbImage, points: &[(u32, Vec2)]) -> Vec<Self> {
        let (light, rings, size) = (linear_of_srgb8(), Rings::new(photo.size), photo.size.as_vec2());
        let read = |(point, share): &(u32, Vec2)| {
            let place = (*share * size).clamp(Vec2::ZERO, size - 1.0);
            let i = (place.as_uvec2().y * photo.size.x + place.as_uvec2().x) as usize;
            let is_masked = photo.alpha.as_ref().is_some_and(|alpha| alpha[i] < 128);
            let useful = !is_masked && photo.rgb[i].iter().all(|code| COMPARED.contains(code));
            let log = photo.rgb[i].map(|code| light[usize::from(code)].ln());
            useful.then(|| Self { point: *point, log, weight: [1.0; 3], r2: rings.square(place) })
        };
        points.iter().filter_map(read).collect()
    }

    /// The light of cells beside that of a drawing of the same size, as a ratio of sums, which noise and small displacements hardly change.
    pub fn beside_drawing(photo: &RgbImage, drawn: &RgbImage) -> Vec<Self> {
        let (size, rings) = (photo.size, Rings::new(photo.size));
        let side = |i: u32, all: u32| (i * all / GRID, (i + 1) * all / GRID);
        let cell = |k: u32| {
            let ((left, right), (top, bottom)) = (side(k % GRID, size.x), side(k / GRID, size.y));
            let pixels = (top..bottom).flat_map(|y| (left..right).map(move |x| (y * size.x + x) as usize));
            let r2 = rings.square(Vec2::new((left + right) as f32, (top + bottom) as f32) / 2.0);
            Self::of_cell(photo, drawn, pixels, r2)
        };
        (0..GRID * GRID).filter_map(cell).collect()
    }

    fn of_cell(
        photo: &RgbImage,
        drawn: &RgbImage,
        pixels: impl Iterator<Item = usize>,
        r2: f32,
    ) -> Option<Self> {
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
        Some(Self { point: DRAWN, log, weight, r2 })
    }
}

/// The points that each training photo tracks, and their places as shares of its width and height; `None` where too few photos track points
/// to compare them.
pub fn compared_points(dataset: &Dataset) -> Option<Vec<Vec<(u32, Vec2)>>> {
    let photos = || dataset.train().filter(|view| !view.photo.is_drawn());
    let tracked = photos().filter(|view| view.tracked.len() >= LEAST).count();
    let of_view = |view: &View| {
        let camera = &view.camera;
        let shown = dataset.tracked(view).filter(|(i, _)| !Dataset::judges_depth(*i));
        let place = |(i, point): (usize, &Point)| {
            Some((i as u32, camera.shows(point.position)?.0 / camera.size.as_vec2()))
        };
        shown.filter_map(place).collect()
    };
    (tracked > 0 && 10 * tracked >= 9 * photos().count()).then(|| dataset.train().map(of_view).collect())
}

/// The exposures that best explain the light of photos whose cameras have these sizes, all at points or all beside drawings; a photo without
/// light has the mean one. Photos of one size share a camera.
pub fn solve(photos: &[Vec<Light>], cameras: &[UVec2]) -> Solved {
    let all: usize = photos.iter().map(Vec::len).sum();
    let stride = (all / MOST + 1) as u32;
    let (mut numbers, mut seen) = (HashMap::from([(DRAWN, 0)]), Vec::new());
    for (photo, lights) in photos.iter().enumerate() {
        for light in lights.iter().filter(|light| light.point == DRAWN || light.point.is_multiple_of(stride))
        {
            let next = numbers.len();
            seen.push(Seen { photo, place: *numbers.entry(light.point).or_insert(next), light: *light });
        }
    }
    let upright = |size: &UVec2| UVec2::new(size.max_element(), size.min_element());
    let first = |camera: &UVec2| cameras.iter().position(|other| upright(other) == upright(camera));
    let kinds: Vec<usize> = cameras.iter().map(|camera| first(camera).unwrap_or(0)).collect();
    let by_points = numbers.len() > 1;
    let spread = by_points.then(|| spread(photos)).flatten();
    let (mut gains, mut errors) = (vec![[0.0f32; 3]; photos.len()], vec![[f32::INFINITY; 3]; photos.len()]);
    let mut falloff = vec![0.0f32; photos.len()];
    for c in 0..if by_points && spread.is_none() { 0 } else { 3 } {
        let channel = Channel::solve(&seen, c, &kinds, numbers.len());
        let dependence = if by_points { 1.0 } else { DEPENDENCE };
        for (photo, error) in channel.errors().into_iter().enumerate() {
            (gains[photo][c], errors[photo][c]) = (channel.photos[photo], dependence * error);
            falloff[photo] += channel.falloff[kinds[photo]] / 3.0;
        }
        let known = || (0..photos.len()).filter(|i| errors[*i][c].is_finite());
        let sum: f64 = known().map(|i| f64::from(gains[i][c])).sum();
        let mean = (sum / known().count().max(1) as f64) as f32;
        for (gains, errors) in gains.iter_mut().zip(&errors) {
            gains[c] = if errors[c].is_finite() { gains[c] - mean } else { 0.0 };
        }
    }
    Solved { exposures: Exposures { gains, falloff }, errors, spread }
}

/// A light, its photo, and the number of its place: 0 beside drawings.
struct Seen {
    photo: usize,
    place: usize,
    light: Light,
}

/// The unknowns of a channel.
struct Channel<'a> {
    seen: &'a [Seen],
    c: usize,
    photos: Vec<f32>,
    places: Vec<f32>,
    /// By the kind of a photo's camera.
    falloff: Vec<f32>,
    kinds: &'a [usize],
    /// Of each light.
    weights: Vec<f64>,
}

impl<'a> Channel<'a> {
    fn solve(seen: &'a [Seen], c: usize, kinds: &'a [usize], places: usize) -> Self {
        let weights = seen.iter().map(|seen| f64::from(seen.light.weight[c])).collect();
        let (photos, falloff) = (vec![0.0; kinds.len()], vec![0.0; kinds.len()]);
        let mut channel = Self { seen, c, photos, places: vec![0.0; places], falloff, kinds, weights };
        channel.places = channel.means(places, |seen| (seen.place, seen.light.log[c]));
        channel.places[0] = 0.0;
        for _ in 0..ROUNDS[0] {
            (0..ROUNDS[1]).for_each(|_| channel.improve());
            channel.weigh();
        }
        channel
    }

    /// Weighted means of a value, by an index.
    fn means(&self, count: usize, value: impl Fn(&Seen) -> (usize, f32)) -> Vec<f32> {
        let mut sums = vec![[0.0f64; 2]; count];
        for (seen, weight) in self.seen.iter().zip(&self.weights) {
            let (index, value) = value(seen);
            sums[index] = [sums[index][0] + weight * f64::from(value), sums[index][1] + weight];
        }
        sums.iter().map(|[sum, weight]| if *weight > 0.0 { (sum / weight) as f32 } else { 0.0 }).collect()
    }

    /// What the unknowns leave of a light.
    fn left(&self, Seen { photo, place, light }: &Seen) -> f32 {
        light.log[self.c] - self.photos[*photo] - self.places[*place]
            + self.falloff[self.kinds[*photo]] * light.r2
    }

    fn improve(&mut self) {
        self.photos =
            self.means(self.photos.len(), |seen| (seen.photo, self.left(seen) + self.photos[seen.photo]));
        self.places =
            self.means(self.places.len(), |seen| (seen.place, self.left(seen) + self.places[seen.place]));
        self.places[0] = 0.0;
        // How the rest grows with r², within a point or beside a drawing.
        let of_place = self.means(self.places.len(), |seen| (seen.place, seen.light.r2));
        let of_photo = self.means(self.photos.len(), |seen| (seen.photo, seen.light.r2));
        let mut sums = vec![[0.0f64; 2]; self.falloff.len()];
        for (seen, weight) in self.seen.iter().zip(&self.weights) {
            let middle = if seen.place == 0 { of_photo[seen.photo] } else { of_place[seen.place] };
            let [apart, left] = [seen.light.r2 - middle, self.left(seen)].map(f64::from);
            let sum = &mut sums[self.kinds[seen.photo]];
            *sum = [sum[0] - weight * apart * left, sum[1] + weight * apart * apart];
        }
        for (falloff, [above, below]) in self.falloff.iter_mut().zip(sums) {
            *falloff += if below > 0.0 { (above / below) as f32 } else { 0.0 };
        }
    }

    /// Less weight for larger residuals.
    fn weigh(&mut self) {
        let weight = |seen: &Seen| seen.light.weight[self.c];
        let left: Vec<f32> = self.seen.iter().map(|seen| self.left(seen)).collect();
        let counted = left.iter().zip(self.seen).filter(|(_, seen)| weight(seen) > 0.0);
        let usual = median(counted.map(|(left, _)| left.abs()).collect(), f32::total_cmp);
        let scale = LEAST_SCALE.max(1.5 * usual.unwrap_or(0.0));
        let weigh = |(seen, left): (&Seen, f32)| f64::from(weight(seen) / (1.0 + (left / scale).powi(2)));
        self.weights = self.seen.iter().zip(left).map(weigh).collect();
    }

    /// Standard errors of the photos' gains; infinite without light.
    fn errors(&self) -> Vec<f32> {
        let mut sums = vec![[0.0f64; 2]; self.photos.len()];
        for (seen, weight) in self.seen.iter().zip(&self.weights) {
            let sum = &mut sums[seen.photo];
            *sum = [sum[0] + (weight * f64::from(self.left(seen))).powi(2), sum[1] + weight];
        }
        let error =
            |[square, sum]: [f64; 2]| if sum > 0.0 { (square.sqrt() / sum) as f32 } else { f32::INFINITY };
        sums.into_iter().map(error).collect()
    }
}

/// Standard deviation of the photos' exposures, as a logarithm, by the points that two photos both show: errors of such pairs do not add up
/// along a chain of photos. What one gain a photo cannot explain is shine: around a loop of pairs, differences of exposure add up to zero.
/// `None` where photos share too few points, or their pairs close no loop.
pub(crate) fn spread(photos: &[Vec<Light>]) -> Option<f32> {
    spread_of(&pairs(photos), photos.len())
}

fn spread_of(pairs: &[Pair], photos: usize) -> Option<f32> {
    let left = unexplained(pairs, photos);
    let mut tied = Sets::new(photos);
    let mut closes = |pair: &&Pair| {
        let [one, other] = pair.photos.map(|photo| photo as u32);
        let closes = tied.first(one) == tied.first(other);
        tied.join(one, other);
        closes
    };
    let loops = pairs.iter().filter(&mut closes).count();
    let mean = |sum: f64| sum / pairs.len() as f64;
    let of_shine = left.iter().map(|left| left.powi(2)).sum::<f64>() / loops as f64;
    // Errors are a part of what is left, except what a photo has in common with all beside it.
    let of_errors = mean(pairs.iter().map(|pair| pair.error).sum());
    let variance = mean(pairs.iter().map(|pair| pair.apart.powi(2)).sum()) - of_shine.max(of_errors);
    // Two photos differ by twice the variance of one.
    (loops > 0).then(|| (variance / 2.0).max(0.0).sqrt() as f32)
}

/// Two photos that show the same points, and the median of how much more light the second shows, as a logarithm.
struct Pair {
    photos: [usize; 2],
    apart: f64,
    /// The variance of that median.
    error: f64,
}

impl Pair {
    /// `None` where the photos share too few points.
    fn new(photos: [usize; 2], apart: Vec<f32>) -> Option<Self> {
        if apart.len() < LEAST {
            return None;
        }
        let middle = median(apart.clone(), f32::total_cmp)?;
        let off = median(apart.iter().map(|apart| (apart - middle).abs()).collect(), f32::total_cmp)?;
        let error = ERROR_OF_MEDIAN * off.powi(2) / apart.len() as f32;
        Some(Self { photos, apart: middle.into(), error: error.into() })
    }
}

fn pairs(photos: &[Vec<Light>]) -> Vec<Pair> {
    let lights =
        photos.iter().enumerate().flat_map(|(photo, lights)| lights.iter().map(move |light| (photo, light)));
    let mut seen: Vec<(u32, usize, f32)> =
        lights.map(|(photo, light)| (light.point, photo, light.log.iter().sum::<f32>() / 3.0)).collect();
    seen.sort_by_key(|(point, photo, _)| (*point, *photo));
    let mut all: BTreeMap<[usize; 2], Vec<f32>> = BTreeMap::new();
    for (i, (point, one, light)) in seen.iter().enumerate() {
        for (_, other, its) in seen[i + 1..].iter().take_while(|other| other.0 == *point).take(BESIDE) {
            all.entry([*one, *other]).or_default().push(its - light);
        }
    }
    all.into_iter().filter_map(|(photos, apart)| Pair::new(photos, apart)).collect()
}

/// What the gains of `photos` photos that best explain the pairs leave of each: least squares, by conjugate gradients.
fn unexplained(pairs: &[Pair], photos: usize) -> Vec<f64> {
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let of_pairs = |gains: &[f64]| -> Vec<f64> {
        pairs.iter().map(|Pair { photos: [one, other], .. }| gains[*other] - gains[*one]).collect()
    };
    let of_photos = |apart: &[f64]| {
        let mut sums = vec![0.0; photos];
        for (Pair { photos: [one, other], .. }, apart) in pairs.iter().zip(apart) {
            sums[*one] -= apart;
            sums[*other] += apart;
        }
        sums
    };
    let mut left: Vec<f64> = pairs.iter().map(|pair| pair.apart).collect();
    let mut slope = of_photos(&left);
    let (mut way, mut steep) = (slope.clone(), product(&slope, &slope));
    let enough = 1e-12 * steep;
    for _ in 0..photos {
        if steep <= enough {
            break;
        }
        let change = of_pairs(&way);
        let far = steep / product(&change, &change);
        left.iter_mut().zip(change).for_each(|(left, change)| *left -= far * change);
        slope = of_photos(&left);
        let before = std::mem::replace(&mut steep, product(&slope, &slope));
        way.iter_mut().zip(&slope).for_each(|(way, slope)| *way = slope + steep / before * *way);
    }
    left
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
        let lights: Vec<Vec<Light>> = (0..4)
            .map(|i| {
                let mut photo = picture(truth[i], 0.4, &Rng::new(1, "photo", i as u64), size);
                // Somebody walks by.
                for y in 30..60 {
                    photo.rgb[160 * y + 20 * i..160 * y + 20 * i + 30].fill([20, 200, 90]);
                }
                Light::beside_drawing(&photo, &drawn)
            })
            .collect();
        let solved = solve(&lights, &[size; 4]);
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
        let lights = [&black, &grey].map(|photo| Light::beside_drawing(photo, &grey));
        let solved = solve(&lights, &[size; 2]);
        assert_eq!(solved.exposures.gains, [[0.0; 3]; 2]);
        assert!(solved.errors[0][0].is_infinite() && solved.errors[1][0].is_finite());
        assert_eq!(solve(&[], &[]), Solved::default());
    }

    /// Photos with these exposures in a chain, each sharing points with its neighbours, whose light differs by `noise`.
    fn chain(truth: &[f32], noise: f32) -> Vec<Vec<Light>> {
        let rng = Rng::new(3, "chain", 0);
        let light = |(photo, exposure): (usize, &f32)| {
            let light = |point: usize| {
                let noise = noise * rng.normal((200 * photo + point) as u64);
                let log = -3.0 + 0.7 * (point as f32 * 0.37).sin() + exposure + noise;
                Light { point: point as u32, log: [log; 3], weight: [1.0; 3], r2: (point % 7) as f32 / 7.0 }
            };
            (30 * photo..30 * photo + 120).map(light).collect()
        };
        truth.iter().enumerate().map(light).collect()
    }

    #[test]
    fn the_spread_of_exposures_is_found_and_drift_is_none() {
        let solved = |truth: &[f32], noise| solve(&chain(truth, noise), &vec![UVec2::ONE; truth.len()]);
        let truth: Vec<f32> = (0..40).map(|i| 0.3 * (i % 4) as f32).collect();
        // The standard deviation of 0, 0.3, 0.6, 0.9.
        for noise in [0.0, 0.2] {
            let found = solved(&truth, noise);
            assert!((found.spread.unwrap() - 0.335).abs() < 0.07, "{noise}: {:?}", found.spread);
            // Within a tenth of a stop; errors of the noise add up along a chain.
            let off = |i: usize| found.exposures.gains[i][1] - truth[i] + 0.45;
            let stops = |log: f32| log / std::f32::consts::LN_2;
            assert!(noise > 0.0 || (0..40).all(|i| stops(off(i)).abs() < 0.1), "{:?}", found.exposures.gains);
            assert!(solved(&[0.0; 40], noise).spread.unwrap() < 0.02);
        }
        // Each pair is off by 0.03, which makes 1.2 along the chain.
        let drift: Vec<f32> = (0..40).map(|i| 0.03 * i as f32).collect();
        assert!(solved(&drift, 0.1).spread.unwrap() < 0.07);
        // What each pair sees otherwise is no exposure: a third photo contradicts it.
        let shine = |a: usize, b: usize| if (a + b).is_multiple_of(2) { 0.3 } else { -0.3 };
        let pair = |a: usize, b: usize, apart| Pair { photos: [a, b], apart, error: 0.0 };
        let all = (0..12).flat_map(|b| (0..b).map(move |a| (a, b)));
        let shining: Vec<Pair> = all.clone().map(|(a, b)| pair(a, b, shine(a, b))).collect();
        let gain = |photo: usize| 0.3 * (photo % 2) as f64;
        let exposed: Vec<Pair> = all.map(|(a, b)| pair(a, b, gain(b) - gain(a))).collect();
        assert!(
            spread_of(&shining, 12).unwrap() < 0.1 && (spread_of(&exposed, 12).unwrap() - 0.15).abs() < 0.02
        );
        assert!(spread_of(&[pair(0, 1, 0.3), pair(1, 2, -0.3)], 3).is_none(), "no loop tells");
        let alone = solved(&[0.0], 0.1);
        assert!(alone.spread.is_none() && alone.errors[0][0].is_infinite(), "{alone:?}");
    }

    #[test]
    fn clipped_and_masked_points_have_no_light() {
        let rgb = vec![[255; 3], [100, 2, 100], [100; 3], [50; 3]];
        let photo = RgbImage { size: UVec2::new(2, 2), rgb, alpha: Some(vec![255, 255, 0, 255]) };
        let places = [(0, [0.2, 0.2]), (1, [0.7, 0.2]), (2, [0.2, 0.7]), (3, [0.999, 1.0])];
        let lights = Light::at_points(&photo, &places.map(|(point, at)| (point, Vec2::from(at))));
        assert_eq!(lights.iter().map(|light| light.point).collect::<Vec<_>>(), [3]);
    }
}
