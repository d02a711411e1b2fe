//! `mesh PHOTOS`: a textured surface of photos alone.

use std::ops::ControlFlow::Continue;
use trisplat_bake::{MeshOptions, TextureOptions, TextureWhen, Views};
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_job::MeshJob;
use trisplat_scene::report::Report;
use trisplat_surface::SurfaceOptions;
use trisplat_synthetic::SyntheticOptions;
use trisplat_train::DepthsDetails;

const PHOTOS: SyntheticOptions = SyntheticOptions {
    views: 24,
    width: 112,
    points: 800,
    seed: 0,
    transparent: false,
    phone: false,
    depth: false,
};

#[test]
fn photos_alone_become_a_textured_surface() {
    let folder = tempfile::tempdir().unwrap();
    trisplat_synthetic::write(folder.path(), &PHOTOS).unwrap();
    let dataset = Dataset::load(folder.path(), &DatasetOptions::default()).unwrap();
    let surface = SurfaceOptions { max_triangles: Some(3000), ..SurfaceOptions::default() };
    let texture = TextureOptions { texture: TextureWhen::On, ..TextureOptions::default() };
    let options = MeshOptions { surface, texture, ..MeshOptions::default() };
    let mut job = MeshJob::new(None, Some(dataset.clone()), options);
    // By steps, not by time: a slow machine makes the same surface.
    job.train.steps = 250;
    job.train.max_triangles = 3000;
    job.budget = None;
    let mut report = Report::new("mesh");
    let asset = job.run(&mut report, &mut |_| Continue(())).unwrap().unwrap();
    asset.mesh.validate().unwrap();
    let names: Vec<&str> = report.stages.iter().map(|stage| stage.name.as_str()).collect();
    let wanted = ["train", "depths", "surface", "texture"];
    assert!(wanted.iter().all(|name| names.contains(name)), "{names:?}");
    let depths = report.details::<DepthsDetails>().unwrap();
    let photos = dataset.train().count() as u64;
    assert!(depths.photos == photos && depths.known > 0.1, "{depths:?}");
    assert!(
        asset.mesh.texture.is_some() && asset.mesh.face_count() <= 3000,
        "{}",
        asset.mesh.face_count()
    );
    let mut views = Views::new(&dataset, &DatasetOptions::default());
    views.transform(&asset.provenance.placement);
    let all: Vec<usize> = (0..views.len()).collect();
    let psnr = views.mean_psnr(&asset.mesh, &all).unwrap();
    let mut colours = asset.mesh;
    colours.drop_texture();
    let without = views.mean_psnr(&colours, &all).unwrap();
    assert!(psnr > 16.0 && psnr > without + 0.5, "{psnr} {without}");
}
