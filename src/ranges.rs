//! The ranges of all numeric options, in one table; each number is checked by its key before any work.

use crate::error::{Error, Result};
use serde::Serialize;
use serde_json::Value;

/// Anything that is finite.
const ANY: (f64, f64) = (f64::MIN, f64::MAX);
/// Practically unbounded.
const LARGEST: f64 = 1e9;
/// Above 0, however little.
const ABOVE_ZERO: f64 = f64::MIN_POSITIVE;
/// More triangles have corners beyond 32-bit indices.
const TRIANGLES: f64 = LARGEST;

/// A key of options, as in `loss.opacity`, with its lowest and highest value.
type Row = (&'static str, (f64, f64));

/// Every number of the options of a bake, a mesh, a plan, a training and a data set. Dependencies between
/// options are checked at their use, too.
const RANGES: &[Row] = &[
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
    ("refine.until", (0.0, LARGEST)),
    ("refine.every", (ABOVE_ZERO, LARGEST)),
    ("refine.growth", (0.0, LARGEST)),
    ("refine.relocate", (0.0, 1.0)),
    ("refine.split_px", (0.0, LARGEST)),
    ("refine.prune_weight", (0.0, 1.0)),
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
#[cfg(all(feature = "cli", feature = "bench"))]
pub(crate) fn count(text: &str) -> std::result::Result<usize, String> {
    let number: Option<usize> = text.parse().ok();
    number
        .filter(|count| (1..=LARGEST as usize).contains(count))
        .ok_or_else(|| "expected 1 to 1e9".to_owned())
}

fn row(key: &str) -> Option<(f64, f64)> {
    RANGES.iter().find(|(row, _)| row_covers(row, key)).map(|(_, range)| *range)
}

/// Whether a row is for this key or its group.
fn row_covers(row: &str, key: &str) -> bool {
    key.strip_prefix(row).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
}

/// Calls `visit` with the key of each number; NaN for one that is not finite, which JSON cannot express.
fn each(value: &Value, key: &str, visit: &mut impl FnMut(&str, f64) -> Result<()>) -> Result<()> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::BakeOptions;
    use crate::bake::mesh::MeshOptions;
    use crate::dataset::DatasetOptions;
    use crate::scale::PlanOptions;
    use crate::train::{TrainOptions, TrainPreset};
    use std::collections::BTreeSet;

    /// Options with a number for everything that need not be given, as JSON; a way to check them; how numbers are called.
    type Checked = (Value, fn(Value) -> Result<()>, Called);

    fn all() -> [Checked; 5] {
        fn read<T: for<'de> serde::Deserialize<'de>>(value: Value) -> Result<T> {
            serde_json::from_value(value).map_err(|e| Error::invalid("options", e, "a number"))
        }
        fn json(value: &impl Serialize) -> Value {
            serde_json::to_value(value).expect("options are JSON")
        }
        let mut bake = json(&BakeOptions::default());
        bake["teacher"]["teacher_pictures"] = 5.into();
        bake["prune"]["max_triangles"] = 5.into();
        bake["unseen"]["max_error"] = 0.5.into();
        bake["lod"]["lod"] = vec![0.5].into();
        let mut mesh = json(&MeshOptions::default());
        mesh["surface"]["resolution"] = 128.into();
        mesh["surface"]["voxel"] = 0.5.into();
        mesh["surface"]["max_triangles"] = 5.into();
        let mut plan = json(&PlanOptions::default());
        (plan["blocks"], plan["block_triangles"]) = (5.into(), 5.into());
        let mut photos = json(&DatasetOptions::default());
        photos["max_size"] = 5.into();
        let train = json(&TrainOptions::preset(TrainPreset::default()));
        [
            (bake, |value| read::<BakeOptions>(value)?.validate(), Called::ByFlag),
            (mesh, |value| read::<MeshOptions>(value)?.validate(), Called::ByFlag),
            (plan, |value| read::<PlanOptions>(value)?.validate(), Called::ByFlag),
            (photos, |value| read::<DatasetOptions>(value)?.validate(), Called::ByFlag),
            (train, |value| read::<TrainOptions>(value)?.validate(), Called::ByKey),
        ]
    }

    /// `options` with another number at `key`; of an array, its first.
    fn with(options: &Value, key: &str, number: Value) -> Value {
        let mut changed = options.clone();
        let mut place = key.split('.').fold(&mut changed, |value, name| match value {
            Value::Array(items) => &mut items[0][name],
            value => &mut value[name],
        });
        if let Value::Array(items) = place {
            place = &mut items[0];
        }
        *place = number;
        changed
    }

    fn keys(options: &Value) -> BTreeSet<String> {
        let mut keys = BTreeSet::new();
        // What was not given is no number.
        let mut add = |key: &str, number: f64| {
            if !number.is_nan() {
                keys.insert(key.to_owned());
            }
            Ok(())
        };
        each(options, "", &mut add).expect("nothing is checked");
        keys
    }

    #[test]
    fn every_number_of_every_option_has_one_range_and_keeps_to_it() {
        let mut used = BTreeSet::new();
        for (options, validate, called) in all() {
            validate(options.clone()).expect("the defaults are in range");
            for key in keys(&options) {
                let (row, range) = RANGES
                    .iter()
                    .find(|(row, _)| row_covers(row, &key))
                    .unwrap_or_else(|| panic!("{key} has no range"));
                used.insert(*row);
                let name =
                    if called == Called::ByKey { &key } else { key.rsplit('.').next().expect("a name") };
                for number in outside(*range) {
                    let whole = number.fract() == 0.0 && number.abs() < 1e18;
                    let number: Value = if whole { (number as i64).into() } else { number.into() };
                    let error = validate(with(&options, &key, number.clone()));
                    let error = error.expect_err(&format!("{key} may be {number}")).to_string();
                    // What the type of a number cannot hold is refused where it is read.
                    assert!(error.contains(name) || error.starts_with("options is "), "{key}: {error}");
                }
            }
        }
        let unused: Vec<&str> =
            RANGES.iter().map(|(row, _)| *row).filter(|row| !used.contains(row)).collect();
        assert!(unused.is_empty(), "ranges of nothing: {unused:?}");
    }

    /// Numbers just outside a range and far from it; none of a range that holds everything.
    fn outside((low, high): (f64, f64)) -> Vec<f64> {
        let below = if low == ABOVE_ZERO { 0.0 } else { low - (1e-6 * low.abs()).max(1e-9) };
        let near = if low.fract() == 0.0 && high.fract() == 0.0 {
            [low - 1.0, high + 1.0]
        } else {
            [below, 2.0 * high]
        };
        match (low, high) == ANY {
            true => Vec::new(),
            false => [below, near[0], near[1], -1e300, 1e300].into(),
        }
    }

    #[test]
    fn a_number_that_is_not_finite_is_out_of_every_range() {
        let mut options = TrainOptions::default();
        options.rates.vertices = f64::NAN;
        assert!(options.validate().unwrap_err().to_string().contains("rates.vertices is NaN"));
        let mut options = BakeOptions::default();
        options.unseen.max_error = Some(f64::INFINITY);
        assert!(options.validate().unwrap_err().to_string().contains("max_error is inf"));
    }
}
