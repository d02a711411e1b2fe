//! The Python module, built into a wheel and used from Python. It compiles the library once more,
//! in over two minutes of CPU time, so it runs only when asked for: `TRISPLAT_PYTHON=1
//! tests/run.sh`, or `TRISPLAT_PYTHON=1 cargo test --test program python`.

use std::path::{Path, PathBuf};
use std::process::Command;

fn here(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

fn runs(command: &mut Command) {
    let done = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let said =
        [done.stdout, done.stderr].map(|said| String::from_utf8_lossy(&said).into_owned()).concat();
    assert!(done.status.success(), "{command:?}\n{said}");
}

/// Runs a notebook in its folder, and asserts what its cells show.
const NOTEBOOK: &str = r#"
import sys, nbclient, nbformat
path = sys.argv[1]
notebook = nbformat.read(path, 4)
assert not any(cell.get("outputs") for cell in notebook.cells), "the notebook is kept without outputs"
nbclient.NotebookClient(notebook, timeout=600, resources={"metadata": {"path": path.rpartition("/")[0]}}).execute()
shown = [kind for cell in notebook.cells for output in cell.get("outputs", []) for kind in output.get("data", {})]
assert shown.count("image/png") == 2, shown
assert any("'psnr': 2" in str(cell.get("outputs")) for cell in notebook.cells), "the scene has 20 to 30 dB"
"#;

#[test]
fn the_wheel_reads_and_bakes() {
    if std::env::var_os("TRISPLAT_PYTHON").is_none() {
        trisplat_fixtures::skip::skipped("TRISPLAT_PYTHON is not set: the wheel is not built");
        return;
    }
    let bin = here("target/judges/venv/bin");
    let maturin = bin.join("maturin");
    assert!(maturin.exists(), "maturin is missing: TRISPLAT_PYTHON=1 tests/run.sh installs it");
    let folder = tempfile::tempdir().unwrap();
    let mut build = Command::new(maturin);
    build.args(["build", "--quiet", "--locked", "--profile", "dev", "--manifest-path"]);
    build
        .arg(here("python/Cargo.toml"))
        .arg("--out")
        .arg(folder.path())
        .arg("--target-dir")
        .arg(here("target/python"));
    runs(build.env("VIRTUAL_ENV", here("target/judges/venv")));
    let wheel = std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
    let site = folder.path().join("site");
    let mut install = Command::new(bin.join("python"));
    install
        .args(["-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target"])
        .arg(&site);
    runs(install.arg(&wheel));
    let mut test = Command::new(bin.join("python"));
    test.arg("-B").arg(here("python/test_trisplat.py")).arg(here("samples")).arg(folder.path());
    runs(test.env("PYTHONPATH", &site));
    let mut notebook = Command::new(bin.join("python"));
    notebook.args(["-B", "-c", NOTEBOOK]).arg(here("examples/photos_to_glb.ipynb"));
    runs(notebook.env("PYTHONPATH", &site));
}
