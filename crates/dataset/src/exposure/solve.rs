//! Gains and falloff from the light of photos at points that several photos show.
//!
//! The light of a photo is photo + point - falloff · r², as logarithms. Photos, points and falloff
//! are solved for in turn, channel by channel, with less weight for what shines, moves or does not
//! match.

use super::correction::{Exposures, Solved};
use super::light::{Light, MIN_POINTS};
use super::relative::beside_others;
use glam::UVec2;
use std::collections::HashMap;
use trisplat_scene::math::lists::{Sets, median};

/// Rounds of new weights, and of solving in each.
const ROUNDS: [usize; 2] = [10, 8];
/// Minimum residual that halves a light's weight, as a logarithm.
const MIN_SCALE: f32 = 0.02;
/// Minimum photos of one camera for a falloff of its own; cameras of fewer photos share one.
const MIN_PHOTOS_PER_CAMERA: usize = 4;
/// Minimum standard deviation of r² within points and photos for an estimate of the falloff: where
/// all points of each photo lie at one radius, falloff and gain are the same.
const MIN_RADII: f64 = 0.03;
/// Largest believed gain, and inverse of the smallest: three stops.
const MAX_GAIN: f32 = 8.0;
/// Lights at points that are solved for; more are thinned.
const MAX_OBSERVATIONS: usize = 150_000;

/// The exposures that best explain the light of photos at points, for cameras of these sizes;
/// photos of one size share a camera. A photo has the mean gain and an infinite error where it
/// shares too few points with most of the others, or where its gain is beyond three stops.
pub fn solve(photos: &[Vec<Light>], cameras: &[UVec2]) -> Solved {
    let all: usize = photos.iter().map(Vec::len).sum();
    let stride = (all / MAX_OBSERVATIONS + 1) as u32;
    let mut numbers = HashMap::new();
    let mut samples = Vec::new();
    for (photo, lights) in photos.iter().enumerate() {
        for light in lights.iter().filter(|light| light.point.is_multiple_of(stride)) {
            let next = numbers.len();
            samples.push(LightSample {
                photo,
                point: *numbers.entry(light.point).or_insert(next),
                light: *light,
            });
        }
    }
    let kinds = kinds(cameras);
    let mut solution = Solved {
        exposures: Exposures {
            gains: vec![[0.0; 3]; photos.len()],
            falloff: vec![0.0; photos.len()],
        },
        errors: vec![[f32::INFINITY; 3]; photos.len()],
        beside_others: Vec::new(),
        falloff_beside_others: radii_beside_others(&samples, photos.len(), numbers.len()),
    };
    let is_connected = connected_photos(&samples, photos.len(), numbers.len());
    for c in 0..3 {
        let channel = Channel::solve(&samples, c, &kinds, numbers.len());
        for (photo, error) in channel.errors().into_iter().enumerate() {
            solution.exposures.falloff[photo] += channel.falloff[kinds[photo]] / 3.0;
            if is_connected[photo] {
                solution.exposures.gains[photo][c] = channel.photos[photo];
                solution.errors[photo][c] = error;
            }
        }
    }
    solution.leave_out_impossible();
    let is_known: Vec<bool> = solution.errors.iter().map(|errors| errors[0].is_finite()).collect();
    let gains = &solution.exposures.gains;
    let relative = beside_others(photos, gains, gains, &is_known);
    solution.beside_others = relative.into_iter().map(Option::unwrap_or_default).collect();
    solution
}

/// Slope of r² less its mean over other photos at the same point on r², within photos; 0 where no
/// point is in several.
fn radii_beside_others(samples: &[LightSample], photos: usize, points: usize) -> f32 {
    let mut of_point = vec![[0.0f64; 2]; points];
    let mut of_photo = vec![[0.0f64; 3]; photos];
    for LightSample { point, light, .. } in samples {
        let [sum, count] = of_point[*point];
        of_point[*point] = [sum + f64::from(light.r2), count + 1.0];
    }
    let relative_r2 = |LightSample { point, light, .. }: &LightSample| {
        let [sum, count] = of_point[*point];
        let r2 = f64::from(light.r2);
        (count > 1.5).then(|| [r2, r2 - (sum - r2) / (count - 1.0)])
    };
    for sample in samples {
        if let Some([r2, rest]) = relative_r2(sample) {
            let [a, b, count] = of_photo[sample.photo];
            of_photo[sample.photo] = [a + r2, b + rest, count + 1.0];
        }
    }
    let mut product = 0.0;
    let mut square = 0.0;
    for sample in samples {
        if let Some([r2, rest]) = relative_r2(sample) {
            let [a, b, count] = of_photo[sample.photo];
            product += (r2 - a / count) * (rest - b / count);
            square += (r2 - a / count).powi(2);
        }
    }
    if square > 0.0 { (product / square) as f32 } else { 0.0 }
}

/// The number of each photo's camera, by its size: 0 for cameras of few photos.
fn kinds(cameras: &[UVec2]) -> Vec<usize> {
    let upright: Vec<UVec2> =
        cameras.iter().map(|size| UVec2::new(size.max_element(), size.min_element())).collect();
    let count = |size: &UVec2| upright.iter().filter(|other| *other == size).count();
    let first = |size: &UVec2| upright.iter().position(|other| other == size).unwrap_or(0);
    let kind =
        |size: &UVec2| if count(size) >= MIN_PHOTOS_PER_CAMERA { 1 + first(size) } else { 0 };
    upright.iter().map(kind).collect()
}

/// True for each photo that tracks enough points and is connected by them to most of the others:
/// between separate groups of photos gains say nothing.
fn connected_photos(samples: &[LightSample], photos: usize, points: usize) -> Vec<bool> {
    let mut groups = Sets::new(photos + points);
    let mut counts = vec![0; photos];
    for LightSample { photo, point, .. } in samples {
        groups.join(*photo as u32, (photos + point) as u32);
        counts[*photo] += 1;
    }
    let group: Vec<u32> = (0..photos as u32).map(|photo| groups.first(photo)).collect();
    let mut sizes = vec![0; photos + points];
    for group in &group {
        sizes[*group as usize] += 1;
    }
    let largest = (0..sizes.len()).rev().max_by_key(|group| sizes[*group]).unwrap_or(0) as u32;
    (0..photos).map(|photo| group[photo] == largest && counts[photo] >= MIN_POINTS).collect()
}

impl Solved {
    /// Subtracts the mean gain; photos whose gain is beyond [`MAX_GAIN`] become unknown first.
    fn leave_out_impossible(&mut self) {
        let gains = &mut self.exposures.gains;
        for c in 0..3 {
            let is_known = |errors: &[f32; 3]| errors.iter().all(|error| error.is_finite());
            let known_gains = gains.iter().zip(&self.errors).filter(|(_, errors)| is_known(errors));
            let middle = median(known_gains.map(|(gains, _)| gains[c]).collect(), f32::total_cmp)
                .unwrap_or(0.0);
            for (gains, errors) in gains.iter().zip(&mut self.errors) {
                if !((gains[c] - middle).abs() <= MAX_GAIN.ln()) {
                    *errors = [f32::INFINITY; 3];
                }
            }
        }
        let known_photos: Vec<usize> =
            (0..gains.len()).filter(|i| self.errors[*i][0].is_finite()).collect();
        for c in 0..3 {
            let sum: f64 = known_photos.iter().map(|i| f64::from(gains[*i][c])).sum();
            let mean = (sum / known_photos.len().max(1) as f64) as f32;
            for (gains, errors) in gains.iter_mut().zip(&self.errors) {
                gains[c] = if errors[0].is_finite() { gains[c] - mean } else { 0.0 };
            }
        }
        let falloff = &mut self.exposures.falloff;
        for falloff in falloff.iter_mut().filter(|falloff| !(falloff.abs() <= MAX_GAIN.ln())) {
            *falloff = 0.0;
        }
    }
}

/// A light, its photo, and the number of its point.
struct LightSample {
    photo: usize,
    point: usize,
    light: Light,
}

/// The unknowns of a channel.
struct Channel<'a> {
    samples: &'a [LightSample],
    c: usize,
    photos: Vec<f32>,
    points: Vec<f32>,
    /// By the kind of a photo's camera.
    falloff: Vec<f32>,
    kinds: &'a [usize],
    /// Of each light.
    weights: Vec<f64>,
    /// True for each kind of camera whose falloff can be told from gains.
    has_radii: Vec<bool>,
}

impl<'a> Channel<'a> {
    fn solve(samples: &'a [LightSample], c: usize, kinds: &'a [usize], points: usize) -> Self {
        let cameras = kinds.len() + 1;
        let mut channel = Self {
            samples,
            c,
            photos: vec![0.0; kinds.len()],
            points: vec![0.0; points],
            falloff: vec![0.0; cameras],
            kinds,
            weights: samples.iter().map(|sample| f64::from(sample.light.weight[c])).collect(),
            has_radii: vec![false; cameras],
        };
        channel.points = channel.means(points, |sample| (sample.point, sample.light.log[c]));
        channel.has_radii = channel.has_radii();
        for _ in 0..ROUNDS[0] {
            for _ in 0..ROUNDS[1] {
                channel.improve();
            }
            channel.weigh();
        }
        channel
    }

    /// True for each kind of camera whose r² differs within points and photos.
    fn has_radii(&self) -> Vec<bool> {
        let of_point = self.means(self.points.len(), |sample| (sample.point, sample.light.r2));
        let r2_in_point = |sample: &LightSample| sample.light.r2 - of_point[sample.point];
        let of_photo = self.means(self.photos.len(), |sample| (sample.photo, r2_in_point(sample)));
        let mut sums = vec![[0.0f64; 2]; self.falloff.len()];
        for (sample, weight) in self.samples.iter().zip(&self.weights) {
            let rest = f64::from(r2_in_point(sample) - of_photo[sample.photo]);
            let sum = &mut sums[self.kinds[sample.photo]];
            *sum = [sum[0] + weight * rest * rest, sum[1] + weight];
        }
        sums.iter().map(|[square, weight]| *square > MIN_RADII.powi(2) * weight).collect()
    }

    /// Weighted means of a value, by an index.
    fn means(&self, count: usize, value: impl Fn(&LightSample) -> (usize, f32)) -> Vec<f32> {
        let mut sums = vec![[0.0f64; 2]; count];
        for (sample, weight) in self.samples.iter().zip(&self.weights) {
            let (index, value) = value(sample);
            sums[index] = [sums[index][0] + weight * f64::from(value), sums[index][1] + weight];
        }
        sums.iter()
            .map(|[sum, weight]| if *weight > 0.0 { (sum / weight) as f32 } else { 0.0 })
            .collect()
    }

    /// Residual of a light.
    fn residual(&self, LightSample { photo, point, light }: &LightSample) -> f32 {
        light.log[self.c] - self.photos[*photo] - self.points[*point]
            + self.falloff[self.kinds[*photo]] * light.r2
    }

    fn improve(&mut self) {
        self.photos = self.means(self.photos.len(), |sample| {
            (sample.photo, self.residual(sample) + self.photos[sample.photo])
        });
        self.points = self.means(self.points.len(), |sample| {
            (sample.point, self.residual(sample) + self.points[sample.point])
        });
        // Growth of the residual with r², within a point.
        let of_point = self.means(self.points.len(), |sample| (sample.point, sample.light.r2));
        let mut sums = vec![[0.0f64; 2]; self.falloff.len()];
        for (sample, weight) in self.samples.iter().zip(&self.weights) {
            let [r2, residual] =
                [sample.light.r2 - of_point[sample.point], self.residual(sample)].map(f64::from);
            let sum = &mut sums[self.kinds[sample.photo]];
            *sum = [sum[0] - weight * r2 * residual, sum[1] + weight * r2 * r2];
        }
        for ((falloff, [above, below]), has_radii) in
            self.falloff.iter_mut().zip(sums).zip(&self.has_radii)
        {
            *falloff += if *has_radii && below > 0.0 { (above / below) as f32 } else { 0.0 };
        }
    }

    /// Less weight for larger residuals.
    fn weigh(&mut self) {
        let weight = |sample: &LightSample| sample.light.weight[self.c];
        let residuals: Vec<f32> = self.samples.iter().map(|sample| self.residual(sample)).collect();
        let counted = residuals.iter().zip(self.samples).filter(|(_, sample)| weight(sample) > 0.0);
        let median_residual =
            median(counted.map(|(residual, _)| residual.abs()).collect(), f32::total_cmp);
        let scale = MIN_SCALE.max(1.5 * median_residual.unwrap_or(0.0));
        let weigh = |(sample, residual): (&LightSample, f32)| {
            f64::from(weight(sample) / (1.0 + (residual / scale).powi(2)))
        };
        self.weights = self.samples.iter().zip(residuals).map(weigh).collect();
    }

    /// Standard errors of the photos' gains; infinite without light.
    fn errors(&self) -> Vec<f32> {
        let mut sums = vec![[0.0f64; 2]; self.photos.len()];
        for (sample, weight) in self.samples.iter().zip(&self.weights) {
            let sum = &mut sums[sample.photo];
            *sum = [sum[0] + (weight * f64::from(self.residual(sample))).powi(2), sum[1] + weight];
        }
        let error = |[square, sum]: [f64; 2]| {
            if sum > 0.0 { (square.sqrt() / sum) as f32 } else { f32::INFINITY }
        };
        sums.into_iter().map(error).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::correction::Strengths;
    use super::*;
    use trisplat_scene::Rng;

    /// The lights of `truth.len()` photos that all show the same 400 points, at other places of
    /// each.
    fn lights(
        truth: &[[f32; 3]],
        falloff: f32,
        radius: impl Fn(usize, usize) -> f32,
    ) -> Vec<Vec<Light>> {
        let rng = Rng::new(3, "lights", 0);
        let light = |photo: usize, point: usize| {
            let r2 = radius(photo, point);
            let log = [0, 1, 2].map(|c: usize| {
                let noise = 0.02 * rng.normal((4 * (500 * photo + point) + c) as u64);
                -2.0 + 0.7 * (point as f32 * 0.37).sin() + truth[photo][c] - falloff * r2 + noise
            });
            // Somebody walks by.
            let log = if point % 9 == photo % 9 { [-1.0; 3] } else { log };
            Light { point: point as u32, log, weight: [1.0; 3], r2 }
        };
        (0..truth.len()).map(|photo| (0..400).map(|point| light(photo, point)).collect()).collect()
    }

    fn spread_radii(photo: usize, point: usize) -> f32 {
        ((7 * photo + 3 * point) % 11) as f32 / 11.0
    }

    const TRUTH: [[f32; 3]; 5] = [
        [0.5, 0.45, 0.4],
        [-0.3, -0.35, -0.2],
        [0.0, 0.1, -0.1],
        [-0.2, -0.2, -0.1],
        [0.0, 0.0, 0.0],
    ];

    #[test]
    fn gains_and_falloff_are_found() {
        let solution = solve(&lights(&TRUTH, 0.4, spread_radii), &[UVec2::new(160, 120); 5]);
        for (i, truth) in TRUTH.iter().enumerate() {
            for (c, truth) in truth.iter().enumerate() {
                let off = solution.exposures.gains[i][c] - truth;
                assert!(off.abs() < 0.01, "{i} {c}: {off}");
                assert!((1e-5..0.02).contains(&solution.errors[i][c]), "{}", solution.errors[i][c]);
            }
            assert!(
                (solution.exposures.falloff[i] - 0.4).abs() < 0.02,
                "{:?}",
                solution.exposures.falloff
            );
        }
    }

    #[test]
    fn gains_stay_where_falloff_cannot_be_told_from_them() {
        // Each photo shows its points at one distance from its middle; each has a size of its own,
        // or all have one.
        let ring = |photo: usize, _: usize| 0.1 + 0.15 * photo as f32;
        for sizes in [[0, 1, 2, 3, 4], [0; 5]].map(|add| add.map(|add| UVec2::new(160 + add, 120)))
        {
            let solution = solve(&lights(&TRUTH, 0.0, ring), &sizes);
            assert_eq!(solution.exposures.falloff, [0.0; 5]);
            for (gains, truth) in solution.exposures.gains.iter().zip(&TRUTH) {
                assert!((0..3).all(|c| (gains[c] - truth[c]).abs() < 0.01), "{gains:?} {truth:?}");
            }
        }
    }

    #[test]
    fn photos_without_usable_estimates_have_the_mean_gain() {
        let mut photos = lights(&TRUTH, 0.0, spread_radii);
        // One shares no point with the others, one is nine stops darker, one shows nothing.
        for light in &mut photos[1] {
            light.point += 1000;
        }
        for light in &mut photos[2] {
            light.log = light.log.map(|log| log - 6.0);
        }
        photos[3].clear();
        let solution = solve(&photos, &[UVec2::new(160, 120); 5]);
        for unknown in [1, 2, 3] {
            assert_eq!(solution.exposures.gains[unknown], [0.0; 3]);
            assert!(
                solution.errors[unknown].iter().all(|error| error.is_infinite()),
                "{:?}",
                solution.errors
            );
        }
        assert!(
            (solution.exposures.gains[0][1] - 0.225).abs() < 0.01,
            "{:?}",
            solution.exposures.gains
        );
        assert_eq!(solution.verdict(Strengths::NONE).unknown, 3);
        assert_eq!(solve(&[], &[]), Solved::default());
    }
}
