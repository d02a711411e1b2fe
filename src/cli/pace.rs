//! Progress in lines, where no bar can be drawn: an estimate after some seconds, then a line every
//! ten percent or thirty seconds.

use indicatif::HumanDuration;
use std::time::{Duration, Instant};

/// Minimum share of the work before the time left is told.
const MIN_FRACTION: f64 = 0.01;
/// Minimum time before the time left is told.
const MIN_TIME: Duration = Duration::from_millis(500);
/// Time before the first line; shorter work has none.
const FIRST: Duration = Duration::from_secs(3);
/// Least and most time between two lines.
const BETWEEN: [Duration; 2] = [Duration::from_secs(10), Duration::from_secs(30)];

/// Decides when a line of progress is due.
#[derive(Debug)]
pub(super) struct Pace {
    began: Instant,
    /// Share that was done before.
    from: f64,
    /// When the last line was due, and the tenths that were done then.
    told: Option<(Instant, u64)>,
}

impl Pace {
    /// Work that begins now, with the share `from` done.
    pub(super) fn new(from: f64) -> Self {
        Self { began: Instant::now(), from, told: None }
    }

    /// Share and time left, as in "40%, 2 minutes left", if a line is due.
    pub(super) fn due(&mut self, fraction: f64) -> Option<String> {
        self.due_at(Instant::now(), fraction)
    }

    fn due_at(&mut self, now: Instant, fraction: f64) -> Option<String> {
        let elapsed = now - self.began;
        let tenths = (10.0 * fraction) as u64;
        let is_due = match self.told {
            None => {
                elapsed >= FIRST && (fraction - self.from >= MIN_FRACTION || elapsed >= BETWEEN[1])
            }
            Some((told, before)) => {
                let waited = now - told;
                (waited >= BETWEEN[0] && tenths > before) || waited >= BETWEEN[1]
            }
        };
        if !is_due || fraction >= 1.0 {
            return None;
        }
        self.told = Some((now, tenths));
        let left = time_left(elapsed, fraction, self.from);
        let left = left.map_or(String::new(), |left| format!(", {left}"));
        Some(format!("{:.0}%{left}", (100.0 * fraction).floor()))
    }
}

/// "12 seconds left" at the present rate, if the share `from` was done before; `None` when it is
/// too early to tell.
pub(super) fn time_left(elapsed: Duration, fraction: f64, from: f64) -> Option<String> {
    let done = fraction - from;
    (done >= MIN_FRACTION && elapsed >= MIN_TIME).then(|| {
        let seconds = elapsed.as_secs_f64() * (1.0 - fraction.min(1.0)) / done;
        format!("{} left", HumanDuration(Duration::from_secs_f64(seconds.ceil())))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_left_is_in_proportion_to_what_is_left() {
        let left = |elapsed, fraction| time_left(Duration::from_secs(elapsed), fraction, 0.0);
        assert_eq!(left(10, 0.25).as_deref(), Some("30 seconds left"));
        assert_eq!(left(100, 1.0).as_deref(), Some("0 seconds left"));
        assert_eq!(left(100, 0.001), None, "too little is done");
        assert_eq!(left(0, 0.5), None, "too early");
        let resumed = time_left(Duration::from_secs(10), 0.75, 0.5);
        assert_eq!(resumed.as_deref(), Some("10 seconds left"));
    }

    #[test]
    fn lines_are_due_every_ten_percent_or_thirty_seconds() {
        let lines = |seconds: u32| {
            let mut pace = Pace::new(0.0);
            let began = pace.began;
            let at = |second: u32| began + Duration::from_secs(second.into());
            let share = |second: u32| f64::from(second) / f64::from(seconds);
            (0..=seconds).filter_map(|s| pace.due_at(at(s), share(s))).collect::<Vec<_>>()
        };
        assert_eq!(lines(2), [""; 0]);
        assert_eq!(lines(20), ["15%, 17 seconds left", "65%, 7 seconds left"]);
        assert_eq!(lines(200).len(), 10, "an estimate, and nine tenths");
        let long = lines(2000);
        assert_eq!(long[0], "1%, 33 minutes left");
        assert!((60..70).contains(&long.len()), "{long:?}");
    }
}
