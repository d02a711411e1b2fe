//! Every number has one range: every option keeps to it, and every flag refuses senseless numbers
//! before any work.

use super::stderr;
use clap::{Arg, Command, CommandFactory};
use schemars::JsonSchema;
use serde::{Serialize, de::DeserializeOwned};
use serde_json::Value;
use std::any::TypeId;
use std::path::Path;
use std::process::Stdio;
use trisplat::cli::program::Cli;
use trisplat_bake::{BakeOptions, MeshOptions};
use trisplat_dataset::DatasetOptions;
use trisplat_scale::PlanOptions;
use trisplat_scene::{
    Error, Result,
    ranges::{ABOVE_ZERO, OptionNaming, each},
};
use trisplat_synthetic::SyntheticOptions;
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
    numbers(&bake, BakeOptions::validate, OptionNaming::Flag, found);
    let mut mesh = MeshOptions::default();
    mesh.surface.resolution = Some(128);
    mesh.surface.voxel = Some(0.5);
    mesh.surface.max_triangles = Some(5);
    numbers(&mesh, MeshOptions::validate, OptionNaming::Flag, found);
    let plan = PlanOptions { blocks: Some(5), ..PlanOptions::default() };
    numbers(&plan, PlanOptions::validate, OptionNaming::Flag, found);
    let photos = DatasetOptions { max_size: Some(5), ..DatasetOptions::default() };
    numbers(&photos, DatasetOptions::validate, OptionNaming::Flag, found);
    numbers(&TrainOptions::default(), TrainOptions::validate, OptionNaming::Key, found);
}

/// Options, a way to check them, and how their numbers are called.
struct Numbers<'a> {
    options: Value,
    validate: &'a dyn Fn(Value) -> Result<()>,
    called: OptionNaming,
}

fn numbers<T: Serialize + DeserializeOwned + JsonSchema>(
    options: &T,
    validate: fn(&T) -> Result<()>,
    called: OptionNaming,
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
        let name = if *called == OptionNaming::Key {
            key
        } else {
            key.rsplit('.').next().expect("a name")
        };
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

/// Flags that may be any number that their type holds.
const ANY: [&str; 2] = ["seed", "threads"];

/// What a flag's type could hold and no flag wants; nothing for flags that take no number.
fn senseless(arg: &Arg) -> Vec<&'static str> {
    let kind = arg.get_value_parser().type_id();
    if kind == TypeId::of::<f64>() {
        return vec!["nan", "inf", "-inf", "-1e308", "1e308"];
    }
    let wholes = [
        (TypeId::of::<u8>(), "255"),
        (TypeId::of::<u16>(), "65535"),
        (TypeId::of::<u32>(), "4294967295"),
        (TypeId::of::<u64>(), "18446744073709551615"),
        (TypeId::of::<usize>(), "18446744073709551615"),
    ];
    let most = wholes.iter().find(|(id, _)| kind == *id).map(|(_, most)| *most);
    let most = most.filter(|_| !ANY.contains(&arg.get_id().as_str()));
    let negative = wholes.iter().any(|(id, _)| kind == *id).then_some("-1");
    most.into_iter().chain(negative).collect()
}

/// What else the command needs.
fn rest(command: &str, flag: &str) -> Vec<&'static str> {
    let words = match command {
        "make" => "photos -o out.glb",
        "capture" => "photos -o out",
        "bake" => "a.ply -o out.glb --dry-run",
        "mesh" => "a.ply -o out.glb",
        "info" => "photos",
        "validate" => "a.ply",
        "train" => "photos -o out.ply --steps 1",
        "plan" => "photos -o city --steps 1",
        "merge" => "city -o out.ply",
        "eval" => "a.ply photos",
        "render" => "a.ply --orbit 1 -o out",
        "view" => "a.ply",
        _ => "",
    };
    let more = match flag {
        "harden_steps" | "harden_pictures" => "--harden",
        "teacher_share" => "--teacher auto",
        _ => "",
    };
    let given = format!("--{}", flag.replace('_', "-"));
    let mut words: Vec<&str> = words.split(' ').collect();
    // What is tried is given once.
    if let Some(at) = words.iter().position(|word| *word == given) {
        words.drain(at..at + 2);
    }
    words.into_iter().chain(more.split(' ')).filter(|word| !word.is_empty()).collect()
}

/// Calls `visit` with the name of every command that has none below it.
fn each_command(command: &Command, name: &str, visit: &mut impl FnMut(&str, &Command)) {
    for below in command.get_subcommands().filter(|below| below.get_name() != "help") {
        let name = format!("{name} {}", below.get_name()).trim().to_owned();
        if below.has_subcommands() {
            each_command(below, &name, visit)
        } else {
            visit(&name, below)
        }
    }
}

fn refuses(folder: &Path, command: &str, arg: &Arg, number: &str) {
    let id = arg.get_id().as_str();
    let flag = format!("--{}={number}", arg.get_long().unwrap_or(id));
    // Under a clock: what is accepted may run for ever.
    let mut program = std::process::Command::new("timeout");
    program.args(["-s", "KILL", "60"]).arg(env!("CARGO_BIN_EXE_trisplat")).args(command.split(' '));
    let output = program
        .args(rest(command, id))
        .arg(&flag)
        .current_dir(folder)
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let said = stderr(&output);
    assert!(matches!(output.status.code(), Some(1 | 2)), "{command} {flag} is taken: {said}");
    let name = format!("--{}", arg.get_long().unwrap_or(id));
    let not_here = said.contains("not in this build");
    assert!(
        not_here || said.contains(&name),
        "{command} {flag} is refused for something else: {said}"
    );
}

#[test]
fn every_flag_with_a_number_refuses_what_makes_no_sense() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(super::sample("degenerate.ply"), folder.path().join("a.ply")).unwrap();
    let options =
        SyntheticOptions { views: 4, width: 16, points: 9, seed: 1, ..SyntheticOptions::default() };
    trisplat_synthetic::write(&folder.path().join("photos"), &options).unwrap();
    let mut tried = 0;
    each_command(&Cli::command(), "", &mut |name, command| {
        for arg in command.get_arguments().filter(|arg| arg.get_long().is_some()) {
            for number in senseless(arg) {
                refuses(folder.path(), name, arg, number);
                tried += 1;
            }
        }
    });
    assert!(tried > 100, "{tried}");
}
