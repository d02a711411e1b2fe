//! `trisplat train` at the command line: the files it writes, and how a run that was stopped is
//! resumed.

use super::{fails, stderr};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

pub(super) fn dataset() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/dataset")
}

/// A short training of small photos in `folder`.
pub(super) fn train(folder: &Path, flags: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    command.current_dir(folder).arg("train").arg(dataset()).stdin(Stdio::null());
    command.args(["--max-size", "80", "--background", "#203040", "--set", "densify.every=10"]);
    if !flags.contains(&"--steps") && !flags.contains(&"--budget") {
        command.args(["--steps", "30"]);
    }
    if !flags.contains(&"--teacher") && !flags.contains(&"--resume") {
        command.args(["--teacher", "off"]);
    }
    command.args(flags);
    command
}

pub(super) fn succeed(command: &mut Command) -> Output {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    output
}

/// The command after "to continue: ", run by a shell as a user would.
pub(super) fn resume(folder: &Path, printed: &str) -> Output {
    let command =
        printed.lines().find_map(|line| line.split_once("to continue: ")).map(|found| found.1);
    let words = command
        .and_then(|command| command.strip_prefix("trisplat "))
        .unwrap_or_else(|| panic!("{printed}"));
    let script = format!("'{}' {words}", env!("CARGO_BIN_EXE_trisplat"));
    succeed(Command::new("sh").arg("-c").arg(script).current_dir(folder).stdin(Stdio::null()))
}

/// What a folder holds, in order.
fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

fn steps(log: &Path) -> Vec<u64> {
    let text = std::fs::read_to_string(log).unwrap();
    let line = |line: &str| {
        serde_json::from_str::<serde_json::Value>(line).unwrap()["step"].as_u64().unwrap()
    };
    text.lines().map(line).collect()
}

#[cfg(unix)]
#[test]
fn resume_by_the_printed_command_gives_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    succeed(&mut train(folder.path(), &["-o", "straight.ply", "--log", "straight.log"]));
    let flags = ["-o", "a b.ply", "--log", "it's.log", "--max-cpu-secs", "0.000001"];
    let stopped = succeed(&mut train(folder.path(), &flags));
    assert!(path("a b.ply").exists() && path("a b.checkpoint").exists());
    assert_ne!(
        std::fs::read(path("a b.ply")).unwrap(),
        std::fs::read(path("straight.ply")).unwrap()
    );
    resume(folder.path(), &stderr(&stopped));
    assert!(
        std::fs::read(path("a b.ply")).unwrap() == std::fs::read(path("straight.ply")).unwrap()
    );
    assert_eq!(steps(&path("it's.log")), steps(&path("straight.log")));
    assert_eq!(steps(&path("straight.log")).last(), Some(&30));
}

#[test]
fn resumed_run_has_its_own_cpu_limit_and_says_how_to_train_on() {
    let folder = tempfile::tempdir().unwrap();
    let made = |output: &Output| {
        let said = stderr(output);
        let line = said.lines().find(|line| line.starts_with("wrote a.ply")).unwrap().to_owned();
        let steps = line.split(", ").find_map(|part| part.strip_suffix(" steps")).unwrap();
        steps.replace(',', "").parse::<u64>().unwrap()
    };
    let flags = ["-o", "a.ply", "--max-cpu-secs", "0.3"];
    let first =
        made(&succeed(&mut train(folder.path(), &[&flags[..], &["--steps", "9000"]].concat())));
    let resume = [&flags[..], &["--resume", "a.checkpoint", "--force"]].concat();
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    command.current_dir(folder.path()).arg("train").arg(dataset()).stdin(Stdio::null());
    command.args(["--max-size", "80", "--background", "#203040"]);
    let second = made(&succeed(command.args(&resume)));
    assert!(second > first + 3, "{first}, {second}");
    let refused = stderr(&command.args(["--steps", "12000"]).output().unwrap());
    let wants = "--from a.ply";
    assert!(refused.contains("the 9000 steps of its run") && refused.contains(wants), "{refused}");
}

#[test]
fn a_preset_that_is_set_has_its_own_values() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(
        folder.path().join("indoor.json"),
        r#"{ "$schema": "x.json", "preset": "indoor" }"#,
    )
    .unwrap();
    let options = |how: &[&str]| {
        let flags =
            [&["-o", "a.ply", "--steps", "1", "--report", "a.json", "--force"], how].concat();
        succeed(&mut train(folder.path(), &flags));
        let report = std::fs::read(folder.path().join("a.json")).unwrap();
        serde_json::from_slice::<serde_json::Value>(&report).unwrap()["options"].clone()
    };
    let typed = options(&["--preset", "indoor"]);
    assert_eq!(typed["loss"]["dssim"], 0.4);
    assert_eq!(options(&["--set", "preset=indoor"]), typed);
    assert_eq!(options(&["--config", "indoor.json"]), typed);
    assert_eq!(
        options(&["--config", "indoor.json", "--set", "preset=solid"])["loss"]["dssim"],
        0.05
    );
}

#[cfg(unix)]
#[test]
fn ctrl_c_and_sigterm_save_and_say_how_to_go_on() {
    for (signal, code) in [("-INT", 130), ("-TERM", 143), ("-HUP", 129), ("-QUIT", 131)] {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("a.log");
        let flags = ["-o", "a.ply", "--log", "a.log", "--log-every", "1", "--steps", "100000"];
        let mut command = train(folder.path(), &flags);
        let child = command.stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
        // Once there is a sample, steps are made; a second signal would not wait for the
        // checkpoint.
        let clock = Instant::now();
        while std::fs::metadata(&log).map_or(0, |meta| meta.len()) == 0 {
            assert!(clock.elapsed() < Duration::from_secs(60), "no step was made");
            std::thread::sleep(Duration::from_millis(20));
        }
        succeed(Command::new("kill").args([signal, &child.id().to_string()]));
        let output = child.wait_with_output().unwrap();
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(code), "{said}");
        assert!(said.contains("--log a.log --log-every 1"), "{said}");
        assert!(said.contains("--force --resume a.checkpoint\n"), "{said}");
        assert_eq!(names(folder.path()), ["a.checkpoint", "a.log", "a.ply"]);
    }
}

#[test]
fn the_report_is_a_file_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let flags = ["-o", "a.ply", "--report", "report.json", "--log", "-", "-q"];
    let output = succeed(&mut train(folder.path(), &flags));
    let last = String::from_utf8_lossy(&output.stdout).lines().last().map(str::to_owned).unwrap();
    let last: serde_json::Value = serde_json::from_str(&last).unwrap();
    let report = std::fs::read_to_string(folder.path().join("report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    assert_eq!(last["step"], 30);
    assert_eq!(
        last["test_psnr"], report["stages"][2]["details"]["psnr"],
        "the log ends with the last evaluation"
    );
    let outputs: Vec<&str> =
        report["outputs"].as_array().unwrap().iter().filter_map(|o| o["path"].as_str()).collect();
    assert_eq!(outputs, ["a.ply"]);
}

#[test]
fn figures_of_photos_that_were_shrunk_name_their_size() {
    let folder = tempfile::tempdir().unwrap();
    let flags = ["-o", "a.ply", "--report", "r.json", "--log", "a.log"];
    let said = stderr(&succeed(&mut train(folder.path(), &flags)));
    let line = said.lines().find(|line| line.contains("held out")).unwrap();
    assert!(line.ends_with(", photos at 80x60)"), "{said}");
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    let last: serde_json::Value =
        serde_json::from_str(read("a.log").lines().last().unwrap()).unwrap();
    assert_eq!(last["test_size"], "80x60");
    let report: serde_json::Value = serde_json::from_str(&read("r.json")).unwrap();
    assert_eq!(report["stages"][2]["details"]["photo_size"], "80x60");

    let eval = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
        command.current_dir(folder.path()).args(["eval", "a.ply"]).arg(dataset()).args(more);
        String::from_utf8_lossy(&succeed(&mut command).stdout).into_owned()
    };
    let means = |text: &str| {
        text.lines().filter(|line| line.starts_with("mean")).map(str::to_owned).collect::<Vec<_>>()
    };
    let small = means(&eval(&["--max-size", "80"]));
    assert!(
        !small.is_empty() && small.iter().all(|line| line.contains(", photos at 80x60")),
        "{small:?}"
    );
    let json: serde_json::Value =
        serde_json::from_str(&eval(&["--max-size", "80", "--json"])).unwrap();
    assert_eq!(json["photo_size"], "80x60");
    let full = means(&eval(&[]));
    assert!(!full.is_empty() && full.iter().all(|line| !line.contains("photos at")), "{full:?}");
}

#[test]
fn nothing_is_replaced_without_force() {
    let folder = tempfile::tempdir().unwrap();
    let data = dataset();
    let out = folder.path().join("a.ply");
    for (flag, name) in
        [("--report", "r.json"), ("--log", "l.jsonl"), ("--checkpoint", "a.checkpoint")]
    {
        let path = folder.path().join(name);
        std::fs::write(&path, b"precious").unwrap();
        fails(folder.path(), &[&"train", &data, &"-o", &out, &flag, &path], &[name, "--force"]);
        assert_eq!(std::fs::read(&path).unwrap(), b"precious");
    }
    // The checkpoint that Ctrl-C would write counts as well.
    fails(folder.path(), &[&"train", &data, &"-o", &out], &["a.checkpoint", "--force"]);
    let missing = folder.path().join("no/where.json");
    fails(
        folder.path(),
        &[&"train", &data, &"-o", &out, &"--force", &"--report", &missing],
        &["where.json"],
    );
}

#[test]
fn self_teaching_scene_is_not_overwritten_nor_empty() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
        stderr(&command.current_dir(folder.path()).arg("train").args(arguments).output().unwrap())
    };
    let samples = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/soups");
    let before = std::fs::read(samples.join("trained.ply")).unwrap();
    std::fs::write(folder.path().join("soft.ply"), &before).unwrap();
    // A triangle without extent, which nothing can be seen of.
    let point = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                  element face 1\nproperty list uchar int vertex_indices\nproperty float opacity\nproperty float sigma\n\
                  property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\nend_header\n\
                 0 0 0\n0 0 0\n0 0 0\n3 0 1 2 0.5 1 0 0 0\n";
    std::fs::write(folder.path().join("point.ply"), point).unwrap();
    let said = run(&["--from", "soft.ply", "-o", "soft.ply", "--force", "--steps", "1"]);
    assert!(
        said.contains("--output is soft.ply: expected a file that is not also an input"),
        "{said}"
    );
    assert!(std::fs::read(folder.path().join("soft.ply")).unwrap() == before);
    let said = run(&["--from", "point.ply", "-o", "solid.ply"]);
    assert!(said.contains("point.ply") && said.contains("photos of it"), "{said}");
    let said = run(&["-o", "solid.ply"]);
    assert!(said.contains("<DATASET>"), "{said}");
    assert!(!folder.path().join("solid.ply").exists());
}

/// What a report says of a stage.
fn stage(report: &Path, name: &str) -> serde_json::Value {
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(report).unwrap()).unwrap();
    let found = report["stages"].as_array().unwrap().iter().find(|stage| stage["name"] == name);
    found.unwrap_or_else(|| panic!("no {name} in {report}")).clone()
}

#[test]
fn a_soft_scene_is_hardened_and_baked_by_one_command() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let trained = succeed(&mut train(
        folder.path(),
        &["-o", "soft.ply", "--preset", "outdoor", "--max-triangles", "1500", "-q"],
    ));
    assert!(stderr(&trained).is_empty());
    let bake = |flags: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
        command
            .current_dir(folder.path())
            .args(["bake", "soft.ply", "--force", "--report", "r.json"])
            .args(flags);
        stderr(&succeed(&mut command))
    };
    let said = bake(&["-o", "plain.glb"]);
    assert!(
        said.contains("soft scene: its solid triangles") && said.contains("--harden"),
        "{said}"
    );
    assert!(
        said.lines().any(|l| l.starts_with("teacher") && l.contains(" pictures of ")),
        "{said}"
    );
    let said = bake(&["-o", "hard.glb", "--harden=40"]);
    assert!(!said.contains("soft scene:"), "{said}");
    let report = path("r.json");
    assert_eq!(stage(&report, "train")["details"]["steps"], 40);
    assert!(stage(&report, "refit").get("details").is_some(), "the soft pictures are there still");
    // With photos these are what it is trained on.
    let photos = dataset();
    let said = bake(&["-o", "photos.glb", "--harden=10", "--dataset", photos.to_str().unwrap()]);
    assert!(
        stage(&report, "train")["details"]["held_out"][0]["name"].as_str().unwrap().contains('.'),
        "{said}"
    );
    // A mesh is solid: nothing to train.
    std::fs::copy(path("hard.glb"), path("soft.ply")).unwrap();
    std::fs::rename(path("soft.ply"), path("mesh.glb")).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    command.current_dir(folder.path()).args(["bake", "mesh.glb", "--harden", "-o", "again.glb"]);
    let said = stderr(&succeed(&mut command));
    assert!(
        said.lines()
            .any(|l| l.starts_with("train") && l.contains("not needed: the input is a mesh")),
        "{said}"
    );
}

#[test]
fn a_soft_training_says_that_it_is_soft_and_info_how_soft() {
    let folder = tempfile::tempdir().unwrap();
    let said =
        stderr(&succeed(&mut train(folder.path(), &["-o", "soft.ply", "--preset", "outdoor"])));
    assert!(said.contains("the scene is soft") && said.contains("bake --harden"), "{said}");
    let said = stderr(&succeed(&mut train(folder.path(), &["-o", "solid.ply"])));
    assert!(!said.contains("the scene is soft"), "{said}");
    let info = |file: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
        let output = succeed(command.current_dir(folder.path()).args(["info", "--json", file]));
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()
    };
    assert!(info("soft.ply")["softness"]["psnr"].as_f64().unwrap() < 40.0);
    assert!(info("solid.ply").get("softness").is_none());
}

#[test]
fn a_training_that_leaves_nothing_but_its_shell_says_so() {
    let folder = tempfile::tempdir().unwrap();
    // No triangle is added at points of known place either.
    let flags = [
        "--steps",
        "60",
        "--set",
        "densify.every=500",
        "--set",
        "densify.until=20000",
        "-o",
        "a.ply",
        "--force",
    ];
    let said = stderr(&succeed(&mut train(folder.path(), &flags)));
    assert!(
        said.contains("warning: no triangle but the shell is left")
            && said.contains("--steps 1000"),
        "{said}"
    );
    let said = stderr(&succeed(&mut train(folder.path(), &["-o", "b.ply", "--preset", "outdoor"])));
    assert!(!said.contains("but the shell"), "{said}");
}

#[test]
fn a_run_of_so_few_steps_that_nothing_is_left_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_trisplat"));
    command
        .current_dir(folder.path())
        .arg("train")
        .arg(dataset())
        .args(["-o", "a.ply", "--steps", "40"]);
    let said = super::stderr(
        &command
            .args([
                "--max-size",
                "60",
                "--set",
                "init.shell_subdivisions=0",
                "--set",
                "densify.until=20000",
            ])
            .output()
            .unwrap(),
    );
    assert!(
        said.contains("only one triangle is left, because 40 steps")
            && said.contains("--steps 1000 or more"),
        "{said}"
    );
}
