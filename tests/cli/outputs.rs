//! Outputs at the command line: none is an input, a photo or another output; each is tried before
//! work starts; what fails on the way costs nothing else.

use super::{fails, sample, stderr, trisplat};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use trisplat_fixtures::samples;

type Argument<'a> = &'a dyn AsRef<OsStr>;

/// A folder with a soup `a.ply` and a data set `photos` of four small photos.
pub(super) fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    samples::photos(folder.path().join("photos"), [4, 24, 40], 0);
    samples::studio(folder.path().join("a.ply"), 60);
    folder
}

pub(super) fn run(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    command.args(arguments).current_dir(folder).stdin(Stdio::null()).output().unwrap()
}

pub(super) fn succeed(output: Output) -> Output {
    assert!(output.status.success(), "{}", stderr(&output));
    output
}

/// Exit code 1 and one error with all of `needles`.
pub(super) fn refused(folder: &Path, arguments: &[&str], needles: &[&str]) {
    let output = run(folder, arguments);
    let text = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{arguments:?}: {text}");
    let errors: Vec<&str> = text.lines().filter(|line| line.starts_with("error: ")).collect();
    assert_eq!(errors.len(), 1, "{text}");
    needles
        .iter()
        .for_each(|needle| assert!(errors[0].contains(needle), "{:?} lacks {needle:?}", errors[0]));
}

const TRAIN: [&str; 6] = ["train", "photos", "--steps", "6", "--max-triangles", "200"];

fn train<'a>(more: &[&'a str]) -> Vec<&'a str> {
    [&TRAIN[..], more].concat()
}

/// Names, sizes and times of everything in a folder.
pub(super) fn state(folder: &Path) -> Vec<(PathBuf, u64, std::time::SystemTime)> {
    let mut all = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap().map(Result::unwrap) {
        let meta = entry.metadata().unwrap();
        if meta.is_dir() {
            all.extend(state(&entry.path()))
        } else {
            all.push((entry.path(), meta.len(), meta.modified().unwrap()))
        }
    }
    all.sort();
    all
}

#[test]
fn what_cannot_be_written_is_refused_before_work_starts() {
    let folder = folder();
    let before = state(folder.path());
    for option in ["--log", "--report", "--checkpoint"] {
        let flags = train(&["-o", "b.ply", option, "no/where"]);
        refused(folder.path(), &flags, &[option, "no/where", "a file in a folder that exists"]);
    }
    refused(
        folder.path(),
        &train(&["-o", "no/b.ply"]),
        &["--output", "a file in a folder that exists"],
    );
    // With the command that makes the folder.
    refused(
        folder.path(),
        &train(&["-o", "no/such/b.ply"]),
        &["mkdir ", "no/such` makes this one"],
    );
    // The input does not exist either: the output is looked at first.
    refused(folder.path(), &["bake", "none.ply", "-o", "no/a.glb"], &["--output", "no/a.glb"]);
    refused(
        folder.path(),
        &["bake", "a.ply", "-o", "b.glb", "--report", "photos"],
        &["--report", "this is a folder"],
    );
    refused(
        folder.path(),
        &["eval", "a.ply", "photos", "--report", "no/a.json"],
        &["--report", "no/a.json"],
    );
    assert_eq!(state(folder.path()), before);
}

#[test]
fn no_output_is_an_input_or_another_output() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    std::fs::hard_link(at("a.ply"), at("hard.ply")).unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink("a.ply", at("soft.ply")).unwrap();
    std::fs::write(at("options.json"), "{}").unwrap();
    let before = state(folder.path());
    let check = |arguments: &[&str], needles: &[&str]| {
        refused(folder.path(), arguments, needles);
        assert_eq!(state(folder.path()), before, "{arguments:?}");
    };
    let forced = |more: &[&'static str]| [&["--force"], more].concat();
    let input = "a file that is not also an input";
    check(
        &train(&forced(&["-o", "c.ply", "--report", "c.ply"])),
        &["--report is c.ply", "--output does not write"],
    );
    check(
        &train(&forced(&["-o", "c.ply", "--report", "./c.checkpoint"])),
        &["--report", "--checkpoint"],
    );
    check(
        &train(&forced(&["-o", "c.ply", "--log", "x", "--report", "x"])),
        &["is x: expected a file that", "--report", "--log"],
    );
    check(&train(&forced(&["-o", "a.ply", "--from", "a.ply"])), &["--output is a.ply", input]);
    check(
        &train(&forced(&["-o", "c.ply", "--config", "options.json", "--log", "options.json"])),
        &["--log", input],
    );
    check(
        &train(&forced(&["-o", "c.ply", "--report", "photos/sparse/0/images.txt"])),
        &["--report", input],
    );
    check(
        &train(&forced(&["-o", "c.ply", "--report", "photos/images/view_0001.png"])),
        &["--report", input],
    );
    check(
        &train(&forced(&["-o", "c.ply", "--preview", "photos/images"])),
        &["--preview", "does not hold inputs"],
    );
    check(
        &["bake", "a.ply", "-o", "q.gltf", "--report", "q.bin"],
        &["--report is q.bin", "--output"],
    );
    for name in ["hard.ply", if cfg!(unix) { "soft.ply" } else { "hard.ply" }] {
        if cfg!(unix) {
            check(&["bake", "a.ply", "-o", name, "--force"], &["--output is", input]);
            check(
                &["eval", "a.ply", "photos", "--report", name, "--force"],
                &["--report is", input],
            );
        }
    }
    check(
        &["eval", "a.ply", "photos", "--report", "photos/test.txt", "--force"],
        &["--report", input],
    );
    let renders = ["--save-renders", "photos/images", "--split", "all", "--force", "--as", "solid"];
    check(&[&["eval", "a.ply", "photos"], &renders[..]].concat(), &["--save-renders", input]);
    let render = [
        "render",
        "a.ply",
        "--dataset",
        "photos",
        "--split",
        "all",
        "-o",
        "photos/images",
        "--force",
    ];
    check(&render, &["--output", input]);
}

#[test]
fn photos_that_differ_in_their_ending_have_renders_of_their_own() {
    let folder = folder();
    let images = folder.path().join("photos/images");
    let model = folder.path().join("photos/sparse/0/images.txt");
    let picture = trisplat_scene::image::RgbImage::load(&images.join("view_0001.png")).unwrap();
    picture.save_png(images.join("view_0000.jpg")).unwrap();
    let text = std::fs::read_to_string(&model).unwrap();
    std::fs::write(&model, text.replace("view_0001.png", "view_0000.jpg")).unwrap();
    let render = ["render", "a.ply", "--dataset", "photos", "--split", "all", "-o", "out"];
    let said = stderr(&succeed(run(folder.path(), &render)));
    assert!(said.contains("wrote 4 pictures"), "{said}");
    for name in ["view_0000.png.png", "view_0000.jpg.png", "view_0002.png", "view_0003.png"] {
        assert!(folder.path().join("out").join(name).is_file(), "{name}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_log_on_a_full_disk_costs_the_log_only() {
    let folder = folder();
    let output =
        run(folder.path(), &train(&["-o", "c.ply", "--log", "/dev/full", "--report", "r.json"]));
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("warning: /dev/full: No space left on device"), "{said}");
    assert!(
        said.contains("error: c.ply is written, but not everything beside it: /dev/full"),
        "{said}"
    );
    succeed(run(folder.path(), &["info", "c.ply"]));
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("r.json")).unwrap()).unwrap();
    assert!(report["warnings"][0].as_str().unwrap().contains("/dev/full"), "{report}");
}

#[cfg(unix)]
#[test]
fn a_folder_that_goes_away_costs_checkpoints_and_previews_only() {
    let folder = folder();
    std::fs::create_dir(folder.path().join("gone")).unwrap();
    let flags = [
        "-o",
        "c.ply",
        "--checkpoint",
        "gone/c.checkpoint",
        "--checkpoint-every",
        "1",
        "--log",
        "-",
    ];
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    command.args([
        "train",
        "photos",
        "--steps",
        "3000",
        "--max-triangles",
        "200",
        "--log-every",
        "1",
    ]);
    command.args(flags).current_dir(folder.path()).stdin(Stdio::null());
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = std::io::BufRead::lines(std::io::BufReader::new(child.stdout.take().unwrap()));
    lines.next().unwrap().unwrap();
    while std::fs::remove_dir_all(folder.path().join("gone")).is_err() {}
    lines.next().unwrap().unwrap();
    succeed(Command::new("kill").args(["-TERM", &child.id().to_string()]).output().unwrap());
    // Nobody reads the log any more.
    drop(lines);
    let output = child.wait_with_output().unwrap();
    let said = stderr(&output);
    assert!(said.contains("warning: gone/c.checkpoint: No such file"), "{said}");
    assert!(!said.contains("to continue"), "there is no checkpoint: {said}");
    assert_eq!(output.status.code(), Some(143), "{said}");
    assert!(folder.path().join("c.ply").is_file(), "{said}");
}

/// Runs with standard error, or standard output, closed by its reader.
fn unread(folder: &Path, arguments: &[&str], errors: bool) -> std::process::ExitStatus {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    command.args(arguments).current_dir(folder).stdin(Stdio::null());
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    if errors {
        drop(child.stderr.take());
    } else {
        drop(child.stdout.take());
    }
    child.wait_with_output().unwrap().status
}

#[test]
fn a_closed_pipe_never_costs_a_file() {
    let folder = folder();
    let there = |name: &str| folder.path().join(name).is_file();
    assert!(
        unread(folder.path(), &["bake", "a.ply", "-o", "a.glb", "-v"], true).success()
            && there("a.glb")
    );
    assert!(
        unread(folder.path(), &train(&["-o", "c.ply", "-v"]), true).success() && there("c.ply")
    );
    let log = train(&["-o", "d.ply", "--log", "-", "--log-every", "1"]);
    assert!(unread(folder.path(), &log, false).success() && there("d.ply"));
    let eval = ["eval", "a.ply", "photos", "--report", "r.json"];
    assert!(unread(folder.path(), &eval, false).success() && there("r.json"));
    for arguments in [
        &["info", "a.ply"][..],
        &["validate", "a.glb"],
        &["schema", "bake"],
        &["completions", "bash"],
    ] {
        assert!(unread(folder.path(), arguments, false).success(), "{arguments:?}");
    }
    // An error that nobody reads is an error all the same.
    assert_eq!(unread(folder.path(), &["info", "none.ply"], true).code(), Some(1));
    // And a scene that nobody reads is lost.
    assert_eq!(unread(folder.path(), &["bake", "a.ply", "-o", "-"], false).code(), Some(1));
}

#[test]
fn files_of_an_earlier_bake_are_named() {
    let folder = folder();
    let bake = |more: &[&str]| {
        let output =
            run(folder.path(), &[&["bake", "a.ply", "-o", "s.glb", "--force"], more].concat());
        stderr(&succeed(output))
    };
    let said = bake(&["--lod", "0.5,0.25", "--target", "godot"]);
    assert!(!said.contains("earlier scene"), "{said}");
    let said = bake(&["--lod", "0.5"]);
    assert!(said.contains("s.lod2.glb"), "{said}");
    for name in ["s.lod2.glb", "s.glb.import", "s.lod.tscn"] {
        assert!(said.contains(name), "{name}: {said}");
    }
    assert!(!said.contains("s.tileset.json are") && !said.contains("s.lod1.glb,"), "{said}");
    assert!(bake(&[]).contains("s.tileset.json"));
}

#[test]
fn one_of_two_trainings_with_one_output_is_refused_at_once() {
    let folder = folder();
    let output = folder.path().join("c.ply");
    let held = trisplat_scene::atomic::AtomicFile::create(&output).unwrap();
    refused(folder.path(), &train(&["-o", "c.ply"]), &["c.ply", "another program is writing"]);
    drop(held);
    succeed(run(folder.path(), &train(&["-o", "c.ply"])));
}

#[test]
fn render_into_a_folder_in_use_is_refused() {
    let folder = folder();
    let out = folder.path().join("out");
    std::fs::create_dir(&out).unwrap();
    let render = ["render", "a.ply", "--orbit", "2", "--width", "16", "-o", "out"];
    let eval =
        ["eval", "a.ply", "photos", "--split", "all", "--as", "soft", "--save-renders", "out"];
    let held = trisplat_scene::atomic::FolderLock::take(&out).unwrap();
    for arguments in [&render[..], &eval[..]] {
        refused(folder.path(), arguments, &["out: another program is writing into this folder"]);
    }
    drop(held);
    succeed(run(folder.path(), &render));
    // Side by side one is done, and the other finds the folder busy or its pictures there.
    for _ in 0..6 {
        std::fs::remove_dir_all(&out).unwrap();
        let start = || {
            let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
            command.args(render).current_dir(folder.path()).stdin(Stdio::null());
            command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
        };
        let both = [start(), start()].map(|child| child.wait_with_output().unwrap());
        let won = both.iter().filter(|output| output.status.success()).count();
        assert_eq!(won, 1, "{:?}", both.each_ref().map(stderr));
        assert_eq!(std::fs::read_dir(&out).unwrap().count(), 2);
    }
}

#[cfg(unix)]
#[test]
fn a_bake_that_is_asked_to_end_leaves_nothing() {
    for (signal, code) in [("-HUP", 129), ("-INT", 130), ("-QUIT", 131), ("-TERM", 143)] {
        let folder = folder();
        let before = std::fs::read_dir(folder.path()).unwrap().count();
        let (child, _) = long_bake(folder.path(), "");
        succeed(Command::new("kill").args([signal, &child.id().to_string()]).output().unwrap());
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(code), "{}", stderr(&output));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), before, "{signal}");
    }
}

#[cfg(unix)]
#[test]
fn a_program_that_is_to_outlive_its_terminal_does() {
    let folder = folder();
    // As nohup does.
    let (child, temporary) = long_bake(folder.path(), "trap '' HUP QUIT; ");
    for signal in ["-HUP", "-QUIT"] {
        succeed(Command::new("kill").args([signal, &child.id().to_string()]).output().unwrap());
    }
    std::thread::sleep(std::time::Duration::from_millis(200));
    assert!(temporary.exists(), "it ended");
    succeed(Command::new("kill").args(["-TERM", &child.id().to_string()]).output().unwrap());
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(143));
}

/// A bake that takes long, once it has begun, and its temporary file; begun by a shell that does
/// this first.
#[cfg(unix)]
fn long_bake(folder: &Path, first: &str) -> (std::process::Child, PathBuf) {
    let soup = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/soups/studio.ply");
    let bake = "exec \"$0\" bake \"$1\" -o long.glb --set reshape.reshape_rounds=10000 --threads 1";
    let mut command = Command::new("sh");
    command.args(["-c", &format!("{first}{bake}"), env!("CARGO_BIN_EXE_trisplat")]).arg(soup);
    command.current_dir(folder).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    let child = command.spawn().unwrap();
    let temporary = trisplat_scene::atomic::temporary_name(&folder.join("long.glb"));
    let clock = std::time::Instant::now();
    while !temporary.exists() {
        assert!(clock.elapsed().as_secs() < 60, "it did not begin");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    (child, temporary)
}

#[cfg(unix)]
#[test]
fn a_symbolic_link_stays_one() {
    let folder = folder();
    std::fs::create_dir(folder.path().join("disk")).unwrap();
    std::os::unix::fs::symlink("disk/real.glb", folder.path().join("link.glb")).unwrap();
    for force in [&[][..], &["--force"]] {
        succeed(run(folder.path(), &[&["bake", "a.ply", "-o", "link.glb"], force].concat()));
        assert!(folder.path().join("link.glb").is_symlink());
        assert!(folder.path().join("disk/real.glb").is_file());
    }
}

#[test]
fn an_existing_report_needs_force_in_a_dry_run_too() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("r.json");
    std::fs::write(&report, "precious").unwrap();
    let soup = sample("studio.ply");
    let arguments: [Argument; 7] =
        [&"bake", &"--dry-run", &soup, &"-o", &folder.path().join("a.glb"), &"--report", &report];
    fails(folder.path(), &arguments, &["--report", "--force"]);
    assert!(trisplat(&[&arguments[..], &[&"--force"]].concat()).status.success());
}
