//! The same cameras in every dialect of transforms.json.

use super::*;

/// Camera to world, OpenGL axes, as JSON rows.
pub(super) fn matrix(camera: &Camera) -> String {
    let r = camera.rotation.as_dmat3().transpose();
    let c = camera.position().as_dvec3();
    let row =
        |i: usize| format!("[{:?},{:?},{:?},{:?}]", r.x_axis[i], -r.y_axis[i], -r.z_axis[i], c[i]);
    format!("[{},{},{},[0,0,0,1]]", row(0), row(1), row(2))
}

/// A folder with the first six photos of the sample, and their views.
pub(super) fn six_photos(subfolder: &str) -> (tempfile::TempDir, Vec<View>) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(folder.path().join(subfolder)).unwrap();
    let views: Vec<View> = load(&sample("dataset")).views.into_iter().take(6).collect();
    for view in &views {
        std::fs::copy(&view.photo.path, folder.path().join(subfolder).join(&view.name)).unwrap();
    }
    (folder, views)
}

pub(super) fn frames(
    views: &[View],
    path: impl Fn(&View) -> String,
    extra: impl Fn(&View) -> String,
) -> String {
    let row = |view: &View| {
        let path = path(view);
        let matrix = matrix(&view.camera);
        let extra = extra(view);
        format!("{{\"file_path\": \"{path}\", {extra} \"transform_matrix\": {matrix}}}")
    };
    views.iter().map(row).collect::<Vec<_>>().join(",\n")
}

fn assert_cameras(folder: &Path, views: &[View], options: &DatasetOptions) -> Dataset {
    let dataset = Dataset::load(folder, options).unwrap();
    assert_eq!(dataset.views.len(), views.len());
    for (have, want) in dataset.views.iter().zip(views) {
        assert_same_camera(&have.camera, &want.camera, &have.name);
        assert_eq!(have.photo.decode().unwrap(), want.photo.decode().unwrap());
    }
    dataset
}

#[test]
fn nerfstudio_with_shared_intrinsics_and_points() {
    let (folder, views) = six_photos("images");
    let camera = views[0].camera;
    let json = format!(
        "{{\"camera_model\": \"OPENCV\", \"w\": 160, \"h\": 120, \"fl_x\": {}, \"fl_y\": {}, \"cx\": {}, \"cy\": {}, \
         \"k1\": 0.0, \"ply_file_path\": \"sparse_pc.ply\", \"unknown\": {{}}, \"frames\": [{}]}}",
        camera.focal.x,
        camera.focal.y,
        camera.center.x,
        camera.center.y,
        frames(&views, |v| format!("images/{}", v.name), |_| "\"colmap_im_id\": 1,".into())
    );
    std::fs::write(folder.path().join("transforms.json"), json).unwrap();
    let ply = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
               property uint8 red\nproperty uint8 green\nproperty uint8 blue\nend_header\n1 2 3 10 20 30\n";
    std::fs::write(folder.path().join("sparse_pc.ply"), ply).unwrap();
    let dataset = assert_cameras(folder.path(), &views, &DatasetOptions::default());
    assert_eq!(
        dataset.views[0].name, "view_0000.png",
        "the folder of photos is no part of the name"
    );
    assert_eq!(dataset.points.len(), 1);
    assert_eq!(
        (dataset.points[0].position.to_array(), dataset.points[0].rgb),
        ([1.0, 2.0, 3.0], [10, 20, 30])
    );
    assert_eq!(dataset.test().count(), 1, "every 8th of six");
    std::fs::remove_file(folder.path().join("sparse_pc.ply")).unwrap();
    let error = error_of(folder.path());
    assert!(
        error.contains("transforms.json: ply_file_path") && error.contains("points found"),
        "{error}"
    );
}

#[test]
fn nerfstudio_with_a_camera_for_every_frame() {
    let (folder, views) = six_photos("images");
    let own = |v: &View| {
        let f = v.camera.focal;
        let c = v.camera.center;
        format!(
            "\"w\": 160, \"h\": 120, \"fl_x\": {}, \"fl_y\": {}, \"cx\": {}, \"cy\": {},",
            f.x, f.y, c.x, c.y
        )
    };
    let json = format!(
        "{{\"fl_x\": 1.0, \"w\": 7, \"h\": 7, \"frames\": [{}]}}",
        frames(&views, |v| format!("./images/{}", v.name), own)
    );
    std::fs::write(folder.path().join("transforms.json"), json).unwrap();
    assert_cameras(folder.path(), &views, &DatasetOptions::default());
}

#[test]
fn instant_ngp_with_angles_and_a_scaled_camera() {
    let (folder, views) = six_photos("images");
    let angle = |focal: f32, side: f64| 2.0 * (side / 2.0 / f64::from(focal)).atan();
    let camera = views[0].camera;
    // Calibrated at four times the size.
    let json = format!(
        "{{\"camera_angle_x\": {}, \"camera_angle_y\": {}, \"cx\": {}, \"cy\": {}, \"w\": 640.0, \"h\": 480.0, \
         \"aabb_scale\": 4, \"frames\": [{}]}}",
        angle(camera.focal.x, 160.0),
        angle(camera.focal.y, 120.0),
        camera.center.x * 4.0,
        camera.center.y * 4.0,
        frames(&views, |v| format!("images/{}", v.name), |_| "\"sharpness\": 42.5,".into())
    );
    std::fs::write(folder.path().join("transforms.json"), json).unwrap();
    let dataset = assert_cameras(folder.path(), &views, &DatasetOptions::default());
    assert!(dataset.warnings.iter().any(|w| w.contains("scaled")), "{:?}", dataset.warnings);
}

#[test]
fn blender_without_extensions_with_a_test_file() {
    let (folder, mut views) = six_photos("train");
    for view in &mut views {
        view.camera.center = view.camera.size.as_vec2() / 2.0;
        view.camera.focal.y = view.camera.focal.x;
    }
    let angle = 2.0 * (80.0 / f64::from(views[0].camera.focal.x)).atan();
    let stem = |v: &View| format!("./train/{}", v.name.trim_end_matches(".png"));
    for (name, range) in [("train", 0..4), ("val", 3..5), ("test", 4..6)] {
        let rows = frames(&views[range], stem, |_| "\"rotation\": 0.01,".into());
        let json = format!("{{\"camera_angle_x\": {angle}, \"frames\": [{rows}]}}");
        std::fs::write(folder.path().join(format!("transforms_{name}.json")), json).unwrap();
    }
    let dataset = assert_cameras(folder.path(), &views, &DatasetOptions::default());
    let held_out: Vec<&str> = dataset.test().map(|v| v.name.as_str()).collect();
    assert_eq!(held_out, ["train/view_0004.png", "train/view_0005.png"]);
    let all = DatasetOptions { test_every: 0, ..DatasetOptions::default() };
    assert_eq!(assert_cameras(folder.path(), &views, &all).test().count(), 0);
    std::fs::write(folder.path().join("test.txt"), "train/view_0001\n").unwrap();
    let dataset = assert_cameras(folder.path(), &views, &DatasetOptions::default());
    let held_out: Vec<&str> = dataset.test().map(|v| v.name.as_str()).collect();
    assert_eq!(held_out, ["train/view_0001.png"], "test.txt goes before transforms_test.json");
}

#[test]
fn the_originals_of_a_phone_are_understood() {
    let Some(path) = real("fox") else { return };
    // The file as instant-ngp ships it names 1080x1920 photos; here only its small copies lie.
    let file = path.join("transforms_original.json");
    let error = Dataset::load(&file, &DatasetOptions::default()).unwrap_err().to_string();
    assert!(error.contains("`skip_broken`"), "{error}");
}

#[test]
fn every_cut_of_a_transforms_file_fails_cleanly() {
    let (folder, views) = six_photos("images");
    let json = format!(
        "{{\"camera_angle_x\": 0.9, \"frames\": [{}]}}",
        frames(&views[..1], |v| format!("images/{}", v.name), |_| String::new())
    );
    let file = folder.path().join("transforms.json");
    for len in 0..json.len() {
        std::fs::write(&file, &json[..len]).unwrap();
        assert!(error_of(folder.path()).contains("transforms.json"), "cut at {len}");
    }
    std::fs::write(&file, &json).unwrap();
    assert_eq!(load(folder.path()).views.len(), 1);
    for (from, to, part) in [
        ("[0,0,0,1]", "[0,0,1,1]", "last row"),
        ("\"camera_angle_x\": 0.9", "\"w\": 160, \"h\": 120", "focal"),
        ("\"camera_angle_x\": 0.9", "\"camera_angle_x\": 4.0", "camera_angle is 4"),
        ("\"camera_angle_x\": 0.9", "\"fl_x\": 100, \"camera_model\": \"OMNI\"", "OMNI"),
        ("\"camera_angle_x\": 0.9", "\"fl_x\": 100, \"k1\": -9.0", "folds"),
    ] {
        assert!(json.contains(from));
        std::fs::write(&file, json.replacen(from, to, 1)).unwrap();
        let error = error_of(folder.path());
        assert!(error.contains(part), "`{part}` is missing from: {error}");
    }
}

#[test]
fn a_matrix_for_every_frame_and_numbers_that_python_writes() {
    let (folder, views) = six_photos("images");
    let own = |v: &View| {
        let f = v.camera.focal;
        let c = v.camera.center;
        format!(
            "\"K\": [[{}, 0, {}], [0, {}, {}], [0, 0, 1]], \"w\": 160, \"h\": 120, \"sharp\": NaN,",
            f.x, c.x, f.y, c.y
        )
    };
    let rows = frames(&views, |v| format!("images/{}", v.name), own);
    let json = format!(
        "{{\"camera_angle_x\": 1.5, \"aabb\": [-Infinity, Infinity], \"of\": \"NaN \\\\ \\\" NaN\", \"frames\": [{rows}]}}"
    );
    let file = folder.path().join("transforms.json");
    std::fs::write(&file, &json).unwrap();
    assert_cameras(folder.path(), &views, &DatasetOptions::default());
    for (from, to, part) in [
        ("\"camera_angle_x\": 1.5", "\"k1\": NaN", "k1 is not a finite number"),
        ("\"sharp\": NaN", "\"cx\": -Infinity", "cx is not a finite number"),
        (",0,0,1]]", ",0,0,NaN]]", "transform_matrix"),
    ] {
        std::fs::write(
            &file,
            json.replacen(from, to, 1).replacen(
                "[0,0,0,1]",
                "[0,0,0,NaN]",
                usize::from(from.starts_with(",0")),
            ),
        )
        .unwrap();
        let error = error_of(folder.path());
        assert!(error.contains(part), "`{part}` is missing from: {error}");
    }
}

#[test]
fn the_lists_of_nerfstudio_are_the_split() {
    let (folder, views) = six_photos("images");
    let rows = frames(&views, |v| format!("images/{}", v.name), |_| String::new());
    let list = |name: &str, range: std::ops::Range<usize>| {
        let names: Vec<String> =
            views[range].iter().map(|v| format!("\"./images/{}\"", v.name)).collect();
        format!("\"{name}\": [{}],", names.join(", "))
    };
    let write = |lists: &[String]| {
        let json = format!("{{\"camera_angle_x\": 0.9, {} \"frames\": [{rows}]}}", lists.concat());
        std::fs::write(folder.path().join("transforms.json"), json).unwrap();
        load(folder.path())
    };
    let names = |dataset: &Dataset, test: bool| -> Vec<String> {
        dataset.views.iter().filter(|v| v.test == test).map(|v| v.name[8..9].to_owned()).collect()
    };
    let both = write(&[
        list("train_filenames", 0..4),
        list("test_filenames", 4..6),
        list("val_filenames", 4..6),
    ]);
    assert_eq!(
        (names(&both, false).concat(), names(&both, true).concat()),
        ("0123".into(), "45".into())
    );
    let val = write(&[list("train_filenames", 2..5), list("val_filenames", 0..1)]);
    assert_eq!(
        (names(&val, false).concat(), names(&val, true).concat()),
        ("234".into(), "0".into())
    );
    assert!(val.warnings[0].contains("2 of 6 photos left out"), "{:?}", val.warnings);
    let test = write(&[list("test_filenames", 1..2)]);
    assert_eq!(names(&test, true), ["1"]);
}

#[test]
fn photos_named_by_another_machine_are_found() {
    let (folder, views) = six_photos("images");
    let foreign = |v: &View| format!("C:\\\\scans\\\\set\\\\{}", v.name.replace(".png", ".dng"));
    let json = format!(
        "{{\"fl_x\": 168, \"fl_y\": 167.2, \"cx\": 81.92, \"cy\": 58.92, \"frames\": [{}]}}",
        frames(&views, foreign, |_| String::new())
    );
    std::fs::write(folder.path().join("transforms.json"), json).unwrap();
    let dataset = assert_cameras(folder.path(), &views, &DatasetOptions::default());
    assert_eq!(dataset.views[0].name, "view_0000.png");
    let [warning] = &dataset.warnings[..dataset.warnings.len() - 1] else {
        panic!("{:?}", dataset.warnings)
    };
    assert!(
        warning.contains("6 files") && warning.contains(r"`C:\scans\set\view_0000.dng`, found as"),
        "{warning}"
    );
}
