//! `--backdrop sky` by pixels: where the scene leaves a picture free, the page and the samples for
//! engines show the panorama's pixel of that direction.

use super::browser::{chromium, fragment, mesh, visit};
use super::editors::{compile_for_unity, has_mcs};
use super::engines::{open_page_sample, page_sample_judges, run_script, sample_of};
use super::{bake, have, here, runs};
use glam::{Mat3, UVec2, Vec2, Vec3};
use serde_json::{Value, json};
use std::f32::consts::{PI, TAU};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;
use trisplat_formats::{ReadOptions, ply, read};
use trisplat_raster::solid::{NO_FACE, SolidRasterOptions, SolidRasterizer};
use trisplat_scene::{Scene, camera::Camera, image::RgbImage, sh0_from_rgb};

const SIZE: UVec2 = UVec2::new(320, 240);
/// From top to bottom, degrees.
const FOV: f32 = 70.0;
const FLAGS: [&str; 2] = ["--backdrop", "sky"];
/// Largest mean difference of a view, codes: the engine's filter, and what it encodes.
const NEAR: f64 = 5.0;
/// By how much every wrong panorama is farther off, codes.
const WORSE: f64 = 10.0;

/// The trained sample, its shell in colours that tell all directions apart: its own are those of a
/// sky, the same on all sides.
fn surrounded(folder: &Path) -> PathBuf {
    let loaded = read(&here("samples/soups/trained.ply"), &ReadOptions::with_degree(0)).unwrap();
    let Scene::Soup(mut soup) = loaded.scene else { panic!("the sample is a soup") };
    for i in (0..soup.len()).filter(|i| soup.is_shell(*i)).collect::<Vec<_>>() {
        let d = soup.vertices[i].iter().sum::<Vec3>().normalize();
        soup.sh[i] = [0.5 + 0.35 * d.x, 0.5 - 0.35 * d.y, 0.5 + 0.35 * d.z].map(sh0_from_rgb);
    }
    let path = folder.join("surrounded.ply");
    let mut bytes = Vec::new();
    ply::write_soup(&mut bytes, &soup, &loaded.provenance, &loaded.cameras).unwrap();
    fs::write(&path, bytes).unwrap();
    path
}

/// A picture that should show a panorama wherever no face is.
struct View {
    camera: Camera,
    eye: Vec3,
    target: Vec3,
    /// The direction of each pixel that is free, as are those beside it.
    free: Vec<(usize, Vec3)>,
}

/// Views from the first viewpoint of a baked file: level ones all around, and one upwards.
fn views(scene: &Path) -> Vec<View> {
    let (mesh, provenance) = mesh(scene);
    assert_eq!(provenance.backdrop_faces, 0, "the scene alone");
    let eye = provenance.viewpoint.unwrap().eye.map(|x| x as f32).into();
    let level = (0..5).map(|i| Vec3::new((1.3 * i as f32).cos(), 0.0, (1.3 * i as f32).sin()));
    let focal = Vec2::splat(0.5 * SIZE.y as f32 / (0.5 * FOV.to_radians()).tan());
    let center = 0.5 * SIZE.as_vec2();
    let lens =
        Camera { rotation: Mat3::IDENTITY, translation: Vec3::ZERO, focal, center, size: SIZE };
    let mut rasterizer = SolidRasterizer::new();
    let view = |ahead: Vec3| {
        let target = eye + ahead;
        let camera = lens.with_look_at(eye, target, Vec3::Y);
        let options = SolidRasterOptions { near: 0.001, ..SolidRasterOptions::default() };
        let free = free(&rasterizer.visibility(&mesh, &camera, &options).face);
        let free =
            free.into_iter().map(|pixel| (pixel, direction(&camera, pixel))).collect::<Vec<_>>();
        assert!(free.len() > 2000, "{} free pixels ahead of {ahead}", free.len());
        View { camera, eye, target, free }
    };
    level.chain([Vec3::new(0.4, 0.8, 0.3)]).map(view).collect()
}

/// Pixels of no face that only such pixels surround: what a renderer does at edges is its own
/// affair.
fn free(faces: &[u32]) -> Vec<usize> {
    let width = SIZE.x as usize;
    let height = SIZE.y as usize;
    let inner = (1..height - 1).flat_map(|y| (1..width - 1).map(move |x| y * width + x));
    let around =
        |at: usize| [at - width, at, at + width].into_iter().flat_map(|at| at - 1..=at + 1);
    inner.filter(|at| around(*at).all(|at| faces[at] == NO_FACE)).collect()
}

/// The direction of a pixel's middle, in the world.
fn direction(camera: &Camera, pixel: usize) -> Vec3 {
    let at = UVec2::new(pixel as u32 % SIZE.x, pixel as u32 / SIZE.x).as_vec2() + 0.5;
    let across = (at - camera.center) / camera.focal;
    (camera.rotation.transpose() * across.extend(1.0)).normalize()
}

/// Where a panorama shows a direction of the file, in shares of its sides: the middle is +X, a
/// quarter from the left -Z.
fn place_in_panorama(d: Vec3) -> Vec2 {
    Vec2::new(0.5 + d.z.atan2(d.x) / TAU, d.y.clamp(-1.0, 1.0).acos() / PI)
}

/// The codes of a panorama in a direction, between its four nearest pixels; its sides touch.
fn seen(sky: &RgbImage, d: Vec3) -> Vec3 {
    let at = place_in_panorama(d) * sky.size.as_vec2() - 0.5;
    let corner = at.floor();
    let share = at - at.floor();
    let code = |x: f32, y: f32| {
        let x = (corner.x + x).rem_euclid(sky.size.x as f32) as usize;
        let y = (corner.y + y).clamp(0.0, sky.size.y as f32 - 1.0) as usize;
        Vec3::from(sky.rgb[y * sky.size.x as usize + x].map(f32::from))
    };
    let row = |y: f32| code(0.0, y).lerp(code(1.0, y), share.x);
    row(0.0).lerp(row(1.0), share.y)
}

/// Where a picture has what belongs into a direction.
type Turn = fn(Vec3) -> Vec3;

/// Ways to show a panorama wrongly.
const WRONG: [(&str, Turn); 6] = [
    ("mirrored in z", |d| Vec3::new(d.x, d.y, -d.z)),
    ("mirrored in x", |d| Vec3::new(-d.x, d.y, d.z)),
    ("turned by 90°", |d| Vec3::new(d.z, d.y, -d.x)),
    ("turned by -90°", |d| Vec3::new(-d.z, d.y, d.x)),
    ("turned by 180°", |d| Vec3::new(-d.x, d.y, -d.z)),
    ("upside down", |d| Vec3::new(d.x, -d.y, d.z)),
];

/// The mean difference of the free pixels of each picture from a panorama that is turned in some
/// way, codes.
fn off(views: &[View], pictures: &[RgbImage], sky: &RgbImage, turn: Turn) -> Vec<f64> {
    let of_one = |(view, picture): (&View, &RgbImage)| {
        let differences = view.free.iter().map(|(pixel, d)| {
            let shown = Vec3::from(picture.rgb[*pixel].map(f32::from));
            f64::from((shown - seen(sky, turn(*d))).abs().element_sum() / 3.0)
        });
        differences.sum::<f64>() / view.free.len() as f64
    };
    views.iter().zip(pictures).map(of_one).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Asserts that a picture of each view, `0.png` and so on in a folder, shows the panorama behind
/// the scene, and shows it in no wrong way.
fn assert_sky_is_seen(who: &str, views: &[View], pictures: &Path, sky: &Path) {
    let sky = RgbImage::load(sky).unwrap();
    let load = |i: usize| RgbImage::load(&pictures.join(picture_name(i))).unwrap();
    let pictures: Vec<RgbImage> = (0..views.len()).map(load).collect();
    assert!(pictures.iter().all(|picture| picture.size == SIZE), "{who}");
    let right = off(views, &pictures, &sky, |d| d);
    println!("{who}: {right:.2?} codes off");
    assert!(right.iter().all(|off| *off < NEAR), "{who}: {right:.2?} codes off");
    for (how, turn) in WRONG {
        let wrong = mean(&off(views, &pictures, &sky, turn));
        println!("{who}: {wrong:.2} codes from a panorama that is {how}");
        assert!(
            wrong > mean(&right) + WORSE,
            "{who}: {wrong:.2} codes from a panorama that is {how}"
        );
    }
}

fn picture_name(view: usize) -> String {
    format!("{view}.png")
}

/// The views as `tests/judges/sample.mjs` and `tests/judges/godot4/sky.gd` read them, with pictures in a folder.
fn write_views(path: &Path, views: &[View], pictures: &Path) {
    let list = views.iter().enumerate().map(|(i, view)| {
        let out = pictures.join(picture_name(i));
        json!({ "size": SIZE.to_array(), "fov": FOV, "eye": view.eye.to_array(), "target": view.target.to_array(), "out": out })
    });
    fs::write(path, Value::from_iter(list).to_string()).unwrap();
}

#[test]
fn a_page_shows_the_panorama_behind_the_scene() {
    let Some(chromium) = chromium() else { return };
    let folder = TempDir::new().unwrap();
    let at = |name: &str| folder.path().join(name);
    let source = surrounded(folder.path());
    bake(&source, &at("a.glb"), &FLAGS);
    bake(&source, &at("a.html"), &FLAGS);
    let views = views(&at("a.glb"));
    let step = |(i, view): (usize, &View)| json!({ "show": fragment(&view.camera), "screenshot": at(&picture_name(i)) });
    let steps: Vec<Value> = views.iter().enumerate().map(step).collect();
    let page = json!({ "page": at("a.html"), "fragment": "#bare&ssaa=1&near=0.001", "size": SIZE.to_array(), "steps": steps });
    let visits = visit(&chromium, &json!([page]));
    assert_eq!(
        (&visits[0]["errors"], &visits[0]["state"]),
        (&json!([]), &json!("ready")),
        "{}",
        visits[0]
    );
    assert_sky_is_seen("page", &views, folder.path(), &at("a.sky.jpg"));
}

#[test]
fn the_page_sample_shows_the_panorama_beside_the_scene() {
    let Some(chromium) = page_sample_judges() else { return };
    let source = TempDir::new().unwrap();
    let folder = sample_of(
        &surrounded(source.path()),
        "three",
        &[&FLAGS[..], &["--target", "web"]].concat(),
    );
    let at = |name: &str| folder.path().join(name);
    let views = views(&at("scene.glb"));
    write_views(&at("views.json"), &views, folder.path());
    let said = open_page_sample(&chromium, folder.path(), Some(&at("views.json")));
    assert_eq!(said["errors"], json!([]), "{said}");
    assert_sky_is_seen("three.js", &views, folder.path(), &at("scene.sky.jpg"));
}

/// The sample for Godot with a sky, and the views of its scene.
fn godot_sample() -> (TempDir, Vec<View>) {
    let source = TempDir::new().unwrap();
    let flags = [&FLAGS[..], &["--target", "godot"]].concat();
    let folder = sample_of(&surrounded(source.path()), "godot4", &flags);
    let views = views(&folder.path().join("scene.glb"));
    (folder, views)
}

#[test]
fn godot_sample_has_the_panorama_as_its_sky() {
    let godot4 = here("target/judges/godot4");
    if !have("godot4", godot4.exists()) {
        return;
    }
    let (folder, _) = godot_sample();
    let sky = RgbImage::load(&folder.path().join("scene.sky.jpg")).unwrap().size.as_vec2();
    let said = run_script(&godot4, folder.path(), "sky.gd");
    let line = said.lines().find(|line| line.starts_with("sky "));
    assert_eq!(line, Some(format!("sky true {:.1} {:.1}", sky.x, sky.y).as_str()), "{said}");
    assert!(!said.contains("SCRIPT ERROR"), "{said}");
    // Without one its background is a colour, as before.
    let folder = sample_of(&here("samples/soups/trained.ply"), "godot4", &["--target", "godot"]);
    let said = run_script(&godot4, folder.path(), "sky.gd");
    assert!(said.contains("sky false") && !said.contains("SCRIPT ERROR"), "{said}");
}

#[test]
fn the_godot_sample_draws_the_panorama_behind_the_scene() {
    let judges = ["godot4", "godot4-screen"].map(|judge| here("target/judges").join(judge));
    if !have("godot4-screen", judges[1].exists()) {
        return;
    }
    let (folder, views) = godot_sample();
    let at = |name: &str| folder.path().join(name);
    write_views(&at("views.json"), &views, Path::new(""));
    fs::copy(here("tests/judges/godot4/sky.gd"), at("sky.gd")).unwrap();
    runs(Command::new(&judges[0]).arg(folder.path()).arg("--import"));
    let mut draw = Command::new(&judges[1]);
    draw.arg(folder.path()).args(["--rendering-method", "gl_compatibility", "--script", "sky.gd"]);
    let done = runs(draw.args(["--resolution", &format!("{}x{}", SIZE.x, SIZE.y)]));
    let said =
        [done.stdout, done.stderr].map(|said| String::from_utf8_lossy(&said).into_owned()).concat();
    assert!(!said.contains("ERROR"), "{said}");
    assert_sky_is_seen("Godot", &views, folder.path(), &at("scene.sky.jpg"));
}

/// Where Unity's shader Skybox/Panoramic, with latitudes and longitudes over 360°, reads its
/// picture for a direction of Unity's world. Its box turns by `rotation` degrees from +X to +Z, and
/// the picture runs the other way.
fn place_in_unity(d: Vec3, rotation: f32) -> Vec2 {
    let longitude = d.z.atan2(d.x) - rotation.to_radians();
    Vec2::new((0.5 - longitude / TAU).rem_euclid(1.0), d.y.clamp(-1.0, 1.0).acos() / PI)
}

/// Unity is not here; its shader's formula says which pixel it would show.
#[test]
fn unity_component_finds_the_panorama_and_turns_it() {
    if !has_mcs() {
        return;
    }
    let source = TempDir::new().unwrap();
    let flags = [&FLAGS[..], &["--target", "unity"]].concat();
    let folder = sample_of(&surrounded(source.path()), "unity", &flags);
    let at = |name: &str| folder.path().join(name);
    // Its copy needs more of Unity than stands in for it.
    fs::remove_file(at("scene.collision.glb")).unwrap();
    compile_for_unity(&at("sky.exe"), &[here("tests/judges/unity/sky.cs"), at("TrisplatScene.cs")]);
    let build = |scene: &str| {
        let done = runs(Command::new("mono").arg(at("sky.exe")).arg(at(scene)));
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        String::from_utf8_lossy(&done.stdout).into_owned()
    };
    let said = build("scene.glb");
    let picture = at("scene.sky.jpg");
    let lines = said.lines().collect::<Vec<_>>();
    let [shader, texture, rotation] = lines[..] else { panic!("{said}") };
    assert_eq!(
        (shader, texture),
        ("shader Skybox/Panoramic", format!("_MainTex {}", picture.display()).as_str())
    );
    let rotation: f32 = rotation.strip_prefix("_Rotation ").unwrap().parse().unwrap();
    for i in 0..200 {
        let d = Vec3::new((2.4 * i as f32).cos(), 0.02 * (i as f32 - 99.5), (2.4 * i as f32).sin())
            .normalize();
        // As importers of glTF place it, and tests/judges/unity/import.cs expects it.
        let reads = place_in_unity(Vec3::new(-d.x, d.y, d.z), rotation);
        let apart = (reads - place_in_panorama(d)).abs();
        assert!(apart.x.min(1.0 - apart.x) < 1e-4 && apart.y < 1e-4, "{d}: {reads}");
    }
    assert_eq!(build("other.glb"), "", "there is no picture beside it");
}
