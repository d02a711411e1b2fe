//! How many triangles fit a number of bytes: by writing, not by guessing.
//!
//! Bytes are nearly in proportion to triangles, so few attempts are needed; the last word is what a file really takes.

use crate::error::{Error, Result};

/// Attempts at most, the first with all triangles among them.
const MOST_ATTEMPTS: u32 = 7;

/// A file this near its limit is not worth another attempt.
const NEAR: f64 = 0.985;

/// What is aimed for, as a share of the limit: a little less, as an attempt that is too large is lost.
const AIM: f64 = 0.995;

/// A scene that was made and measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Attempt {
    /// The most triangles that were permitted; `None`: as many as there are.
    pub max_triangles: Option<u64>,
    /// Triangles there are.
    pub triangles: u64,
    /// Bytes of all files.
    pub bytes: u64,
}

/// The attempt with most triangles whose files take at most `limit` bytes. `make` makes the scene with at most its argument's number of triangles, and measures
/// it; the first time with `max_triangles`.
///
/// Errors: those of `make`; a limit that not even one triangle fits.
pub fn most_within(
    limit: u64,
    max_triangles: Option<u64>,
    mut make: impl FnMut(Option<u64>) -> Result<Attempt>,
) -> Result<Attempt> {
    let mut over = make(max_triangles)?;
    if over.bytes <= limit {
        return Ok(over);
    }
    let mut within: Option<Attempt> = None;
    for _ in 1..MOST_ATTEMPTS {
        let Some(triangles) = next(limit, &over, within.as_ref()) else { break };
        let attempt = make(Some(triangles))?;
        if attempt.bytes > limit {
            over = attempt;
        } else {
            within = Some(attempt);
            if attempt.bytes as f64 >= NEAR * limit as f64 {
                break;
            }
        }
    }
    within.ok_or_else(|| {
        let least = format!("{} or more: that is what {} triangles take", over.bytes, over.triangles);
        Error::invalid("max_bytes", limit, least)
    })
}

/// The triangles to try next: on the line through what is known; `None` when nothing lies between.
fn next(limit: u64, over: &Attempt, within: Option<&Attempt>) -> Option<u64> {
    let (low, low_bytes) = within.map_or((0.0, 0.0), |fits| (fits.triangles as f64, fits.bytes as f64));
    let (high, high_bytes) = (over.triangles as f64, over.bytes as f64);
    let aim = (AIM * limit as f64).max(low_bytes);
    let share = (aim - low_bytes) / (high_bytes - low_bytes).max(1.0);
    // No triangles at all take bytes, too: the line from 0 is too steep.
    let shy = if within.is_some() { 1.0 } else { 0.97 };
    let triangles = (low + shy * share * (high - low)).floor().max(low + 1.0);
    (triangles < high).then_some(triangles as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn search(limit: u64, all: u64, header: u64, each: u64) -> (Result<Attempt>, u32) {
        let mut made = 0;
        let found = most_within(limit, None, |most| {
            made += 1;
            let triangles = most.map_or(all, |most| most.min(all));
            Ok(Attempt { max_triangles: most, triangles, bytes: header + each * triangles })
        });
        (found, made)
    }

    #[test]
    fn what_fits_is_left_alone() {
        let (found, made) = search(10_000, 100, 500, 60);
        assert_eq!((found.unwrap().triangles, made), (100, 1));
    }

    #[test]
    fn the_limit_is_kept_and_nearly_reached() {
        for (limit, header) in [(3_000_000, 1500), (1_000_000, 100_000), (50_000, 1500), (5_999_999, 0)] {
            let (found, made) = search(limit, 100_000, header, 60);
            let found = found.unwrap();
            assert!(found.bytes <= limit && found.bytes as f64 > 0.9 * limit as f64, "{limit}: {found:?}");
            assert!(made <= MOST_ATTEMPTS, "{made}");
            assert_eq!(found.max_triangles, Some(found.triangles));
        }
    }

    #[test]
    fn a_limit_below_one_triangle_is_an_error() {
        let error = search(1000, 50_000, 1500, 60).0.unwrap_err().to_string();
        assert!(error.starts_with("max_bytes is 1000: expected "), "{error}");
    }
}
