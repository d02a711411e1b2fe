//! The time limit of a run, and its clock.

use crate::process::cpu_secs;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;
use std::time::Instant;

/// The longest budget, seconds: thirty years.
const LONGEST: f64 = 1e9;

/// A number of seconds, written as `90`, `90s`, `1.5m` or `2h`.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Seconds(pub f64);

impl FromStr for Seconds {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let unit =
            [('s', 1.0), ('m', 60.0), ('h', 3600.0)].into_iter().find(|(unit, _)| text.ends_with(*unit));
        let (number, factor) = match unit {
            Some((_, factor)) => (&text[..text.len() - 1], factor),
            None => (text, 1.0),
        };
        let seconds = number.parse::<f64>().ok().map(|number| number * factor);
        // NaN is in no range.
        seconds
            .filter(|seconds| *seconds > 0.0 && *seconds <= LONGEST)
            .map(Self)
            .ok_or_else(|| "expected a time above 0, at most 1e9 seconds, as in 30s, 2m or 1.5h".to_owned())
    }
}

impl fmt::Display for Seconds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (number, unit) = match self.0 {
            seconds if seconds < 120.0 => (seconds, "s"),
            seconds if seconds < 7200.0 => (seconds / 60.0, "m"),
            seconds => (seconds / 3600.0, "h"),
        };
        let shown = if number < 0.01 { number } else { (number * 100.0).round() / 100.0 };
        write!(f, "{shown}{unit}")
    }
}

/// The clock of a budget.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum BudgetClock {
    /// User and system seconds of the process, on all cores.
    #[default]
    Cpu,
    /// Seconds that pass.
    Wall,
}

/// The time limit of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Budget {
    /// How long.
    pub seconds: Seconds,
    /// By which clock.
    pub clock: BudgetClock,
}

impl Budget {
    /// A budget of CPU seconds.
    pub fn cpu(seconds: Seconds) -> Self {
        Self { seconds, clock: BudgetClock::Cpu }
    }

    /// A budget of wall-clock seconds.
    pub fn wall(seconds: Seconds) -> Self {
        Self { seconds, clock: BudgetClock::Wall }
    }

    /// The name of its option.
    pub fn option(&self) -> &'static str {
        match self.clock {
            BudgetClock::Cpu => "budget",
            BudgetClock::Wall => "budget_wall",
        }
    }
}

impl fmt::Display for Budget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.clock {
            BudgetClock::Cpu => write!(f, "{} of CPU time", self.seconds),
            BudgetClock::Wall => write!(f, "{}", self.seconds),
        }
    }
}

/// A clock for the spent part of a budget.
#[derive(Debug, Clone, Copy)]
pub struct Spending {
    clock: BudgetClock,
    /// When it began.
    began: Instant,
    /// CPU seconds of the process when it began.
    cpu_began: f64,
    /// Seconds spent by earlier processes of the same run.
    before: f64,
}

impl Spending {
    /// That begins now.
    pub fn new(clock: BudgetClock) -> Self {
        Self { clock, began: Instant::now(), cpu_began: cpu_secs(), before: 0.0 }
    }

    /// For the whole process, which began at about `began`.
    pub fn of_process(clock: BudgetClock, began: Instant) -> Self {
        Self { clock, began, cpu_began: 0.0, before: 0.0 }
    }

    /// The same, after `before` seconds of earlier processes.
    pub fn after(self, before: f64) -> Self {
        Self { before, ..self }
    }

    /// Seconds spent so far.
    pub fn seconds(&self) -> f64 {
        let now = match self.clock {
            BudgetClock::Cpu => cpu_secs() - self.cpu_began,
            BudgetClock::Wall => self.began.elapsed().as_secs_f64(),
        };
        self.before + now
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_have_units() {
        for (text, seconds, shown) in [
            ("90", 90.0, "90s"),
            ("30s", 30.0, "30s"),
            ("2m", 120.0, "2m"),
            ("1.5m", 90.0, "90s"),
            ("0.25h", 900.0, "15m"),
            ("3h", 10_800.0, "3h"),
        ] {
            let parsed: Seconds = text.parse().unwrap();
            assert_eq!((parsed.0, parsed.to_string().as_str()), (seconds, shown), "{text}");
        }
        for bad in
            ["", "0", "0s", "-1", "-1m", "nan", "NaNs", "inf", "1e10", "abc", "m", "2 m", "2d", "2m-wall"]
        {
            assert!(bad.parse::<Seconds>().is_err(), "{bad}");
        }
    }
}
