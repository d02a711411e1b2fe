//! Data sets: real photos, the sample, lenses and options.

mod broken;
mod depth;
mod exports;
mod masks;
mod models;
mod phone;
mod photogrammetry;
mod silhouettes;
mod transforms;
mod wide;

use glam::{DVec2, DVec3, UVec2, Vec2};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use trisplat_dataset::{
    Dataset, DatasetKind, DatasetOptions, Distortion, Lens, Masks, View, random_points,
};
use trisplat_fixtures::{root, sample};
use trisplat_scene::{Limits, camera::Camera, image::RgbImage, math::metric};
use trisplat_synthetic::{Ray, SyntheticOptions, trace};

type Scene = (&'static str, usize, usize, [u32; 2], Option<f64>);

/// Real scenes: name, photos, held out, the photo's size, and the mean reprojection error that
/// their makers measured, at this size, px.
const SCENES: [Scene; 6] = [
    ("banana", 15, 2, [640, 425], Some(0.657 * 640.0 / 3008.0)),
    // Only points with less than 1 px of error were kept.
    ("bonsai", 292, 37, [576, 384], None),
    ("brighton_beach", 18, 3, [640, 359], Some(0.784 * 640.0 / 4000.0)),
    ("dtu_scan24", 49, 7, [640, 480], Some(0.637 * 640.0 / 1600.0)),
    ("fox", 50, 7, [359, 640], Some(0.960 * 640.0 / 1920.0)),
    ("fox480", 50, 7, [270, 480], None),
];

fn load(path: &Path) -> Dataset {
    Dataset::load(path, &DatasetOptions::default()).unwrap()
}

fn real(name: &str) -> Option<PathBuf> {
    let path = root().join("../shared/data").join(name);
    if !path.is_dir() {
        trisplat_fixtures::skip::skipped(&format!("no ../shared/data/{name}"));
        return None;
    }
    Some(path)
}

fn assert_same_camera(a: &Camera, b: &Camera, context: &str) {
    assert_eq!(a.size, b.size, "{context}");
    assert!(a.rotation.abs_diff_eq(b.rotation, 1e-6), "{context}: {} {}", a.rotation, b.rotation);
    let reach = 1e-6 * (1.0 + a.position().length());
    assert!(
        a.position().abs_diff_eq(b.position(), reach),
        "{context}: {} {}",
        a.position(),
        b.position()
    );
    assert!(a.focal.abs_diff_eq(b.focal, 1e-3), "{context}: {} {}", a.focal, b.focal);
    assert!(a.center.abs_diff_eq(b.center, 1e-3), "{context}: {} {}", a.center, b.center);
}

fn assert_same_views(a: &Dataset, b: &Dataset) {
    assert_eq!(a.views.len(), b.views.len());
    for (a, b) in a.views.iter().zip(&b.views) {
        assert_eq!((&a.name, a.test), (&b.name, b.test));
        assert_same_camera(&a.camera, &b.camera, &a.name);
    }
}

fn project(camera: &Camera, point: glam::Vec3) -> Option<Vec2> {
    let v = camera.rotation * point + camera.translation;
    let q = camera.focal * v.truncate() / v.z + camera.center;
    (v.z > 0.0 && q.cmpge(Vec2::ZERO).all() && q.cmplt(camera.size.as_vec2()).all()).then_some(q)
}

fn copy_sample(to: &Path) {
    for folder in ["images", "sparse/0", ""] {
        std::fs::create_dir_all(to.join(folder)).unwrap();
        for entry in std::fs::read_dir(sample("dataset").join(folder)).unwrap() {
            let path = entry.unwrap().path();
            if path.is_file() {
                std::fs::copy(&path, to.join(folder).join(path.file_name().unwrap())).unwrap();
            }
        }
    }
}

fn error_of(path: &Path) -> String {
    match Dataset::load(path, &DatasetOptions::default()) {
        Ok(_) => panic!("{} was read", path.display()),
        Err(error) => error.to_string(),
    }
}

// ---- real photos

#[test]
fn colmap_and_transforms_give_the_same_cameras() {
    for (name, ..) in SCENES {
        let Some(path) = real(name) else { continue };
        assert_same_views(&load(&path), &load(&path.join("transforms.json")));
    }
}

#[test]
fn real_scenes_have_the_views_and_errors_their_makers_measured() {
    for (name, views, held_out, size, error) in SCENES {
        let Some(path) = real(name) else { continue };
        let dataset = load(&path);
        assert!(
            dataset.kind.to_string().starts_with("COLMAP"),
            "{name}: COLMAP goes before transforms.json"
        );
        assert_eq!((dataset.views.len(), dataset.test().count()), (views, held_out), "{name}");
        assert_eq!(dataset.warnings, [""; 0], "{name}");
        assert_eq!(dataset.origin, DVec3::ZERO, "{name}");
        let list = std::fs::read_to_string(path.join("test.txt")).unwrap();
        let names: Vec<&str> = dataset.test().map(|v| v.name.as_str()).collect();
        assert_eq!(names, list.lines().collect::<Vec<_>>(), "{name}");
        assert!(dataset.views.iter().all(|v| v.camera.size == UVec2::from(size)), "{name}");
        if let Some(want) = error {
            let measured = dataset.reprojection(&Limits::DEFAULT).unwrap().unwrap();
            assert_eq!(measured.behind, 0, "{name}");
            // The makers' figure is from before the photos were resized and some points dropped.
            assert!(
                (measured.mean_px / want - 1.0).abs() < 0.1,
                "{name}: {measured:?}, want {want}"
            );
        }
    }
}

#[test]
fn real_photos_show_the_points_where_the_cameras_say() {
    for (name, ..) in SCENES {
        let Some(path) = real(name) else { continue };
        let dataset = load(&path);
        let view = &dataset.views[dataset.views.len() / 2];
        let pixels = view.photo.decode().unwrap();
        let size = view.camera.size.as_vec2();
        // The same photo, mirrored, is the control: what a wrong axis would give.
        let mut straight = 0.0;
        let mut mirrored = 0.0;
        for point in &dataset.points {
            let Some(q) = project(&view.camera, point.position) else { continue };
            let at = |q: Vec2| pixels.rgb[q.y as usize * pixels.size.x as usize + q.x as usize];
            let off = |rgb: [u8; 3]| {
                (0..3).map(|c| f64::from(rgb[c].abs_diff(point.rgb[c]))).sum::<f64>()
            };
            straight += off(at(q));
            for other in [Vec2::new(size.x - q.x, q.y), Vec2::new(q.x, size.y - q.y)] {
                mirrored += 0.5 * off(at(other.min(size - 1.0)));
            }
        }
        assert!(straight < 0.8 * mirrored, "{name}: {straight} against {mirrored}");
    }
}

#[test]
fn masks_of_a_real_scene_are_found_and_used() {
    let Some(path) = real("dtu_scan24") else { return };
    let with = |masks| {
        let options = DatasetOptions { masks, ..DatasetOptions::default() };
        Dataset::load(&path, &options).unwrap().views[3].photo.decode().unwrap()
    };
    let ignore = with(Masks::Ignore);
    let cut = with(Masks::Cut);
    let off = with(Masks::Off);
    assert_eq!(off.alpha, None);
    assert_eq!(ignore.rgb, off.rgb);
    let weights = ignore.alpha.unwrap();
    assert!(weights.contains(&0) && weights.contains(&255));
    assert_eq!(
        cut.alpha.as_ref(),
        Some(&weights),
        "what the thing covers, for scores over any background"
    );
    for ((cut, whole), weight) in cut.rgb.iter().zip(&off.rgb).zip(&weights) {
        match weight {
            0 => assert_eq!(*cut, [0; 3]),
            255 => assert_eq!(cut, whole),
            _ => {}
        }
    }
}

// ---- the sample

#[test]
fn the_sample_is_what_the_generator_makes() {
    let options = SyntheticOptions::default();
    let folder = tempfile::tempdir().unwrap();
    trisplat_synthetic::write_poses(folder.path(), &options).unwrap();
    for name in ["sparse/0/cameras.txt", "sparse/0/images.txt", "sparse/0/points3D.txt", "test.txt"]
    {
        let [made, kept] = [folder.path(), &sample("dataset")]
            .map(|root| std::fs::read_to_string(root.join(name)).unwrap());
        assert_eq!(
            made, kept,
            "{name}: run `cargo run -p trisplat-bench -- sample dataset -f -o samples/dataset`"
        );
    }
    let dataset = load(&sample("dataset"));
    assert_eq!(dataset.views.len(), options.views as usize);
    for index in [0, 21] {
        let view = &dataset.views[index as usize];
        let exact =
            trisplat_synthetic::render(&trisplat_synthetic::camera(&options, index)).to_pixels();
        let kept = view.photo.decode().unwrap();
        // One code: another platform's sine may round differently.
        let off = exact
            .rgb
            .as_flattened()
            .iter()
            .zip(kept.rgb.as_flattened())
            .map(|(a, b)| a.abs_diff(*b));
        assert!(off.max().unwrap() <= 1, "{}", view.name);
        assert_same_camera(&view.camera, &trisplat_synthetic::camera(&options, index), &view.name);
    }
}

#[test]
fn the_sample_loads_without_complaint() {
    let dataset = load(&sample("dataset"));
    assert_eq!(dataset.warnings, [""; 0]);
    assert_eq!((dataset.views.len(), dataset.test().count(), dataset.points.len()), (40, 5, 1500));
    let measured = dataset.reprojection(&Limits::DEFAULT).unwrap().unwrap();
    // Rayleigh mean of the noise that was added: 0.25 sqrt(pi / 2).
    assert!((measured.mean_px - 0.3133).abs() < 0.01, "{measured:?}");
    assert!(measured.observations > 8000 && measured.behind == 0);
}

#[test]
fn synthetic_images_are_exact() {
    let camera = trisplat_synthetic::camera(&SyntheticOptions::default(), 30);
    let width = camera.size.x as usize;
    let image = trisplat_synthetic::render(&camera);
    let to_world = camera.rotation.as_dmat3().transpose();
    let origin = -(to_world * camera.translation.as_dvec3());
    let mut off = Vec::new();
    for (i, have) in image.pixels.iter().enumerate().step_by(7) {
        let corner = DVec2::new((i % width) as f64, (i / width) as f64);
        let mut sum = DVec3::ZERO;
        for k in 0..48 * 48 {
            let i = f64::from(k % 48);
            let j = f64::from(k / 48);
            let pixel = corner + DVec2::new(i + (j + 0.5) / 48.0, j + (i + 0.5) / 48.0) / 48.0;
            let ray = ((pixel - camera.center.as_dvec2()) / camera.focal.as_dvec2()).extend(1.0);
            sum += trace(Ray { origin, direction: to_world * ray }).unwrap().rgb;
        }
        let want = sum / (48.0 * 48.0);
        off.push((DVec3::from(have.map(f64::from)) - want).abs().max_element() * 255.0);
    }
    let mean = off.iter().sum::<f64>() / off.len() as f64;
    off.sort_by(f64::total_cmp);
    let p99 = off[off.len() * 99 / 100];
    let worst = off[off.len() - 1];
    // 256 rays where there is an edge: a coverage is right to about a hundredth, 2.5 codes of full
    // contrast.
    assert!(mean < 0.2 && p99 < 2.5 && worst < 6.0, "mean {mean} p99 {p99} worst {worst} of 255");
}

// ---- lenses

#[test]
fn photos_of_a_distorted_lens_become_photos_of_a_pinhole() {
    let options = SyntheticOptions { width: 160, views: 3, ..SyntheticOptions::default() };
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(folder.path().join("images")).unwrap();
    trisplat_synthetic::write_poses(folder.path(), &options).unwrap();
    let distortion = Distortion {
        radial: [-0.12, 0.03, 0.0, 0.0],
        tangential: [0.002, -0.001],
        ..Distortion::default()
    };
    for index in 0..3 {
        let camera = trisplat_synthetic::camera(&options, index);
        let lens = Lens {
            size: camera.size,
            focal: camera.focal.as_dvec2(),
            center: camera.center.as_dvec2(),
            distortion,
        };
        trisplat_synthetic::render_lens(&camera, &lens)
            .save_png(folder.path().join(format!("images/view_{index:04}.png")))
            .unwrap();
    }
    let camera = trisplat_synthetic::camera(&options, 0);
    let f = camera.focal;
    let c = camera.center;
    let line =
        format!("1 OPENCV 160 120 {} {} {} {} -0.12 0.03 0.002 -0.001\n", f.x, f.y, c.x, c.y);
    std::fs::write(folder.path().join("sparse/0/cameras.txt"), line).unwrap();
    let dataset = load(folder.path());
    for view in &dataset.views {
        let undistorted = view.photo.decode().unwrap();
        assert_eq!(undistorted.size, view.camera.size);
        let want = trisplat_synthetic::render(&view.camera).to_pixels();
        let psnr = metric::psnr(&undistorted.rgb, &want.rgb, None);
        // The rest is the blur of resampling sharp edges; half a pixel of shift would give 22
        // dB.
        assert!(psnr > 27.0, "{}: {psnr} dB at {}", view.name, view.camera.size);
        let bent = RgbImage::load(&view.photo.path).unwrap().downscaled(view.camera.size);
        assert!(psnr > metric::psnr(&bent.rgb, &want.rgb, None) + 6.0);
    }
}

// ---- options

#[test]
fn photos_are_shrunk_with_their_cameras() {
    let options = DatasetOptions { max_size: Some(50), ..DatasetOptions::default() };
    let small = Dataset::load(sample("dataset"), &options).unwrap();
    let view = &small.views[5];
    let whole = &load(&sample("dataset")).views[5];
    assert_eq!(view.camera.size, UVec2::new(50, 38));
    assert!(
        view.camera
            .focal
            .abs_diff_eq(whole.camera.focal * Vec2::new(50.0 / 160.0, 38.0 / 120.0), 1e-4)
    );
    let pixels = view.photo.decode().unwrap();
    // Rows are averaged while they are decoded, in whole numbers of pixels first: within one code
    // of a picture shrunk at once.
    let at_once = whole.photo.decode().unwrap().downscaled(UVec2::new(50, 38));
    let apart = pixels
        .rgb
        .as_flattened()
        .iter()
        .zip(at_once.rgb.as_flattened())
        .map(|(a, b)| a.abs_diff(*b))
        .max();
    assert!(apart.is_some_and(|codes| codes <= 1), "{apart:?} codes apart");
    let exact = trisplat_synthetic::render(&view.camera).to_pixels();
    let psnr = metric::psnr(&pixels.rgb, &exact.rgb, None);
    // Pixels that a new one covers in part are taken as of one colour; that is all the difference.
    assert!(psnr > 42.0, "{psnr} dB");
    let larger = DatasetOptions { max_size: Some(5000), ..DatasetOptions::default() };
    assert_eq!(
        Dataset::load(sample("dataset"), &larger).unwrap().views[0].camera.size,
        UVec2::new(160, 120)
    );
}

#[test]
fn a_random_cloud_is_repeatable_and_in_view() {
    let dataset = load(&sample("dataset"));
    let views: Vec<&View> = dataset.train().collect();
    let points = random_points(&views, 2000, 7);
    assert_eq!(points, random_points(&views, 2000, 7));
    assert_ne!(points, random_points(&views, 2000, 8));
    let seen_by = |at| views.iter().filter(|v| project(&v.camera, at).is_some()).count();
    let counts: Vec<usize> = points.iter().map(|p| seen_by(p.position)).collect();
    assert!(counts.iter().all(|&n| n >= 1));
    assert!(counts.iter().filter(|&&n| n >= 2).count() > 1990);
    assert_eq!(random_points(&views[..1], 10, 7).len(), 10, "one photo is enough");
    assert_eq!(random_points(&[], 10, 7), []);
}

#[test]
fn points_at_infinity_are_named_and_brought_near() {
    let folder = tempfile::tempdir().unwrap();
    copy_sample(folder.path());
    let near = load(folder.path());
    let file = folder.path().join("sparse/0/points3D.txt");
    let text = std::fs::read_to_string(&file).unwrap();
    std::fs::write(&file, text + "900001 3e6 4e5 -2e6 9 9 9 0.3\n900002 -1e9 0 2e8 9 9 9 0.3\n")
        .unwrap();
    let far = load(folder.path());
    assert_eq!(far.points.len(), near.points.len() + 2);
    let beyond: Vec<f32> =
        far.points[near.points.len()..].iter().map(|point| point.position.length()).collect();
    assert!(beyond.iter().all(|distance| (100.0..1e4).contains(distance)), "{beyond:?}");
    assert!(far.warnings.iter().any(|warning| warning.starts_with("2 of ")), "{:?}", far.warnings);
}

#[test]
fn a_scene_far_from_the_origin_keeps_its_detail() {
    let folder = tempfile::tempdir().unwrap();
    let far = DVec3::new(4.5e6, -2e5, 1.25e6);
    copy_sample(folder.path());
    let near = load(folder.path());
    move_model(&folder.path().join("sparse/0"), far);
    let moved = load(folder.path());
    assert_eq!(near.origin, DVec3::ZERO);
    assert!(moved.origin.distance(far) < 10.0);
    let shift = (far - moved.origin).as_vec3();
    for (a, b) in near.points.iter().zip(&moved.points) {
        assert!((a.position + shift).distance(b.position) < 1e-5, "{} {}", a.position, b.position);
    }
    for (a, b) in near.views.iter().zip(&moved.views) {
        assert!((a.camera.position() + shift).distance(b.camera.position()) < 1e-5);
        assert_eq!(a.camera.rotation, b.camera.rotation);
    }
    let error =
        |dataset: &Dataset| dataset.reprojection(&Limits::DEFAULT).unwrap().unwrap().mean_px;
    assert!((error(&near) - error(&moved)).abs() < 1e-4);
}

/// Adds an offset to every pose and point of a text model, in f64.
fn move_model(sparse: &Path, offset: DVec3) {
    let read = |name: &str| std::fs::read_to_string(sparse.join(name)).unwrap();
    let mut images = String::new();
    for line in read("images.txt").lines() {
        let words: Vec<&str> = line.split(' ').collect();
        if words.len() == 10 && words[9].ends_with(".png") {
            let n = |i: usize| words[i].parse::<f64>().unwrap();
            let t = DVec3::new(n(5), n(6), n(7))
                - glam::DQuat::from_xyzw(n(2), n(3), n(4), n(1)) * offset;
            let moved = format!(
                "{} {} {} {} {}",
                words[..5].join(" "),
                t.x,
                t.y,
                t.z,
                words[8..].join(" ")
            );
            images += &moved;
        } else {
            images += line;
        }
        images.push('\n');
    }
    let mut points = String::new();
    for line in read("points3D.txt").lines().filter(|line| !line.starts_with('#')) {
        let words: Vec<&str> = line.split(' ').collect();
        let n = |i: usize| words[i].parse::<f64>().unwrap();
        let p = DVec3::new(n(1), n(2), n(3)) + offset;
        writeln!(points, "{} {} {} {} {}", words[0], p.x, p.y, p.z, words[4..].join(" ")).unwrap();
    }
    std::fs::write(sparse.join("images.txt"), images).unwrap();
    std::fs::write(sparse.join("points3D.txt"), points).unwrap();
}
