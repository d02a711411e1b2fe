//! The commands in README.md and docs/commands.md run, as a newcomer would type them; those that
//! cannot run here are parsed. Pages of the documentation are short, and their links lead
//! somewhere.

#![allow(clippy::print_stderr, reason = "names the commands that are only parsed")]

use checkpoints::{checkpoint, floats};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use trisplat_fixtures::folders::copy_folder;
use trisplat_fixtures::{checkpoints, samples};

/// Every line of every ```sh block of the two pages, once.
fn commands() -> Vec<String> {
    let page =
        |name| std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(name)).unwrap();
    let pages = [page("README.md"), page("docs/commands.md")].join("\n");
    let blocks = pages.split("```sh\n").skip(1).map(|rest| rest.split("```").next().unwrap());
    let lines = blocks.flat_map(str::lines).map(|l| l.split('#').next().unwrap().trim().to_owned());
    let mut seen = BTreeSet::new();
    lines.filter(|line| seen.insert(line.clone())).collect()
}

/// What the README's examples take for granted: the samples, somebody's photos and an author's
/// checkpoint.
fn prepare(folder: &Path) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    copy_folder(&root.join("samples/dataset"), &folder.join("samples/dataset"));
    // Few and small, as what is made of them is judged elsewhere.
    samples::photos(folder.join("photos"), [16, 64, 400], 0);
    std::fs::create_dir(folder.join("samples/soups")).unwrap();
    std::fs::copy(root.join("samples/soups/trained.ply"), folder.join("samples/soups/trained.ply"))
        .unwrap();
    std::fs::copy(root.join("samples/soups/trained.ply"), folder.join("soft.ply")).unwrap();
    std::fs::write(folder.join("splats.ply"), splats()).unwrap();
    // Fewer and smaller pictures than would be chosen.
    super::splats_bake::cameras(&folder.join("splats.cameras.json"), 6, 0.0);
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

/// A block of opaque Gaussians.
fn splats() -> String {
    let names =
        "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let properties: String =
        names.split(' ').map(|name| format!("property float {name}\n")).collect();
    let line =
        |i: usize| format!("{} {} {} 1 0 -1 4 -0.7 -0.7 -0.7 1 0 0 0\n", i % 4, i / 4 % 4, i / 16);
    let lines: String = (0..64).map(line).collect();
    format!("ply\nformat ascii 1.0\nelement vertex 64\n{properties}end_header\n{lines}")
}

/// What is added to a command so that it takes seconds and may replace the file of an earlier one.
fn additions(arguments: &[&str]) -> &'static [&'static str] {
    match *arguments {
        ["bake", "splats.ply", ..] => {
            &["--force", "--harden=5", "--preset", "fast", "--max-triangles", "500"]
        }
        ["bake", ..] => &["--force"],
        // Enough steps to have something to bake, in place of those that the README asks for.
        ["train", ..] => &["--force", "--steps", "60"],
        ["eval", ..] => &["--ssaa", "1"],
        ["make", ..] => &["--force", "--steps", "60", "--max-triangles", "500"],
        _ => &[],
    }
}

#[test]
fn every_command_of_the_readme_runs() {
    let folder = tempfile::tempdir().unwrap();
    prepare(folder.path());
    let mut ran = 0;
    let mut parsed = Vec::new();
    for command in commands() {
        let words: Vec<&str> = command.split_whitespace().collect();
        let mut arguments = match words[..] {
            ["cargo", "run", "--release", "--", ref rest @ ..] | ["trisplat", ref rest @ ..] => {
                rest.to_vec()
            }
            // The test command runs this very test, and what is installed is what runs here.
            ["bash", "tests/run.sh"] | ["cargo", "install", "--path", "."] => continue,
            _ => panic!("a command of the README that no test knows: {command}"),
        };
        // A window wants a screen and somebody to close it; tests/window opens one. Poses want
        // another program; tests/cli/capture.rs has one.
        let only_parsed = ["view", "capture"].contains(&arguments[0]);
        // The additions to a bake of splats choose the preset.
        let preset = if arguments.contains(&"splats.ply") { "--preset" } else { "--budget" };
        for replaced in ["--steps", "--budget", preset] {
            if let Some(at) = arguments.iter().position(|a| *a == replaced) {
                arguments.drain(at..at + 2);
            }
        }
        if let Some(harden) = arguments.iter_mut().find(|a| **a == "--harden") {
            *harden = "--harden=20";
        }
        if arguments[..2] == ["mesh", "scene.ply"] {
            // So few steps make a fog, which has no surface: the sample has one.
            arguments[1] = "soft.ply";
        }
        if arguments[0] == "view" && cfg!(not(feature = "view")) {
            trisplat_fixtures::skip::skipped(&format!("built without the feature view: {command}"));
            continue;
        }
        let more = if only_parsed { &["--help"] } else { additions(&arguments) };
        let mut trisplat = Command::new(env!("CARGO_BIN_EXE_trisplat"));
        let output =
            trisplat.current_dir(folder.path()).args(&arguments).args(more).output().unwrap();
        assert!(output.status.success(), "{command}\n{}", String::from_utf8_lossy(&output.stderr));
        if only_parsed { parsed.push(command) } else { ran += 1 }
    }
    for command in &parsed {
        eprintln!("PARSED ONLY: {command}");
    }
    assert!(
        parsed.len() <= 2 && ran >= 10,
        "{ran} commands ran, {} were only parsed",
        parsed.len()
    );
}

/// README.md, CHANGELOG.md and every page below the folders that have some.
fn pages() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut pages =
        vec![root.join("README.md"), root.join("CHANGELOG.md"), root.join("python/README.md")];
    let mut folders = vec![root.join("docs"), root.join("samples")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "md") {
                pages.push(path);
            }
        }
    }
    pages
}

/// The names by which a page's headings are linked to, as GitHub makes them.
fn anchors(page: &str) -> BTreeSet<String> {
    let outside_code = page.split("```").step_by(2);
    let headings = outside_code.flat_map(str::lines).filter(|line| line.starts_with('#'));
    headings
        .map(|heading| {
            let kept = heading.trim_start_matches('#').trim().to_lowercase();
            let kept = kept.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
            kept.map(|c| if c == ' ' { '-' } else { c }).collect()
        })
        .collect()
}

#[test]
fn pages_are_short_and_their_links_lead_somewhere() {
    let mut links = 0;
    for path in pages() {
        let page = std::fs::read_to_string(&path).unwrap();
        let lines = page.lines().count();
        assert!(
            lines <= 200 || path.ends_with("CHANGELOG.md"),
            "{} has {lines} lines",
            path.display()
        );
        for link in page.split("](").skip(1).map(|rest| rest.split(')').next().unwrap()) {
            if link.contains("://") {
                continue;
            }
            let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target =
                if file.is_empty() { path.clone() } else { path.parent().unwrap().join(file) };
            assert!(target.exists(), "{} links to {link}, which does not exist", path.display());
            if !anchor.is_empty() {
                let headings = anchors(&std::fs::read_to_string(&target).unwrap());
                assert!(
                    headings.contains(anchor),
                    "{} links to {link}: no such heading",
                    path.display()
                );
            }
            links += 1;
        }
    }
    assert!(links > 100, "only {links} links were found");
}

/// The help of `--set` names the page.
#[test]
fn every_key_of_a_bake_is_in_its_page_with_its_default() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = std::fs::read_to_string(root.join("docs/bake.md")).unwrap();
    let schema = std::fs::read(root.join("schemas/bake.schema.json")).unwrap();
    let schema: serde_json::Value = serde_json::from_slice(&schema).unwrap();
    let groups = schema["$defs"].as_object().unwrap().values();
    let keys: Vec<(&String, &serde_json::Value)> =
        groups.filter_map(|group| group["properties"].as_object()).flatten().collect();
    assert!(keys.len() > 30, "{keys:?}");
    for (key, entry) in keys {
        let Some(default) = entry
            .get("default")
            .filter(|value| !value.is_null() && **value != serde_json::json!([]))
        else {
            assert!(page.contains(&format!("`{key}`")), "docs/bake.md does not name {key}");
            continue;
        };
        let said = match default {
            serde_json::Value::String(text) => text.clone(),
            // 4.0 is written as 4.
            serde_json::Value::Number(number) => number.as_f64().unwrap().to_string(),
            other => other.to_string(),
        };
        assert!(
            page.contains(&format!("`{key}` ({said})")),
            "docs/bake.md has no `{key}` ({said})"
        );
    }
}
