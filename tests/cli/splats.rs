//! Gaussian splats at the command line: described, drawn, and refused where triangles are wanted.

use super::{fails, stderr, trisplat};
use std::path::{Path, PathBuf};
use trisplat_scene::image::RgbImage;

/// Two Gaussians as a trainer writes them, red before green, in front of a camera at the origin
/// that looks along +z.
fn scene(folder: &Path) -> PathBuf {
    let names =
        "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let mut ply = "ply\nformat ascii 1.0\nelement vertex 2\n".to_owned();
    names.split(' ').for_each(|name| ply += &format!("property float {name}\n"));
    ply += "end_header\n0 0 3 -1.8 1.8 -1.8 9 0 0 0 1 0 0 0\n0 0 2 1.8 -1.8 -1.8 9 -1.5 -1.5 -1.5 1 0 0 0\n";
    let path = folder.join("splats.ply");
    std::fs::write(&path, ply).unwrap();
    path
}

/// A list of one camera whose middle is `center` px from the left.
fn cameras(path: &Path, center: u32) {
    let camera = format!(
        r#"[{{"img_name":"photo.jpg","width":64,"height":48,"position":[0,0,0],"rotation":[[1,0,0],[0,1,0],[0,0,1]],
        "fx":60,"fy":60,"cx":{center},"cy":24}}]"#
    );
    std::fs::write(path, camera).unwrap();
}

#[test]
fn gaussians_are_described_and_drawn_from_any_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let file = scene(folder.path());
    cameras(&folder.path().join("splats.cameras.json"), 32);
    let said = trisplat(&[&"info", &file]);
    let text = String::from_utf8(said.stdout).unwrap();
    for needle in
        ["Gaussian splats, spherical harmonics of degree 0", "splats     2", "cameras    1"]
    {
        assert!(text.contains(needle), "{text} lacks {needle}");
    }
    assert!(!text.contains("triangles") && !text.contains("bake"), "{text}");

    let output = folder.path().join("pictures");
    let drawn = |more: &[&str]| {
        let mut arguments: Vec<&dyn AsRef<std::ffi::OsStr>> =
            vec![&"render", &file, &"-o", &output, &"-f"];
        arguments.extend(more.iter().map(|a| a as &dyn AsRef<std::ffi::OsStr>));
        let done = trisplat(&arguments);
        assert!(done.status.success(), "{}", stderr(&done));
    };
    let pixel = |x: usize| {
        let picture = RgbImage::load(&output.join("photo.png")).unwrap();
        assert_eq!(picture.size.to_array(), [64, 48]);
        picture.rgb[24 * 64 + x]
    };
    drawn(&[]);
    assert!(pixel(32)[0] > 240 && pixel(32)[1] < 10, "the nearer one is red: {:?}", pixel(32));
    assert!(
        pixel(45)[1] > 120 && pixel(45)[0] < 60,
        "around it is the wider green one: {:?}",
        pixel(45)
    );
    let list = folder.path().join("list.json");
    cameras(&list, 10);
    drawn(&["--cameras", list.to_str().unwrap()]);
    assert!(pixel(10)[0] > 240 && pixel(60)[0] == 0, "the principal point moved");
    drawn(&["--orbit", "2", "--width", "32"]);
    let turned = RgbImage::load(&output.join("orbit_0001.png")).unwrap();
    assert!(turned.rgb.iter().any(|rgb| rgb[1] > 100), "something is seen");
}

#[test]
fn what_only_triangles_have_is_refused_of_gaussians() {
    let folder = tempfile::tempdir().unwrap();
    let file = scene(folder.path());
    let output = folder.path().join("pictures");
    fails(folder.path(), &[&"render", &file, &"-o", &output], &["--orbit", "--cameras"]);
    let orbit = |more: [&'static str; 2], needles: &[&str]| {
        fails(
            folder.path(),
            &[&"render", &file, &"-o", &output, &"--orbit", &"2", &more[0], &more[1]],
            needles,
        );
    };
    orbit(["--as", "solid"], &["--as", "Gaussians"]);
    orbit(["--show", "depth"], &["--show", "Gaussians"]);
    let list = folder.path().join("cameras.json");
    cameras(&list, 32);
    let before = std::fs::read(&list).unwrap();
    fails(
        folder.path(),
        &[&"bake", &file, &"-f", &"-o", &"a.glb", &"--report", &list],
        &["cameras.json"],
    );
    assert_eq!(std::fs::read(&list).unwrap(), before, "the cameras beside Gaussians are an input");
}

#[test]
fn gaussians_are_scored_on_photos_as_their_trainers_draw_them() {
    let folder = tempfile::tempdir().unwrap();
    let file = scene(folder.path());
    let dataset = folder.path().join("photos");
    std::fs::create_dir_all(dataset.join("images")).unwrap();
    cameras(&folder.path().join("splats.cameras.json"), 32);
    let images = dataset.join("images");
    let done = trisplat(&[&"render", &file, &"-o", &images]);
    assert!(done.status.success(), "{}", stderr(&done));
    // Blender's axes: y up, z back.
    let transforms = r#"{"w":64,"h":48,"fl_x":60,"fl_y":60,"cx":32,"cy":24,"frames":[{"file_path":"images/photo.png",
        "transform_matrix":[[1,0,0,0],[0,-1,0,0],[0,0,-1,0],[0,0,0,1]]}]}"#;
    std::fs::write(dataset.join("transforms.json"), transforms).unwrap();
    let scored = trisplat(&[&"eval", &file, &dataset, &"--split", &"all", &"--json"]);
    assert!(scored.status.success(), "{}", stderr(&scored));
    let report: serde_json::Value = serde_json::from_slice(&scored.stdout).unwrap();
    let step = &report["steps"][0];
    assert_eq!((step["name"].as_str(), step["splats"].as_u64()), (Some("splats"), Some(2)));
    // Equal pictures have at most this.
    assert!(step["mean"]["psnr"].as_f64().unwrap() > 80.0, "{step}");
    let as_triangles: [&dyn AsRef<std::ffi::OsStr>; 7] =
        [&"eval", &file, &dataset, &"--split", &"all", &"--as", &"solid"];
    fails(folder.path(), &as_triangles, &["--as", "Gaussians"]);
}
