//! Damaged photos, of a kind that has made a decoder panic.

use super::{fails, sample, stderr, trisplat};
use std::path::{Path, PathBuf};
use trisplat_fixtures::png;
use trisplat_synthetic::SyntheticOptions;

/// A data set of four photos, the last of them these bytes.
fn dataset(folder: &Path, photo: &[u8]) -> PathBuf {
    let data = folder.join("photos");
    let options =
        SyntheticOptions { views: 4, width: 16, points: 9, seed: 1, ..SyntheticOptions::default() };
    trisplat_synthetic::write(&data, &options).unwrap();
    std::fs::write(data.join("images/view_0003.png"), photo).unwrap();
    data
}

#[test]
fn damaged_palette_is_an_error_of_its_photo_or_mask() {
    let folder = tempfile::tempdir().unwrap();
    let glb = folder.path().join("a.glb");
    let ply = folder.path().join("a.ply");
    let whole = dataset(folder.path(), &png::indexed(16, 12, &[7; 12], &[0, 128]));
    assert!(trisplat(&[&"info", &whole]).status.success(), "a whole palette is read");
    for bytes in [0, 1, 4, 5, 766, 768 + 3, 768 + 4] {
        let photo = png::indexed(16, 12, &vec![7; bytes], &[]);
        let data = dataset(folder.path(), &photo);
        let wants =
            ["view_0003.png: PLTE chunk at byte 33", &format!("{bytes} bytes are no palette")];
        fails(folder.path(), &[&"info", &data], &wants);
        if bytes == 4 {
            let soup = sample("trained.ply");
            fails(folder.path(), &[&"eval", &soup, &data, &"--split", &"all"], &wants);
            fails(folder.path(), &[&"bake", &soup, &"--dataset", &data, &"-o", &glb], &wants);
            fails(folder.path(), &[&"train", &data, &"--steps", &"1", &"-o", &ply], &wants);
        }
        let skipped = trisplat(&[&"info", &data, &"--skip-broken"]);
        let text = String::from_utf8_lossy(&skipped.stdout);
        assert!(
            skipped.status.success() && text.contains("view_0003.png"),
            "{text}{}",
            stderr(&skipped)
        );
    }
    // As a mask: a photo that is whole, and a mask that is not.
    let data = dataset(folder.path(), &png::indexed(16, 12, &[7; 12], &[]));
    let masks = data.join("masks");
    std::fs::create_dir(&masks).unwrap();
    for view in 0..4 {
        let palette: &[u8] = if view == 3 { &[7; 4] } else { &[255; 12] };
        std::fs::write(
            masks.join(format!("view_000{view}.png.png")),
            png::indexed(16, 12, palette, &[]),
        )
        .unwrap();
    }
    let wants = ["view_0003.png.png: PLTE chunk at byte 33"];
    fails(folder.path(), &[&"eval", &sample("trained.ply"), &data, &"--split", &"all"], &wants);
    fails(
        folder.path(),
        &[&"bake", &sample("trained.ply"), &"--dataset", &data, &"-o", &glb],
        &wants,
    );
}
