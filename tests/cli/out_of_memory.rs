//! Memory that ends at any point of a command: the whole output, or an end that leaves everything as it was, but for temporary files
//! that the next run removes.

use super::{sample, stderr};
use std::path::Path;
use std::process::{Command, Output, Stdio};

/// Bakes the studio to `out` with so much address space, MB.
fn bake_within(megabytes: u32, out: &Path) -> Output {
    let mut command = Command::new("sh");
    command.args(["-c", &format!("ulimit -v {} && exec \"$0\" \"$@\"", megabytes * 1024)]);
    command.args([env!("CARGO_BIN_EXE_trisplat"), "bake"]).arg(sample("studio.ply")).arg("-o").arg(out);
    command.args(["--force", "--preset", "fast", "--lod", "0.5", "--threads", "2"]);
    // To print where a panic was takes memory, and Rust's library waits for itself for ever where there is none.
    command.env("RUST_BACKTRACE", "0").stdin(Stdio::null()).output().unwrap()
}

#[test]
fn whatever_memory_there_is_files_are_whole_or_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("scene.glb");
    let left = || {
        let entries = std::fs::read_dir(folder.path()).unwrap();
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.filter(|name| name.contains(".trisplat.")).collect::<Vec<_>>()
    };
    let mut ended = 0;
    // From too little to load the program to more than enough.
    for megabytes in 16..400 {
        std::fs::write(&out, "an earlier scene").unwrap();
        let output = bake_within(megabytes, &out);
        let text = stderr(&output);
        if output.status.success() {
            assert!(std::fs::read(&out).unwrap().starts_with(b"glTF"));
            assert!(left().is_empty(), "{:?}", left());
            assert!(ended > 2, "ended {ended} times for want of memory");
            return;
        }
        assert_eq!(std::fs::read(&out).unwrap(), b"an earlier scene", "{megabytes} MB: {text}");
        assert!(text.lines().filter(|l| l.starts_with("error: ")).count() <= 1, "{text}");
        if output.status.code().is_some() {
            assert!(left().is_empty(), "{megabytes} MB: {:?} after {text}", left());
        }
        ended += usize::from(text.contains("memory allocation of"));
    }
    panic!("it never succeeded");
}
