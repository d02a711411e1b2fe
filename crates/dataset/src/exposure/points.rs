//! Relative exposure of photos, from points that several photos show.

/// Usable 8-bit codes: brighter ones are clipped, darker ones mostly noise.
const USEFUL: std::ops::RangeInclusive<u8> = 8..=247;
/// Fewest shared points for an estimate.
const LEAST: usize = 20;
/// Rounds of alternation; a chain of photos needs at most its length.
const ROUNDS: usize = 60;

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

/// Solves light = exposure + point by alternating least squares. Returns the exposure of each photo in stops, up to a common constant;
/// `None` for photos with too few shared points.
pub(crate) fn solve(observations: &[Observation], photos: usize, points: usize) -> Vec<Option<f64>> {
    let mut seen = vec![0usize; points];
    observations.iter().for_each(|o| seen[o.point] += 1);
    let useful: Vec<&Observation> = observations.iter().filter(|o| seen[o.point] > 1).collect();
    let mut counts = vec![0usize; photos];
    useful.iter().for_each(|o| counts[o.photo] += 1);
    let mut exposure = vec![0.0; photos];
    for _ in 0..ROUNDS {
        let mut brightness = vec![0.0; points];
        useful
            .iter()
            .for_each(|o| brightness[o.point] += (o.light - exposure[o.photo]) / seen[o.point] as f64);
        exposure.fill(0.0);
        useful
            .iter()
            .for_each(|o| exposure[o.photo] += (o.light - brightness[o.point]) / counts[o.photo] as f64);
    }
    exposure.into_iter().zip(counts).map(|(stops, count)| (count >= LEAST).then_some(stops)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exposures_are_found_again_along_a_chain() {
        let truth: Vec<f64> = (0..12).map(|i| 0.4 * f64::from(i % 4)).collect();
        let mut observations = Vec::new();
        for (photo, stops) in truth.iter().enumerate() {
            for point in 30 * photo..30 * photo + 120 {
                let light = -4.0 + (point as f64 * 0.37).sin() + stops;
                observations.push(Observation { photo, point, light });
            }
        }
        let found = solve(&observations, 13, 1000);
        assert_eq!(found[12], None);
        let offset = found[0].unwrap() - truth[0];
        for (found, truth) in found.iter().zip(&truth) {
            assert!((found.unwrap() - offset - truth).abs() < 0.02, "{found:?} {truth}");
        }
        assert!(Observation::of_code(0, 0, 255).is_none() && Observation::of_code(0, 0, 0).is_none());
        let stops = |code| Observation::of_code(0, 0, code).unwrap().light;
        assert!((stops(188) - stops(137) - 1.0).abs() < 0.02, "twice the light");
    }
}
