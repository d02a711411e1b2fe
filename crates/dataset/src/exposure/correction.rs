//! A phone's changes to the light of each photo: exposure, white balance, and the lens's falloff towards the
//! corners.
//!
//! ```text
//! photo(x) = scene(x) · exp(gain of the photo and channel - falloff of the camera · r²)        in linear light
//! ```
//!
//! with r the distance from the middle of the picture, 1 in its corners. Gains of a channel have the mean
//! zero over all photos. Photos are corrected, not drawings, so training on any device, fitted colours and
//! textures see the same light.

use glam::{UVec2, Vec2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::{linear_from_srgb, srgb_from_linear};

/// Whether photos are corrected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum ExposureUse {
    /// Where their light differs.
    #[default]
    Auto,
    /// Always.
    On,
    /// Never.
    Off,
}

/// Longer side of the compared pictures, px.
const LONGEST: u32 = 256;
/// Larger codes may be saturated.
const SATURATED: u8 = 252;
/// Weight, of 255, of a pixel with saturated light that the correction darkens.
const SATURATED_WEIGHT: u8 = 32;
/// Steps of r² at which the falloff is tabulated.
const RINGS: usize = 64;

/// The size for comparing a photo of `size`.
pub fn compared_size(size: UVec2) -> UVec2 {
    let by = f64::from(LONGEST) / f64::from(size.max_element().max(1));
    if by >= 1.0 { size } else { (size.as_dvec2() * by).round().as_uvec2().max(UVec2::ONE) }
}

/// The light of all photos of a set.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Exposures {
    /// Logarithm of each photo's gain, per channel. `[photos]`
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub gains: Vec<[f32; 3]>,
    /// Falloff of each photo's camera: the loss of light in a corner, as a logarithm. `[photos]`
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub falloff: Vec<f32>,
}

impl Exposures {
    /// True when photo `index` needs no correction.
    pub fn is_plain(&self, index: usize) -> bool {
        let plain = |x: f32| x == 0.0;
        self.gains.get(index).is_none_or(|gains| gains.iter().all(|x| plain(*x)))
            && self.falloff.get(index).is_none_or(|x| plain(*x))
    }

    /// The corrected photo `index`; `None` if it needs no correction. Saturated pixels hardly count.
    pub fn correct(&self, index: usize, photo: &RgbImage) -> Option<RgbImage> {
        if self.is_plain(index) {
            return None;
        }
        let tables = self.tables(index);
        let darker = self.gains[index].iter().any(|gain| *gain > 0.0);
        let mut corrected = photo.clone();
        let mut saturated = Vec::new();
        let rings = Rings::new(photo.size);
        for (i, rgb) in corrected.rgb.iter_mut().enumerate() {
            if darker && rgb.iter().any(|code| *code >= SATURATED) {
                saturated.push(i);
            }
            let table = &tables[rings.of(i)];
            *rgb = std::array::from_fn(|c| table[c][usize::from(rgb[c])]);
        }
        if !saturated.is_empty() {
            let all = photo.rgb.len();
            let alpha = corrected.alpha.get_or_insert_with(|| vec![u8::MAX; all]);
            saturated.into_iter().for_each(|i| alpha[i] = alpha[i].min(SATURATED_WEIGHT));
        }
        Some(corrected)
    }

    /// The corrected value of each code. `[ring][channel][code]`
    fn tables(&self, index: usize) -> Vec<[[u8; 256]; 3]> {
        let (gains, falloff) = (self.gains[index], self.falloff[index]);
        let rings = if falloff == 0.0 { 1 } else { RINGS };
        let ring = |ring: usize| {
            let r2 = ring as f32 / (RINGS - 1) as f32;
            gains.map(|gain| {
                let by = (falloff * r2 - gain).exp();
                std::array::from_fn(|code| {
                    let light = linear_from_srgb(code as f32 / 255.0) * by;
                    (255.0 * srgb_from_linear(light)).round() as u8
                })
            })
        };
        let tables: Vec<_> = (0..rings).map(ring).collect();
        if rings == 1 { vec![tables[0]; RINGS] } else { tables }
    }
}

/// Distances of pixels from the middle of a picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rings {
    width: usize,
    middle: Vec2,
    /// 1 / r² of a corner, px.
    per: f32,
}

impl Rings {
    pub(super) fn new(size: UVec2) -> Self {
        let middle = size.as_vec2() / 2.0;
        Self { width: size.x as usize, middle, per: 1.0 / middle.length_squared().max(1e-6) }
    }

    /// r² of a place, 0 to 1.
    pub(super) fn square(&self, place: Vec2) -> f32 {
        (place.distance_squared(self.middle) * self.per).min(1.0)
    }

    fn of(&self, pixel: usize) -> usize {
        let place = Vec2::new((pixel % self.width) as f32 + 0.5, (pixel / self.width) as f32 + 0.5);
        (self.square(place) * (RINGS - 1) as f32).round() as usize
    }
}

/// Bounds of the spread of exposure, as a logarithm. Below the first, photos stay unchanged; from the second
/// on they are corrected in full, between the two by a part. The first is high because neighbouring photos
/// share exposure, so correction lowers raw scores (docs/benchmarks/exposure.md). White balance does not
/// decide, because colours of an untrained scene differ from photo to photo.
pub(crate) const SPREAD: [f32; 2] = [0.15, 0.25];
/// The same bounds for the falloff, if photos are corrected. A scene can absorb a weak falloff, and its own
/// edges may look like one.
const FALLOFF: [f32; 2] = [0.12, 0.3];

/// How far photos differ, in words.
pub fn differ(exposure: f32) -> String {
    format!("photos differ by {:.0}% in exposure", 100.0 * exposure)
}

/// The solution and its errors.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Solved {
    /// As measured, mean zero.
    pub exposures: Exposures,
    /// Standard errors of the gains. `[photos]`
    pub errors: Vec<[f32; 3]>,
    /// How far photos that show the same points are apart: the standard deviation of exposure, as a logarithm. `None` beside drawings,
    /// and where too few points are shown by several photos.
    pub spread: Option<f32>,
}

/// The spread of the photos' light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Verdict {
    /// Standard deviation of the photos' exposure, as a logarithm: between photos that show the same points, or beside drawings of the
    /// scene, where photos track no points.
    pub exposure: f32,
    /// The same of red and blue against green.
    pub balance: f32,
    /// Loss of light in the corners, as a logarithm, the mean over the photos.
    pub corners: f32,
    /// The share of exposure and balance that is corrected: 0 if photos agree, 1 if they clearly differ.
    pub strength: f32,
}

/// How photos differ, and what corrects them.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ExposureDetails {
    /// The differences; absent where they were not measured.
    #[serde(default, flatten, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    /// The correction of each training photo, in order of name; empty where photos agree.
    #[serde(default, flatten)]
    pub exposures: Exposures,
}

trisplat_scene::stage!(ExposureDetails, "exposure");

/// The photos' corrections; `None` if they agree. Uncertain estimates count less.
pub fn judge(solved: Solved, wanted: ExposureUse) -> (Option<Exposures>, Verdict) {
    let Solved { mut exposures, errors, spread: measured } = solved;
    let modes: Vec<[f32; 3]> = exposures.gains.iter().map(modes).collect();
    let noise: Vec<[f32; 3]> = errors.iter().map(mode_errors).collect();
    let spread: [f32; 3] = [0, 1, 2].map(|m: usize| {
        let known = || (0..modes.len()).filter(|i| noise[*i][m].is_finite());
        let count = known().count().max(2) as f32;
        let variance =
            known().map(|i| modes[i][m].powi(2) - noise[i][m].powi(2)).sum::<f32>() / (count - 1.0);
        variance.max(0.0).sqrt()
    });
    let falloff = exposures.falloff.iter().sum::<f32>() / exposures.falloff.len().max(1) as f32;
    let exposure = measured.unwrap_or(spread[0]);
    let strength = match wanted {
        ExposureUse::On => 1.0,
        ExposureUse::Off => 0.0,
        ExposureUse::Auto => part(exposure, SPREAD),
    };
    let dark_corners = strength * part(falloff, FALLOFF);
    let balance = spread[1].hypot(spread[2]) / std::f32::consts::SQRT_2;
    let verdict = Verdict { exposure, balance, corners: falloff, strength };
    if strength == 0.0 {
        return (None, verdict);
    }
    for ((gains, modes), noise) in exposures.gains.iter_mut().zip(&modes).zip(&noise) {
        let kept = [0, 1, 2].map(|m: usize| {
            let known = spread[m].powi(2) / (spread[m].powi(2) + noise[m].powi(2)).max(f32::MIN_POSITIVE);
            strength * known * modes[m]
        });
        *gains = channels(kept);
    }
    exposures.falloff.iter_mut().for_each(|k| *k = dark_corners * k.max(0.0));
    (Some(exposures), verdict)
}

/// 0 below the first bound, 1 above the second, smooth between.
fn part(value: f32, [least, full]: [f32; 2]) -> f32 {
    let t = ((value - least) / (full - least)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Exposure, and red and blue against green.
fn modes([red, green, blue]: &[f32; 3]) -> [f32; 3] {
    [(red + green + blue) / 3.0, red - green, blue - green]
}

fn channels([mean, red, blue]: [f32; 3]) -> [f32; 3] {
    let green = mean - (red + blue) / 3.0;
    [green + red, green, green + blue]
}

/// Standard errors of the modes. Errors of the channels are assumed equal in the mean, and independent in the
/// differences.
fn mode_errors([red, green, blue]: &[f32; 3]) -> [f32; 3] {
    [(red + green + blue) / 3.0, red.hypot(*green), blue.hypot(*green)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_correction_undoes_gain_and_falloff() {
        let size = UVec2::new(64, 48);
        let scene = |i: usize| [60 + i % 50, 70 + i % 31, 50 + i / 64].map(|c| c as u8);
        let (gains, falloff) = ([0.4, -0.2, 0.1], 0.35);
        let rings = Rings::new(size);
        let taken = |i: usize| {
            let place = Vec2::new((i % 64) as f32 + 0.5, (i / 64) as f32 + 0.5);
            std::array::from_fn(|c| {
                let light = linear_from_srgb(f32::from(scene(i)[c]) / 255.0);
                let light = light * (gains[c] - falloff * rings.square(place)).exp();
                (255.0 * srgb_from_linear(light)).round() as u8
            })
        };
        let photo = RgbImage { size, rgb: (0..64 * 48).map(taken).collect(), alpha: None };
        let exposures = Exposures { gains: vec![[0.0; 3], gains], falloff: vec![0.0, falloff] };
        assert!(exposures.correct(0, &photo).is_none());
        let corrected = exposures.correct(1, &photo).unwrap();
        for (i, rgb) in corrected.rgb.iter().enumerate() {
            for c in 0..3 {
                assert!(rgb[c].abs_diff(scene(i)[c]) <= 1, "{i}: {rgb:?} {:?}", scene(i));
            }
        }
        assert!(corrected.alpha.is_none(), "nothing was saturated");
    }

    #[test]
    fn saturated_pixels_hardly_count_where_they_become_darker() {
        let photo = RgbImage { size: UVec2::new(2, 1), rgb: vec![[255; 3], [100; 3]], alpha: None };
        let of =
            |gain: f32| Exposures { gains: vec![[gain; 3]], falloff: vec![0.0] }.correct(0, &photo).unwrap();
        assert_eq!(of(0.5).alpha, Some(vec![SATURATED_WEIGHT, 255]));
        assert_eq!(of(-0.5).alpha, None, "they are brighter than white in any case");
    }

    /// Estimates for photos whose exposure spreads by `spread`, with a standard error of `error`.
    fn solved(spread: f32, error: f32, falloff: f32) -> Solved {
        let gains: Vec<[f32; 3]> = (0..40).map(|i| [if i % 2 == 0 { spread } else { -spread }; 3]).collect();
        let exposures = Exposures { falloff: vec![falloff; gains.len()], gains };
        Solved { errors: vec![[error; 3]; 40], exposures, spread: None }
    }

    #[test]
    fn photos_that_agree_are_left_as_they_are() {
        assert_eq!(judge(solved(0.12, 0.001, 0.1), ExposureUse::Auto).0, None);
        // What spreads is what is not known.
        assert_eq!(judge(solved(0.2, 0.2, 0.0), ExposureUse::Auto).0, None);
        assert_eq!(judge(solved(0.3, 0.01, 0.5), ExposureUse::Off).0, None);
        assert!(judge(solved(0.001, 0.0001, 0.0), ExposureUse::On).0.is_some());
    }

    #[test]
    fn photos_that_differ_are_corrected_by_what_is_known() {
        let (exposures, verdict) = judge(solved(0.3, 0.01, 0.4), ExposureUse::Auto);
        let exposures = exposures.unwrap();
        assert!((exposures.gains[0][1] - 0.3).abs() < 1e-3 && (exposures.gains[1][2] + 0.3).abs() < 1e-3);
        assert_eq!((exposures.falloff[7], verdict.strength), (0.4, 1.0));
        assert!((verdict.exposure - 0.3).abs() < 0.01 && verdict.balance == 0.0, "{verdict:?}");
        // Half of the spread's square is error: half is believed.
        let (exposures, _) = judge(solved(0.6, 0.6 / 2f32.sqrt(), 0.0), ExposureUse::Auto);
        assert!((exposures.unwrap().gains[0][0] - 0.3).abs() < 0.02);
    }

    #[test]
    fn there_is_no_cliff_between_the_two() {
        let gain = |spread: f32| {
            judge(solved(spread, 1e-4, 0.0), ExposureUse::Auto).0.map_or(0.0, |e| e.gains[0][0])
        };
        let all: Vec<f32> = (0..400).map(|i| gain(0.001 * i as f32)).collect();
        assert!(all.windows(2).all(|two| (0.0..0.006).contains(&(two[1] - two[0]))), "{all:?}");
        assert!(all[140] == 0.0 && (all[260] - 0.26).abs() < 1e-3);
    }
}
