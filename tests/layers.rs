//! Who may import whom (docs/architecture.md): arrows go down, never up.

use std::path::{Path, PathBuf};

/// module → the modules it may name as `crate::…`.
const MAY: &[(&str, &str)] = &[
    ("error", ""),
    ("report", "error"),
    ("rng", ""),
    ("math", ""),
    ("camera", "error math"),
    ("atomic", "error"),
    ("image", "atomic error math"),
    ("soup", "error math"),
    ("mesh", "error math"),
    ("bvh", "mesh error math"),
    ("asset", "mesh bvh camera report error math"),
    ("scene", "soup mesh asset camera error"),
    ("placed", "asset camera"),
    ("kernel", "math"),
    ("gpu", "error"),
    ("dataset", "formats asset camera image rng error math"),
    ("formats", "soup mesh scene bvh asset camera report error math"),
    ("raster", "kernel gpu soup mesh camera image math error"),
    ("train", "raster kernel gpu dataset formats soup mesh camera image rng report error math asset"),
    ("bake", "raster dataset formats soup mesh scene placed bvh asset camera image rng report error math"),
    ("view", "asset placed rng mesh soup scene raster camera image gpu error math"),
    (
        "bench",
        "asset bake bvh camera dataset error formats gpu image kernel math mesh placed raster report rng scene soup train view",
    ),
    (
        "cli",
        "asset bake bench bvh camera dataset error formats gpu image kernel math mesh placed raster report rng scene soup train view",
    ),
    ("main", "cli"),
    ("lib", ""),
];

#[test]
fn imports_go_down_only() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut wrong = Vec::new();
    for file in rust_files(&src) {
        let relative = file.strip_prefix(&src).unwrap();
        let module = relative.components().next().unwrap().as_os_str().to_string_lossy().replace(".rs", "");
        let Some((_, may)) = MAY.iter().find(|(name, _)| *name == module) else {
            panic!("{} belongs to no layer: add its module to this table", relative.display());
        };
        let text = std::fs::read_to_string(&file).unwrap();
        // Tests inside a file may reach up: they hold things against each other.
        let code = text.split("#[cfg(test)]").next().unwrap();
        for part in code.split("crate::").skip(1) {
            let named: String = part.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
            if named != module && !named.is_empty() && !may.split(' ').any(|m| m == named) {
                wrong.push(format!("{} names crate::{named}", relative.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "layers broken:\n{}", wrong.join("\n"));
}

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(rust_files(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
    files
}
