//! How many triangles fit a number of bytes, found by writing files.
//!
//! Bytes are nearly in proportion to triangles of any shape. So a scene without fitting, which costs little,
//! is measured first, and gives a nearly right number of triangles. The size of the final files decides.

use trisplat_scene::{Error, Result};

/// Probes at most, the first with all triangles among them.
const MOST_PROBES: u32 = 7;

/// Attempts to come closer to the limit; more only while nothing that is [`CLOSE`] fits.
const ENOUGH: u32 = 2;
/// Most attempts in all.
const MOST_MADE: u32 = 7;

/// A file this close to its limit is good enough, ...
const NEAR: f64 = 0.96;
/// ... and after [`ENOUGH`] attempts one this close.
const CLOSE: f64 = 0.9;

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

impl Attempt {
    /// What decides its size: the number that was permitted. Later stages may have dropped some of them.
    fn permitted(&self) -> u64 {
        self.max_triangles.unwrap_or(self.triangles)
    }

    fn fills(&self, share: f64, limit: u64) -> bool {
        self.bytes as f64 >= share * limit as f64
    }
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
    let Probed { mut most, all } = probed(limit, max_triangles, probe)?;
    let (mut over, mut within): (Option<Attempt>, Option<(Attempt, T)>) = (None, None);
    for made in 1..=MOST_MADE {
        let (attempt, scene) = make(most)?;
        if attempt.bytes > limit {
            over = Some(attempt);
        } else if within.as_ref().is_none_or(|(best, _)| best.bytes < attempt.bytes) {
            within = Some((attempt, scene));
        }
        let best = within.as_ref().map(|(best, _)| best);
        let share = if made < ENOUGH { NEAR } else { CLOSE };
        let is_enough = |best: &Attempt| {
            best.max_triangles == max_triangles || best.permitted() >= all || best.fills(share, limit)
        };
        if best.is_some_and(is_enough) {
            break;
        }
        match next(limit, over.as_ref(), best) {
            Some(triangles) => most = Some(triangles.min(all)),
            None => break,
        }
    }
    match (within, over) {
        (Some((_, scene)), _) => Ok(scene),
        (None, over) => Err(too_few(limit, over)),
    }
}

/// What probes found.
struct Probed {
    /// How many triangles to permit.
    most: Option<u64>,
    /// How many there are, at most the requested number: more cannot be permitted.
    all: u64,
}

/// How many triangles fit according to probes; at most the requested number.
fn probed(
    limit: u64,
    max_triangles: Option<u64>,
    mut probe: impl FnMut(Option<u64>) -> Result<Attempt>,
) -> Result<Probed> {
    let mut over = probe(max_triangles)?;
    let all = over.triangles;
    if over.bytes <= limit {
        return Ok(Probed { most: max_triangles, all });
    }
    let mut within: Option<Attempt> = None;
    for _ in 1..MOST_PROBES {
        let Some(triangles) = next(limit, Some(&over), within.as_ref()) else { break };
        let attempt = probe(Some(triangles))?;
        if attempt.bytes > limit {
            over = attempt;
        } else {
            within = Some(attempt);
            if attempt.fills(NEAR, limit) {
                break;
            }
        }
    }
    let most = within.map_or_else(|| next(limit, Some(&over), None), |found| found.max_triangles);
    most.map_or_else(|| Err(too_few(limit, Some(over))), |most| Ok(Probed { most: Some(most), all }))
}

fn too_few(limit: u64, over: Option<Attempt>) -> Error {
    let least = over.map_or("more".to_owned(), |over| {
        format!("{} or more: that is what {} triangles take", over.bytes, over.triangles)
    });
    Error::invalid("max_bytes", limit, least)
}

/// The number of triangles to try next, on the line through the known sizes; `None` when nothing lies
/// between.
fn next(limit: u64, over: Option<&Attempt>, within: Option<&Attempt>) -> Option<u64> {
    let at = |attempt: &Attempt| (attempt.permitted() as f64, attempt.bytes as f64);
    let (low, low_bytes) = within.map_or((0.0, 0.0), at);
    let aim = (AIM * limit as f64).max(low_bytes);
    let Some((high, high_bytes)) = over.map(at) else {
        // If none were too many, bytes are taken to be in proportion to triangles.
        return Some((low * aim / low_bytes.max(1.0)).floor().max(low + 1.0) as u64);
    };
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

    /// Half of a soft scene's triangles go once pictures tell which of them are seen.
    #[test]
    fn triangles_that_later_stages_drop_make_room_for_others() {
        let limit = 20_000;
        let measured = |most: Option<u64>, kept: f64| {
            let triangles = (kept * most.map_or(1000, |most| most.min(1000)) as f64) as u64;
            Attempt { max_triangles: most, triangles, bytes: 1500 + 60 * triangles }
        };
        for kept in [0.1, 0.4, 0.7, 1.0] {
            let probe = |most| Ok(measured(most, 1.0));
            let make = |most| Ok((measured(most, kept), measured(most, kept)));
            let found = most_within(limit, None, probe, make).unwrap();
            assert!(found.bytes <= limit, "{kept}: {found:?}");
            let all = measured(None, kept).bytes;
            assert!(found.fills(CLOSE, limit.min(all)), "{kept}: {found:?}");
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
