//! The checked-in samples are what the generator makes today, to the byte.
//! `UPDATE=1 cargo test --test samples` rewrites them.

use std::path::Path;
use trisplat::bake::{Bake, BakeOptions, Views};
use trisplat::bench::evaluate::evaluate;
use trisplat::bench::scene_renderer::SceneRenderer;
use trisplat::bench::scenes::{SampleScene, provenance, soup};
use trisplat::bench::steps::{EvalStep, SMALLEST, reread};
use trisplat::dataset::{Dataset, DatasetOptions};
use trisplat::formats::ply::write_soup;
use trisplat::formats::{self, ReadOptions};

fn check(name: SampleScene, triangles: usize, seed: u64, file: &str) {
    let mut bytes = Vec::new();
    write_soup(&mut bytes, &soup(name, triangles, seed), &provenance(name, triangles, seed, 0), &[]).unwrap();
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

/// The README's way from photos to a file, from its middle on: the soup it trains is checked in.
#[test]
fn the_trained_sample_meets_held_out_photos_as_a_file() {
    let samples = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples");
    let dataset = Dataset::load(&samples.join("dataset"), &DatasetOptions::default()).unwrap();
    let loaded = formats::read(&samples.join("soups/trained.ply"), &ReadOptions { sh_degree: 0 }).unwrap();
    let psnr = |mut views: Option<Views>| {
        let options = BakeOptions::default();
        let asset = Bake::new(&options).photos(views.as_mut()).run([loaded.clone()]).unwrap();
        let (file, bytes) = reread(&asset, &SMALLEST).unwrap();
        let (triangles, placement) = (file.mesh.face_count() as u64, file.provenance.placement);
        let renderer = SceneRenderer::solid(file.mesh, &placement, Some(&dataset), [0.0; 3], 4);
        let mut steps = [EvalStep { name: "file", triangles, bytes: Some(bytes), renderer }];
        let held_out: Vec<_> = dataset.test().collect();
        evaluate(&mut steps, &held_out, 1 << 26, |_, _, _| Ok(())).unwrap()[0].mean.psnr
    };
    let (plain, with_photos) = (psnr(None), psnr(Some(Views::new(&dataset, 1 << 26, [0.0; 3]))));
    // Measured 24.1 and 26.7 dB; what the photos add to a bake is the point.
    assert!(plain > 23.5 && with_photos > 26.0 && with_photos > plain + 1.5, "{plain:.2} {with_photos:.2}");
}
