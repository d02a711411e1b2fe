//! Photos of the town by a drone and a pedestrian, in a data set with exact poses.

use super::town::{PITCH, half_side, town};
use glam::{Mat3, UVec2, Vec2, Vec3, vec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::io::Write;
use std::path::Path;
use trisplat_formats::ply;
use trisplat_raster::solid::{NO_FACE, SolidRasterOptions, SolidRasterizer};
use trisplat_scene::{
    Asset, Error, Provenance, Result, Rng, UpAxis,
    atomic::AtomicFile,
    camera::Camera,
    math::color::srgb_from_linear,
    mesh::{Colors, Mesh},
};

/// What to make.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", command(next_help_heading = "Town"))]
pub struct TownOptions {
    /// Photos: two of three by a drone above the roofs, the others from the streets.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..=100_000)))]
    pub views: u32,
    /// Width of a photo, px; the height is three quarters of it.
    #[cfg_attr(feature = "cli", arg(long, value_name = "PX", default_value_t = 320, value_parser = clap::value_parser!(u32).range(16..=4096)))]
    pub width: u32,
    /// Lots along each side of the town, 20 m each.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=64)))]
    pub lots: u32,
    /// Points of the sparse cloud.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = 8000, value_parser = clap::value_parser!(u32).range(0..=10_000_000)))]
    pub points: u32,
    /// Seed of the houses, the flight and the points.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = 0))]
    pub seed: u64,
}

impl Default for TownOptions {
    fn default() -> Self {
        Self { views: 300, width: 320, lots: 8, points: 8000, seed: 0 }
    }
}

/// Samples per pixel along each axis of the photos.
const SAMPLES: u32 = 4;

/// Writes the data set: `images/`, `transforms.json`, `points.ply`, `test.txt` with every 8th photo, and `truth.ply`, the town itself.
///
/// Errors: those of the operating system.
pub fn write(folder: &Path, options: &TownOptions) -> Result<()> {
    let images = folder.join("images");
    std::fs::create_dir_all(&images).map_err(|e| Error::io(&images, e))?;
    let mesh = town(options.lots, options.seed);
    let cameras: Vec<Camera> = (0..options.views).map(|i| camera(options, i)).collect();
    let drawing = SolidRasterOptions { background: [0.0; 3], samples: SAMPLES, near: 0.05 };
    let mut solid = SolidRasterizer::new();
    for (i, camera) in cameras.iter().enumerate() {
        solid.render(&mesh, camera, &drawing).save_png(images.join(photo_name(i)))?;
    }
    text(&folder.join("points.ply"), &points(&mesh, &cameras, options))?;
    let held_out: String = (0..cameras.len()).step_by(8).map(|i| photo_name(i) + "\n").collect();
    text(&folder.join("test.txt"), &held_out)?;
    write_truth(&folder.join("truth.ply"), mesh)?;
    let frames: Vec<_> = cameras.iter().enumerate().map(|(i, camera)| frame(i, camera)).collect();
    let transforms = json!({ "ply_file_path": "points.ply", "frames": frames });
    text(
        &folder.join("transforms.json"),
        &(serde_json::to_string_pretty(&transforms).unwrap_or_default() + "\n"),
    )
}

fn photo_name(index: usize) -> String {
    format!("view_{index:05}.png")
}

fn text(path: &Path, text: &str) -> Result<()> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(text.as_bytes()).map_err(|e| Error::io(path, e))?;
    file.commit().map(drop)
}

fn write_truth(path: &Path, mesh: Mesh) -> Result<()> {
    let provenance = Provenance {
        generator: Some(trisplat_scene::report::generator()),
        up: Some(UpAxis::Z),
        ..Provenance::default()
    };
    let mut file = AtomicFile::create(path)?;
    let asset = Asset { provenance, ..Asset::from(mesh) };
    ply::write_mesh(&mut file, &asset, true).map_err(|e| Error::io(path, e))?;
    file.commit().map(drop)
}

/// The camera of photo `index`.
pub fn camera(options: &TownOptions, index: u32) -> Camera {
    let rng = Rng::new(options.seed, "flight", u64::from(index));
    let half = half_side(options.lots);
    let size = UVec2::new(options.width, (options.width * 3 / 4).max(1));
    let lens = Camera {
        rotation: Mat3::IDENTITY,
        translation: Vec3::ZERO,
        focal: Vec2::splat(0.8 * options.width as f32),
        center: size.as_vec2() / 2.0,
        size,
    };
    let (eye, target) = if index % 3 == 2 {
        walk(&rng, half, options.lots)
    } else {
        flight(&rng, half, index, options.views)
    };
    lens.looking(eye, target, Vec3::Z)
}

/// Above the roofs, evenly over the town, looking down at an angle in any direction.
fn flight(rng: &Rng, half: f32, index: u32, views: u32) -> (Vec3, Vec3) {
    // A plastic-number sequence (Roberts 2018) covers a square evenly for every number of points.
    let along = |step: f64| ((0.5 + step * f64::from(index)) % 1.0) as f32;
    let (x, y) = (along(0.754_877_666_246_693), along(0.569_840_290_998_053));
    let turn = std::f32::consts::TAU * (rng.uniform(0) + index as f32 / views as f32);
    let eye = vec3((2.0 * x - 1.0) * half, (2.0 * y - 1.0) * half, 24.0 + 10.0 * rng.uniform(1));
    let reach = 16.0 + 14.0 * rng.uniform(2);
    (eye, vec3(eye.x + reach * turn.cos(), eye.y + reach * turn.sin(), 3.0))
}

/// In the middle of a street, looking along it and a little up.
fn walk(rng: &Rng, half: f32, lots: u32) -> (Vec3, Vec3) {
    let street = PITCH * (rng.bits(0) % u64::from(lots + 1)) as f32 - half;
    let along = (2.0 * rng.uniform(1) - 1.0) * half;
    let sign = if along > 0.0 { -1.0 } else { 1.0 };
    let aside = 3.0 * (rng.uniform(2) - 0.5);
    let (eye, ahead) = (
        vec3(along, street + aside, 1.8 + 2.0 * rng.uniform(3)),
        vec3(sign, 1.2 * (rng.uniform(4) - 0.5), 0.05),
    );
    let swap = |v: Vec3| if rng.bits(5).is_multiple_of(2) { v } else { vec3(v.y, v.x, v.z) };
    (swap(eye), swap(eye + 10.0 * ahead))
}

/// A frame of `transforms.json`: camera to world, OpenGL's axes.
fn frame(index: usize, camera: &Camera) -> serde_json::Value {
    let to_world = camera.rotation.as_dmat3().transpose();
    let eye = -(to_world * camera.translation.as_dvec3());
    let columns = [to_world.x_axis, -to_world.y_axis, -to_world.z_axis, eye];
    let row = |r: usize| columns.map(|column| column[r]);
    json!({
        "file_path": format!("images/{}", photo_name(index)),
        "w": camera.size.x, "h": camera.size.y,
        "fl_x": camera.focal.x, "fl_y": camera.focal.y,
        "cx": camera.center.x, "cy": camera.center.y,
        "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
    })
}

/// The cloud: surface points at some pixels of some photos, as PLY text.
fn points(mesh: &Mesh, cameras: &[Camera], options: &TownOptions) -> String {
    let drawing = SolidRasterOptions { samples: 1, near: 0.05, ..SolidRasterOptions::default() };
    let mut solid = SolidRasterizer::new();
    let mut rows = Vec::new();
    for (i, camera) in cameras.iter().enumerate() {
        let from = options.points as usize * i / cameras.len();
        let to = options.points as usize * (i + 1) / cameras.len();
        let seen = solid.visibility(mesh, camera, &drawing);
        for k in from..to {
            let rng = Rng::new(options.seed, "point", k as u64);
            rows.extend(point(mesh, camera, &seen.face, &seen.depth, rng));
        }
    }
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", rows.len());
    for property in ["float x", "float y", "float z", "uchar red", "uchar green", "uchar blue"] {
        text += &format!("property {property}\n");
    }
    text + "end_header\n" + &rows.concat()
}

/// The surface point at a random pixel, as a row; the sky has few points, as in a reconstruction.
fn point(mesh: &Mesh, camera: &Camera, faces: &[u32], depths: &[f32], rng: Rng) -> Option<String> {
    for attempt in 0..16 {
        let at = (rng.bits(2 * attempt) % faces.len() as u64) as usize;
        let (face, depth) = (faces[at], depths[at]);
        let far = depth > 60.0 && rng.uniform(2 * attempt + 1) > 0.1;
        if face == NO_FACE || far {
            continue;
        }
        let pixel =
            Vec2::new((at as u32 % camera.size.x) as f32 + 0.5, (at as u32 / camera.size.x) as f32 + 0.5);
        let seen = ((pixel - camera.center) / camera.focal * depth).extend(depth);
        let p = camera.rotation.transpose() * (seen - camera.translation);
        let Colors::Face(colors) = &mesh.colors else { return None };
        let [r, g, b] = colors[face as usize].map(|c| (255.0 * srgb_from_linear(c)).round() as u8);
        return Some(format!("{} {} {} {r} {g} {b}\n", p.x, p.y, p.z));
    }
    None
}
