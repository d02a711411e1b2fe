//! The checked-in samples are what the generator makes today, to the byte.
//! `UPDATE=1 cargo test --test samples` rewrites them.

use std::path::Path;
use trisplat::bench::scenes::{SampleScene, provenance, soup};
use trisplat::formats::ply::write_soup;

fn check(name: SampleScene, triangles: usize, seed: u64, file: &str) {
    let mut bytes = Vec::new();
    write_soup(&mut bytes, &soup(name, triangles, seed), &provenance(name, triangles, seed, 0)).unwrap();
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
    check(SampleScene::Studio, 8000, 1, "studio.ply");
}

#[test]
fn degenerate_is_current() {
    check(SampleScene::Degenerate, 0, 0, "degenerate.ply");
}
