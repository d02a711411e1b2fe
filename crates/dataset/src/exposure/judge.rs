//! Whether photos differ in their light.

use super::{ExposureUse, Exposures, Solved};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Bounds of the spread of exposure, as a logarithm. Below the first, photos stay unchanged; from the second
/// on they are corrected in full, between the two by a part. The first is high because neighbouring photos
/// share exposure, so correction lowers raw scores (docs/benchmarks/exposure.md). White balance does not
/// decide, because colours of an untrained scene differ from photo to photo.
const SPREAD: [f32; 2] = [0.15, 0.25];
/// The same bounds for the falloff, if photos are corrected. A scene can absorb a weak falloff, and its own
/// edges may look like one.
const FALLOFF: [f32; 2] = [0.12, 0.3];

/// The spread of the photos' light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Verdict {
    /// Standard deviation of the photos' exposure, as a logarithm, without the part from errors of the
    /// estimates.
    pub exposure: f32,
    /// The same of red and blue against green.
    pub balance: f32,
    /// Loss of light in the corners, as a logarithm, the mean over the photos.
    pub corners: f32,
    /// The share of exposure and balance that is corrected: 0 if photos agree, 1 if they clearly differ.
    pub strength: f32,
}

/// The photos' corrections; `None` if they agree. Uncertain estimates count less.
pub fn judge(solved: Solved, wanted: ExposureUse) -> (Option<Exposures>, Verdict) {
    let Solved { mut exposures, errors } = solved;
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
    let strength = match wanted {
        ExposureUse::On => 1.0,
        ExposureUse::Off => 0.0,
        ExposureUse::Auto => part(spread[0], SPREAD),
    };
    let dark_corners = strength * part(falloff, FALLOFF);
    let balance = spread[1].hypot(spread[2]) / std::f32::consts::SQRT_2;
    let verdict = Verdict { exposure: spread[0], balance, corners: falloff, strength };
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

    /// Estimates for photos whose exposure spreads by `spread`, with a standard error of `error`.
    fn solved(spread: f32, error: f32, falloff: f32) -> Solved {
        let gains: Vec<[f32; 3]> = (0..40).map(|i| [if i % 2 == 0 { spread } else { -spread }; 3]).collect();
        let exposures = Exposures { falloff: vec![falloff; gains.len()], gains };
        Solved { errors: vec![[error; 3]; 40], exposures }
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
