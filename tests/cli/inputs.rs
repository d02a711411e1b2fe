//! Inputs that claim too much, never end, or name what is not theirs: each is one error that names
//! the file and the remedy.

use super::{fails, sample, stderr, trisplat};
use glam::{Mat3, UVec2, Vec2, Vec3};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;
use trisplat_fixtures::folders::copy_folder;
use trisplat_formats::ply;
use trisplat_scene::{Soup, camera::Camera};

type Word<'a> = &'a dyn AsRef<OsStr>;

fn words<'a>(first: &[Word<'a>], more: &[Word<'a>]) -> Vec<Word<'a>> {
    [first, more].concat()
}

/// A copy of the sample data set; its photos and its cameras.
fn dataset(folder: &Path) -> PathBuf {
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/dataset");
    let to = folder.join("dataset");
    copy_folder(&from, &to);
    to
}

/// A `transforms.json` of one frame, and a photo beside it.
fn transforms(folder: &Path, frame: serde_json::Value) -> PathBuf {
    let mut frame = frame;
    frame["transform_matrix"] =
        serde_json::json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
    let json = serde_json::json!({ "fl_x": 20.0, "frames": [frame] });
    std::fs::create_dir_all(folder).unwrap();
    std::fs::write(folder.join("transforms.json"), json.to_string()).unwrap();
    photo(&folder.join("a.png"));
    folder.to_owned()
}

fn photo(path: &Path) {
    let rgb = vec![[90, 120, 30]; 16 * 12];
    let pixels = trisplat_scene::image::RgbImage { size: UVec2::new(16, 12), rgb, alpha: None };
    pixels.save_png(path).unwrap();
}

/// A PNG of 57 bytes that claims 50,000 x 50,000 px.
const CLAIMING: [u8; 57] = *b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\xc3\x50\0\0\xc3\x50\x08\x02\0\0\0\
    \xc4\xcd\xaa\x9d\0\0\0\0IDAT\x35\xaf\x06\x1e\0\0\0\0IEND\xaeB\x60\x82";

fn soup(size: UVec2) -> Vec<u8> {
    let soup = Soup {
        vertices: vec![[Vec3::ZERO, Vec3::X, Vec3::Y]],
        opacity: vec![0.5],
        sigma: vec![1.0],
        sh: vec![[0.1; 3]],
        sh_degree: 0,
        ..Soup::default()
    };
    let camera = Camera {
        rotation: Mat3::IDENTITY,
        translation: Vec3::Z * 3.0,
        focal: Vec2::splat(100.0),
        center: size.as_vec2() / 2.0,
        size,
    };
    let mut bytes = Vec::new();
    ply::write_soup(&mut bytes, &soup, &Default::default(), &[camera]).unwrap();
    bytes
}

#[test]
fn a_stored_camera_of_65535_squared_in_a_soup_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("soup.ply");
    let out = folder.path().join("a.glb");
    for (size, key) in
        [(65_535, "--limit camera_pixels=4294836225"), (4_000_000_000, "--limit picture_side=")]
    {
        std::fs::write(&path, soup(UVec2::splat(size))).unwrap();
        fails(folder.path(), &[&"bake", &path, &"-o", &out], &["soup.ply: view 0: ", key]);
        fails(folder.path(), &[&"info", &path], &["soup.ply: view 0: ", key]);
    }
    std::fs::write(&path, soup(UVec2::new(64, 48))).unwrap();
    assert!(trisplat(&[&"bake", &path, &"-o", &out]).status.success());
    let low = [&"bake" as Word, &path, &"-f", &"-o", &out, &"--limit", &"camera_pixels=3071"];
    fails(
        folder.path(),
        &low,
        &["view 0: 3072 pixels, the limit is 3071", "--limit camera_pixels=3072"],
    );
}

#[test]
fn photo_bomb_of_57_bytes_is_refused_by_every_command() {
    let folder = tempfile::tempdir().unwrap();
    let data = dataset(folder.path());
    let images = std::fs::read_dir(data.join("images")).unwrap();
    let mut names: Vec<PathBuf> = images.map(|entry| entry.unwrap().path()).collect();
    names.sort();
    std::fs::write(&names[1], CLAIMING).unwrap();
    let name = names[1].file_name().unwrap().to_str().unwrap();
    let glb = folder.path().join("a.glb");
    let ply = folder.path().join("a.ply");
    let drawn = folder.path().join("drawn");
    let commands: [&[Word]; 5] = [
        &[&"bake", &sample("trained.ply"), &"--dataset", &data, &"-o", &glb],
        &[&"render", &sample("trained.ply"), &"--dataset", &data, &"--as", &"soft", &"-o", &drawn],
        &[&"info", &data],
        &[&"train", &data, &"--steps", &"1", &"-o", &ply],
        &[&"eval", &sample("trained.ply"), &data],
    ];
    for command in commands {
        fails(
            folder.path(),
            command,
            &[name, "2500000000 pixels", "--limit picture_pixels=2500000000"],
        );
    }
    // With the limit lifted it is still not what it claims.
    let lifted = words(commands[2], &[&"--limit", &"picture_pixels=2500000000"]);
    fails(folder.path(), &lifted, &[name, "which 57 bytes cannot hold"]);
    let skipped = trisplat(&words(commands[2], &[&"--skip-broken"]));
    assert!(skipped.status.success(), "{}", stderr(&skipped));
    let text = String::from_utf8(skipped.stdout).unwrap();
    assert!(
        text.contains("warning") && text.contains(name),
        "`info` called the set healthy: {text}"
    );
}

/// Runs under a clock: what waits for ever is a failure, not a test that hangs.
#[cfg(target_os = "linux")]
fn ends(folder: &Path, arguments: &[Word], needles: &[&str]) {
    let mut command = Command::new("timeout");
    command.args(["-s", "KILL", "60"]).arg(env!("CARGO_BIN_EXE_trisplat"));
    let output =
        command.args(arguments.iter().map(|a| a.as_ref())).current_dir(folder).output().unwrap();
    let text = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{text}");
    for needle in needles {
        assert!(text.contains(needle), "{text:?} lacks {needle:?}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn devices_and_pipes_are_refused_wherever_a_file_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let fifo = folder.path().join("fifo");
    assert!(Command::new("mkfifo").arg(&fifo).status().unwrap().success());
    for (i, endless) in [Path::new("/dev/zero"), &fifo].into_iter().enumerate() {
        let reason = "is a device or a pipe";
        let ply = "out.ply";
        let glb = "out.glb";
        let data = folder.path().join(format!("data{i}"));
        let good = transforms(&data.join("good"), serde_json::json!({ "file_path": "a.png" }));
        let photo = serde_json::json!({ "file_path": endless });
        let photo = transforms(&data.join("photo"), photo);
        let mask = serde_json::json!({ "file_path": "a.png", "mask_path": endless });
        let mask = transforms(&data.join("mask"), mask);
        ends(folder.path(), &[&"info", &photo], &[reason]);
        ends(folder.path(), &[&"train", &photo, &"--steps", &"1", &"-o", &ply], &[reason]);
        ends(folder.path(), &[&"train", &mask, &"--steps", &"1", &"-o", &ply], &[reason]);
        ends(folder.path(), &[&"bake", &endless, &"-o", &glb], &[reason, "standard input"]);
        ends(folder.path(), &[&"validate", &endless], &[reason]);
        let studio = sample("studio.ply");
        ends(folder.path(), &[&"bake", &studio, &"-o", &glb, &"--config", &endless], &[reason]);
        ends(folder.path(), &[&"train", &good, &"-o", &ply, &"--config", &endless], &[reason]);
        ends(folder.path(), &[&"train", &good, &"-o", &ply, &"--resume", &endless], &[reason]);
        ends(folder.path(), &[&"train", &good, &"-o", &ply, &"--from", &endless], &[reason]);
        let video = folder.path().join(format!("walk{i}.mp4"));
        std::os::unix::fs::symlink(endless, &video).unwrap();
        ends(folder.path(), &[&"capture", &video, &"-o", &"set"], &[reason]);
    }
}

#[cfg(target_os = "linux")]
#[test]
fn what_a_shell_hands_over_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let script = "\"$0\" bake <(cat \"$1\") -o a.glb --config <(echo '{ \"preset\": \"fast\" }') && \
                  \"$0\" info - < \"$1\" && cat \"$1\" | \"$0\" info /dev/stdin && \"$0\" info /dev/stdin < \"$1\"";
    let mut bash = Command::new("bash");
    bash.arg("-c").arg(script).arg(env!("CARGO_BIN_EXE_trisplat")).arg(sample("studio.ply"));
    let output = bash.current_dir(folder.path()).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(folder.path().join("a.glb").is_file());
}

#[test]
fn a_gltf_buffer_outside_its_folder_wants_allow_outside() {
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("inner");
    std::fs::create_dir(&inner).unwrap();
    let scene = inner.join("scene.gltf");
    assert!(trisplat(&[&"bake", &sample("studio.ply"), &"-o", &scene]).status.success());
    std::fs::rename(inner.join("scene.bin"), folder.path().join("scene.bin")).unwrap();
    let text = std::fs::read_to_string(&scene).unwrap();
    for uri in ["../scene.bin", "a/../../scene.bin", "%2e%2e/scene.bin"] {
        std::fs::write(&scene, text.replace("\"scene.bin\"", &format!("\"{uri}\""))).unwrap();
        fails(
            folder.path(),
            &[&"info", &scene],
            &["scene.gltf", "outside the folder", "--allow-outside"],
        );
        if !uri.starts_with('a') {
            let allowed = trisplat(&[&"info", &scene, &"--allow-outside"]);
            assert!(allowed.status.success(), "{}", stderr(&allowed));
        }
    }
}

#[test]
fn photo_outside_the_data_set_needs_allow_outside() {
    let folder = tempfile::tempdir().unwrap();
    photo(&folder.path().join("secret.png"));
    for frame in [
        serde_json::json!({ "file_path": "../secret.png" }),
        serde_json::json!({ "file_path": "a.png", "mask_path": "./../secret.png" }),
    ] {
        let data = transforms(&folder.path().join("set"), frame);
        fails(
            folder.path(),
            &[&"info", &data],
            &["transforms.json: frame 0", "outside", "--allow-outside"],
        );
        let allowed = trisplat(&[&"info", &data, &"--allow-outside"]);
        assert!(allowed.status.success(), "{}", stderr(&allowed));
    }
    let absolute = serde_json::json!({ "file_path": folder.path().join("secret.png") });
    let told = trisplat(&[&"info", &transforms(&folder.path().join("set"), absolute)]);
    let text = String::from_utf8(told.stdout).unwrap();
    assert!(told.status.success() && text.contains("names 1 file by an absolute path"), "{text}");
}

#[test]
fn threads_beyond_four_per_core_are_clamped_with_a_warning() {
    let output = trisplat(&[&"info", &sample("studio.ply"), &"--threads", &"60000"]);
    let text = stderr(&output);
    assert!(output.status.success(), "{text}");
    assert!(
        text.starts_with("warning: 60000 threads") && text.contains("--limit threads_per_core="),
        "{text}"
    );
    let output = trisplat(&[&"info", &sample("studio.ply"), &"--threads", &"4"]);
    assert!(output.status.success() && output.stderr.is_empty(), "{}", stderr(&output));
}

#[test]
fn numbers_out_of_range_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let data = dataset(folder.path());
    let out = folder.path().join("a.ply");
    let train = [&"train" as Word, &data, &"-o", &out];
    for pause in ["nan", "-1", "inf", "1e300"] {
        for flag in ["--preview-every", "--max-cpu-secs"] {
            let flag = format!("{flag}={pause}");
            let output = trisplat(&words(&train, &[&flag]));
            assert_eq!(output.status.code(), Some(2), "{flag}: {}", stderr(&output));
            assert!(stderr(&output).contains("expected seconds"), "{flag}: {}", stderr(&output));
        }
    }
    for (setting, wants) in
        [("init.size=1e308", "init.size is"), ("rates.corners=1e300", "rates.corners is")]
    {
        fails(folder.path(), &words(&train, &[&"--set", &setting]), &[wants, "expected "]);
    }
    fails(
        folder.path(),
        &words(&train, &[&"--max-triangles", &"0"]),
        &["--max-triangles is 0", "1 or more"],
    );
    let glb = folder.path().join("a.glb");
    for scene in [sample("studio.ply"), sample("trained.ply")] {
        let bake = [&"bake" as Word, &scene, &"-o", &glb, &"--max-triangles", &"0"];
        fails(folder.path(), &bake, &["--max-triangles is 0", "1 or more"]);
    }
}

#[test]
fn an_unknown_limit_lists_the_known_ones() {
    let folder = tempfile::tempdir().unwrap();
    let info = [&"info" as Word, &sample("studio.ply"), &"--limit"];
    fails(
        folder.path(),
        &words(&info, &[&"pixels=5"]),
        &["--limit is pixels=5", "picture_pixels", "triangles"],
    );
    fails(
        folder.path(),
        &words(&info, &[&"triangles=many"]),
        &["--limit is triangles=many", "whole number"],
    );
    fails(
        folder.path(),
        &words(&info, &[&"triangles=9"]),
        &["studio.ply", "the limit is 9", "--limit triangles="],
    );
    fails(folder.path(), &words(&info, &[&"file_bytes=9"]), &["studio.ply", "--limit file_bytes="]);
}

#[test]
fn photo_above_the_photo_memory_is_refused_with_the_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let data = transforms(&folder.path().join("set"), serde_json::json!({ "file_path": "a.png" }));
    let rgb = vec![[1, 2, 3]; 1024 * 300];
    let large = trisplat_scene::image::RgbImage { size: UVec2::new(1024, 300), rgb, alpha: None };
    large.save_png(data.join("a.png")).unwrap();
    let info = [&"info" as Word, &data, &"--photo-memory-mib"];
    fails(folder.path(), &words(&info, &[&"1"]), &["a.png", "takes 2 MiB", "--photo-memory-mib 2"]);
    assert!(trisplat(&words(&info, &[&"2"])).status.success());
}

#[test]
fn a_name_from_a_file_cannot_forge_a_line_or_reach_the_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let name = "a\nerror: forged\u{1b}[2J\u{202e}.png";
    let data = transforms(&folder.path().join("set"), serde_json::json!({ "file_path": name }));
    let output = trisplat(&[&"info", &data]);
    let text = stderr(&output);
    assert_eq!((output.status.code(), text.lines().count()), (Some(1), 1), "{text}");
    assert!(text.contains("a\\nerror: forged\\u{1b}[2J\\u{202e}.png"), "{text}");
    // In the table of `info`, in a warning.
    let path = folder.path().join("a.gltf");
    let gltf = serde_json::json!({ "asset": { "version": "2.0", "generator": "x\nwarning    forged\u{9b}" } });
    let bare = sample("studio.ply");
    assert!(trisplat(&[&"bake", &bare, &"-o", &path]).status.success());
    let mut json: serde_json::Value =
        serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    json["asset"]["generator"] = gltf["asset"]["generator"].clone();
    std::fs::write(&path, json.to_string()).unwrap();
    let info = trisplat(&[&"info", &path]);
    let text = String::from_utf8(info.stdout).unwrap();
    assert!(
        info.status.success() && !text.lines().any(|line| line.starts_with("warning    forged")),
        "{text}"
    );
    assert!(text.contains("x\\nwarning    forged\\u{9b}"), "{text}");
}

#[test]
fn a_byte_order_mark_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let mark = |path: &Path| {
        let bytes = std::fs::read(path).unwrap();
        std::fs::write(path, [b"\xef\xbb\xbf", bytes.as_slice()].concat()).unwrap();
    };
    let scene = folder.path().join("scene");
    for ending in ["obj", "ply", "gltf", "off"] {
        let path = scene.with_extension(ending);
        if ending == "off" {
            std::fs::write(&path, "OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n")
                .unwrap();
        } else {
            assert!(trisplat(&[&"bake", &sample("studio.ply"), &"-o", &path]).status.success());
        }
        let figures = || {
            let output = trisplat(&[&"info", &"--json", &path]);
            assert!(output.status.success(), "{ending}: {}", stderr(&output));
            let mut json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
            json["bytes"].take();
            json
        };
        let plain = figures();
        mark(&path);
        assert_eq!(figures(), plain, "{ending}");
    }
    let data = dataset(folder.path());
    let transforms_set =
        transforms(&folder.path().join("set"), serde_json::json!({ "file_path": "a.png" }));
    let info = |path: &Path| {
        let output = trisplat(&[&"info", &path]);
        assert!(output.status.success(), "{}", stderr(&output));
        output.stdout
    };
    let plain = (info(&data), info(&transforms_set));
    let texts = walk(&data).into_iter().chain(walk(&transforms_set));
    let marked: Vec<PathBuf> =
        texts.filter(|path| path.extension().is_some_and(|e| e == "txt" || e == "json")).collect();
    assert!(marked.len() >= 4, "{marked:?}");
    marked.iter().for_each(|path| mark(path));
    assert_eq!((info(&data), info(&transforms_set)), plain);
    // The first name of the list of held-out photos counts.
    let first = walk(&data.join("images")).into_iter().min().unwrap();
    let name = first.file_name().unwrap().to_str().unwrap().to_owned();
    std::fs::write(data.join("test.txt"), format!("\u{feff}{name}\n")).unwrap();
    let text = String::from_utf8(info(&data)).unwrap();
    assert!(text.contains(" 1 held out") && !text.contains("warning"), "{text}");
    let config = folder.path().join("config.json");
    std::fs::write(&config, "\u{feff}{ \"preset\": \"fast\" }").unwrap();
    let out = folder.path().join("b.glb");
    assert!(
        trisplat(&[&"bake", &sample("studio.ply"), &"-o", &out, &"--config", &config])
            .status
            .success()
    );
}

fn walk(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { walk(&path) } else { vec![path] }).collect()
}
