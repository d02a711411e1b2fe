//! A photo's exposure beside that of a scene trained on others.

use super::correction::Strengths;
use super::light::Light;
use super::relative::beside_others;
use super::solve::solve;
use glam::UVec2;

/// Gains that bring renderings of a scene to the exposure of photos, per photo and channel, as
/// logarithms of light; `None` where it is unknown. The scene was trained on the photos for which
/// `is_trained` holds, corrected by `strengths`. `lights` and `sizes` are those of all photos, as
/// for [`solve`].
pub fn own_exposures(
    lights: &[Vec<Light>],
    sizes: &[UVec2],
    is_trained: &[bool],
    strengths: Strengths,
) -> Vec<Option<[f32; 3]>> {
    let mut solution = solve(lights, sizes);
    let is_known: Vec<bool> = solution.errors.iter().map(|errors| errors[1].is_finite()).collect();
    let is_used: Vec<bool> =
        is_trained.iter().zip(&is_known).map(|(trained, known)| *trained && *known).collect();
    // The training knew the mean of its own photos.
    let used_photos = || (0..lights.len()).filter(|photo| is_used[*photo]);
    for c in 0..3 {
        let gains = &mut solution.exposures.gains;
        let mean = used_photos().map(|photo| gains[photo][c]).sum::<f32>()
            / used_photos().count().max(1) as f32;
        for gains in gains {
            gains[c] -= mean;
        }
    }
    let gains = &solution.exposures.gains;
    let mut residuals = gains.clone();
    for (residual, correction) in
        residuals.iter_mut().zip(solution.corrections(strengths).unwrap_or_default().gains)
    {
        for (residual, correction) in residual.iter_mut().zip(correction) {
            *residual -= correction;
        }
    }
    let relative = beside_others(lights, gains, &residuals, &is_used);
    relative.into_iter().zip(is_known).map(|(own, is_known)| own.filter(|_| is_known)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_photo_is_compared_with_what_its_scene_shows() {
        let gains = [0.3f32, -0.3, 0.2, -0.2, 0.5];
        let light = |photo: usize, point: u32| {
            let log = -2.0 + (point as f32).sin() + gains[photo];
            Light { point, log: [log; 3], weight: [1.0; 3], r2: 0.0 }
        };
        let mut lights: Vec<Vec<Light>> =
            (0..5).map(|photo| (0..100).map(|point| light(photo, point)).collect()).collect();
        let sizes = [UVec2::splat(64); 5];
        let is_trained = [true, true, true, true, false];
        for strengths in [Strengths::NONE, Strengths::FULL] {
            // Gains of the training photos have the mean 0, corrected or not.
            let own = own_exposures(&lights, &sizes, &is_trained, strengths)[4].unwrap();
            assert!(own.iter().all(|own| (own - 0.5).abs() < 0.02), "{own:?}");
        }
        lights[4].clear();
        assert_eq!(own_exposures(&lights, &sizes, &is_trained, Strengths::NONE)[4], None);
    }
}
