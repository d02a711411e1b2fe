//! The commands in README.md run, as a newcomer would type them; the few that cannot run here are parsed, and said.

#![allow(clippy::print_stderr, reason = "a command that only is parsed is said")]

#[allow(dead_code, reason = "shared with the tests of checkpoints")]
#[path = "pt/files.rs"]
mod checkpoints;

use checkpoints::{checkpoint, floats};
use std::path::Path;
use std::process::Command;

/// Every line of every ```sh block.
fn commands() -> Vec<String> {
    let readme = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("README.md")).unwrap();
    let blocks = readme.split("```sh\n").skip(1).map(|rest| rest.split("```").next().unwrap());
    blocks.flat_map(str::lines).map(|l| l.split('#').next().unwrap().trim().to_owned()).collect()
}

/// What the README's examples take for granted: the samples, somebody's photos and an author's checkpoint.
fn prepare(folder: &Path) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    copy_folder(&root.join("samples/dataset"), &folder.join("samples/dataset"));
    copy_folder(&root.join("samples/dataset"), &folder.join("photos"));
    std::fs::create_dir(folder.join("samples/soups")).unwrap();
    std::fs::copy(root.join("samples/soups/studio.ply"), folder.join("samples/soups/studio.ply")).unwrap();
    std::fs::copy(root.join("samples/soups/trained.ply"), folder.join("soft.ply")).unwrap();
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]];
    let triangles = (0..20).flat_map(|i| corners.map(|[x, y, z]| [x + i as f32, y, z])).flatten();
    let tensors = [
        floats("triangles_points", &[20, 3, 3], triangles),
        floats("sigma", &[20, 1], [-3.0; 20]),
        floats("opacity", &[20, 1], [4.0; 20]),
        floats("features_dc", &[20, 1, 3], [0.5; 60]),
        floats("features_rest", &[20, 0, 3], []),
    ];
    std::fs::write(folder.join("point_cloud_state_dict.pt"), checkpoint(&tensors, b"")).unwrap();
}

/// What is added to a command so that it takes seconds and may replace the file of an earlier one.
fn additions(arguments: &[&str]) -> &'static [&'static str] {
    match *arguments {
        ["bake", .., "--harden"] | ["bake", .., "--harden", "--dataset", _] => {
            &["--force", "--harden-steps", "20"]
        }
        ["bake", ..] => &["--force"],
        // Enough steps to have something to bake, in place of those that the README asks for.
        ["train", ..] => &["--force", "--steps", "60"],
        ["bench", "bake"] => &["--triangles", "2000", "--runs", "1"],
        ["bench", "stress"] => &["--cases", "20000", "--climb", "50"],
        ["bench", "cost", ..] => &["--steps", "20", "--max-size", "64"],
        _ => &[],
    }
}

#[test]
fn every_command_of_the_readme_runs() {
    let folder = tempfile::tempdir().unwrap();
    prepare(folder.path());
    let (mut ran, mut parsed) = (0, Vec::new());
    for command in commands() {
        let words: Vec<&str> = command.split_whitespace().collect();
        let mut arguments = match words[..] {
            ["cargo", "run", "--release", "--", ref rest @ ..] | ["trisplat", ref rest @ ..] => rest.to_vec(),
            // The test command runs this very test, and what is installed is what runs here.
            ["bash", "tests/run.sh"] | ["cargo", "install", "--path", "."] => continue,
            _ => panic!("a command of the README that no test knows: {command}"),
        };
        // A window wants a screen and somebody to close it; tests/view opens one.
        let only_parsed = arguments[0] == "view";
        if let Some(steps) = arguments.iter().position(|a| *a == "--steps") {
            arguments.drain(steps..steps + 2);
        }
        if arguments[0] == "mesh" {
            // So few steps make a fog, which has no surface: the sample has one.
            arguments[1] = "soft.ply";
        }
        if only_parsed && cfg!(not(feature = "view")) {
            eprintln!("SKIPPED (built without the feature view): {command}");
            continue;
        }
        let more = if only_parsed { &["--help"] } else { additions(&arguments) };
        let mut trisplat = Command::new(env!("CARGO_BIN_EXE_trisplat"));
        let output = trisplat.current_dir(folder.path()).args(&arguments).args(more).output().unwrap();
        assert!(output.status.success(), "{command}\n{}", String::from_utf8_lossy(&output.stderr));
        if only_parsed { parsed.push(command) } else { ran += 1 }
    }
    for command in &parsed {
        eprintln!("PARSED ONLY: {command}");
    }
    assert!(parsed.len() <= 1 && ran >= 10, "{ran} commands ran, {} were only parsed", parsed.len());
}

fn copy_folder(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        match entry.file_type().unwrap().is_dir() {
            true => copy_folder(&entry.path(), &to.join(entry.file_name())),
            false => drop(std::fs::copy(entry.path(), to.join(entry.file_name())).unwrap()),
        }
    }
}
