//! `trisplat train --backend`.

use super::card;
use std::path::Path;
use std::process::{Command, Output};
use trisplat::dataset::synthetic::{self, SyntheticOptions};

fn train(folder: &Path, more: &[&str]) -> (Output, String) {
    let start = ["train", "photos", "-o", "scene.ply", "--force", "--steps", "3", "--max-triangles", "200"];
    let program = env!("CARGO_BIN_EXE_trisplat");
    let output = Command::new(program).current_dir(folder).args(start).args(more).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    (output, said)
}

#[test]
fn the_program_says_on_which_card_it_trains() {
    let Some(gpu) = card() else { return };
    let folder = tempfile::tempdir().unwrap();
    let options = SyntheticOptions { views: 8, width: 24, points: 50, ..SyntheticOptions::default() };
    synthetic::write(&folder.path().join("photos"), &options).unwrap();
    let (output, said) = train(folder.path(), &["--backend", "gpu"]);
    assert!(output.status.success(), "{said}");
    assert!(said.contains(&format!("training on {}, about ", gpu.describe())), "{said}");
    assert_eq!(said.contains("software"), gpu.is_software(), "{said}");
    assert!(folder.path().join("scene.ply").is_file());

    let (output, said) = train(folder.path(), &["--backend", "cpu"]);
    assert!(output.status.success() && !said.contains("training on"), "{said}");
    let (output, said) = train(folder.path(), &["--backend", "gpu", "--adapter", "no such card"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(said.contains("--adapter is no such card: wants part of one of: "), "{said}");
}
