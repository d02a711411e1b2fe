//! The commands in README.md run, as a newcomer would type them.

use std::path::Path;
use std::process::Command;

/// Every line of every ```sh block.
fn commands() -> Vec<String> {
    let readme = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("README.md")).unwrap();
    let blocks = readme.split("```sh\n").skip(1).map(|rest| rest.split("```").next().unwrap());
    blocks.flat_map(str::lines).map(|l| l.split('#').next().unwrap().trim().to_owned()).collect()
}

#[test]
fn every_command_of_the_readme_runs() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().unwrap();
    // What the README's examples take for granted.
    std::fs::create_dir(folder.path().join("samples")).unwrap();
    let soups = folder.path().join("samples/soups");
    std::fs::create_dir(&soups).unwrap();
    std::fs::copy(root.join("samples/soups/studio.ply"), soups.join("studio.ply")).unwrap();
    std::fs::copy(root.join("samples/soups/studio.ply"), folder.path().join("scene.ply")).unwrap();
    copy_folder(&root.join("samples/dataset"), &folder.path().join("samples/dataset"));
    let mut ran = 0;
    for command in commands() {
        let words: Vec<&str> = command.split_whitespace().collect();
        let arguments = match words[..] {
            ["cargo", "run", "--release", "--", ref rest @ ..] | ["trisplat", ref rest @ ..] => rest,
            // The test command runs this very test.
            ["bash", "tests/run.sh"] => continue,
            _ => panic!("a command of the README that no test knows: {command}"),
        };
        // Inputs that are not in the repository, benchmarks of minutes and windows are only parsed.
        let absent = arguments.iter().any(|a| a.ends_with(".pt") || a.contains("photos"))
            || ["bench", "view"].contains(&arguments[0]);
        // Enough steps to have something to bake.
        let arguments = arguments.iter().map(|a| if *a == "3000" { "60" } else { a });
        let mut trisplat = Command::new(env!("CARGO_BIN_EXE_trisplat"));
        trisplat.current_dir(folder.path()).args(arguments.clone());
        if absent {
            trisplat.arg("--help");
        } else if arguments.clone().next() == Some("bake") {
            trisplat.arg("--force");
        }
        let output = trisplat.output().unwrap();
        assert!(output.status.success(), "{command}\n{}", String::from_utf8_lossy(&output.stderr));
        ran += 1;
    }
    assert!(ran >= 5, "only {ran} commands found");
}

fn copy_folder(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        match entry.file_type().unwrap().is_dir() {
            true => copy_folder(&entry.path(), &to.join(entry.file_name())),
            false => drop(std::fs::copy(entry.path(), to.join(entry.file_name())).unwrap()),
        }
    }
}
