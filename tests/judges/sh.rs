//! Files with view-dependent colours, read by others: the validator, and the decoder in Python that
//! docs/formats.md names.

use super::{assert_valid, bake, here, python, runs, validator};
use glam::Vec3;
use std::path::{Path, PathBuf};
use tempfile::TempDir;
use trisplat_formats::{self as formats, ReadOptions};
use trisplat_raster::solid::view_colors;
use trisplat_scene::Scene;
use trisplat_scene::math::color::srgb_from_linear;
use trisplat_scene::mesh::Colors;

/// A file with harmonics of degree 2, and its number of triangles.
fn shiny(folder: &Path, name: &str) -> (PathBuf, u64) {
    let scene = folder.join(name);
    let photos = here("samples/dataset").display().to_string();
    let flags = ["--dataset", &photos, "--sh", "2"];
    let triangles = bake(&here("samples/soups/trained.ply"), &scene, &flags);
    (scene, triangles)
}

#[test]
fn validator_is_silent_about_harmonics() {
    if !validator() {
        return;
    }
    let folder = TempDir::new().unwrap();
    assert_valid(&[shiny(folder.path(), "scene.glb"), shiny(folder.path(), "scene.gltf")]);
}

#[test]
fn python_decodes_harmonics_as_we_do() {
    let Some(mut decoder) = python("PIL") else { return };
    let folder = TempDir::new().unwrap();
    let (scene, _) = shiny(folder.path(), "scene.glb");
    let eye = Vec3::new(0.7, 1.1, 3.2);
    decoder.arg(here("samples/decode_sh.py")).arg(&scene);
    let done = runs(decoder.args(eye.to_array().map(|x| x.to_string())));
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));

    let loaded = formats::read(&scene, &ReadOptions::default()).unwrap();
    let Scene::Mesh(mesh) = loaded.scene else { panic!("baked files hold meshes") };
    let Some(Colors::Vertex(ours)) = view_colors(&mesh, eye) else { panic!("no harmonics") };
    let theirs = String::from_utf8(done.stdout).unwrap();
    assert!(theirs.lines().count() > 1000);
    for (line, ours) in theirs.lines().zip(&ours) {
        let numbers: Vec<f32> = line.split(' ').map(|word| word.parse().unwrap()).collect();
        for c in 0..3 {
            let apart = (numbers[1 + c] - srgb_from_linear(ours[c])).abs();
            assert!(apart < 1e-4, "{line}: {ours:?}");
        }
    }
}
