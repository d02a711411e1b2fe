//! Fisheye and 360° photos as pinhole views: geometry, pictures, names, the split.

use super::*;
use trisplat_dataset::LensProjection;
use trisplat_synthetic::{render_lens, write_lens};

fn blank(lens: &Lens, _: &Camera) -> RgbImage {
    RgbImage {
        size: lens.size,
        rgb: vec![[90; 3]; lens.size.element_product() as usize],
        alpha: None,
    }
}

fn fisheye(size: [u32; 2], focal: f64, radial: [f64; 4]) -> Lens {
    let size = UVec2::from(size);
    let distortion =
        Distortion { radial, projection: LensProjection::Fisheye, ..Distortion::default() };
    Lens {
        size,
        focal: DVec2::splat(focal),
        center: size.as_dvec2() * DVec2::new(0.51, 0.49),
        distortion,
    }
}

/// Lenses of each kind: the line of cameras.txt, the lens, the names of its views.
fn lenses() -> Vec<(&'static str, Lens, &'static [&'static str])> {
    let prism = Lens {
        focal: DVec2::new(74.0, 73.0),
        ..fisheye([220, 160], 0.0, [0.02, -0.01, 0.004, -0.001])
    };
    let bent =
        Distortion { tangential: [0.001, -0.002], prism: [0.003, 0.001], ..prism.distortion };
    vec![
        ("SIMPLE_RADIAL_FISHEYE", fisheye([160, 120], 92.0, [0.01, 0.0, 0.0, 0.0]), &[""]),
        ("RADIAL_FISHEYE", fisheye([240, 120], 90.0, [-0.02, 0.003, 0.0, 0.0]), &["left", "right"]),
        (
            "OPENCV_FISHEYE",
            fisheye([120, 240], 90.0, [0.03, -0.01, 0.004, -0.001]),
            &["down", "up"],
        ),
        (
            "THIN_PRISM_FISHEYE",
            Lens { distortion: bent, ..prism },
            &["down", "front", "left", "right", "up"],
        ),
        ("FISHEYE", fisheye([200, 200], 63.0, [0.0; 4]), &["down", "front", "left", "right", "up"]),
        (
            "SPHERICAL",
            Lens::spherical(UVec2::new(320, 160)),
            &["back", "down", "front", "left", "right", "up"],
        ),
    ]
}

#[test]
fn fisheye_views_cover_the_field_and_place_points_exactly() {
    for (model, lens, names) in lenses() {
        let folder = tempfile::tempdir().unwrap();
        let options = SyntheticOptions { views: 3, points: 0, ..SyntheticOptions::default() };
        write_lens(folder.path(), &options, model, &lens, &blank).unwrap();
        let dataset = load(folder.path());
        assert_eq!(dataset.views.len(), 3 * names.len(), "{model}");
        let photo = trisplat_synthetic::camera(&options, 1);
        let rotation = photo.rotation.as_dmat3();
        let eye = photo.position().as_dvec3();
        let views: Vec<&View> =
            dataset.views.iter().filter(|view| view.name.starts_with("view_0001")).collect();
        let name = |part: &&str| {
            if part.is_empty() { "view_0001.png".into() } else { format!("view_0001@{part}.png") }
        };
        assert!(
            views.iter().map(|v| v.name.clone()).eq(names.iter().map(name)),
            "{model}: {:?}",
            names
        );
        let mut shown = 0;
        let mut all = 0;
        for i in 0..60 * 60 {
            let at = DVec2::new(f64::from(i % 60) + 0.5, f64::from(i / 60) + 0.5) / 60.0
                * lens.size.as_dvec2();
            // Beyond the circle of a fisheye there is nothing.
            let Some(ray) = lens.ray(at).filter(|_| {
                (at - lens.center).length() < 1.6 * lens.focal.x || model == "SPHERICAL"
            }) else {
                continue;
            };
            let point = (eye + rotation.transpose() * ray * 5.0).as_vec3();
            let places: Vec<_> = views
                .iter()
                .filter_map(|view| Some((view, view.camera.project(point)?.0)))
                .collect();
            all += 1;
            shown += usize::from(!places.is_empty());
            for (view, place) in places {
                let camera = &view.camera;
                let seen = ((place - camera.center) / camera.focal).as_dvec2().extend(1.0);
                let back =
                    lens.pixel(rotation * (camera.rotation.as_dmat3().transpose() * seen)).unwrap();
                assert!(back.distance(at) < 0.02, "{model} {}: {back} for {at}", view.name);
            }
        }
        let share = f64::from(shown as u32) / f64::from(all as u32);
        // Rectangles leave out round corners.
        let least = if model == "SPHERICAL" { 0.99 } else { 0.8 };
        assert!(share > least, "{model}: {share:.3} of {all} directions are shown");
    }
}

#[test]
fn views_show_what_a_pinhole_there_sees() {
    for (model, lens, _) in lenses() {
        let folder = tempfile::tempdir().unwrap();
        let options = SyntheticOptions { views: 2, points: 0, ..SyntheticOptions::default() };
        let draw = |lens: &Lens, camera: &Camera| render_lens(camera, lens);
        write_lens(folder.path(), &options, model, &lens, &draw).unwrap();
        let dataset = load(folder.path());
        for view in dataset.views.iter().filter(|view| view.name.starts_with("view_0001")) {
            let have = view.photo.decode().unwrap();
            assert_eq!(have.size, view.camera.size);
            let want = trisplat_synthetic::render(&view.camera).to_pixels();
            let psnr = metric::psnr(&have.rgb, &want.rgb, None);
            // The rest is the blur of resampling sharp edges; half a pixel of shift would give
            // 22 dB.
            assert!(psnr > 24.0, "{model} {}: {psnr:.1} dB", view.name);
        }
    }
}

#[test]
fn the_views_of_a_photo_are_held_out_together() {
    let folder = tempfile::tempdir().unwrap();
    let options = SyntheticOptions { views: 10, points: 0, ..SyntheticOptions::default() };
    let (model, lens, _) = lenses().swap_remove(5);
    write_lens(folder.path(), &options, model, &lens, &blank).unwrap();
    let held_out = |dataset: &Dataset| {
        let mut names: Vec<String> = dataset.test().map(|v| v.name[..9].to_owned()).collect();
        assert_eq!(names.len() % 6, 0);
        names.dedup();
        names
    };
    assert_eq!(held_out(&load(folder.path())), ["view_0000", "view_0008"], "test.txt names photos");
    std::fs::remove_file(folder.path().join("test.txt")).unwrap();
    let every = DatasetOptions { test_every: 4, ..DatasetOptions::default() };
    let dataset = Dataset::load(folder.path(), &every).unwrap();
    assert_eq!(held_out(&dataset), ["view_0000", "view_0004", "view_0008"]);
    assert!(
        dataset.warnings.iter().any(|w| w.contains("10 wide photos are read as 60 pinhole views")),
        "{:?}",
        dataset.warnings
    );
    let names = ["view_0003@up.png", "view_0007@back.png"].map(str::to_owned).into();
    let some = Dataset::load_some(folder.path(), &every, &names, None).unwrap();
    assert!(some.views.iter().map(|v| &v.name).eq(&names));
}

#[test]
fn the_keys_of_nerfstudio_and_instant_ngp_are_read() {
    let (folder, views) = super::transforms::six_photos("images");
    let write = |keys: &str| {
        let rows =
            super::transforms::frames(&views, |v| format!("images/{}", v.name), |_| String::new());
        let json = format!(
            "{{\"fl_x\": 60, \"fl_y\": 60, \"cx\": 80, \"cy\": 60, {keys} \"frames\": [{rows}]}}"
        );
        std::fs::write(folder.path().join("transforms.json"), json).unwrap();
    };
    for (keys, count) in [
        ("\"camera_model\": \"OPENCV_FISHEYE\", \"k1\": 0.01,", 5),
        ("\"is_fisheye\": true, \"k1\": 0.01, \"k4\": 0.0,", 5),
        ("\"is_fisheye\": true, \"fisheye_crop_radius\": 50,", 1),
    ] {
        write(keys);
        assert_eq!(load(folder.path()).views.len(), 6 * count, "{keys}");
    }
    for (keys, part) in [
        ("\"ftheta_p0\": 0.1,", "ftheta_p0"),
        ("\"equirectangular\": true,", "`equirectangular`"),
        ("\"latlong\": true,", "twice as wide as high"),
        ("\"camera_model\": \"EQUIRECTANGULAR\",", "this one is 160x120"),
        ("\"camera_model\": \"VR180_L\",", "VR180_L"),
    ] {
        write(keys);
        let error = error_of(folder.path());
        assert!(error.contains(part), "`{part}` is missing from: {error}");
    }
    for view in &views {
        let pano =
            RgbImage { size: UVec2::new(160, 80), rgb: vec![[90; 3]; 160 * 80], alpha: None };
        pano.save_png(folder.path().join("images").join(&view.name)).unwrap();
    }
    write("\"camera_model\": \"EQUIRECTANGULAR\", \"w\": 160, \"h\": 80,");
    let dataset = load(folder.path());
    assert_eq!(dataset.views.len(), 36);
    let front = dataset.views.iter().find(|v| v.name == "view_0002@front.png").unwrap();
    assert!(
        front.camera.rotation.abs_diff_eq(views[2].camera.rotation, 1e-6),
        "its middle is where the camera looks"
    );
}
