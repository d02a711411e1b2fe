//! The checked-in samples are what the generator makes today, to the byte.
//! `UPDATE=1 cargo test --test program samples` rewrites them.

use std::path::{Path, PathBuf};
use std::process::Command;
use trisplat_bake::{Bake, BakeOptions, Views};
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_formats::{
    self as formats, OutputOptions, OutputTarget, ReadOptions, ply::write_soup,
};
use trisplat_job::EvalJob;
use trisplat_scene::{ImportedScene, Scene, Soup};
use trisplat_synthetic::soups;

fn check(soup: &Soup, recipe: &str, file: &str) {
    let mut bytes = Vec::new();
    write_soup(&mut bytes, soup, &soups::provenance(recipe), &[]).unwrap();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/soups").join(file);
    if std::env::var_os("UPDATE").is_some() {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, &bytes).unwrap();
    }
    let kept = std::fs::read(&path).unwrap();
    assert!(kept == bytes, "{file} is not what the generator makes: UPDATE=1 rewrites it");
    assert!(bytes.len() < 1_000_000, "{file} has {} bytes: too large to check in", bytes.len());
}

#[test]
fn studio_is_current() {
    check(&soups::studio(8000, 1), &soups::studio_recipe(8000, 1), "studio.ply");
}

#[test]
fn degenerate_is_current() {
    check(&soups::degenerate(), soups::DEGENERATE_RECIPE, "degenerate.ply");
}

/// The README's command that trains on the sample data set, and the file that it writes.
fn train_as_the_readme_does(folder: &Path) -> Vec<u8> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let readme = std::fs::read_to_string(root.join("README.md")).unwrap();
    let command = readme
        .lines()
        .find_map(|line| line.strip_prefix("cargo run --release -- train samples/dataset "));
    let output = folder.join("trained.ply");
    let mut trisplat = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    trisplat.current_dir(root).args(["train", "samples/dataset", "-q"]);
    for word in command.expect("the README trains on the sample data set").split_whitespace() {
        match word {
            "trained.ply" => trisplat.arg(&output),
            word => trisplat.arg(word),
        };
    }
    let done = trisplat.output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    std::fs::read(&output).unwrap()
}

/// The header of a PLY file, without the numbers of elements.
fn header(bytes: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(bytes);
    let lines = text.lines().take_while(|line| *line != "end_header");
    lines.filter(|line| !line.starts_with("element ")).map(str::to_owned).collect()
}

/// Training has the same bits for any number of threads, but not on CPUs with other vector
/// instructions (docs/numerics.md): there the file only is as large and as good.
#[test]
fn trained_is_what_the_command_of_the_readme_writes() {
    let folder = tempfile::tempdir().unwrap();
    let made = train_as_the_readme_does(folder.path());
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/soups/trained.ply");
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(&path, &made).unwrap();
    }
    let kept = std::fs::read(&path).unwrap();
    if made == kept {
        return;
    }
    assert_eq!(header(&made), header(&kept), "UPDATE=1 rewrites trained.ply");
    let dataset = Dataset::load(samples().join("dataset"), &DatasetOptions::default()).unwrap();
    let read = |path: &Path| formats::read(path, &ReadOptions::with_degree(0)).unwrap();
    let [new, old] = [read(&folder.path().join("trained.ply")), read(&path)];
    let [count, wants] = [&new, &old].map(|loaded| loaded.scene.triangle_count() as f64);
    assert!((count / wants - 1.0).abs() < 0.05, "{count} triangles, not {wants}");
    let [psnr, wants] = [&new, &old].map(|loaded| file_psnr(loaded, &dataset, None));
    assert!(
        (psnr - wants).abs() < 0.5,
        "{psnr:.2} dB, not {wants:.2} dB: UPDATE=1 rewrites trained.ply"
    );
}

fn samples() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("samples")
}

/// PSNR of the smallest file of a scene on the held-out photos, dB.
fn file_psnr(loaded: &ImportedScene, dataset: &Dataset, mut views: Option<Views>) -> f64 {
    let options = BakeOptions::default();
    let asset = Bake::new(&options).photos(views.as_mut()).run([loaded.clone()]).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.glb");
    let smallest = OutputOptions { target: OutputTarget::Web, ..OutputOptions::SMALL };
    formats::write(&asset, &file, &smallest).unwrap();
    let job = EvalJob::new(file);
    job.run(dataset).unwrap().steps[0].mean.psnr
}

/// The PSNR of the smallest file of a scene without photos and with them, dB.
fn without_and_with_photos(loaded: &ImportedScene) -> (f64, f64) {
    let dataset = Dataset::load(samples().join("dataset"), &DatasetOptions::default()).unwrap();
    let views = Views::new(&dataset, &DatasetOptions::default());
    (file_psnr(loaded, &dataset, None), file_psnr(loaded, &dataset, Some(views)))
}

fn trained() -> ImportedScene {
    formats::read(&samples().join("soups/trained.ply"), &ReadOptions::with_degree(0)).unwrap()
}

/// The README's commands after the training.
#[test]
fn the_trained_sample_meets_held_out_photos_as_a_file() {
    let (plain, with_photos) = without_and_with_photos(&trained());
    // Measured 29.54 and 29.65 dB.
    assert!(
        plain > 29.0 && with_photos > 29.2 && with_photos > plain,
        "{plain:.2} {with_photos:.2}"
    );
}

/// A training leaves colours little to gain; those of a scene with a tenth less contrast have more.
#[test]
fn photos_improve_the_bake_of_a_scene_of_dull_colours() {
    let mut dull = trained();
    let Scene::Soup(soup) = &mut dull.scene else { panic!("the sample is a soup") };
    soup.sh.as_flattened_mut().iter_mut().for_each(|c| *c *= 0.9);
    let (plain, with_photos) = without_and_with_photos(&dull);
    assert!(with_photos > 28.3 && with_photos > plain + 0.3, "{plain:.2} {with_photos:.2}");
}

#[test]
fn the_package_holds_what_a_build_needs_and_nothing_else() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut cargo = Command::new(env!("CARGO"));
    let done = cargo
        .args(["package", "--list", "--allow-dirty", "--offline"])
        .current_dir(root)
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let files = String::from_utf8(done.stdout).unwrap();
    for needed in
        ["src/main.rs", "schemas/bake.schema.json", "samples/soups/studio.ply", "LICENSE-MIT"]
    {
        assert!(files.lines().any(|file| file == needed), "{needed} is missing from\n{files}");
    }
    let strays =
        files.lines().filter(|file| file.contains("node_modules") || file.contains("target/"));
    assert_eq!(strays.collect::<Vec<_>>(), Vec::<&str>::new());
    let bytes: u64 = files
        .lines()
        .filter_map(|file| std::fs::metadata(root.join(file)).ok())
        .map(|m| m.len())
        .sum();
    // A registry takes 10 MB, compressed; these are not.
    assert!(bytes < 10_000_000, "{bytes} bytes");
}

/// The scripts that `samples/cluster/slurm.sh` submits are those of a city of this name; nothing in
/// it is executed.
#[cfg(unix)]
#[test]
fn no_name_of_a_city_is_executed_by_the_cluster_script() {
    use super::stderr;
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let city = at("c$(touch X)`touch Y` \"q\" it's;touch Z %a $HOME");
    for made in [&city, &at("bin"), &at("jobs")] {
        std::fs::create_dir(made).unwrap();
    }
    let manifest =
        "{\n \"blocks\": [\n {\"key\": 1},\n {\"key\": 2}\n ],\n \"bytes\": 123456789\n}";
    std::fs::write(city.join("manifest.json"), manifest).unwrap();
    let tool = |name: &str, script: &str| {
        std::fs::write(at("bin").join(name), format!("#!/bin/sh\n{script}\n")).unwrap();
        std::fs::set_permissions(at("bin").join(name), PermissionsExt::from_mode(0o755)).unwrap();
    };
    tool("sbatch", r#"n=$(ls jobs | wc -l); cat > "jobs/$((n + 1)).sh"; echo 77"#);
    tool("trisplat", r#"for word; do printf '<%s>' "$word" >> said; done; echo >> said"#);
    let path = format!("{}:{}", at("bin").display(), std::env::var("PATH").unwrap());
    let run = |script: &Path, argument: &Path| {
        let mut shell = Command::new("sh");
        shell.arg(script).arg(argument).current_dir(folder.path()).env("PATH", &path);
        let output =
            shell.env("SLURM_ARRAY_TASK_ID", "1").env("SLURM_CPUS_PER_TASK", "2").output().unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
    };
    run(&Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/cluster/slurm.sh"), &city);
    run(&at("jobs/1.sh"), &city);
    run(&at("jobs/2.sh"), &city);
    let full = city.canonicalize().unwrap();
    let city = full.display();
    let wants = format!(
        "<train><--block><{city}:1><--threads><2>\n<merge><{city}><-o><{city}/city.ply><-f>\n\
         <bake><{city}><-o><{city}/city.tileset.json><-f>\n"
    );
    assert_eq!(std::fs::read_to_string(at("said")).unwrap(), wants);
    assert_eq!(
        std::fs::read_dir(folder.path()).unwrap().count(),
        4,
        "a command of the name was executed"
    );
}
