//! `capture` and `make`, with a program in place of COLMAP. A run that a fault ended leaves what the next one goes on from.

use super::cases::{Case, plain};
use super::tree;
use std::path::Path;

/// Photos in `in/photos/images`, `views` of them, and the program with a model of them.
fn begin(folder: &Path, views: &str) {
    std::fs::create_dir_all(folder.join("out")).unwrap();
    let small = ["--views", views, "--width", "32", "--points", "200"];
    plain(folder, &[&["sample", "dataset", "-o", "in/photos"], &small[..]].concat());
    let mut program = tree::Tree::new();
    program.insert("in/colmap".into(), include_bytes!("../common/colmap.sh").into());
    for (name, bytes) in tree::read(&folder.join("in/photos/sparse/0")) {
        program.insert(format!("in/model/{name}"), bytes);
    }
    tree::write(folder, &program);
}

fn case(
    name: &'static str,
    views: &str,
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
    const CAPTURE: &[&str] = &["capture", "in/photos/images", "-o", "out/set", "--poses", "in/colmap"];
    case("capture", "4", CAPTURE, &[], |_| {})
}

pub(crate) fn capture_replaces() -> Case {
    const CAPTURE: &[&str] =
        &["capture", "in/photos/images", "-o", "out/set", "--poses", "in/colmap", "--force"];
    let together = &["out/set/images/", "out/set/sparse/"];
    case("capture over one of other photos", "4", CAPTURE, together, |folder| {
        let other = ["sample", "dataset", "-o", "in/other", "--views", "5", "--width", "32", "--seed", "7"];
        plain(folder, &other);
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
        "--force",
    ];
    case("make", "8", MAKE, &[], |_| {})
}
