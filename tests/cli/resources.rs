//! What inputs may cost, and what a system may lack: memory of decoders, threads, a folder for
//! temporary files.

use super::{sample, stderr, trisplat};
use image::{ImageBuffer, Rgb, Rgba};
use serde_json::{Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
#[cfg(target_os = "linux")]
use trisplat_fixtures::png;

const MIB: u64 = 1 << 20;

/// A data set of six cameras; `save` writes the photo of each.
fn dataset(folder: &Path, ending: &str, save: &dyn Fn(&Path)) -> PathBuf {
    std::fs::create_dir_all(folder).unwrap();
    let frame = |i: u32| {
        let name = format!("{i}.{ending}");
        save(&folder.join(&name));
        let x = f64::from(i) * 0.1;
        json!({ "file_path": name, "transform_matrix": [[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]] })
    };
    let frames: Vec<Value> = (0..6).map(frame).collect();
    let set = json!({ "camera_angle_x": 0.8, "frames": frames });
    std::fs::write(folder.join("transforms.json"), set.to_string()).unwrap();
    folder.to_owned()
}

/// Peak memory of a training of few steps on photos that it shrinks, bytes: the least of eight
/// runs, since a busy machine only adds: there, both threads decode at the same moment.
fn peak_of_training(data: &Path, megabytes: &str) -> u64 {
    (0..8).map(|_| peak_of_run(data, megabytes)).min().unwrap()
}

fn peak_of_run(data: &Path, megabytes: &str) -> u64 {
    let out = data.join("out.ply");
    let report = data.join("report.json");
    let output = trisplat(&[
        &"train",
        &data,
        &"-o",
        &out,
        &"--report",
        &report,
        &"--steps",
        &"12",
        &"--max-size",
        &"64",
        &"--threads",
        &"2",
        &"--photo-memory-mib",
        &megabytes,
        &"--teacher",
        &"off",
        &"--force",
    ]);
    assert!(output.status.success(), "{}", stderr(&output));
    let report: Value = serde_json::from_slice(&std::fs::read(report).unwrap()).unwrap();
    let stages = report["stages"].as_array().unwrap();
    stages.iter().find_map(|stage| stage["details"]["peak_bytes"].as_u64()).unwrap()
}

#[test]
fn what_decoding_takes_counts_in_the_memory_for_photos() {
    const SIDES: (u32, u32) = (1600, 1200);
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let code = |x: u32, y: u32| ((x / 8 + y / 8) % 256) as u8;
    let small = dataset(&at("small"), "png", &|path| {
        ImageBuffer::from_fn(160, 120, |x, y| Rgba([code(x, y), 9, 9, code(y, x)]))
            .save(path)
            .unwrap();
    });
    // 16 bits: 15 MB as they are, 8 MB in 8 bits.
    let deep = dataset(&at("deep"), "png", &|path| {
        let pixel = |x, y| Rgba([code(x, y), 9, 9, code(y, x)].map(|c| 257 * u16::from(c)));
        ImageBuffer::from_fn(SIDES.0, SIDES.1, pixel).save(path).unwrap();
    });
    // Its decoder holds a picture of its own: 13 MB together.
    let webp = dataset(&at("webp"), "webp", &|path| {
        ImageBuffer::from_fn(SIDES.0, SIDES.1, |x, y| Rgb([code(x, y), 9, 9])).save(path).unwrap();
    });
    let least = peak_of_training(&small, "8");
    for (name, data, most) in [("deep", &deep, 16 * MIB), ("webp", &webp, 22 * MIB)] {
        let more = peak_of_training(data, "8").saturating_sub(least);
        assert!(more < most, "{name}: {more} bytes more than with small photos");
    }
}

/// A small PNG with a colour profile that unpacks to `mebibytes` of zeros.
#[cfg(target_os = "linux")]
fn png_with_a_profile_of(mebibytes: usize) -> Vec<u8> {
    let zeros = vec![0; MIB as usize];
    let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    let mut ends = Vec::new();
    for _ in 0..2 {
        packed.write_all(&zeros).unwrap();
        packed.flush().unwrap();
        ends.push(packed.get_ref().len());
    }
    let packed = packed.get_ref();
    let again = packed[ends[0]..ends[1]].repeat(mebibytes - 1);
    let profile = [&b"profile\0\0"[..], &packed[..ends[0]], &again].concat();
    let size = glam::UVec2::new(16, 12);
    let rgb = vec![[9; 3]; 16 * 12];
    let plain = trisplat_scene::image::RgbImage { size, rgb, alpha: None };
    let png = plain.to_png().unwrap();
    // Behind the signature and the header.
    let (before, after) = png.split_at(33);
    let chunk = [&(profile.len() as u32).to_be_bytes()[..], b"iCCP", &profile, &[0; 4]].concat();
    png::with_checksums(&[before, &chunk, after].concat())
}

/// Runs with `kilobytes` of address space.
#[cfg(target_os = "linux")]
fn within(kilobytes: u32, arguments: &[&dyn AsRef<std::ffi::OsStr>]) -> Output {
    let mut command = Command::new("sh");
    command.args(["-c", &format!("ulimit -v {kilobytes} && exec \"$0\" \"$@\"")]);
    command.arg(env!("CARGO_BIN_EXE_trisplat")).args(arguments.iter().map(|a| a.as_ref()));
    command.stdin(Stdio::null()).output().unwrap()
}

#[cfg(target_os = "linux")]
#[test]
fn colour_profile_bomb_costs_no_memory() {
    let folder = tempfile::tempdir().unwrap();
    let png = png_with_a_profile_of(2048);
    assert!(png.len() < 4 << 20, "{}", png.len());
    let data =
        dataset(&folder.path().join("set"), "png", &|path| std::fs::write(path, &png).unwrap());
    let out = data.join("out.ply");
    let commands: [&[&dyn AsRef<std::ffi::OsStr>]; 2] = [
        &[&"info", &data],
        &[&"train", &data, &"-o", &out, &"--steps", &"1", &"--threads", &"1", &"--teacher", &"off"],
    ];
    for command in commands {
        let output = within(1 << 20, command);
        assert!(output.status.success(), "{}", stderr(&output));
    }
}

#[test]
fn missing_temporary_folder_is_named_with_the_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing");
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    for variable in ["TMPDIR", "TMP", "TEMP"] {
        command.env(variable, &missing);
    }
    let file = std::fs::File::open(sample("studio.ply")).unwrap();
    let output = command.args(["info", "-"]).stdin(file).output().unwrap();
    let text = stderr(&output);
    assert_eq!((output.status.code(), text.lines().count()), (Some(1), 1), "{text}");
    let wants = format!("error: {}: no temporary file can be written here", missing.display());
    assert!(text.starts_with(&wants) && text.contains("name another folder"), "{text}");
}

#[test]
fn threads_that_the_environment_asks_for_are_limited_too() {
    let with = |threads: &str, argument: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
        command.args(["schema", "info", "--threads", argument]);
        stderr(&command.env("RAYON_NUM_THREADS", threads).stdin(Stdio::null()).output().unwrap())
    };
    let text = with("60000", "0");
    assert!(text.starts_with("warning: 60000 threads are more than 4 for each of"), "{text}");
    assert_eq!(with("60000", "2"), "", "the flag wins");
    assert_eq!(with("2", "0"), "");
}

/// The number of threads of a user is limited, but not that of the administrator.
#[cfg(target_os = "linux")]
#[test]
fn a_training_goes_on_where_the_system_starts_no_more_threads() {
    use std::os::unix::fs::{MetadataExt, PermissionsExt};
    let folder = tempfile::tempdir().unwrap();
    let data = dataset(&folder.path().join("set"), "png", &|path| {
        ImageBuffer::from_fn(32, 24, |x, y| Rgb([x as u8, y as u8, 9])).save(path).unwrap();
    });
    // A copy, because another user may not reach the folder of the build.
    let program = folder.path().join("trisplat");
    std::fs::copy(env!("CARGO_BIN_EXE_trisplat"), &program).unwrap();
    for path in [folder.path(), &data] {
        std::fs::set_permissions(path, PermissionsExt::from_mode(0o777)).unwrap();
    }
    let is_root = std::fs::metadata(&data).unwrap().uid() == 0;
    let mut command = if is_root { Command::new("setpriv") } else { Command::new("bash") };
    if is_root {
        command.args(["--reuid", "54321", "--regid", "54321", "--clear-groups", "bash"]);
    }
    command.args(["-c", "ulimit -u 3 && exec \"$0\" \"$@\""]).arg(&program).arg("train").arg(&data);
    command.arg("-o").arg(data.join("out.ply")).args([
        "--steps",
        "3",
        "--threads",
        "1",
        "--teacher",
        "off",
    ]);
    let output = command.env("TMPDIR", folder.path()).stdin(Stdio::null()).output().unwrap();
    let text = stderr(&output);
    if is_root {
        // The program itself, its signals and one worker: photos are decoded without threads of
        // their own.
        assert!(output.status.success() && data.join("out.ply").is_file(), "{text}");
    } else {
        // The user has more threads already.
        assert_eq!(output.status.code(), Some(1), "{text}");
        assert!(
            text.contains("error: --threads is 1: expected a number that the system can start"),
            "{text}"
        );
    }
}
