//! How many triangles fit a number of bytes, found by writing files.
//!
//! Bytes are nearly in proportion to triangles of any shape. So a scene without fitting, which costs little,
//! is measured first, and gives a nearly right number of triangles. The size of the final files decides.

use trisplat_scene::error::{Error, Result};

/// Probes at most, the first with all triangles among them.
const MOST_PROBES: u32 = 7;

/// Attempts to come closer to the limit; more only while nothing fits.
const ENOUGH: u32 = 2;
/// Most attempts in all.
const MOST_MADE: u32 = 7;

/// A file this close to its limit is good enough.
const NEAR: f64 = 0.96;

/// The target size, as a share of the limit: a little less, because a scene that is too large is discarded.
const AIM: f64 = 0.985;

/// A scene that was made and measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Attempt {
    /// The most triangles that were permitted; `None`: no limit.
    pub max_triangles: Option<u64>,
    /// Triangles there are.
    pub triangles: u64,
    /// Bytes of all files.
    pub bytes: u64,
}

/// The scene with most triangles whose files take at most `limit` bytes. `make` makes and measures a scene
/// with at most the given number of triangles. `probe` measures a similar scene, made in a fraction of the
/// time. Neither has more than `max_triangles`.
///
/// Errors: those of both; a limit that not even one triangle fits.
pub fn most_within<T>(
    limit: u64,
    max_triangles: Option<u64>,
    probe: impl FnMut(Option<u64>) -> Result<Attempt>,
    mut make: impl FnMut(Option<u64>) -> Result<(Attempt, T)>,
) -> Result<T> {
    let mut most = probed(limit, max_triangles, probe)?;
    let (mut over, mut within): (Option<Attempt>, Option<(Attempt, T)>) = (None, None);
    for made in 1..=MOST_MADE {
        let (attempt, scene) = make(most)?;
        if attempt.bytes > limit {
            over = Some(attempt);
        } else if within.as_ref().is_none_or(|(best, _)| best.bytes < attempt.bytes) {
            within = Some((attempt, scene));
        }
        let best = within.as_ref().map(|(best, _)| best);
        if best.is_some_and(|best| made >= ENOUGH || is_enough(limit, max_triangles, best)) {
            break;
        }
        // If none were too many, bytes are taken to be in proportion to triangles.
        let double =
            |best: &Attempt| Attempt { triangles: 2 * best.triangles, bytes: 2 * best.bytes, ..*best };
        let Some(high) = over.or_else(|| best.map(double)) else { break };
        match next(limit, &high, best) {
            Some(triangles) => most = Some(max_triangles.map_or(triangles, |most| most.min(triangles))),
            None => break,
        }
    }
    match (within, over) {
        (Some((_, scene)), _) => Ok(scene),
        (None, over) => Err(too_few(limit, over)),
    }
}

/// Whether to stop: more triangles are not worth the time, or there are no more.
fn is_enough(limit: u64, asked: Option<u64>, found: &Attempt) -> bool {
    let all = found.max_triangles == asked || found.max_triangles.is_none_or(|most| found.triangles < most);
    all || found.bytes as f64 >= NEAR * limit as f64
}

/// How many triangles fit according to probes; at most the requested number.
fn probed(
    limit: u64,
    max_triangles: Option<u64>,
    mut probe: impl FnMut(Option<u64>) -> Result<Attempt>,
) -> Result<Option<u64>> {
    let mut over = probe(max_triangles)?;
    if over.bytes <= limit {
        return Ok(max_triangles);
    }
    let mut within: Option<Attempt> = None;
    for _ in 1..MOST_PROBES {
        let Some(triangles) = next(limit, &over, within.as_ref()) else { break };
        let attempt = probe(Some(triangles))?;
        if attempt.bytes > limit {
            over = attempt;
        } else {
            within = Some(attempt);
            if attempt.bytes as f64 >= NEAR * limit as f64 {
                break;
            }
        }
    }
    match within {
        Some(found) => Ok(found.max_triangles),
        None => next(limit, &over, None).map(Some).ok_or_else(|| too_few(limit, Some(over))),
    }
}

fn too_few(limit: u64, over: Option<Attempt>) -> Error {
    let least = over.map_or("more".to_owned(), |over| {
        format!("{} or more: that is what {} triangles take", over.bytes, over.triangles)
    });
    Error::invalid("max_bytes", limit, least)
}

/// The number of triangles to try next, on the line through the known sizes; `None` when nothing lies
/// between.
fn next(limit: u64, over: &Attempt, within: Option<&Attempt>) -> Option<u64> {
    let (low, low_bytes) = within.map_or((0.0, 0.0), |fits| (fits.triangles as f64, fits.bytes as f64));
    let (high, high_bytes) = (over.triangles as f64, over.bytes as f64);
    let aim = (AIM * limit as f64).max(low_bytes);
    let share = (aim - low_bytes) / (high_bytes - low_bytes).max(1.0);
    // A file without triangles takes bytes, too: the line from 0 is too steep.
    let shy = if within.is_some() { 1.0 } else { AIM };
    let triangles = (low + shy * share * (high - low)).floor().max(low + 1.0);
    (triangles < high).then_some(triangles as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scene of `all` triangles of `each` bytes; probes take `probed` times as many bytes. Returns the
    /// result and the number of attempts.
    fn search(limit: u64, all: u64, header: u64, each: u64, probed: f64) -> (Result<Attempt>, u32) {
        let mut made = 0;
        let measured = |most: Option<u64>, each: f64| {
            let triangles = most.map_or(all, |most| most.min(all));
            Attempt { max_triangles: most, triangles, bytes: header + (each * triangles as f64) as u64 }
        };
        let probe = |most| Ok(measured(most, probed * each as f64));
        let found = most_within(limit, None, probe, |most| {
            made += 1;
            let attempt = measured(most, each as f64);
            Ok((attempt, attempt))
        });
        (found, made)
    }

    #[test]
    fn what_fits_is_left_alone() {
        let (found, made) = search(10_000, 100, 500, 60, 1.0);
        assert_eq!((found.unwrap(), made), (Attempt { max_triangles: None, triangles: 100, bytes: 6500 }, 1));
    }

    #[test]
    fn the_limit_is_kept_and_nearly_reached_by_making_the_scene_at_most_twice() {
        for (limit, header) in [(3_000_000, 1500), (1_000_000, 100_000), (50_000, 1500), (5_999_999, 0)] {
            for probed in [1.0, 0.8, 1.3] {
                let (found, made) = search(limit, 100_000, header, 60, probed);
                let found = found.unwrap();
                let share = found.bytes as f64 / limit as f64;
                assert!((0.95..=1.0).contains(&share), "{limit}, {probed}: {found:?}");
                assert!(made <= ENOUGH && (probed != 1.0 || made == 1), "{limit}, {probed}: {made}");
                assert_eq!(found.max_triangles, Some(found.triangles));
            }
        }
    }

    #[test]
    fn a_probe_that_is_far_off_costs_time_and_breaks_no_limit() {
        let (found, made) = search(3_000_000, 100_000, 1500, 60, 0.3);
        assert!(found.unwrap().bytes <= 3_000_000 && made <= 3, "{made}");
    }

    #[test]
    fn a_limit_below_one_triangle_is_an_error() {
        let error = search(1000, 50_000, 1500, 60, 1.0).0.unwrap_err().to_string();
        assert!(error.starts_with("max_bytes is 1000: expected "), "{error}");
        assert_eq!(search(1000, 50_000, 1500, 60, 1.0).1, 0, "probes are enough to know");
    }
}
