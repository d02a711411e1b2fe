//! The ranges of all numeric options, in one table; each number is checked by its key before any work.

use crate::error::{Error, Result};
use serde::Serialize;
use serde_json::Value;

/// Anything that is finite.
pub const ANY: (f64, f64) = (f64::MIN, f64::MAX);
/// Practically unbounded.
const LARGEST: f64 = 1e9;
/// Above 0, however little.
pub const ABOVE_ZERO: f64 = f64::MIN_POSITIVE;
/// More triangles have corners beyond 32-bit indices.
const TRIANGLES: f64 = LARGEST;

/// A key of options, as in `loss.opacity`, with its lowest and highest value.
pub type Row = (&'static str, (f64, f64));

/// Every number of the options of a bake, a mesh, a plan, a training and a data set. Dependencies between
/// options are checked at their use, too.
pub const RANGES: &[Row] = &[
    // Data set.
    ("max_size", (1.0, 65_535.0)),
    ("test_every", (0.0, 1e6)),
    ("photo_memory_mib", (0.0, 16_777_216.0)),
    ("limits", ANY),
    // Bake.
    ("teacher.teacher_pictures", (1.0, 100_000.0)),
    ("collision.collision_triangles", (1.0, TRIANGLES)),
    ("prune.min_opacity", (0.0, 1.0)),
    ("prune.max_sigma", (0.0, LARGEST)),
    ("prune.max_edge", (0.0, LARGEST)),
    ("prune.max_triangles", (1.0, TRIANGLES)),
    ("solid.contour", (0.0, 1.0)),
    ("unseen.min_seen_px", (0.0, LARGEST)),
    ("unseen.max_error", (0.0, 1000.0)),
    ("reshape.reshape_rounds", (1.0, 10_000.0)),
    ("lod.lod", (0.0, 1.0)),
    ("tiles.tile_triangles", (1000.0, TRIANGLES)),
    ("refit.refit_flatness", (0.0, LARGEST)),
    ("refit.refit_passes", (1.0, 1000.0)),
    ("texture.texture_size", (64.0, 8192.0)),
    ("texture.texture_pages", (1.0, 16.0)),
    ("texture.texels_per_pixel", (0.05, 4.0)),
    ("texture.texture_flatness", (0.0, LARGEST)),
    ("place.rotate", (-360.0, 360.0)),
    ("place.scale", (1e-9, LARGEST)),
    ("chunk.chunk_triangles", (0.0, 21_845.0)),
    ("output.tileset_tiles", (5.0, TRIANGLES)),
    // Mesh.
    ("surface.resolution", (8.0, 65_536.0)),
    ("surface.voxel", (1e-9, LARGEST)),
    ("surface.truncation", (2.0, 64.0)),
    ("surface.min_views", (1.0, 1e6)),
    ("surface.min_component", (0.0, TRIANGLES)),
    ("surface.max_triangles", (1.0, TRIANGLES)),
    // Plan.
    ("blocks", (1.0, 65_536.0)),
    ("block_triangles", (1.0, TRIANGLES)),
    ("halo", (0.0, 1.0)),
    ("min_cover", (0.0, 0.5)),
    ("block_photos", (0.0, 1e6)),
    ("passes", (0.0, 100.0)),
    ("coarse_steps", (0.0, LARGEST)),
    ("coarse_triangles", (0.0, TRIANGLES)),
    // Training.
    ("steps", (1.0, LARGEST)),
    ("max_triangles", (1.0, TRIANGLES)),
    ("sh_degree", (0.0, 3.0)),
    ("seed", ANY),
    ("milestones", (0.0, LARGEST)),
    ("init.size", (ABOVE_ZERO, 1000.0)),
    ("init.shell_subdivisions", (0.0, 6.0)),
    ("loss.dssim", (0.0, 1.0)),
    ("loss.opacity", (0.0, LARGEST)),
    ("loss.distortion", (0.0, LARGEST)),
    ("loss.normal", (0.0, LARGEST)),
    ("loss.size", (0.0, LARGEST)),
    ("rates.vertices", (0.0, LARGEST)),
    ("densify.until", (0.0, LARGEST)),
    ("densify.every", (ABOVE_ZERO, LARGEST)),
    ("densify.growth", (0.0, LARGEST)),
    ("densify.relocate", (0.0, 1.0)),
    ("densify.split_px", (0.0, LARGEST)),
    ("densify.prune_weight", (0.0, 1.0)),
    ("warmup.quarter_until", (0.0, LARGEST)),
    ("warmup.half_until", (0.0, LARGEST)),
    ("solid.opacity_from", (0.0, LARGEST)),
    ("solid.opacity_until", (0.0, LARGEST)),
];

/// Optional numbers.
const MAY_BE_LEFT_OUT: [&str; 9] = [
    "max_size",
    "teacher.teacher_pictures",
    "prune.max_triangles",
    "unseen.max_error",
    "surface.resolution",
    "surface.voxel",
    "surface.max_triangles",
    "blocks",
    "block_triangles",
];

/// The name of a number in errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Called {
    /// By its flag, the last part of its key: `max_sigma`.
    ByFlag,
    /// By its whole key: `loss.opacity`.
    ByKey,
}

/// Checks every number of `options`, of `group` or, if that is empty, of all groups, against the table.
///
/// Errors: the first number out of its range.
pub fn check(group: &str, options: &impl Serialize, called: Called) -> Result<()> {
    let value = serde_json::to_value(options).map_err(|e| Error::invalid("options", e, "numbers"))?;
    each(&value, group, &mut |key, number| match row(key) {
        Some(range) => within(key, number, range, called),
        None => Ok(()),
    })
}

/// [`check`] of an optional number, because JSON cannot tell a missing number from one that is not finite.
pub fn check_given(key: &str, value: Option<f64>) -> Result<()> {
    match (value, row(key)) {
        (Some(value), Some(range)) => within(key, value, range, Called::ByFlag),
        _ => Ok(()),
    }
}

/// A count on the command line.
pub fn count(text: &str) -> std::result::Result<usize, String> {
    let number: Option<usize> = text.parse().ok();
    number
        .filter(|count| (1..=LARGEST as usize).contains(count))
        .ok_or_else(|| "expected 1 to 1e9".to_owned())
}

fn row(key: &str) -> Option<(f64, f64)> {
    RANGES.iter().find(|(row, _)| row_covers(row, key)).map(|(_, range)| *range)
}

/// Whether a row is for this key or its group.
pub fn row_covers(row: &str, key: &str) -> bool {
    key.strip_prefix(row).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
}

/// Calls `visit` with the key of each number; NaN for one that is not finite, which JSON cannot express.
pub fn each(value: &Value, key: &str, visit: &mut impl FnMut(&str, f64) -> Result<()>) -> Result<()> {
    match value {
        Value::Number(number) => visit(key, number.as_f64().unwrap_or(f64::NAN)),
        Value::Null if MAY_BE_LEFT_OUT.contains(&key) => Ok(()),
        Value::Null => visit(key, f64::NAN),
        Value::Array(items) => items.iter().try_for_each(|item| each(item, key, visit)),
        Value::Object(fields) => fields.iter().try_for_each(|(name, field)| {
            let key = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
            each(field, &key, visit)
        }),
        Value::Bool(_) | Value::String(_) => Ok(()),
    }
}

fn within(key: &str, value: f64, (low, high): (f64, f64), called: Called) -> Result<()> {
    let option = match called {
        Called::ByKey => key,
        Called::ByFlag => key.rsplit('.').next().unwrap_or(key),
    };
    match (low..=high).contains(&value) {
        true => Ok(()),
        false => Err(Error::invalid(option, value, words(low, high))),
    }
}

fn words(low: f64, high: f64) -> String {
    // 1e9 is easier to read than 1000000000.
    let short = |x: f64| if x >= 1e6 && x.log10().fract() == 0.0 { format!("{x:e}") } else { x.to_string() };
    match low {
        ABOVE_ZERO => format!("> 0, at most {}", short(high)),
        _ if high >= LARGEST => format!("{} or more, at most {}", short(low), short(high)),
        _ => format!("{} to {}", short(low), short(high)),
    }
}
