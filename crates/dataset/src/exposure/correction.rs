//! A phone's changes to the light of each photo: exposure, white balance, and the lens's falloff
//! towards the corners.
//!
//! ```text
//! photo(x) = scene(x) · exp(gain of the photo and channel - falloff of the camera · (r² - 1/3)) in
//! linear light
//! ```
//!
//! with r the distance from the middle of the picture, 1 in its corners; the mean of r² over a
//! picture is 1/3, so falloff does not change its mean. Gains of a channel have the mean zero over
//! all photos. Photos are corrected, not drawings, so training on any device, fitted colours and
//! textures see the same light.

use glam::{UVec2, Vec2};
use schemars::JsonSchema;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::{linear_from_srgb, srgb_from_linear};

/// Use of exposure correction.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ExposureUse {
    /// As far as photos that a short training leaves out confirm the estimates; a bake follows the
    /// training.
    #[default]
    Auto,
    /// In full.
    On,
    /// Never.
    Off,
    /// By these shares of the estimated gain, white balance and falloff.
    #[serde(untagged)]
    Shares(#[schemars(inner(range(min = 0.0, max = 1.0)))] [f32; 3]),
}

/// Values accepted for the option, for its error message.
const EXPOSURE_USES: &str = "auto, on, off, or three shares from 0 to 1, as in [0.5,0,0]";

impl<'de> Deserialize<'de> for ExposureUse {
    fn deserialize<D: Deserializer<'de>>(input: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Written {
            Word(String),
            Shares([f32; 3]),
        }
        let refused = || D::Error::custom(EXPOSURE_USES);
        match Written::deserialize(input).map_err(|_| refused())? {
            Written::Word(word) => match word.as_str() {
                "auto" => Ok(Self::Auto),
                "on" => Ok(Self::On),
                "off" => Ok(Self::Off),
                _ => Err(refused()),
            },
            Written::Shares(shares) if shares.iter().all(|share| (0.0..=1.0).contains(share)) => {
                Ok(Self::Shares(shares))
            }
            Written::Shares(_) => Err(refused()),
        }
    }
}

impl ExposureUse {
    /// The strengths that it sets; `None`: evidence decides.
    pub fn strengths(self) -> Option<Strengths> {
        match self {
            Self::Auto => None,
            Self::On => Some(Strengths::FULL),
            Self::Off => Some(Strengths::NONE),
            Self::Shares(shares) => Some(Strengths::from(shares)),
        }
    }
}

/// Applied shares of the estimated corrections, 0 to 1.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Strengths {
    /// Share of each photo's exposure.
    pub gain: f32,
    /// Share of each photo's white balance.
    pub balance: f32,
    /// Share of the falloff towards the corners.
    pub falloff: f32,
}

impl Strengths {
    /// No correction.
    pub const NONE: Self = Self { gain: 0.0, balance: 0.0, falloff: 0.0 };
    /// The estimates as they are.
    pub const FULL: Self = Self { gain: 1.0, balance: 1.0, falloff: 1.0 };

    /// True when nothing is corrected.
    pub fn is_none(&self) -> bool {
        *self == Self::NONE
    }

    /// Gain, white balance, falloff.
    pub fn to_array(self) -> [f32; 3] {
        [self.gain, self.balance, self.falloff]
    }

    /// The option that sets them.
    pub fn to_use(self) -> ExposureUse {
        if self.is_none() { ExposureUse::Off } else { ExposureUse::Shares(self.to_array()) }
    }
}

impl From<[f32; 3]> for Strengths {
    fn from([gain, balance, falloff]: [f32; 3]) -> Self {
        Self { gain, balance, falloff }
    }
}

/// Longer side of the compared pictures, px.
const LONGEST: u32 = 256;
/// Codes from this one on may be saturated: the light was at least this much.
const SATURATED: u8 = 252;
/// Weight, of 255, of a saturated pixel in a photo that the correction darkens: about 1/8, from the
/// smallest darkening on. Darkened, a clipped white becomes a grey that the scene never had, so
/// photos that are not clipped there decide; it is not 0, as a highlight that is clipped in all
/// photos would have no colour at all.
const SATURATED_WEIGHT: u8 = 32;
/// Steps of r² at which the falloff is tabulated.
const RINGS: usize = 64;
/// Mean of r² over a picture.
const MEAN_R2: f32 = 1.0 / 3.0;

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

    /// The corrected photo `index`; `None` if it needs no correction. Saturated pixels hardly
    /// count.
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
            for i in saturated {
                alpha[i] = alpha[i].min(SATURATED_WEIGHT);
            }
        }
        Some(corrected)
    }

    /// The corrected value of each code. `[ring][channel][code]`
    fn tables(&self, index: usize) -> Vec<[[u8; 256]; 3]> {
        let gains = self.gains[index];
        let falloff = self.falloff[index];
        let rings = if falloff == 0.0 { 1 } else { RINGS };
        let ring = |ring: usize| {
            let r2 = ring as f32 / (RINGS - 1) as f32;
            gains.map(|gain| {
                let by = (falloff * (r2 - MEAN_R2) - gain).exp();
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

/// Sentence on the spread of exposures, a logarithm.
pub fn differ(exposure: f32) -> String {
    format!("photos differ by {:.0}% in exposure", 100.0 * exposure)
}

/// Estimated corrections of all photos, and their errors.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Solved {
    /// Estimates; gains have the mean zero.
    pub exposures: Exposures,
    /// Standard errors of the gains; infinite for photos without a usable estimate. `[photos]`
    pub errors: Vec<[f32; 3]>,
    /// Gains less the mean of other photos at the same points: what a scene of the others lacks.
    /// `[photos]`
    pub beside_others: Vec<[f32; 3]>,
    /// Slope of r² less its mean over other photos at the same point on r²: the part of a falloff
    /// that a scene of the others lacks.
    pub falloff_beside_others: f32,
}

/// Spread of the photos' light, and what is corrected of it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Verdict {
    /// Standard deviation of the photos' exposure, as a logarithm, at the points that they track.
    pub exposure: f32,
    /// The same of red and blue against green.
    pub balance: f32,
    /// Loss of light in the corners, as a logarithm, the mean over the photos.
    pub corners: f32,
    /// Photos without a usable estimate, which are not corrected.
    #[serde(default)]
    pub unknown: u64,
    /// Corrected shares.
    pub strengths: Strengths,
}

/// Spread of the photos' light, and its corrections.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ExposureDetails {
    /// The differences; absent where they were not measured.
    #[serde(default, flatten, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    /// The correction of each training photo, in order of name; empty where photos are taken as
    /// they are.
    #[serde(default, flatten)]
    pub exposures: Exposures,
}

trisplat_scene::stage!(ExposureDetails, "exposure");

impl Solved {
    /// The spread of the photos' light with these `strengths`.
    pub fn verdict(&self, strengths: Strengths) -> Verdict {
        let spread = self.spread();
        let falloff = &self.exposures.falloff;
        Verdict {
            exposure: spread[0],
            balance: spread[1].hypot(spread[2]) / std::f32::consts::SQRT_2,
            corners: falloff.iter().sum::<f32>() / falloff.len().max(1) as f32,
            unknown: self.errors.iter().filter(|errors| !errors[1].is_finite()).count() as u64,
            strengths,
        }
    }

    /// The corrections by these `strengths`; `None` of none. Uncertain gains count less: by the
    /// share of their variance that is no error.
    pub fn corrections(&self, strengths: Strengths) -> Option<Exposures> {
        if strengths.is_none() || self.exposures.gains.is_empty() {
            return None;
        }
        let spread = self.spread();
        let of_mode = [strengths.gain, strengths.balance, strengths.balance];
        let gains = self.exposures.gains.iter().zip(&self.errors).map(|(gains, errors)| {
            let noise = mode_errors(errors);
            let modes = modes(gains);
            channels([0, 1, 2].map(|m: usize| {
                let variance = spread[m].powi(2);
                let certainty = variance / (variance + noise[m].powi(2)).max(f32::MIN_POSITIVE);
                of_mode[m] * certainty * modes[m]
            }))
        });
        let falloff =
            self.exposures.falloff.iter().map(|falloff| strengths.falloff * falloff.max(0.0));
        Some(Exposures { gains: gains.collect(), falloff: falloff.collect() })
    }

    /// Standard deviation of each mode over the photos, without the part that is error.
    fn spread(&self) -> [f32; 3] {
        let photos = || {
            self.exposures
                .gains
                .iter()
                .zip(&self.errors)
                .filter(|(_, errors)| errors[1].is_finite())
        };
        let count = photos().count().max(2) as f32;
        [0, 1, 2].map(|m: usize| {
            let of_photo =
                |(gains, errors)| modes(gains)[m].powi(2) - mode_errors(errors)[m].powi(2);
            let variance = photos().map(of_photo).sum::<f32>() / (count - 1.0);
            variance.max(0.0).sqrt()
        })
    }
}

/// Exposure, and red and blue against green.
pub(super) fn modes([red, green, blue]: &[f32; 3]) -> [f32; 3] {
    [(red + green + blue) / 3.0, red - green, blue - green]
}

fn channels([mean, red, blue]: [f32; 3]) -> [f32; 3] {
    let green = mean - (red + blue) / 3.0;
    [green + red, green, green + blue]
}

/// Standard errors of the modes. Errors of the channels are assumed equal in the mean, and
/// independent in the differences.
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
        let gains = [0.4, -0.2, 0.1];
        let falloff = 0.35;
        let rings = Rings::new(size);
        let photo_pixel = |i: usize| {
            let place = Vec2::new((i % 64) as f32 + 0.5, (i / 64) as f32 + 0.5);
            std::array::from_fn(|c| {
                let light = linear_from_srgb(f32::from(scene(i)[c]) / 255.0);
                let light = light * (gains[c] - falloff * (rings.square(place) - MEAN_R2)).exp();
                (255.0 * srgb_from_linear(light)).round() as u8
            })
        };
        let photo = RgbImage { size, rgb: (0..64 * 48).map(photo_pixel).collect(), alpha: None };
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
        let of = |gain: f32| {
            Exposures { gains: vec![[gain; 3]], falloff: vec![0.0] }.correct(0, &photo).unwrap()
        };
        assert_eq!(of(0.5).alpha, Some(vec![SATURATED_WEIGHT, 255]));
        assert_eq!(of(-0.5).alpha, None, "they are brighter than white in any case");
    }

    /// Estimates for photos whose exposure spreads by `spread`, with a standard error of `error`.
    fn solved(spread: f32, error: f32, falloff: f32) -> Solved {
        let gains: Vec<[f32; 3]> =
            (0..40).map(|i| [if i % 2 == 0 { spread } else { -spread }; 3]).collect();
        let exposures = Exposures { falloff: vec![falloff; gains.len()], gains };
        Solved {
            errors: vec![[error; 3]; 40],
            exposures,
            beside_others: Vec::new(),
            falloff_beside_others: 1.0,
        }
    }

    #[test]
    fn exposure_corrections_follow_errors_and_strengths() {
        assert_eq!(solved(0.3, 0.01, 0.5).corrections(Strengths::NONE), None);
        let estimates = solved(0.3, 0.01, 0.4);
        let full = estimates.corrections(Strengths::FULL).unwrap();
        assert!((full.gains[0][1] - 0.3).abs() < 1e-3 && (full.gains[1][2] + 0.3).abs() < 1e-3);
        assert_eq!(full.falloff[7], 0.4);
        let verdict = estimates.verdict(Strengths::FULL);
        assert!((verdict.exposure - 0.3).abs() < 0.01 && verdict.balance == 0.0, "{verdict:?}");
        let part = Strengths { gain: 0.5, balance: 0.0, falloff: 0.25 };
        let half = estimates.corrections(part).unwrap();
        assert!((half.gains[0][1] - 0.15).abs() < 1e-3 && half.falloff[0] == 0.1, "{half:?}");
        // Half of the spread's square is error: half is believed.
        let unsure = solved(0.6, 0.6 / 2f32.sqrt(), 0.0).corrections(Strengths::FULL).unwrap();
        assert!((unsure.gains[0][0] - 0.3).abs() < 0.02);
        assert_eq!(
            solved(0.2, 0.2, 0.0).verdict(Strengths::NONE).exposure,
            0.0,
            "all of the spread is error"
        );
    }

    #[test]
    fn shares_are_written_as_a_list_and_words_as_words() {
        let shares = Strengths { gain: 0.7, balance: 0.0, falloff: 0.25 }.to_use();
        for (value, text) in [(shares, "[0.7,0.0,0.25]"), (ExposureUse::On, "\"on\"")] {
            assert_eq!(serde_json::to_string(&value).unwrap(), text);
            assert_eq!(serde_json::from_str::<ExposureUse>(text).unwrap(), value);
        }
        for wrong in ["\"bright\"", "[5,0,0]", "[1,0]", "0.5", "null"] {
            let error = serde_json::from_str::<ExposureUse>(wrong).unwrap_err().to_string();
            assert!(error.contains("three shares from 0 to 1"), "{wrong}: {error}");
        }
        assert_eq!(Strengths::NONE.to_use(), ExposureUse::Off);
    }
}
