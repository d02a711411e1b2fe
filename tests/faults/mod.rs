//! Every system call by which a command changes files, or opens them, fails once; every one from
//! some point on finds the disk full; or the program is killed there, or asked to end. Whatever
//! happens, outputs are the old ones or the new ones, whole, and nothing else changes.
//!
//! The calls are caught by `inject.c`, a library that `cc` compiles and the system's loader puts
//! before the C library. A plain run of the suite visits some calls of each command;
//! `TRISPLAT_FAULTS=all` visits every one, and `TRISPLAT_FUZZ_SECONDS=600` goes on with random ones
//! for ten minutes each.
#![cfg(target_os = "linux")]
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a skipped test says so, and a visit what it visited"
)]

mod captures;
mod cases;
mod run;
mod tree;

use cases::Case;
use run::{Fault, Injector, Kind};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Instant, SystemTime};
use trisplat_scene::Rng;

/// Visits the calls of `case`, with every kind of fault.
fn visit(case: &Case) {
    let Some(injector) = Injector::build() else {
        trisplat_fixtures::skip::skipped("no `cc` that compiles a library for LD_PRELOAD");
        return;
    };
    let new = case.outcome(&injector);
    let all = std::env::var_os("TRISPLAT_FAULTS").is_some_and(|value| value == "all");
    let step = if all { 1 } else { new.calls.div_ceil(case.visits()).max(1) };
    let mut visited = 0;
    let mut failed = 0;
    for kind in [Kind::Error, Kind::Full, Kind::Kill, Kind::Signal] {
        if kind == Kind::Signal && !case.knows_signals() {
            continue;
        }
        // Not the same calls for every kind.
        let first = 1 + kind as u64 % step;
        for at in (first..=new.calls).step_by(step as usize) {
            let fault = Fault { kind, at };
            let checked = catch_unwind(AssertUnwindSafe(|| case.check(&injector, &new, fault)));
            failed += u64::from(checked.is_err());
            visited += 1;
        }
    }
    // Other places every time.
    let began = Instant::now();
    let seed = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap();
    let random = Rng::new(seed.as_nanos() as u64, case.name, 0);
    while began.elapsed() < trisplat_fixtures::duration() {
        let kind = [Kind::Kill, Kind::Kill, Kind::Error, Kind::Full]
            [random.bits(2 * visited) as usize % 4];
        let fault = Fault { kind, at: 1 + random.bits(2 * visited + 1) % new.calls };
        let checked = catch_unwind(AssertUnwindSafe(|| case.check(&injector, &new, fault)));
        failed += u64::from(checked.is_err());
        visited += 1;
    }
    println!("{}: {} calls, {visited} faults", case.name, new.calls);
    assert_eq!(failed, 0, "faults of {visited} that broke a promise");
}

#[test]
fn a_bake_that_replaces_many_files() {
    visit(&cases::bake_replaces());
}

#[test]
fn a_bake_of_new_files() {
    visit(&cases::bake_new());
}

#[test]
fn a_training() {
    visit(&cases::train());
}

#[test]
fn a_training_with_a_teacher() {
    visit(&cases::train_with_teacher());
}

#[test]
fn an_evaluation() {
    visit(&cases::eval());
}

#[test]
fn pictures() {
    visit(&cases::render());
}

#[test]
fn a_plan() {
    visit(&cases::plan_new());
}

#[test]
fn a_plan_that_replaces_one() {
    visit(&cases::plan_replaces());
}

#[test]
fn a_block() {
    visit(&cases::block());
}

#[test]
fn a_merge() {
    visit(&cases::merge());
}

#[test]
fn tiles_that_replace_others() {
    visit(&cases::tiles());
}

#[test]
fn tiles_of_a_city() {
    visit(&cases::tiles_of_a_city());
}

#[test]
fn a_manual() {
    visit(&cases::manual());
}

#[test]
fn a_capture() {
    visit(&captures::capture_new());
}

#[test]
fn a_capture_that_replaces_one_of_other_photos() {
    visit(&captures::capture_replaces());
}

#[test]
fn everything_from_photos_to_a_page() {
    visit(&captures::make());
}
