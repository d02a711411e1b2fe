//! Checkpoints at the command line: which runs go on, and from which file.

use super::stderr;
use std::path::Path;
use std::process::{Command, Output, Stdio};

fn run(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    command.args(arguments).current_dir(folder).stdin(Stdio::null()).output().unwrap()
}

fn succeed(output: Output) -> String {
    assert!(output.status.success(), "{}", stderr(&output));
    stderr(&output)
}

/// A folder with a data set and the checkpoint `a.checkpoint` of a run that was stopped in the
/// middle.
fn stopped() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    trisplat_fixtures::samples::photos(folder.path().join("photos"), [6, 24, 40], 0);
    let options = [
        "--steps",
        "20",
        "--max-triangles",
        "200",
        "--background",
        "#203040",
        "--max-size",
        "20",
        "--preset",
        "outdoor",
    ];
    let every = ["-o", "a.ply", "--checkpoint-every", "15"];
    succeed(run(folder.path(), &[&["train", "photos"], &options[..], &every].concat()));
    folder
}

const RESUME: [&str; 7] = ["train", "photos", "-o", "b.ply", "--force", "--resume", "a.checkpoint"];
const SAME: [&str; 4] = ["--background", "#203040", "--max-size", "20"];

fn refused(folder: &Path, more: &[&str], needle: &str) {
    let output = run(folder, &[&RESUME[..], more].concat());
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(
        said.contains("error: --resume is of another run: ") && said.contains("--force-resume"),
        "{said}"
    );
    assert!(said.contains(needle), "{said}");
    assert!(!folder.join("b.ply").exists());
}

#[test]
fn a_run_goes_on_with_what_it_was_made_of_or_not_at_all() {
    let folder = stopped();
    let described = run(folder.path(), &["info", "a.checkpoint"]);
    let text = String::from_utf8(described.stdout.clone()).unwrap();
    succeed(described);
    for needle in ["checkpoint of a training", "15 of 20", "--resume a.checkpoint"] {
        assert!(text.contains(needle), "{needle}: {text}");
    }
    let baked = stderr(&run(folder.path(), &["bake", "a.checkpoint", "-o", "c.glb"]));
    assert!(baked.contains("--resume a.checkpoint"), "{baked}");
    refused(folder.path(), &SAME[..2], "px and is 24x");
    refused(folder.path(), &SAME[2..], "its background was #203040 and is #000000 (--background)");
    let forced =
        succeed(run(folder.path(), &[&RESUME[..], &SAME[2..], &["--force-resume"]].concat()));
    assert!(forced.contains("warning: resumed although its background was #203040"), "{forced}");
    std::fs::remove_file(folder.path().join("b.ply")).unwrap();
    succeed(run(folder.path(), &[&RESUME[..], &SAME].concat()));
    let bytes = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(bytes("a.ply") == bytes("b.ply"));
    std::fs::remove_file(folder.path().join("b.ply")).unwrap();

    // The same names, sizes and cameras, and one photo of something else.
    let photo = folder.path().join("photos/images/view_0003.png");
    let kept = std::fs::read(&photo).unwrap();
    let mut pixels = trisplat_scene::image::RgbImage::load(&photo).unwrap();
    pixels.rgb[7][1] ^= 0x40;
    pixels.save_png(&photo).unwrap();
    refused(folder.path(), &SAME, "its photo view_0003.png has other pixels");
    succeed(run(folder.path(), &[&RESUME[..], &SAME, &["--force-resume"]].concat()));
    std::fs::remove_file(folder.path().join("b.ply")).unwrap();
    std::fs::write(&photo, kept).unwrap();

    let change = |name: &str, from: &str, to: &str| {
        let path = folder.path().join("photos/sparse/0").join(name);
        let text = std::fs::read_to_string(&path).unwrap();
        let line = text.lines().find(|line| !line.starts_with('#') && !line.is_empty()).unwrap();
        std::fs::write(&path, text.replacen(line, &line.replacen(from, to, 1), 1)).unwrap();
        text
    };
    let cameras = change("cameras.txt", "PINHOLE 24 18 ", "PINHOLE 24 18 1");
    refused(folder.path(), &SAME, "the camera of its photo");
    std::fs::write(folder.path().join("photos/sparse/0/cameras.txt"), cameras).unwrap();
    change("points3D.txt", " ", " 1");
    refused(folder.path(), &SAME, "the points of its data set differ");
}

#[test]
fn checkpoints_keep_the_last_and_find_the_newest_whole_one() {
    let folder = stopped();
    let options = [
        "--steps",
        "20",
        "--max-triangles",
        "200",
        "--checkpoint-every",
        "5",
        "--keep",
        "2",
        "--preset",
        "outdoor",
    ];
    let train = ["train", "photos", "-o", "b.ply", "--checkpoint", "kept/b.checkpoint"];
    std::fs::create_dir(folder.path().join("kept")).unwrap();
    succeed(run(folder.path(), &[&train[..], &options, &SAME].concat()));
    let names = || {
        let entries = std::fs::read_dir(folder.path().join("kept")).unwrap();
        let mut names: Vec<String> = entries
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    };
    assert_eq!(names(), ["b.step-00000015.checkpoint", "b.step-00000020.checkpoint"]);
    // The newest is damaged.
    let newest = folder.path().join("kept/b.step-00000020.checkpoint");
    let mut bytes = std::fs::read(&newest).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&newest, bytes).unwrap();
    let resume = ["train", "photos", "-o", "c.ply", "--resume", "kept"];
    let said = succeed(run(folder.path(), &[&resume[..], &SAME].concat()));
    assert!(said.contains("checksum: does not fit"), "{said}");
    assert!(
        said.contains("resuming from kept") && said.contains("b.step-00000015.checkpoint"),
        "{said}"
    );
    let bytes = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(bytes("b.ply") == bytes("c.ply"));
    // A new run does not push the files of another out.
    let output = run(folder.path(), &[&train[..], &options, &SAME, &["-o", "d.ply"]].concat());
    assert!(!output.status.success());
    std::fs::remove_file(folder.path().join("b.ply")).unwrap();
    let output = run(folder.path(), &[&train[..], &options, &SAME].concat());
    assert!(stderr(&output).contains("--checkpoint is kept"), "{}", stderr(&output));
    let empty = tempfile::tempdir().unwrap();
    let none = run(
        folder.path(),
        &["train", "photos", "-o", "e.ply", "--resume", empty.path().to_str().unwrap()],
    );
    assert!(
        stderr(&none).contains("holds no file that ends with .checkpoint"),
        "{}",
        stderr(&none)
    );
}
