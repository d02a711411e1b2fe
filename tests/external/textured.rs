//! A textured file in three.js, near and far: it filters the texture as trisplat's rasteriser does.

use super::browser::chromium;
use super::{bake, have, here, runs, validator};
use glam::{DVec3, UVec2};
use serde_json::{Value, json};
use std::process::Command;
use tempfile::TempDir;
use trisplat_formats::{self as formats, ReadOptions};
use trisplat_raster::solid::{SolidRasterOptions, SolidRasterizer};
#[cfg(feature = "ktx2")]
use trisplat_scene::math::color;
use trisplat_scene::{Scene, camera::Viewpoint, image::RgbImage, math::metric};

const SIZE: UVec2 = UVec2::new(320, 240);
/// Least PSNR between pictures of the two renderers, dB: with one sample a pixel, edges of triangles fall on either side of it.
const AGREE_DB: f64 = 36.0;
/// The same where the card has other blocks than the file, as colours are rounded twice.
#[cfg(feature = "ktx2")]
const AGREE_KTX2_DB: f64 = 34.0;

/// Flags for large triangles, to which a texture adds much.
fn textured(photos: &str) -> [&str; 5] {
    ["--dataset", photos, "--texture", "--max-triangles", "1500"]
}

#[test]
fn three_filters_textures_as_we_do() {
    three_draws_as_we_do(&[], AGREE_DB);
}

/// Its loader turns the blocks into those of the card, ours into a picture, and its mip levels are those of the file.
#[cfg(feature = "ktx2")]
#[test]
fn three_draws_ktx2_textures_as_we_do() {
    three_draws_as_we_do(&["--set", "texture_format=ktx2"], AGREE_KTX2_DB);
    three_draws_as_we_do(&["--set", "texture_format=ktx2-uastc"], AGREE_KTX2_DB);
}

fn three_draws_as_we_do(flags: &[&str], least_db: f64) {
    let three = here("target/judges/node_modules/three");
    let Some(chromium) = chromium() else { return };
    if !have("3d-tiles-renderer", three.exists()) {
        return;
    }
    let folder = TempDir::new().unwrap();
    let (scene, views) = (folder.path().join("scene.glb"), folder.path().join("views.json"));
    let photos = here("samples/dataset").display().to_string();
    bake(
        &here("samples/soups/trained.ply"),
        &scene,
        &[&textured(&photos)[..], &["--backdrop", "off"], flags].concat(),
    );
    let loaded = formats::read(&scene, &ReadOptions::default()).unwrap();
    let (Scene::Mesh(mesh), Some(first)) = (loaded.scene, loaded.provenance.viewpoint) else {
        panic!("a mesh")
    };
    assert!(mesh.texture.is_some());
    // From where it is looked at first, from nearer, and from so far away that coarse mip levels are drawn.
    let (eye, target) = (DVec3::from(first.eye), DVec3::from(first.target));
    let at = |distance: f64| Viewpoint { eye: (target + (eye - target) * distance).to_array(), ..first };
    let places = [0.5, 1.0, 2.0, 4.0].map(at);
    let out = |i: usize| folder.path().join(format!("{i}.png"));
    let asked = places.iter().enumerate().map(|(i, place)| {
        json!({ "size": SIZE.to_array(), "fov": place.fov, "eye": place.eye, "target": place.target,
            "up": place.up, "out": out(i) })
    });
    std::fs::write(&views, Value::from_iter(asked).to_string()).unwrap();
    let mut command = Command::new("node");
    let done = runs(
        command.arg(here("tests/textured.mjs")).arg(here("target/judges")).args([&chromium, &scene, &views]),
    );
    let said: Value = serde_json::from_slice(&done.stdout).expect("the script's answer");
    assert_eq!(said, json!({ "errors": [] }));
    for (i, place) in places.iter().enumerate() {
        let options = SolidRasterOptions { background: [0.0; 3], samples: 1, near: 0.01 };
        let ours = SolidRasterizer::new().render(&mesh, &place.camera(SIZE), &options);
        let psnr = metric::psnr(&ours.rgb, &RgbImage::load(&out(i)).unwrap().rgb, None);
        println!("three.js, {flags:?}, place {i}: {psnr:.1} dB");
        assert!(psnr > least_db, "place {i}: {psnr} dB");
    }
}

#[test]
fn textured_files_are_valid_gltf() {
    if !validator() {
        return;
    }
    let (folder, photos) = (TempDir::new().unwrap(), here("samples/dataset").display().to_string());
    let files: Vec<_> = [
        ("plain.glb", &[] as &[&str]),
        ("exact.glb", &["--set", "texture_format=png"]),
        ("small.glb", &["--target", "unity", "--preset", "small"]),
        ("beside.gltf", &["--target", "godot", "--backdrop", "sphere"]),
    ]
    .map(|(name, flags)| {
        let file = folder.path().join(name);
        let triangles =
            bake(&here("samples/soups/trained.ply"), &file, &[&textured(&photos)[..], flags].concat());
        (file, triangles)
    })
    .into();
    super::assert_valid(&files);
}

/// The validator does not know the extension, and so takes its picture for one of an unknown kind that nothing uses; it finds nothing else.
#[cfg(feature = "ktx2")]
#[test]
fn ktx2_files_are_valid_gltf_but_for_what_the_validator_does_not_know() {
    if !validator() {
        return;
    }
    let (folder, photos) = (TempDir::new().unwrap(), here("samples/dataset").display().to_string());
    // A small page, because a large one takes a quarter of a minute to compress.
    let small = ["--set", "texture_size=512", "--set", "texture_pages=1"];
    for (name, format) in [("etc1s.glb", "texture_format=ktx2"), ("uastc.gltf", "texture_format=ktx2-uastc")]
    {
        let file = folder.path().join(name);
        bake(
            &here("samples/soups/trained.ply"),
            &file,
            &[&textured(&photos)[..], &small, &["--set", format]].concat(),
        );
        let mut command = Command::new("node");
        let done = runs(command.arg(here("tests/validate.mjs")).arg(here("target/judges")).arg(&file));
        let found: Value = serde_json::from_slice(&done.stdout).expect("the script's answer");
        assert_eq!((&found["numErrors"], &found["numWarnings"]), (&json!(0), &json!(2)), "{found}");
        let codes = found["first"].as_array().unwrap().iter().filter_map(Value::as_str);
        let codes: Vec<&str> = codes.filter_map(|said| said.split(' ').next()).collect();
        assert_eq!(codes, ["UNSUPPORTED_EXTENSION", "VALUE_NOT_IN_LIST", "UNUSED_OBJECT"], "{found}");
    }
}

/// Why KTX2 is refused for Godot: its importer makes colours linear, and its material reads them as sRGB.
#[cfg(feature = "ktx2")]
#[test]
fn godot4_imports_ktx2_too_dark() {
    let godot4 = here("target/judges/godot4");
    if !have("godot4", godot4.exists()) {
        return;
    }
    let photos = here("samples/dataset").display().to_string();
    for format in ["ktx2", "ktx2-uastc"] {
        let folder = TempDir::new().unwrap();
        std::fs::copy(here("tests/godot4/project.godot"), folder.path().join("project.godot")).unwrap();
        let (set, scene) = (format!("texture_format={format}"), folder.path().join("scene.glb"));
        let flags = ["--set", &set];
        bake(&here("samples/soups/trained.ply"), &scene, &[&textured(&photos)[..], &flags].concat());
        let read = formats::read(&scene, &ReadOptions::default()).unwrap();
        let Scene::Mesh(mesh) = read.scene else { panic!("a mesh") };
        let page = mesh.texture.unwrap().pages[0].clone();
        let said = super::engines::run_script(&godot4, folder.path(), "texture.gd");
        let said: Value = said.lines().find_map(|line| serde_json::from_str(line).ok()).expect("the answer");
        println!("{format}: {said}");
        assert_eq!(said["size"], json!(page.size().to_array()));
        assert_eq!(said["mipmaps"], json!(true));
        let linear = |code: u8| (color::linear_of_srgb8()[usize::from(code)] * 255.0).round() as u8;
        let wants: Vec<[u8; 3]> = page.level(4).rgb.iter().map(|rgb| rgb.map(linear)).collect();
        let got = |i: usize, c: usize| said["level4"][3 * i + c].as_u64().expect("a code") as u8;
        let got: Vec<[u8; 3]> = (0..wants.len()).map(|i| [0, 1, 2].map(|c| got(i, c))).collect();
        let psnr = metric::psnr(&got, &wants, None);
        println!("{format}: level 4 {psnr:.1} dB");
        assert!(psnr > AGREE_KTX2_DB, "{format}: {psnr}");
    }
}
