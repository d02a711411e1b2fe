//! `capture` and `make`, with a program in place of COLMAP. A run that a fault ended leaves what
//! the next one goes on from.

use super::cases::{Case, plain};
use super::tree;
use std::path::Path;
use trisplat_fixtures::samples;

/// Photos in `in/photos/images`, `views` of them, and the program with a model of them.
fn begin(folder: &Path, views: u32) {
    std::fs::create_dir_all(folder.join("out")).unwrap();
    samples::photos(folder.join("in/photos"), [views, 32, 200], 0);
    let mut program = tree::Tree::new();
    program.insert("in/colmap".into(), include_bytes!("../fixtures/colmap.sh").into());
    for (name, bytes) in tree::read(&folder.join("in/photos/sparse/0")) {
        program.insert(format!("in/model/{name}"), bytes);
    }
    tree::write(folder, &program);
}

fn case(
    name: &'static str,
    views: u32,
    arguments: &'static [&'static str],
    together: &'static [&'static str],
    earlier: impl FnOnce(&Path),
) -> Case {
    let folder = tempfile::tempdir().unwrap();
    begin(folder.path(), views);
    earlier(folder.path());
    let before = tree::read(folder.path());
    Case { name, arguments, before, together, kept: None, all_or_nothing: false }
}

pub(crate) fn capture_new() -> Case {
    const CAPTURE: &[&str] =
        &["capture", "in/photos/images", "-o", "out/set", "--poses", "in/colmap"];
    case("capture", 4, CAPTURE, &[], |_| {})
}

pub(crate) fn capture_replaces() -> Case {
    const CAPTURE: &[&str] =
        &["capture", "in/photos/images", "-o", "out/set", "--poses", "in/colmap", "--force"];
    let together = &["out/set/images/", "out/set/sparse/"];
    case("capture over one of other photos", 4, CAPTURE, together, |folder| {
        samples::photos(folder.join("in/other"), [5, 32, 1500], 7);
        plain(folder, &["capture", "in/other/images", "-o", "out/set", "--poses", "in/colmap"]);
        std::fs::write(folder.join("out/set/images/mine.txt"), "mine").unwrap();
    })
}

pub(crate) fn make() -> Case {
    const MAKE: &[&str] = &[
        "make",
        "in/photos/images",
        "-o",
        "out/a.glb",
        "--work",
        "out/work",
        "--poses",
        "in/colmap",
        "--steps",
        "100",
        "--max-triangles",
        "200",
        "--report",
        "out/report.json",
    ];
    case("make", 8, MAKE, &[], |_| {})
}
