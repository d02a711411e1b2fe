//! Files with view-dependent colours, read by others: the validator, the decoder in Python that
//! docs/formats.md names, the samples for Babylon.js, Blender and Godot, and programs that rewrite
//! files.

use super::browser::chromium;
use super::engines::{open_page_sample, sample};
use super::{assert_valid, bake, have, here, python, runs, validator};
use glam::{UVec2, Vec3};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;
use trisplat_formats::{self as formats, ReadOptions};
use trisplat_raster::solid::{SolidRasterOptions, SolidRasterizer, view_colors};
use trisplat_scene::Scene;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::srgb_from_linear;
use trisplat_scene::mesh::{Colors, Mesh};

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

/// Runs a program of the judges that turns `scene` into `out`.
fn rewrite(program: &str, words: &[&str], folder: &Path) {
    let program = here("target/judges/node_modules/.bin").join(program);
    let done = runs(Command::new(program).args(words).current_dir(folder));
    assert!(done.status.success(), "{words:?}: {}", String::from_utf8_lossy(&done.stderr));
}

/// Draws a file that was made of `scene` from its viewpoint, and compares.
fn assert_rewritten(scene: &Path, rewritten: &str) {
    let folder = scene.parent().unwrap();
    let read = |path: &Path| formats::read(path, &ReadOptions::default()).unwrap();
    let size = UVec2::new(480, 360);
    let camera = read(scene).provenance.viewpoint.unwrap().camera(size);
    let Scene::Mesh(mesh) = read(&folder.join(rewritten)).scene else { panic!("no mesh") };
    let options = SolidRasterOptions { samples: 4, ..SolidRasterOptions::default() };
    let drawn = SolidRasterizer::new().render(&mesh, &camera, &options);
    let picture = folder.join(rewritten).with_extension("png");
    drawn.save_png(&picture).unwrap();
    assert_drawn_as_we_do(scene, &picture, size);
}

#[test]
fn gltfpack_keeps_harmonics() {
    if !have("gltfpack", here("target/judges/node_modules/gltfpack").exists()) {
        return;
    }
    let folder = TempDir::new().unwrap();
    let (scene, _) = shiny(folder.path(), "scene.glb");
    let files = ["-i", "scene.glb", "-o", "packed.glb"];
    for flags in [&["-ke", "-noq", "-vc", "16"][..], &["-ke", "-vtf", "-vp", "16", "-cc"]] {
        rewrite("gltfpack", &[&files, flags].concat(), folder.path());
        assert_rewritten(&scene, "packed.glb");
    }
}

#[test]
fn gltf_transform_keeps_harmonics() {
    if !have("gltf-transform", here("target/judges/node_modules/@gltf-transform/cli").exists()) {
        return;
    }
    let folder = TempDir::new().unwrap();
    let (scene, _) = shiny(folder.path(), "scene.glb");
    rewrite("gltf-transform", &["optimize", "scene.glb", "optimized.glb"], folder.path());
    assert_rewritten(&scene, "optimized.glb");
}

/// Pictures of a scene by an engine, and of our renderer with harmonics and without, as a camera
/// at its viewpoint sees them.
fn assert_drawn_as_we_do(scene: &Path, picture: &Path, size: UVec2) {
    let loaded = formats::read(scene, &ReadOptions::default()).unwrap();
    let Scene::Mesh(mut mesh) = loaded.scene else { panic!("baked files hold meshes") };
    let camera = loaded.provenance.viewpoint.unwrap().camera(size);
    let draw = |mesh: &Mesh| {
        let options = SolidRasterOptions { samples: 4, ..SolidRasterOptions::default() };
        SolidRasterizer::new().render(mesh, &camera, &options).rgb
    };
    let shiny = draw(&mesh);
    mesh.sh = None;
    let plain = draw(&mesh);
    let theirs = RgbImage::load(picture).unwrap();
    assert_eq!(theirs.size, size);
    // Where neighbours are alike: samples and filters of edges differ.
    let width = size.x as usize;
    let apart =
        |a: [u8; 3], b: [u8; 3]| (0..3).map(|c| f64::from(a[c].abs_diff(b[c]))).sum::<f64>() / 3.0;
    let is_flat = |i: &usize| {
        let near = [i + 1, i + width, i.wrapping_sub(1), i.wrapping_sub(width)];
        near.iter().all(|k| plain.get(*k).is_some_and(|b| apart(plain[*i], *b) < 3.0))
    };
    let flat: Vec<usize> = (0..plain.len()).filter(is_flat).collect();
    let mean = |ours: &[[u8; 3]]| {
        flat.iter().map(|i| apart(ours[*i], theirs.rgb[*i])).sum::<f64>() / flat.len() as f64
    };
    let [with, without] = [mean(&shiny), mean(&plain)];
    println!("{}: {with:.2} of 255 from ours, {without:.2} from the plain ones", picture.display());
    assert!(with < 1.0 && with < 0.7 * without, "{with} with harmonics, {without} without");
}

/// Writes the view from a scene's viewpoint as the scripts of the samples read it.
fn write_view(path: &Path, scene: &Path, size: UVec2, picture: &Path) {
    let loaded = formats::read(scene, &ReadOptions::default()).unwrap();
    let viewpoint = loaded.provenance.viewpoint.unwrap();
    let view = json!([{ "size": size.to_array(), "fov": viewpoint.fov, "eye": viewpoint.eye, "target": viewpoint.target, "out": picture }]);
    std::fs::write(path, view.to_string()).unwrap();
}

#[test]
fn babylon_draws_harmonics_as_we_do() {
    let Some(chromium) = chromium() else { return };
    if !have("babylon", here("target/judges/node_modules/babylonjs").exists()) {
        return;
    }
    let folder = TempDir::new().unwrap();
    for name in ["index.html", "sh.js"] {
        let sample = here("samples/engines/babylon").join(name);
        std::fs::copy(sample, folder.path().join(name)).unwrap();
    }
    let (scene, _) = shiny(folder.path(), "scene.glb");
    let size = UVec2::new(480, 360);
    let picture = folder.path().join("babylon.png");
    let views = folder.path().join("views.json");
    write_view(&views, &scene, size, &picture);
    let said = open_page_sample(&chromium, folder.path(), Some(&views));
    assert_eq!(said["errors"], json!([]), "{said}");
    assert_drawn_as_we_do(&scene, &picture, size);
}

#[test]
fn blender_draws_harmonics_as_we_do() {
    let python = here("target/judges/venv/bin/python");
    let is_there = Command::new(&python).args(["-c", "import bpy"]).output();
    if !have("bpy", is_there.is_ok_and(|done| done.status.success())) {
        return;
    }
    let folder = TempDir::new().unwrap();
    let (scene, _) = shiny(folder.path(), "scene.glb");
    let size = UVec2::new(160, 120);
    let picture = folder.path().join("blender.png");
    let mut blender = Command::new(python);
    blender.arg(here("tests/judges/blender/view_colors.py")).arg(here("samples/engines/blender"));
    let done = runs(blender.args([&scene, &picture]).args(size.to_array().map(|x| x.to_string())));
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    assert_drawn_as_we_do(&scene, &picture, size);
}

#[test]
fn godot_draws_harmonics_as_we_do() {
    let judges = ["godot4", "godot4-screen"].map(|judge| here("target/judges").join(judge));
    if !have("godot4-screen", judges[1].exists()) {
        return;
    }
    let photos = here("samples/dataset").display().to_string();
    let folder = sample("godot4", &["--target", "godot", "--dataset", &photos, "--sh", "2"]);
    let at = |name: &str| folder.path().join(name);
    let mut import = std::fs::read_to_string(at("scene.glb.import")).unwrap();
    import += "\nimport_script/path=\"res://sh_import.gd\"\n";
    std::fs::write(at("scene.glb.import"), import).unwrap();
    let size = UVec2::new(480, 360);
    write_view(&at("views.json"), &at("scene.glb"), size, Path::new("picture.png"));
    std::fs::copy(here("tests/judges/godot4/sky.gd"), at("sky.gd")).unwrap();
    runs(Command::new(&judges[0]).arg(folder.path()).arg("--import"));
    for renderer in ["forward_plus", "gl_compatibility"] {
        let mut draw = Command::new(&judges[1]);
        draw.arg(folder.path()).args(["--rendering-method", renderer, "--script", "sky.gd"]);
        let done = runs(draw.args(["--resolution", &format!("{}x{}", size.x, size.y)]));
        let said = String::from_utf8_lossy(&done.stdout).into_owned();
        assert!(said.contains("sky false") && !said.contains("ERROR"), "{said}");
        assert_drawn_as_we_do(&at("scene.glb"), &at("picture.png"), size);
    }
}
