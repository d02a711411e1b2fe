//! Memory that ends at any point of a command: the whole output, or one error and everything as it was.

use super::{sample, stderr};
use std::path::Path;
use std::process::{Command, Output, Stdio};

/// Bakes the studio to `out` with so much address space, MB.
fn bake_within(megabytes: u32, out: &Path) -> Output {
    let mut command = Command::new("sh");
    command.args(["-c", &format!("ulimit -v {} && exec \"$0\" \"$@\"", megabytes * 1024)]);
    command.args([env!("CARGO_BIN_EXE_trisplat"), "bake"]).arg(sample("studio.ply")).arg("-o").arg(out);
    command.args(["--force", "--preset", "fast", "--lod", "0.5", "--threads", "2"]);
    command.stdin(Stdio::null()).output().unwrap()
}

#[test]
fn whatever_memory_there_is_files_are_whole_or_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("scene.glb");
    let names = || std::fs::read_dir(folder.path()).unwrap().count();
    let mut ended = 0;
    // From too little to load the program to more than enough.
    for megabytes in 16..400 {
        std::fs::write(&out, "an earlier scene").unwrap();
        let output = bake_within(megabytes, &out);
        let text = stderr(&output);
        if output.status.success() {
            assert!(std::fs::read(&out).unwrap().starts_with(b"glTF"));
            assert!(ended > 2, "ended {ended} times for want of memory");
            return;
        }
        assert_eq!(std::fs::read(&out).unwrap(), b"an earlier scene", "{megabytes} MB: {text}");
        assert_eq!(names(), 1, "{megabytes} MB: something was left behind");
        // A thread that is begun needs memory of the C library, which aborts when there is none: no code of ours can say more, and
        // the files are as they were all the same.
        if text.contains("Fatal glibc error") {
            assert!(matches!(output.status.code(), None | Some(1)), "{megabytes} MB: {text}");
            assert!(text.lines().filter(|l| l.starts_with("error: ")).count() <= 1, "{text}");
            continue;
        }
        if text.contains("error: ") {
            assert_eq!(output.status.code(), Some(1), "{megabytes} MB: {text}");
            assert_eq!(text.lines().filter(|l| l.starts_with("error: ")).count(), 1, "{text}");
            ended += usize::from(text.contains("out of memory"));
        } else {
            // The system could not even load it.
            assert_eq!(ended, 0, "{megabytes} MB: {text}");
        }
    }
    panic!("it never succeeded");
}
