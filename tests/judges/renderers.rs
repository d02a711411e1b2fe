//! One file in other renderers, from a data set's cameras: they must come as close to the photos as
//! trisplat's.
//!
//! Every renderer draws four times the width and height with one sample a pixel, and each 4 x 4
//! pixels are averaged in linear light here: equal sampling, whatever antialiasing a renderer has
//! of its own. `tests/judges/renderers.sh FILE DATASET` does the same for any file and data set and prints
//! the table.

use super::browser::{chromium, fragment, in_file, mesh, visit};
use super::{bake, here, python, runs_with, studio};
use glam::{UVec2, Vec3};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use tempfile::TempDir;
use trisplat_dataset::{Dataset, DatasetOptions, View};
use trisplat_raster::solid::{SolidRasterOptions, SolidRasterizer};
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::{linear_from_srgb, srgb_from_linear};
use trisplat_scene::math::metric;

/// Samples along an axis of a pixel.
const FINE: u32 = 4;
/// Depth of the near plane, for renderers that have the setting.
const NEAR: f32 = 0.01;
/// Background, sRGB codes.
const BACKGROUND: [u8; 3] = [0; 3];
/// Largest difference of PSNR against the photos, dB.
const AGREE_DB: f64 = 0.3;

/// What to draw: a file and the cameras in its frame.
struct Job {
    file: PathBuf,
    cameras: Vec<Camera>,
    folder: TempDir,
}

impl Job {
    fn picture(&self, renderer: &str, i: usize) -> PathBuf {
        self.folder.path().join(format!("{renderer}-{i}.png"))
    }

    /// The coarse pictures of a renderer's fine ones.
    fn coarse(&self, renderer: &str) -> Vec<RgbImage> {
        let load = |(i, camera): (usize, &Camera)| {
            let fine = RgbImage::load(&self.picture(renderer, i)).unwrap();
            averaged(&fine, camera.size)
        };
        self.cameras.iter().enumerate().map(load).collect()
    }
}

/// A picture of a fourth of the size, averaged in linear light.
pub(super) fn averaged(fine: &RgbImage, size: UVec2) -> RgbImage {
    assert_eq!(fine.size, size * FINE);
    let linear: Vec<f32> = (0..=255).map(|code| linear_from_srgb(code as f32 / 255.0)).collect();
    let pixel = |at: u32| {
        let x = at % size.x;
        let y = at / size.x;
        let mut sum = [0.0f32; 3];
        for dy in 0..FINE {
            for dx in 0..FINE {
                let row = (y * FINE + dy) * fine.size.x;
                let rgb = fine.rgb[(row + x * FINE + dx) as usize];
                (0..3).for_each(|c| sum[c] += linear[usize::from(rgb[c])]);
            }
        }
        sum.map(|s| (255.0 * srgb_from_linear(s / (FINE * FINE) as f32)).round() as u8)
    };
    RgbImage { size, rgb: (0..size.x * size.y).map(pixel).collect(), alpha: None }
}

/// three.js in Chromium, through trisplat's page.
fn three(job: &Job) -> Option<Vec<RgbImage>> {
    let chromium = chromium()?;
    let page = job.folder.path().join("scene.html");
    bake(&job.file, &page, &AS_IT_IS);
    let size = job.cameras[0].size * FINE;
    let step = |(i, c): (usize, &Camera)| json!({ "show": fragment(c), "screenshot": job.picture("three", i) });
    let steps: Vec<Value> = job.cameras.iter().enumerate().map(step).collect();
    let background = BACKGROUND.map(|code| format!("{code:02x}")).concat();
    let fragment = format!("#bare&ssaa=1&near={NEAR}&background={background}");
    let pages =
        json!([{ "page": page, "fragment": fragment, "size": [size.x, size.y], "steps": steps }]);
    let visits = visit(&chromium, &pages);
    assert_eq!(
        (&visits[0]["errors"], &visits[0]["state"]),
        (&json!([]), &json!("ready")),
        "{}",
        visits[0]
    );
    Some(job.coarse("three"))
}

/// f3d (VTK), through its Python module. It shows COLOR_0 as it is, so it gets a file with sRGB
/// codes.
fn f3d(job: &Job) -> Option<Vec<RgbImage>> {
    let mut command = python("f3d")?;
    let file = job.folder.path().join("codes.glb");
    bake(&job.file, &file, &[&AS_IT_IS[..], &["--target", "godot"]].concat());
    let size = job.cameras[0].size * FINE;
    let view = |(i, camera): (usize, &Camera)| {
        let middle = camera.center - camera.size.as_vec2() / 2.0;
        assert!(middle.length() < 1.0, "f3d has the principal point in the middle");
        // Pixels are square there: the mean of two focal lengths that hardly differ.
        let focal = (camera.focal.x * camera.focal.y).sqrt();
        let axes = camera.rotation.transpose();
        let position = camera.position();
        json!({
            "eye": position.to_array(),
            "target": (position + axes * Vec3::Z).to_array(),
            "up": (axes * Vec3::NEG_Y).to_array(),
            "fov": 2.0 * (camera.size.y as f32 / (2.0 * focal)).atan().to_degrees(),
            "out": job.picture("f3d", i),
        })
    };
    let views: Vec<Value> = job.cameras.iter().enumerate().map(view).collect();
    let background = BACKGROUND.map(|code| f32::from(code) / 255.0);
    let words =
        json!({ "file": file, "size": [size.x, size.y], "background": background, "views": views });
    let done =
        runs_with(command.arg(here("tests/judges/f3d_views.py")), words.to_string().as_bytes());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    Some(job.coarse("f3d"))
}

/// Flags under which a baked file is written again triangle by triangle.
const AS_IT_IS: [&str; 4] = ["--preset", "fast", "--set", "solid=none"];

/// The rasteriser that the numbers in docs/benchmarks come from.
fn ours(job: &Job) -> Vec<RgbImage> {
    let (mesh, _) = mesh(&job.file);
    let background = BACKGROUND.map(|code| f32::from(code) / 255.0);
    let options = SolidRasterOptions { background, samples: FINE, near: NEAR };
    let mut solid = SolidRasterizer::new();
    job.cameras.iter().map(|camera| solid.render(&mesh, camera, &options)).collect()
}

/// Draws `file` with all renderers that are there; prints one row each and asserts that they agree.
fn compare(file: &Path, dataset: &Path, keep: Option<&Path>, square: bool) {
    let dataset = Dataset::load(dataset, &DatasetOptions::default()).unwrap();
    let provenance = mesh(file).1;
    let views: Vec<&View> = dataset.test().collect();
    let camera = |view: &&View| {
        let camera = in_file(&view.camera, dataset.origin, &provenance);
        // The sample's principal point is not in the middle, which f3d does not support.
        let middle = camera.size.as_vec2() / 2.0;
        if square { Camera { center: middle, ..camera } } else { camera }
    };
    let job = Job {
        file: file.to_owned(),
        cameras: views.iter().map(camera).collect(),
        folder: TempDir::new().unwrap(),
    };
    let truth = ours(&job);
    let photos: Vec<RgbImage> = if square {
        truth.clone()
    } else {
        views
            .iter()
            .map(|view| RgbImage::load(&view.photo.path).unwrap().over(BACKGROUND))
            .collect()
    };
    let mean = |pictures: &[RgbImage], wanted: &[RgbImage]| {
        let psnr =
            pictures.iter().zip(wanted).map(|(a, b)| metric::psnr(&a.rgb, &b.rgb, None).min(99.0));
        psnr.sum::<f64>() / pictures.len() as f64
    };
    let head = if square { "" } else { "PSNR against photos, dB" };
    println!("| renderer | {head} | PSNR against trisplat, dB |\n|---|---|---|");
    let own = mean(&truth, &photos);
    println!("| trisplat, solid on the CPU | {own:.3} | |");
    // f3d has a 24-bit depth buffer: more of the sample's coplanar triangles are ordered
    // differently.
    let others = [("three.js in Chromium", three(&job), 40.0), ("f3d (VTK)", f3d(&job), 33.0)];
    for (name, pictures, close_db) in others {
        let Some(pictures) = pictures else { continue };
        let psnr = mean(&pictures, &photos);
        let to_ours = mean(&pictures, &truth);
        println!("| {name} | {psnr:.3} | {to_ours:.2} |");
        for (i, picture) in pictures.iter().enumerate().filter(|_| keep.is_some()) {
            let at = |who: &str| keep.unwrap_or(Path::new("")).join(format!("{i:02}-{who}.png"));
            picture.save_png(at(name.split([' ', '.']).next().unwrap_or(name))).unwrap();
            truth[i].save_png(at("ours")).unwrap();
        }
        if square {
            assert!(to_ours >= close_db, "{name}: {to_ours:.2} dB from ours");
        } else {
            assert!((psnr - own).abs() <= AGREE_DB, "{name}: {psnr:.3} dB, ours {own:.3} dB");
        }
    }
}

#[test]
fn outside_renderers_draw_the_studio_as_we_do() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("scene.glb");
    bake(&studio(), &file, &["--set", "chunk_triangles=3000"]);
    compare(&file, &here("samples/dataset"), None, true);
}

/// What `tests/judges/renderers.sh` runs.
#[test]
fn outside_renderers_agree_on_the_photos() {
    let (Some(file), Some(dataset)) =
        (std::env::var_os("TRISPLAT_FILE"), std::env::var_os("TRISPLAT_DATASET"))
    else {
        trisplat_fixtures::skip::skipped(
            "no TRISPLAT_FILE and TRISPLAT_DATASET: tests/judges/renderers.sh gives them",
        );
        return;
    };
    let keep = std::env::var_os("TRISPLAT_KEEP").map(PathBuf::from);
    compare(Path::new(&file), Path::new(&dataset), keep.as_deref(), false);
}
