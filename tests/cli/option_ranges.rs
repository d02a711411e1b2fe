//! Every number of every option has one range, and keeps to it.

use schemars::JsonSchema;
use serde::{Serialize, de::DeserializeOwned};
use serde_json::Value;
use trisplat_bake::{BakeOptions, MeshOptions};
use trisplat_dataset::DatasetOptions;
use trisplat_scale::PlanOptions;
use trisplat_scene::{
    Error, Result,
    ranges::{ABOVE_ZERO, Called, each},
};
use trisplat_train::TrainOptions;

/// What is told of every number: where it stands, its key and its range.
type Found<'a> = dyn FnMut(&Numbers<'_>, &str, (f64, f64)) + 'a;

/// Calls `found` with every number of every option, and its range.
fn every(found: &mut Found<'_>) {
    let mut bake = BakeOptions::default();
    bake.teacher.teacher_pictures = Some(5);
    bake.prune.max_triangles = Some(5);
    bake.unseen.max_error = Some(0.5);
    bake.lod.lod = vec![0.5];
    numbers(&bake, BakeOptions::validate, Called::ByFlag, found);
    let mut mesh = MeshOptions::default();
    mesh.surface.resolution = Some(128);
    mesh.surface.voxel = Some(0.5);
    mesh.surface.max_triangles = Some(5);
    numbers(&mesh, MeshOptions::validate, Called::ByFlag, found);
    let plan = PlanOptions { blocks: Some(5), ..PlanOptions::default() };
    numbers(&plan, PlanOptions::validate, Called::ByFlag, found);
    let photos = DatasetOptions { max_size: Some(5), ..DatasetOptions::default() };
    numbers(&photos, DatasetOptions::validate, Called::ByFlag, found);
    numbers(&TrainOptions::default(), TrainOptions::validate, Called::ByKey, found);
}

/// Options, a way to check them, and how their numbers are called.
struct Numbers<'a> {
    options: Value,
    validate: &'a dyn Fn(Value) -> Result<()>,
    called: Called,
}

fn numbers<T: Serialize + DeserializeOwned + JsonSchema>(
    options: &T,
    validate: fn(&T) -> Result<()>,
    called: Called,
    found: &mut Found<'_>,
) {
    validate(options).expect("the defaults are in range");
    let read = |value| {
        let read: T =
            serde_json::from_value(value).map_err(|e| Error::invalid("options", e, "a number"))?;
        validate(&read)
    };
    let json = serde_json::to_value(options).expect("options are JSON");
    let numbers = Numbers { options: json, validate: &read, called };
    let mut visit = |key: &str, _: f64, range: (f64, f64)| {
        found(&numbers, key, range);
        Ok(())
    };
    each(options, &mut visit).expect("nothing is checked");
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

#[test]
fn every_number_of_every_option_has_a_range_and_keeps_to_it() {
    let mut count = 0;
    every(&mut |Numbers { options, validate, called }, key, range| {
        // Any number is a seed, and limits are what a user makes them.
        if key == "seed" || key.starts_with("limits.") {
            return;
        }
        count += 1;
        assert!(range.0 > f64::MIN && range.1 < f64::MAX, "{key} has no range");
        let name =
            if *called == Called::ByKey { key } else { key.rsplit('.').next().expect("a name") };
        for number in outside(range) {
            let whole = number.fract() == 0.0 && number.abs() < 1e18;
            let number: Value = if whole { (number as i64).into() } else { number.into() };
            let error = validate(with(options, key, number.clone()));
            let error = error.expect_err(&format!("{key} may be {number}")).to_string();
            // What the type of a number cannot hold is refused where it is read.
            assert!(error.contains(name) || error.starts_with("options is "), "{key}: {error}");
        }
    });
    assert!(count > 60, "{count} numbers");
}

/// Numbers just outside a range and far from it.
fn outside((low, high): (f64, f64)) -> Vec<f64> {
    let below = if low == ABOVE_ZERO { 0.0 } else { low - (1e-6 * low.abs()).max(1e-9) };
    let near = if low.fract() == 0.0 && high.fract() == 0.0 {
        [low - 1.0, high + 1.0]
    } else {
        [below, 2.0 * high]
    };
    [below, near[0], near[1], -1e300, 1e300].into()
}

#[test]
fn a_number_that_is_not_finite_is_out_of_every_range() {
    let mut options = TrainOptions::default();
    options.rates.corners = f64::NAN;
    assert!(options.validate().unwrap_err().to_string().contains("rates.corners is NaN"));
    let mut options = BakeOptions::default();
    options.unseen.max_error = Some(f64::INFINITY);
    assert!(options.validate().unwrap_err().to_string().contains("max_error is inf"));
}
