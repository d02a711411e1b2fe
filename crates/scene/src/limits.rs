//! Limits: of inputs, one value for all readers, and of the time of a run.

use crate::error::{Error, Result};
use crate::process::cpu_secs;
use bytemuck::Zeroable;
use glam::UVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt::{self, Display};
use std::path::Path;
use std::str::FromStr;
use std::time::Instant;

/// Limits on files. Data beyond a limit are refused before memory is allocated; the error names the
/// limit and how to raise it. The defaults exceed every scene in the literature.
///
/// ```
/// use trisplat_scene::Limits;
///
/// let mut limits = Limits::default();
/// limits.set("picture_pixels=400000000")?;
/// assert_eq!(limits.picture_pixels, 400_000_000);
/// assert!(limits.set("pixels=1").is_err(), "there is no such limit");
/// # Ok::<(), trisplat_scene::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Longer side of a photo, mask or camera, px.
    pub picture_side: u64,
    /// Pixels of a photo or mask.
    pub picture_pixels: u64,
    /// Pixels of a camera. Drawing its view takes some 40 bytes per pixel.
    pub camera_pixels: u64,
    /// Triangles of a scene: by default ten times the largest one in the literature.
    pub triangles: u64,
    /// Vertices of a scene, points of a cloud.
    pub vertices: u64,
    /// Bytes of a file.
    pub file_bytes: u64,
    /// Bytes of a file that is read into memory whole (JSON, photos, masks, lists), and of a line
    /// of COLMAP's text.
    pub document_bytes: u64,
    /// Bytes of one array in memory.
    pub array_bytes: u64,
    /// Entries of an array in a glTF document: nodes, meshes, accessors.
    pub nodes: u64,
    /// Nodes of a glTF document between a root and its farthest descendant.
    pub nesting: u64,
    /// Worker threads per core.
    pub threads_per_core: u64,
}

impl Limits {
    /// The default limits.
    pub const DEFAULT: Self = Self {
        // The largest side of a JPEG; the best cameras have 200 million pixels.
        picture_side: 65_535,
        picture_pixels: 1 << 28,
        camera_pixels: 1 << 27,
        triangles: 1 << 26,
        vertices: 1 << 28,
        file_bytes: 1 << 38,
        document_bytes: 1 << 30,
        array_bytes: 1 << 34,
        // Three bytes of JSON make a node of some 200 bytes.
        nodes: 1 << 20,
        nesting: 1 << 12,
        threads_per_core: 4,
    };

    /// Sets one limit, given as `KEY=VALUE`.
    ///
    /// # Errors
    ///
    /// An unknown limit, or not a whole number.
    pub fn set(&mut self, setting: &str) -> Result<()> {
        let wrong = |wants: String| Error::invalid("limit", setting, wants);
        let (key, value) = setting
            .split_once('=')
            .ok_or_else(|| wrong("KEY=VALUE, as in triangles=100000000".to_owned()))?;
        let mut all = serde_json::to_value(*self).unwrap_or_default();
        let expected_keys = |all: &serde_json::Value| {
            let names = all.as_object().into_iter().flat_map(|map| map.keys().map(String::as_str));
            format!("one of {}", names.collect::<Vec<_>>().join(", "))
        };
        let Some(slot) = all.get_mut(key) else { return Err(wrong(expected_keys(&all))) };
        let value: u64 =
            value.parse().map_err(|_| wrong("a whole number, 0 or more".to_owned()))?;
        *slot = value.into();
        *self = serde_json::from_value(all).map_err(|e| wrong(e.to_string()))?;
        Ok(())
    }

    /// Refuses a picture that is too large; `place` names it.
    pub fn picture(&self, place: impl Display, size: UVec2) -> Result<()> {
        self.side(&place, size)?;
        check(place, "pixels", "picture_pixels", pixels(size), self.picture_pixels)
    }

    /// Refuses a camera whose pictures are too large to be drawn; `place` names it.
    pub fn camera(&self, place: impl Display, size: UVec2) -> Result<()> {
        self.side(&place, size)?;
        check(place, "pixels", "camera_pixels", pixels(size), self.camera_pixels)
    }

    fn side(&self, place: impl Display, size: UVec2) -> Result<()> {
        let side = u64::from(size.max_element());
        check(place, "px on one side", "picture_side", side, self.picture_side)
    }

    /// Refuses a file with too many triangles; `place` is its path, or a place in it.
    pub fn triangles(&self, place: impl Display, count: u64) -> Result<()> {
        check(place, "triangles", "triangles", count, self.triangles)
    }

    /// Refuses a file with too many vertices or points.
    pub fn vertices(&self, place: impl Display, count: u64) -> Result<()> {
        check(place, "vertices", "vertices", count, self.vertices)
    }

    /// Refuses a file that is too large.
    pub fn file(&self, path: &Path, bytes: u64) -> Result<()> {
        check(path.display(), "bytes", "file_bytes", bytes, self.file_bytes)
    }

    /// Refuses a file, or a part of one, that is too large to be read into memory whole.
    pub fn document(&self, place: impl Display, bytes: u64) -> Result<()> {
        check(place, "bytes", "document_bytes", bytes, self.document_bytes)
    }

    /// Refuses too many entries of an array of a document.
    pub fn nodes(&self, place: impl Display, count: u64) -> Result<()> {
        check(place, "entries", "nodes", count, self.nodes)
    }

    /// Refuses a tree that is too deep.
    pub fn nesting(&self, place: impl Display, depth: u64) -> Result<()> {
        check(place, "levels of nodes", "nesting", depth, self.nesting)
    }

    /// Reserves memory for `additional` entries of `list`. An array beyond the limit, or without
    /// enough memory, is an error.
    pub fn reserve<T>(
        &self,
        place: impl Display,
        list: &mut Vec<T>,
        additional: usize,
    ) -> Result<()> {
        let bytes = self.array::<T>(&place, list.len().saturating_add(additional))?;
        list.try_reserve_exact(additional)
            .map_err(|_| Error::Memory { place: place.to_string(), bytes })
    }

    /// An array of `count` zeros.
    ///
    /// # Errors
    ///
    /// As for [`Limits::reserve`].
    pub fn zeroed<T: Zeroable>(&self, place: impl Display, count: usize) -> Result<Vec<T>> {
        let bytes = self.array::<T>(&place, count)?;
        bytemuck::allocation::try_zeroed_vec(count)
            .map_err(|()| Error::Memory { place: place.to_string(), bytes })
    }

    /// Bytes of an array of `count` entries, if within the limit.
    fn array<T>(&self, place: impl Display, count: usize) -> Result<u64> {
        let bytes = (count as u64).saturating_mul(size_of::<T>() as u64);
        check(place, "bytes in one array", "array_bytes", bytes, self.array_bytes)?;
        Ok(bytes)
    }
}

crate::default!(Limits);

fn pixels(size: UVec2) -> u64 {
    u64::from(size.x) * u64::from(size.y)
}

fn check(
    place: impl Display,
    what: &'static str,
    key: &'static str,
    value: u64,
    limit: u64,
) -> Result<()> {
    if value <= limit {
        return Ok(());
    }
    Err(Error::Limit { place: place.to_string(), what, key, value, limit })
}

// ---- The time limit of a run, and its clock -----------------------------------------------------

/// Maximum budget, seconds: thirty years.
const MAX_SECONDS: f64 = 1e9;

/// A number of seconds, written as `90`, `90s`, `1.5m` or `2h`.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Seconds(pub f64);

impl FromStr for Seconds {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let unit = [('s', 1.0), ('m', 60.0), ('h', 3600.0)]
            .into_iter()
            .find(|(unit, _)| text.ends_with(*unit));
        let factor = unit.map_or(1.0, |(_, factor)| factor);
        let number = if unit.is_some() { &text[..text.len() - 1] } else { text };
        let seconds = number.parse::<f64>().ok().map(|number| number * factor);
        // NaN is in no range.
        seconds.filter(|seconds| *seconds > 0.0 && *seconds <= MAX_SECONDS).map(Self).ok_or_else(
            || "expected a time above 0, at most 1e9 seconds, as in 30s, 2m or 1.5h".to_owned(),
        )
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
    /// Duration.
    pub seconds: Seconds,
    /// Clock that measures it.
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
    /// Start of the clock.
    began: Instant,
    /// CPU seconds of the process at the start of the clock.
    cpu_began: f64,
    /// Seconds spent by earlier processes of the same run.
    before: f64,
}

impl Spending {
    /// Starts the clock now.
    pub fn new(clock: BudgetClock) -> Self {
        Self { clock, began: Instant::now(), cpu_began: cpu_secs(), before: 0.0 }
    }

    /// Clock of the whole process, which began at about `began`.
    pub fn of_process(clock: BudgetClock, began: Instant) -> Self {
        Self { clock, began, cpu_began: 0.0, before: 0.0 }
    }

    /// Adds the seconds that earlier processes of the same run have spent.
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
    fn every_limit_can_be_set_by_its_key() {
        let all = serde_json::to_value(Limits::DEFAULT).unwrap();
        for key in all.as_object().unwrap().keys() {
            let mut limits = Limits::DEFAULT;
            limits.set(&format!("{key}=7")).unwrap();
            assert_eq!(serde_json::to_value(limits).unwrap()[key], 7);
            assert_ne!(limits, Limits::DEFAULT);
        }
        let mut limits = Limits::DEFAULT;
        for (setting, wants) in [
            ("triangles", "KEY=VALUE"),
            ("Triangles=1", "picture_side, picture_pixels, camera_pixels"),
            ("nodes=-1", "whole"),
        ] {
            let message = limits.set(setting).unwrap_err().to_string();
            assert!(message.contains(wants) && message.starts_with("limit is "), "{message}");
        }
        assert_eq!(limits, Limits::DEFAULT);
    }

    #[test]
    fn an_error_names_place_value_limit_and_what_lifts_it() {
        let message =
            Limits::DEFAULT.picture("a.png", UVec2::splat(50_000)).unwrap_err().to_string();
        let wants = "a.png: 2500000000 pixels, the limit is 268435456; if that is right, give `limit` \
                     picture_pixels=2500000000";
        assert_eq!(message, wants);
        let mut lifted = Limits::DEFAULT;
        lifted.set("picture_pixels=2500000000").unwrap();
        assert!(lifted.picture("a.png", UVec2::splat(50_000)).is_ok());
        assert!(
            lifted
                .picture("a.png", UVec2::new(65_536, 1))
                .unwrap_err()
                .to_string()
                .contains("picture_side")
        );
    }

    #[test]
    fn what_cannot_be_had_is_an_error() {
        let limits = Limits { array_bytes: u64::MAX, ..Limits::DEFAULT };
        let mut list = vec![1u64];
        let message = limits.reserve("a.ply", &mut list, usize::MAX / 32).unwrap_err().to_string();
        assert!(message.starts_with("a.ply: ") && message.contains("memory"), "{message}");
        assert!(limits.zeroed::<[u64; 4]>("a.ply", usize::MAX / 64).is_err());
        let small = Limits { array_bytes: 64, ..Limits::DEFAULT };
        assert!(small.zeroed::<u64>("a.ply", 8).is_ok());
        assert!(
            small.zeroed::<u64>("a.ply", 9).unwrap_err().to_string().contains("array_bytes=72")
        );
        assert!(small.reserve("a.ply", &mut list, 8).is_err(), "what is there counts");
    }
}

#[cfg(test)]
mod budget_tests {
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
        for bad in [
            "", "0", "0s", "-1", "-1m", "nan", "NaNs", "inf", "1e10", "abc", "m", "2 m", "2d",
            "2m-wall",
        ] {
            assert!(bad.parse::<Seconds>().is_err(), "{bad}");
        }
    }
}
