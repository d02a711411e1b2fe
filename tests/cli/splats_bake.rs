//! Gaussian splats become triangles: a ball of Gaussians, judged from places that no picture was
//! drawn from.

use super::{fails, stderr};
use glam::Vec3;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::metric;

/// Width and height of pictures, px.
const SIDE: u32 = 144;
/// Minimum dB of the ball's pictures: of a bake from chosen places (the ball among floaters), from
/// listed cameras, and of a surface, which ends sharply where the ball fades. With corners that
/// move almost three times as far they have 24.6, 28.9 and 21.4.
const FLOORS: [f64; 3] = [25.0, 30.5, 22.0];

/// Directions spread over the sphere.
fn direction(i: usize, count: usize) -> Vec3 {
    let y = 1.0 - 2.0 * (i as f32 + 0.5) / count as f32;
    let (sin, cos) = (i as f32 * 2.399_963).sin_cos();
    let radius = (1.0 - y * y).sqrt();
    Vec3::new(radius * cos, y, radius * sin)
}

/// A ball of flat Gaussians in eight patches of colour.
fn ball(folder: &Path) -> PathBuf {
    floating(folder, "ball.ply", 0)
}

/// The same with some Gaussians that float 4 to 20 radii away.
fn floating(folder: &Path, name: &str, floaters: usize) -> PathBuf {
    let names =
        "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let count = 2500;
    let mut ply = format!("ply\nformat ascii 1.0\nelement vertex {}\n", count + floaters);
    names.split(' ').for_each(|name| writeln!(ply, "property float {name}").unwrap());
    ply += "end_header\n";
    for i in 0..count {
        let p = direction(i, count);
        let patch = [p.x > 0.0, p.y > 0.0, p.z > 0.0].map(|side| if side { 0.9 } else { -0.9 });
        let turn = glam::Quat::from_rotation_arc(Vec3::Z, p);
        let [r, g, b] = patch;
        let [x, y, z, w] = turn.to_array();
        // Standard deviations of 0.045, and of 0.003 outwards.
        writeln!(ply, "{} {} {} {r} {g} {b} 4 -3.1 -3.1 -5.8 {w} {x} {y} {z}", p.x, p.y, p.z)
            .unwrap();
    }
    for i in 0..floaters {
        let p = direction(i, floaters) * (4.0 + 16.0 * i as f32 / floaters as f32);
        writeln!(ply, "{} {} {} 1 1 1 4 -3.1 -3.1 -3.1 1 0 0 0", p.x, p.y, p.z).unwrap();
    }
    let path = folder.join(name);
    std::fs::write(&path, ply).unwrap();
    path
}

/// A list of cameras that look at the middle from `count` directions, turned by `turn`.
pub(super) fn cameras(path: &Path, count: usize, turn: f32) {
    let one = |i: usize| {
        let eye = glam::Quat::from_rotation_x(turn) * direction(i, count) * 4.0;
        let ahead = -eye.normalize();
        let right = ahead.cross(Vec3::new(0.1, 1.0, 0.2)).normalize();
        let down = ahead.cross(right);
        let row = |k: usize| [right[k], down[k], ahead[k]];
        serde_json::json!({
            "img_name": format!("view_{i:02}.png"), "width": SIDE, "height": SIDE, "position": eye.to_array(),
            "rotation": [row(0), row(1), row(2)], "fx": 240.0, "fy": 240.0,
        })
    };
    let list: Vec<_> = (0..count).map(one).collect();
    std::fs::write(path, serde_json::to_string(&list).unwrap()).unwrap();
}

fn run(folder: &Path, threads: u32, arguments: &[&str]) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    let done = command
        .current_dir(folder)
        .env("RAYON_NUM_THREADS", threads.to_string())
        .args(arguments)
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", stderr(&done));
}

/// Pictures of `file` over a background from the cameras of `held.json`.
fn pictures(folder: &Path, file: &str, background: &str) -> Vec<RgbImage> {
    run(
        folder,
        2,
        &[
            "render",
            file,
            "--cameras",
            "held.json",
            "--background",
            background,
            "-o",
            "pictures",
            "-f",
        ],
    );
    (0..6)
        .map(|i| RgbImage::load(&folder.join(format!("pictures/view_{i:02}.png"))).unwrap())
        .collect()
}

/// Fails where `file` does not look like the ball over black and over white.
fn looks_like_the_ball(folder: &Path, file: &str, floor: f64) {
    for background in ["black", "white"] {
        let wanted = pictures(folder, "ball.ply", background);
        let found = pictures(folder, file, background);
        let score = |(a, b): (&RgbImage, &RgbImage)| metric::psnr(&a.rgb, &b.rgb, None);
        let mean = wanted.iter().zip(&found).map(score).sum::<f64>() / wanted.len() as f64;
        assert!(mean > floor, "{file} over {background}: {mean:.2} dB");
    }
}

#[test]
fn gaussian_ball_bakes_to_a_triangle_ball_over_any_background() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    ball(folder);
    cameras(&folder.join("held.json"), 6, 0.7);
    let bake = ["bake", "ball.ply", "--preset", "fast", "--max-triangles", "3000", "-f", "-o"];
    cameras(&folder.join("ball.cameras.json"), 24, 0.0);
    run(folder, 2, &[&bake[..], &["listed.glb", "--report", "report.json"]].concat());
    // Few steps tell as well whether threads change a bit.
    for (threads, file) in [(1, "one.glb"), (3, "three.glb")] {
        run(folder, threads, &[&bake[..], &[file, "--harden=50"]].concat());
    }
    looks_like_the_ball(folder, "listed.glb", FLOORS[1]);
    run(
        folder,
        2,
        &["mesh", "ball.ply", "--texture", "--max-triangles", "2000", "-o", "surface.glb"],
    );
    looks_like_the_ball(folder, "surface.glb", FLOORS[2]);
    let [one, three] =
        ["one.glb", "three.glb"].map(|file| std::fs::read(folder.join(file)).unwrap());
    assert!(one == three, "the same bytes for any number of threads");
    let report = std::fs::read_to_string(folder.join("report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    assert_eq!(report["stages"][0]["name"], "train");
    assert!(report["stages"][0]["after"]["triangles"].as_u64().unwrap() <= 3000);
}

#[test]
fn what_floats_around_a_ball_changes_nothing_but_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    ball(folder);
    floating(folder, "floating.ply", 75);
    cameras(&folder.join("held.json"), 6, 0.7);
    let bake = ["--preset", "fast", "--max-triangles", "3000", "-f", "--report", "report.json"];
    run(folder, 2, &[&["bake", "floating.ply", "-o", "floating.glb"], &bake[..]].concat());
    let report = std::fs::read_to_string(folder.join("report.json")).unwrap();
    assert!(report.contains("75 of 2575 splats float alone"), "{report}");
    looks_like_the_ball(folder, "floating.glb", FLOORS[0]);
}

/// A floor under the ball, which no picture of the Gaussians shows.
#[test]
fn mesh_beside_gaussians_stays_as_given() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    ball(folder);
    let floor = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
                 property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
                 property list uchar int vertex_indices\nend_header\n-3 1.5 -3 9 200 9\n3 1.5 -3 9 200 9\n\
                 3 1.5 3 9 200 9\n-3 1.5 3 9 200 9\n4 0 1 2 3\n";
    std::fs::write(folder.join("floor.ply"), floor).unwrap();
    let bake = ["bake", "ball.ply", "floor.ply", "-o", "both.obj", "--up=-y", "--harden=50"];
    run(folder, 2, &[&bake[..], &["--preset", "fast", "--max-triangles", "1000"]].concat());
    let text = std::fs::read_to_string(folder.join("both.obj")).unwrap();
    let green = |line: &&str| {
        let numbers: Vec<f32> = line.split(' ').skip(1).filter_map(|w| w.parse().ok()).collect();
        line.starts_with("v ") && numbers.len() == 6 && numbers[4] > 5.0 * numbers[3]
    };
    let corners: Vec<&str> = text.lines().filter(green).collect();
    assert!(corners.len() >= 4, "{corners:?}");
    assert!(text.lines().filter(|line| line.starts_with("f ")).count() > 200);
}

#[test]
fn gaussians_that_cannot_be_baked_say_why() {
    let folder = tempfile::tempdir().unwrap();
    let file = ball(folder.path());
    let glb = folder.path().join("a.glb");
    fails(
        folder.path(),
        &[&"bake", &file, &file, &"-o", &glb],
        &["ball.ply", "like an input before it", "merge"],
    );
    // Nothing is seen of Gaussians that are points.
    let text = std::fs::read_to_string(&file).unwrap().replace(" -3.1 -3.1 -5.8 ", " -99 -99 -99 ");
    std::fs::write(&file, text).unwrap();
    fails(folder.path(), &[&"bake", &file, &"-o", &glb], &["ball.ply", "dataset", "cameras.json"]);
}

/// Rods of 1:50 cover little of any picture; a lone one has no neighbours that tell how large it
/// is.
#[test]
fn thin_rods_alone_are_baked() {
    let folder = tempfile::tempdir().unwrap();
    let names =
        "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    for (count, least) in [(60, 2000), (1, 1500)] {
        let mut ply = format!("ply\nformat ascii 1.0\nelement vertex {count}\n");
        names.split(' ').for_each(|name| writeln!(ply, "property float {name}").unwrap());
        ply += "end_header\n";
        for i in 0..count {
            let p = direction(i, 60) * (0.3 + 0.01 * i as f32);
            let [x, y, z, w] =
                glam::Quat::from_rotation_arc(Vec3::X, direction(59 - i, 60)).to_array();
            // Standard deviations of 0.2 and 0.004.
            writeln!(ply, "{} {} {} 1 0 0 6 -1.6 -5.5 -5.5 {w} {x} {y} {z}", p.x, p.y, p.z)
                .unwrap();
        }
        std::fs::write(folder.path().join("rods.ply"), ply).unwrap();
        let bake = [
            "bake",
            "rods.ply",
            "-o",
            "rods.glb",
            "--preset",
            "fast",
            "--max-triangles",
            "300",
            "--force",
        ];
        run(folder.path(), 2, &bake);
        assert!(
            std::fs::metadata(folder.path().join("rods.glb")).unwrap().len() > least,
            "{count}"
        );
    }
}
