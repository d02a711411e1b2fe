//! Every flag that takes a number refuses what makes no sense, before any work.

use super::stderr;
use clap::{Arg, Command, CommandFactory};
use std::any::TypeId;
use std::path::Path;
use std::process::Stdio;
use trisplat::cli::program::Cli;
use trisplat_synthetic::SyntheticOptions;

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
