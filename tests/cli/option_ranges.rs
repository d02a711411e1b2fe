//! Every number of every option has one range, and keeps to it.

use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeSet;
use trisplat_bake::{BakeOptions, MeshOptions};
use trisplat_dataset::DatasetOptions;
use trisplat_scale::PlanOptions;
use trisplat_scene::{
    Error, Result,
    ranges::{ABOVE_ZERO, ANY, Called, RANGES, each, row_covers},
};
use trisplat_train::{TrainOptions, TrainPreset};

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
            let name = if called == Called::ByKey { &key } else { key.rsplit('.').next().expect("a name") };
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
    let unused: Vec<&str> = RANGES.iter().map(|(row, _)| *row).filter(|row| !used.contains(row)).collect();
    assert!(unused.is_empty(), "ranges of nothing: {unused:?}");
}

/// Numbers just outside a range and far from it; none of a range that holds everything.
fn outside((low, high): (f64, f64)) -> Vec<f64> {
    let below = if low == ABOVE_ZERO { 0.0 } else { low - (1e-6 * low.abs()).max(1e-9) };
    let near =
        if low.fract() == 0.0 && high.fract() == 0.0 { [low - 1.0, high + 1.0] } else { [below, 2.0 * high] };
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
