//! `trisplat train --backend`.

use std::path::Path;
use std::process::{Command, Output};
use trisplat_fixtures::skip::skipped;
use trisplat_gpu::{AdapterOptions, Gpu};
use trisplat_scene::image::RgbImage;
use trisplat_synthetic::SyntheticOptions;

/// A card, or `None` after saying that there is none.
fn card() -> Option<Gpu> {
    match Gpu::headless(&AdapterOptions::default()) {
        Ok(gpu) => Some(gpu),
        Err(error) => {
            let is_required = std::env::var("TRISPLAT_REQUIRE_GPU").is_ok_and(|v| v == "1");
            assert!(!is_required, "TRISPLAT_REQUIRE_GPU=1, but {error}");
            skipped(&format!("no adapter: {error}"));
            None
        }
    }
}

/// A folder with a small data set in `photos`.
fn folder_of_photos() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let options =
        SyntheticOptions { views: 8, width: 24, points: 50, ..SyntheticOptions::default() };
    trisplat_synthetic::write(&folder.path().join("photos"), &options).unwrap();
    folder
}

fn train(folder: &Path, more: &[&str]) -> (Output, String) {
    let start = [
        "train",
        "photos",
        "-o",
        "scene.ply",
        "--force",
        "--steps",
        "3",
        "--max-triangles",
        "200",
        "--teacher",
        "off",
    ];
    let program = env!("CARGO_BIN_EXE_trisplat");
    let output = Command::new(program).current_dir(folder).args(start).args(more).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    (output, said)
}

#[test]
fn the_program_says_on_which_card_it_trains() {
    let Some(gpu) = card() else { return };
    let folder = folder_of_photos();
    let (output, said) = train(folder.path(), &["--backend", "gpu"]);
    assert!(output.status.success(), "{said}");
    assert!(said.contains(&format!("training on {}, about ", gpu.describe())), "{said}");
    assert_eq!(said.contains("software"), gpu.is_software(), "{said}");
    assert!(folder.path().join("scene.ply").is_file());

    let (output, said) = train(folder.path(), &["--backend", "cpu"]);
    assert!(output.status.success() && !said.contains("training on"), "{said}");
    let (output, said) = train(folder.path(), &["--backend", "gpu", "--adapter", "no such card"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(said.contains("--adapter is no such card: expected part of one of: "), "{said}");
}

#[test]
fn render_and_eval_draw_soft_pictures_on_the_chosen_card() {
    let Some(gpu) = card() else { return };
    let folder = folder_of_photos();
    let (output, said) = train(folder.path(), &["--backend", "cpu"]);
    assert!(output.status.success(), "{said}");
    let run = |arguments: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
        let output =
            command.current_dir(folder.path()).args(arguments.split(' ')).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{said}");
        (String::from_utf8(output.stdout).unwrap(), said)
    };
    let drawing_on = format!("drawing soft pictures on {}", gpu.describe());
    let render = "render scene.ply --dataset photos -f -o";
    let (_, said) = run(&format!("{render} card --backend gpu"));
    assert!(said.contains(&drawing_on) && said.contains("software") == gpu.is_software(), "{said}");
    let (_, said) = run(&format!("{render} cpu --backend cpu"));
    assert!(!said.contains("drawing soft pictures"), "{said}");
    let pictures = std::fs::read_dir(folder.path().join("card")).unwrap();
    for name in pictures.map(|entry| entry.unwrap().file_name()) {
        let picture = |side: &str| RgbImage::load(&folder.path().join(side).join(&name)).unwrap();
        let card = picture("card");
        let cpu = picture("cpu");
        let apart =
            card.rgb.as_flattened().iter().zip(cpu.rgb.as_flattened()).map(|(a, b)| a.abs_diff(*b));
        assert!(apart.max().unwrap() <= 1, "{name:?}");
    }
    let psnr = |backend: &str| {
        let (json, _) = run(&format!("eval scene.ply photos --as soft --json --backend {backend}"));
        let report: serde_json::Value = serde_json::from_str(&json).unwrap();
        report["steps"][0]["mean"]["psnr"].as_f64().unwrap()
    };
    assert!((psnr("gpu") - psnr("cpu")).abs() < 0.01);
    // Depth comes from the CPU, and nothing is said of a card.
    let (_, said) = run(&format!("{render} depth --show depth --backend gpu"));
    assert!(!said.contains("drawing soft pictures"), "{said}");
}
