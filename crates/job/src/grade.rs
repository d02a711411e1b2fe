//! One word for how a scene looks, on a scale that was set by looking at pictures
//! (docs/benchmarks/grades.md).

use super::extrapolation::CoverageScores;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::metric;
use trisplat_train::Quality;

/// Longer side of the compared pictures, px: scores of larger ones follow their finest texture, and
/// not what a person sees first.
const SIDE: u32 = 480;
/// Worst values of good, fair and rough: PSNR in dB, SSIM, FLIP. All three must reach them.
const SCALE: [(Grade, Look); 3] = [
    (Grade::Good, Look { psnr: 24.0, ssim: 0.78, flip: 0.17 }),
    (Grade::Fair, Look { psnr: 21.0, ssim: 0.68, flip: 0.195 }),
    (Grade::Rough, Look { psnr: 15.0, ssim: 0.3, flip: 0.42 }),
];
/// Share of the views beside the cameras that no photo supports, above which a scene is at most
/// fair, ...
const FAIR_UNSUPPORTED: f64 = 0.1;
/// ... and at most rough.
const ROUGH_UNSUPPORTED: f64 = 0.2;

/// Likeness of a scene to its photos.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "lowercase")]
pub enum Grade {
    /// Hardly to be recognised: poses or exposure are wrong, or photos are missing.
    Poor,
    /// To be recognised, with parts that are shattered or blurred.
    Rough,
    /// Looks right at first sight, with faults at the second.
    Fair,
    /// Like the photos.
    Good,
}

impl Grade {
    /// The word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Fair => "fair",
            Self::Rough => "rough",
            Self::Poor => "poor",
        }
    }

    /// The meaning of the word.
    pub fn meaning(self) -> &'static str {
        match self {
            Self::Good => "like the photos",
            Self::Fair => "right at first sight, with faults at the second",
            Self::Rough => "to be recognised, with parts that are shattered or blurred",
            Self::Poor => "wrong poses or exposure, or too few photos",
        }
    }

    /// The grade of these means over held-out photos; views from `beside` the cameras can lower it.
    pub(super) fn of(look: Look, beside: Option<CoverageScores>) -> Self {
        let reached = |least: &Look| {
            look.psnr >= least.psnr && look.ssim >= least.ssim && look.flip <= least.flip
        };
        let grade =
            SCALE.iter().find(|(_, least)| reached(least)).map_or(Self::Poor, |(grade, _)| *grade);
        let limit = match beside.map_or(0.0, |beside| beside.unsupported) {
            share if share > ROUGH_UNSUPPORTED => Self::Rough,
            share if share > FAIR_UNSUPPORTED => Self::Fair,
            _ => Self::Good,
        };
        grade.min(limit)
    }
}

/// Scores of a drawing at a size that a person takes in at once.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Look {
    pub(super) psnr: f64,
    pub(super) ssim: f64,
    pub(super) flip: f64,
}

impl Look {
    /// Of a picture and its photo, in any size.
    pub(super) fn of(picture: &RgbImage, photo: &RgbImage) -> Self {
        let share = f64::from(SIDE) / f64::from(photo.size.max_element());
        if share >= 1.0 {
            return Self::at_size(picture, photo);
        }
        let size = (photo.size.as_dvec2() * share).round().as_uvec2().max(glam::UVec2::ONE);
        Self::at_size(&picture.downscaled(size), &photo.downscaled(size))
    }

    fn at_size(picture: &RgbImage, photo: &RgbImage) -> Self {
        let Quality { psnr, ssim } = Quality::of(picture, photo);
        let flip = metric::flip(photo.size, &photo.rgb, &picture.rgb, photo.alpha.as_deref());
        Self { psnr, ssim, flip }
    }

    /// The mean of some.
    pub(super) fn mean(looks: &[Self]) -> Self {
        let count = looks.len().max(1) as f64;
        let mean = |of: fn(&Self) -> f64| looks.iter().map(of).sum::<f64>() / count;
        Self { psnr: mean(|l| l.psnr), ssim: mean(|l| l.ssim), flip: mean(|l| l.flip) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Scenes that a person graded by pictures before reading their scores: PSNR, SSIM, FLIP, and
    /// the share without support beside the cameras (docs/benchmarks/grades.md).
    const LOOKED_AT: [(&str, Grade, [f64; 4]); 15] = [
        ("fox480", Grade::Good, [26.97, 0.791, 0.163, 0.005]),
        ("dtu_scan24", Grade::Good, [25.04, 0.821, 0.125, 0.006]),
        ("bonsai, 14 of one side", Grade::Fair, [25.15, 0.810, 0.154, 0.115]),
        ("banana", Grade::Fair, [27.22, 0.728, 0.132, 0.092]),
        ("mug", Grade::Fair, [26.81, 0.820, 0.186, 0.005]),
        ("bonsai", Grade::Fair, [24.09, 0.728, 0.167, 0.012]),
        ("bonsai24", Grade::Rough, [21.50, 0.698, 0.210, 0.056]),
        ("bonsai, 40 around", Grade::Rough, [21.75, 0.626, 0.203, 0.038]),
        ("mug, 20 around", Grade::Rough, [24.41, 0.778, 0.219, 0.019]),
        ("mug, 14 around", Grade::Rough, [22.93, 0.755, 0.250, 0.021]),
        ("bonsai24, 14, longer", Grade::Rough, [20.76, 0.611, 0.228, 0.066]),
        ("bonsai24, 14 of one side", Grade::Rough, [19.63, 0.604, 0.252, 0.106]),
        ("bonsai24, 14 around", Grade::Rough, [19.14, 0.537, 0.266, 0.131]),
        ("brighton_beach", Grade::Rough, [18.58, 0.425, 0.383, 0.045]),
        ("brighton_beach, 12", Grade::Rough, [17.11, 0.343, 0.395, 0.072]),
    ];

    #[test]
    fn grades_are_those_of_a_person_who_looked() {
        for (name, wants, [psnr, ssim, flip, unsupported]) in LOOKED_AT {
            let beside = CoverageScores { unsupported, empty: 0.0 };
            assert_eq!(Grade::of(Look { psnr, ssim, flip }, Some(beside)), wants, "{name}");
        }
        let wrong = Look { psnr: 11.0, ssim: 0.2, flip: 0.55 };
        assert_eq!(Grade::of(wrong, None), Grade::Poor);
        assert!(Grade::Poor < Grade::Rough && Grade::Fair < Grade::Good);
    }

    #[test]
    fn large_pictures_are_graded_small() {
        let size = glam::UVec2::new(960, 8);
        let striped = |at: u32| RgbImage {
            size,
            rgb: (0..960 * 8)
                .map(|i| [if (i + at).is_multiple_of(2) { 90 } else { 110 }; 3])
                .collect(),
            alpha: None,
        };
        let look = Look::of(&striped(0), &striped(1));
        assert!(look.psnr > 50.0 && look.flip < 0.01, "texture of a pixel is not seen: {look:?}");
    }
}
