//! Evidence of left-out photos for the exposures that tracked points predict.
//!
//! A scene takes up what neighbouring photos have in common. So beside its drawing, a left-out
//! photo shows only the part of its exposure that its neighbours lack: the slope b of what it shows
//! on what its points predict. b is 1 where exposures differ from photo to photo, near 0 where they
//! change smoothly around the scene, or where the estimates are wrong. The points tell a second b,
//! the slope of gains beside those of other photos at the same points; a long training takes up
//! more than a short one, so the smaller b counts.
//!
//! With a share s of the gain corrected in all photos, a left-out photo of gain 1 differs from its
//! drawing by s + (1 - s)·b, and photos still contradict the scene that they train by (1 - s)·b.
//! The sum of both squares is least at s = 1 - (1 - b) / ((1 - b)² + b²): nothing is corrected up
//! to b = 1/2, and all of it at b = 1.
//!
//! A dozen photos tell b roughly, so b less its standard error counts, by the jackknife: the slopes
//! without each photo in turn.

use super::correction::{Strengths, modes};
use super::light::Light;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::math::lists::median;

/// Minimum number of left-out photos that can decide.
const MIN_PHOTOS: usize = 3;
/// Minimum mean of predicted differences: smaller ones of an 8-bit photo's light are less than a
/// code.
const MIN_PREDICTION: f32 = 0.01;

/// A photo that a training left out.
#[derive(Debug, Clone)]
pub struct LeftOutPhoto {
    /// Light of its cells beside the drawing: [`Light::beside_drawing`].
    pub cells: Vec<Light>,
    /// Predicted gains, as logarithms.
    pub gains: [f32; 3],
    /// The same beside other photos at the same points.
    pub beside_others: [f32; 3],
    /// Predicted falloff of its camera, 0 or more.
    pub falloff: f32,
    /// Share of it that is left beside other photos at the same points.
    pub falloff_beside_others: f32,
}

/// Agreement of left-out photos with the predicted corrections.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ExposureEvidence {
    /// Number of left-out photos.
    pub photos: u64,
    /// Slopes of what they show on what was predicted.
    pub slopes: Strengths,
    /// Shares that are corrected for it.
    pub strengths: Strengths,
}

trisplat_scene::stage!(ExposureEvidence, "evidence");

impl ExposureEvidence {
    /// Compares predictions with what `photos` show.
    pub fn of(photos: &[LeftOutPhoto]) -> Self {
        let photos: Vec<_> = photos.iter().filter(|photo| !photo.cells.is_empty()).collect();
        let mut gain = Fit::new(photos.len());
        let mut balance = Fit::new(photos.len());
        let mut falloff = Fit::new(photos.len());
        for mode in 0..3 {
            let predicted = photos.iter().map(|photo| modes(&photo.gains)[mode]);
            let shown = photos
                .iter()
                .map(|photo| middle(photo.cells.iter().map(|cell| modes(&cell.log)[mode])));
            let fit = if mode == 0 { &mut gain } else { &mut balance };
            let beside = photos.iter().map(|photo| modes(&photo.beside_others)[mode]);
            fit.beside_others
                .extend(predicted.clone().zip(beside).map(<[f32; 2]>::from).enumerate());
            fit.pairs.extend(centered(predicted.zip(shown).collect()).into_iter().enumerate());
        }
        for (number, photo) in photos.iter().enumerate() {
            let of_cell = |cell: &Light| (-photo.falloff * cell.r2, modes(&cell.log)[0]);
            let pairs = centered(photo.cells.iter().map(of_cell).collect());
            falloff.pairs.extend(pairs.into_iter().map(|pair| (number, pair)));
            let beside = photo.falloff * photo.falloff_beside_others;
            falloff.beside_others.push((number, [photo.falloff, beside]));
        }
        let [gain, balance, falloff] = [gain, balance, falloff].map(Fit::judge);
        let of = |which: usize| Strengths {
            gain: gain[which],
            balance: balance[which],
            falloff: falloff[which],
        };
        Self { photos: photos.len() as u64, slopes: of(0), strengths: of(1) }
    }
}

/// Pairs of what is predicted and what is shown, with the number of their photo.
struct Fit {
    pairs: Vec<(usize, [f32; 2])>,
    /// Predictions, and the same beside other photos.
    beside_others: Vec<(usize, [f32; 2])>,
    photos: usize,
}

impl Fit {
    fn new(photos: usize) -> Self {
        Self { pairs: Vec::new(), beside_others: Vec::new(), photos }
    }

    /// The slope, and the corrected share: 0 unless it brings most photos closer to their drawings.
    fn judge(self) -> [f32; 2] {
        let sum: f32 = self.pairs.iter().map(|(_, [predicted, _])| predicted.abs()).sum();
        if self.photos < MIN_PHOTOS || sum < MIN_PREDICTION * self.pairs.len() as f32 {
            return [0.0; 2];
        }
        let slope = self.slope(None);
        let share = share(slope - self.standard_error());
        let mut change = vec![0.0f32; self.photos];
        for (photo, [predicted, shown]) in &self.pairs {
            change[*photo] += (shown - share * predicted).abs() - shown.abs();
        }
        let closer = change.iter().filter(|change| **change < 0.0).count() as f32;
        // Of photos that are as often closer as not, half are, with this standard error.
        let photos = self.photos as f32;
        let is_confirmed = closer > (photos + photos.sqrt()) / 2.0;
        [slope, if is_confirmed { share } else { 0.0 }]
            .map(|number| (100.0 * number).round() / 100.0)
    }

    /// The smaller of both slopes, without the photo `left_out`.
    fn slope(&self, left_out: Option<usize>) -> f32 {
        let of = |pairs: &[(usize, [f32; 2])]| {
            let kept = pairs.iter().filter(|(photo, _)| Some(*photo) != left_out);
            least_slope(kept.map(|(_, pair)| *pair))
        };
        of(&self.pairs).min(of(&self.beside_others))
    }

    /// Jackknife estimate of the standard error of the slope.
    fn standard_error(&self) -> f32 {
        let photos = self.photos as f32;
        let slopes: Vec<f32> = (0..self.photos).map(|photo| self.slope(Some(photo))).collect();
        let mean = slopes.iter().sum::<f32>() / photos;
        let squares: f32 = slopes.iter().map(|slope| (slope - mean).powi(2)).sum();
        (squares * (photos - 1.0) / photos).sqrt()
    }
}

/// The slope through zero with the least sum of absolute errors: a median of quotients, weighted by
/// what is predicted. 0 where nothing is.
fn least_slope(pairs: impl Iterator<Item = [f32; 2]>) -> f32 {
    let usable = pairs.filter(|[predicted, _]| predicted.abs() > 1e-6);
    let mut quotients: Vec<[f32; 2]> =
        usable.map(|[predicted, shown]| [shown / predicted, predicted.abs()]).collect();
    quotients.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let half = quotients.iter().map(|[_, weight]| weight).sum::<f32>() / 2.0;
    let mut sum = 0.0;
    let mut reaches_half = |[_, weight]: &&[f32; 2]| {
        sum += weight;
        sum >= half
    };
    quotients.iter().find(&mut reaches_half).map_or(0.0, |[quotient, _]| *quotient)
}

/// The corrected share for a slope: see the head of this file.
fn share(slope: f32) -> f32 {
    let slope = slope.clamp(0.0, 1.0);
    let rest = 1.0 - slope;
    (1.0 - rest / (rest * rest + slope * slope)).clamp(0.0, 1.0)
}

/// Both of each pair less their medians: neither has a known zero.
fn centered(pairs: Vec<(f32, f32)>) -> Vec<[f32; 2]> {
    let predicted = middle(pairs.iter().map(|pair| pair.0));
    let shown = middle(pairs.iter().map(|pair| pair.1));
    pairs.into_iter().map(|pair| [pair.0 - predicted, pair.1 - shown]).collect()
}

fn middle(values: impl Iterator<Item = f32>) -> f32 {
    median(values.collect(), f32::total_cmp).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::Rng;

    /// Twelve photos whose cells show `slope` of their gain, and as much of a falloff of 0.4.
    fn left_out(slope: f32, noise: f32) -> Vec<LeftOutPhoto> {
        let rng = Rng::new(5, "left out", 0);
        let photo = |i: usize| {
            let gain = 0.4 * (1.7 * i as f32).sin();
            let cell = |k: usize| {
                let r2 = (k % 16) as f32 / 15.0;
                let noise = noise * rng.normal((300 * i + k) as u64);
                let log = slope * (gain - 0.4 * r2) + noise;
                Light { point: 0, log: [log + 0.1 * slope * gain, log, log], weight: [1.0; 3], r2 }
            };
            LeftOutPhoto {
                cells: (0..256).map(cell).collect(),
                gains: [1.1 * gain, gain, gain],
                beside_others: [1.1 * gain, gain, gain],
                falloff: 0.4,
                falloff_beside_others: 1.0,
            }
        };
        (0..12).map(photo).collect()
    }

    #[test]
    fn what_left_out_photos_show_is_corrected() {
        let of = |slope, noise| ExposureEvidence::of(&left_out(slope, noise));
        let confirmed = of(1.0, 0.1);
        assert_eq!(confirmed.photos, 12);
        for (slope, share) in [
            (confirmed.slopes.gain, confirmed.strengths.gain),
            (confirmed.slopes.balance, confirmed.strengths.balance),
            (confirmed.slopes.falloff, confirmed.strengths.falloff),
        ] {
            assert!((slope - 1.0).abs() < 0.1 && share > 0.9, "{confirmed:?}");
        }
        // A scene that took up most of it shows little.
        let absorbed = of(0.4, 0.02);
        assert!(
            (absorbed.slopes.gain - 0.4).abs() < 0.05 && absorbed.strengths.is_none(),
            "{absorbed:?}"
        );
        let mut photos = left_out(1.0, 0.1);
        photos
            .iter_mut()
            .for_each(|photo| photo.beside_others = photo.gains.map(|gain| 0.4 * gain));
        let strengths = ExposureEvidence::of(&photos).strengths;
        assert!(
            strengths.gain == 0.0 && strengths.falloff > 0.9,
            "neighbours share most: {strengths:?}"
        );
        assert!(of(0.0, 0.1).strengths.is_none() && of(-1.0, 0.1).strengths.is_none());
    }

    #[test]
    fn one_odd_photo_decides_nothing_and_two_photos_neither() {
        let mut photos = left_out(1.0, 0.02);
        photos[4].gains = [0.9; 3];
        assert!(ExposureEvidence::of(&photos).strengths.gain > 0.9);
        assert!(ExposureEvidence::of(&photos[..2]).strengths.is_none());
        assert_eq!(ExposureEvidence::of(&[]), ExposureEvidence::default());
    }

    #[test]
    fn the_share_has_the_least_sum_of_both_errors() {
        for slope in [0.3f32, 0.55, 0.7, 0.9, 0.99] {
            let cost = |s: f32| (s + (1.0 - s) * slope).powi(2) + ((1.0 - s) * slope).powi(2);
            let best = (0..=1000)
                .map(|i| i as f32 / 1000.0)
                .min_by(|a, b| cost(*a).total_cmp(&cost(*b)))
                .unwrap();
            assert!((share(slope) - best).abs() < 0.002, "{slope}: {} {best}", share(slope));
        }
    }
}
