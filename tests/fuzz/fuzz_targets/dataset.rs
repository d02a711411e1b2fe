//! Any bytes as the files of a data set: posed photos or one error, never a panic.
#![no_main]

use libfuzzer_sys::fuzz_target;
use std::path::Path;
use trisplat::{Dataset, DatasetOptions, Limits};
use trisplat_scene::image::RgbImage;

// The first byte says which kind of data set, the rest is cut into its files at `\xff\xfe`.
fuzz_target!(|bytes: &[u8]| {
    let Some((kind, rest)) = bytes.split_first() else { return };
    let names: &[&str] = match kind % 6 {
        0 => &["transforms.json", "points.ply", "test.txt", "depths/a.png"],
        1 => &[
            "sparse/0/cameras.txt",
            "sparse/0/images.txt",
            "sparse/0/points3D.txt",
            "test.txt",
            "sparse/0/depth_params.json",
            "depths/a.png",
        ],
        2 => &["cameras.xml"],
        3 => &["poses.csv"],
        4 => &["poses_bounds.npy"],
        _ => &["sparse/0/cameras.bin", "sparse/0/images.bin", "sparse/0/points3D.bin", "test.txt"],
    };
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(folder.path().join("sparse/0")).unwrap();
    std::fs::create_dir(folder.path().join("images")).unwrap();
    std::fs::create_dir(folder.path().join("depths")).unwrap();
    let mut parts = split(rest).into_iter();
    for name in names {
        std::fs::write(folder.path().join(name), parts.next().unwrap_or_default()).unwrap();
    }
    photo(&folder.path().join("a.png"));
    photo(&folder.path().join("images/a.png"));
    if let Ok(dataset) = Dataset::load(folder.path(), &DatasetOptions::default()) {
        for view in &dataset.views {
            view.camera.validate(&Limits::DEFAULT).unwrap();
            drop(view.photo.decode());
            drop(view.photo.decode_depth());
        }
    }
});

fn split(bytes: &[u8]) -> Vec<&[u8]> {
    let mut parts = vec![];
    let mut rest = bytes;
    while let Some(at) = rest.windows(2).position(|pair| pair == b"\xff\xfe") {
        parts.push(&rest[..at]);
        rest = &rest[at + 2..];
    }
    parts.push(rest);
    parts
}

fn photo(path: &Path) {
    let pixels =
        RgbImage { size: glam::UVec2::new(16, 12), rgb: vec![[9, 80, 200]; 192], alpha: None };
    std::fs::write(path, pixels.to_png().unwrap()).unwrap();
}
