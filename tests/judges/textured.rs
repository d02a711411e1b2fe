//! A textured file in three.js, near and far: it filters the texture as trisplat's rasteriser does.

use super::browser::chromium;
use super::{bake, have, here, runs, validator};
use glam::{DVec3, UVec2};
use serde_json::{Value, json};
use std::process::Command;
use tempfile::TempDir;
use trisplat_formats::{self as formats, ReadOptions};
use trisplat_raster::solid::{SolidRasterOptions, SolidRasterizer};
use trisplat_scene::{Scene, camera::Viewpoint, image::RgbImage, math::metric};

const SIZE: UVec2 = UVec2::new(320, 240);
/// Minimum PSNR between pictures of the two renderers, dB: with one sample a pixel, edges of
/// triangles fall on either side of it.
const AGREE_DB: f64 = 36.0;
/// Flags for large triangles, to which a texture adds much.
fn textured(photos: &str) -> [&str; 5] {
    ["--dataset", photos, "--texture", "--max-triangles", "1500"]
}

#[test]
fn three_filters_textures_as_we_do() {
    let three = here("target/judges/node_modules/three");
    let Some(chromium) = chromium() else { return };
    if !have("3d-tiles-renderer", three.exists()) {
        return;
    }
    let folder = TempDir::new().unwrap();
    let scene = folder.path().join("scene.glb");
    let views = folder.path().join("views.json");
    let photos = here("samples/dataset").display().to_string();
    bake(
        &here("samples/soups/trained.ply"),
        &scene,
        &[&textured(&photos)[..], &["--backdrop", "off", "--set", "sides=both"]].concat(),
    );
    let loaded = formats::read(&scene, &ReadOptions::default()).unwrap();
    let (Scene::Mesh(mesh), Some(first)) = (loaded.scene, loaded.provenance.viewpoint) else {
        panic!("a mesh")
    };
    assert!(mesh.texture.is_some());
    // From where it is looked at first, from nearer, and from so far away that coarse mip levels
    // are drawn.
    let eye = DVec3::from(first.eye);
    let target = DVec3::from(first.target);
    let at =
        |distance: f64| Viewpoint { eye: (target + (eye - target) * distance).to_array(), ..first };
    let places = [0.5, 1.0, 2.0, 4.0].map(at);
    let out = |i: usize| folder.path().join(format!("{i}.png"));
    let asked = places.iter().enumerate().map(|(i, place)| {
        json!({ "size": SIZE.to_array(), "fov": place.fov, "eye": place.eye, "target": place.target,
            "up": place.up, "out": out(i) })
    });
    std::fs::write(&views, Value::from_iter(asked).to_string()).unwrap();
    let mut command = Command::new("node");
    let done = runs(
        command
            .arg(here("tests/judges/textured.mjs"))
            .arg(here("target/judges"))
            .args([&chromium, &scene, &views]),
    );
    let said: Value = serde_json::from_slice(&done.stdout).expect("the script's answer");
    assert_eq!(said, json!({ "errors": [] }));
    for (i, place) in places.iter().enumerate() {
        let options = SolidRasterOptions { background: [0.0; 3], samples: 1, near: 0.01 };
        let ours = SolidRasterizer::new().render(&mesh, &place.camera(SIZE), &options);
        let psnr = metric::psnr(&ours.rgb, &RgbImage::load(&out(i)).unwrap().rgb, None);
        println!("three.js, place {i}: {psnr:.1} dB");
        assert!(psnr > AGREE_DB, "place {i}: {psnr} dB");
    }
}

#[test]
fn textured_files_are_valid_gltf() {
    if !validator() {
        return;
    }
    let folder = TempDir::new().unwrap();
    let photos = here("samples/dataset").display().to_string();
    let files: Vec<_> = [
        ("plain.glb", &[] as &[&str]),
        ("exact.glb", &["--set", "texture_format=png"]),
        ("small.glb", &["--target", "unity", "--preset", "small"]),
        ("beside.gltf", &["--target", "godot", "--backdrop", "sphere"]),
    ]
    .map(|(name, flags)| {
        let file = folder.path().join(name);
        let triangles = bake(
            &here("samples/soups/trained.ply"),
            &file,
            &[&textured(&photos)[..], flags].concat(),
        );
        (file, triangles)
    })
    .into();
    super::assert_valid(&files);
}
