//! Poses as people have them: of several parts, of other conventions, of apps, with gaps.

use super::transforms::{frames, six_photos};
use super::*;
use glam::{DMat3, DMat4, DQuat};
use std::fmt::Write as _;

const LENS: &str =
    "\"fl_x\": 168, \"fl_y\": 167.2, \"cx\": 81.92, \"cy\": 58.92, \"w\": 160, \"h\": 120";
const SENSOR: &str = "<sensors><sensor id=\"0\" type=\"frame\"><resolution width=\"160\" height=\"120\"/><calibration \
     class=\"adjusted\"><f>167.2</f><b1>0.8</b1><cx>1.92</cx><cy>-1.08</cy></calibration></sensor></sensors>";

fn words(numbers: &[f64]) -> String {
    numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}

/// World to component, with the component's place as XML.
fn component(turn: f64, scale: f64) -> (DMat4, String) {
    let rotation = DMat3::from_rotation_y(turn);
    let moved = DVec3::new(turn, 2.0, -scale);
    let place = DMat4::from_translation(moved) * DMat4::from_mat3(rotation * scale);
    let xml = format!(
        "<transform><rotation>{}</rotation><translation>{}</translation><scale>{scale}</scale></transform>",
        words(&rotation.transpose().to_cols_array()),
        words(&moved.to_array())
    );
    (place.inverse(), xml)
}

/// A camera of a `cameras.xml`.
fn camera(view: &View, component: usize, to_component: DMat4) -> String {
    let turn = view.camera.rotation.as_dmat3().transpose();
    let center = to_component.transform_point3(view.camera.position().as_dvec3());
    let turn = DMat3::from_mat4(to_component) * turn;
    let turn = turn * (1.0 / turn.determinant().cbrt());
    let pose = DMat4::from_translation(center) * DMat4::from_mat3(turn);
    format!(
        "<camera id=\"1\" sensor_id=\"0\" component_id=\"{component}\" label=\"{}\"><transform>{}</transform></camera>",
        view.name.trim_end_matches(".png"),
        words(&pose.transpose().to_cols_array())
    )
}

fn xml(chunks: &[String]) -> String {
    let chunk = |(i, chunk): (usize, &String)| {
        format!("<chunk label=\"Chunk {i}\">{SENSOR}{chunk}</chunk>")
    };
    format!("<document>{}</document>", chunks.iter().enumerate().map(chunk).collect::<String>())
}

#[test]
fn metashape_places_components_and_takes_the_main_part() {
    let (folder, views) = six_photos("images");
    let file = folder.path().join("cameras.xml");
    let parts = [component(0.7, 2.0), component(-1.2, 0.5)];
    let cameras = |range: std::ops::Range<usize>| -> String {
        views[range].iter().enumerate().map(|(i, v)| camera(v, i % 2, parts[i % 2].0)).collect()
    };
    let chunk = |places: [&str; 2], cameras: String| {
        let [a, b] = places;
        format!(
            "<components><component id=\"0\">{a}</component><component id=\"1\">{b}</component></components>\
             <cameras>{cameras}</cameras>"
        )
    };
    let placed = || chunk([&parts[0].1, &parts[1].1], cameras(0..6));
    std::fs::write(&file, xml(&[placed()])).unwrap();
    let wanted = |dataset: Dataset| {
        assert_eq!(dataset.views.len(), 6);
        for (have, want) in dataset.views.iter().zip(&views) {
            assert_same_camera(&have.camera, &want.camera, &want.name);
        }
        dataset.warnings
    };
    wanted(load(&file));
    // Chunks: without photos, with fewer poses.
    let two = chunk([&parts[0].1, &parts[1].1], cameras(0..2));
    std::fs::write(&file, xml(&["<cameras></cameras>".into(), placed()])).unwrap();
    assert!(!wanted(load(&file)).iter().any(|warning| warning.contains("chunk")));
    std::fs::write(&file, xml(&[two, placed()])).unwrap();
    let warnings = wanted(load(&file));
    assert!(warnings[0].contains("only `Chunk 1` is used, of 6 photos"), "{warnings:?}");
    // Components of two worlds.
    let cameras = cameras(0..5);
    std::fs::write(&file, xml(&[chunk(["", &parts[1].1], cameras)])).unwrap();
    let dataset = load(&file);
    assert_eq!(dataset.views.len(), 3);
    assert!(dataset.warnings[0].contains("2 components without a place"), "{:?}", dataset.warnings);
}

#[test]
fn photos_of_one_name_in_two_folders_are_told() {
    let (folder, views) = six_photos("images/cardA");
    let at = |name: &str| folder.path().join(name);
    std::fs::create_dir_all(at("images/cardB")).unwrap();
    let place = component(0.0, 1.0).0;
    let write = |views: &[View]| {
        let cameras: String = views.iter().map(|view| camera(view, 0, place)).collect();
        let text = xml(&[format!("<cameras>{cameras}</cameras>")]);
        std::fs::write(at("cameras.xml"), text).unwrap();
    };
    write(&views);
    let dataset = load(folder.path());
    assert_eq!(dataset.views[5].name, "cardA/view_0005.png");
    std::fs::copy(at("images/cardA/view_0003.png"), at("images/cardB/VIEW_0003.PNG")).unwrap();
    let told = |error: String| {
        let parts = ["view_0003", "cardA", "cardB", "a name of its own"];
        assert!(parts.iter().all(|part| error.contains(part)), "{error}");
    };
    told(error_of(folder.path()));
    // A label twice, and a file in the place that is looked at first.
    std::fs::copy(at("images/cardA/view_0003.png"), at("images/view_0003.png")).unwrap();
    write(&[&views[..], &views[3..4]].concat());
    told(error_of(folder.path()));
    let table = |names: &[&str]| {
        let row = |name: &&str| format!("{name},1,2,3,4,5,6,26,0,0,0,0,0,0,0,0\n");
        let head = "#name,x,y,alt,yaw,pitch,roll,f_35mm,px_norm,py_norm,k1,k2,k3,k4,t1,t2\n";
        std::fs::write(
            at("poses.csv"),
            names.iter().map(row).fold(head.into(), |a: String, b| a + &b),
        )
        .unwrap();
        error_of(&at("poses.csv"))
    };
    std::fs::remove_file(at("images/view_0003.png")).unwrap();
    told(table(&["view_0001.png", "view_0003.png"]));
}

/// Around the origin wrong poses stand in the middle, and some of them look at any point.
#[test]
fn inverted_poses_of_a_centred_orbit_are_named() {
    let folder = tempfile::tempdir().unwrap();
    copy_sample(folder.path());
    let dataset = load(folder.path());
    let row = |p: &trisplat_dataset::Point| {
        format!("{} {} {}\n", p.position.x, p.position.y, p.position.z)
    };
    let near = dataset.points.iter().filter(|p| p.position.length() < 4.0);
    let points: Vec<String> = near.map(row).collect();
    let header = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
        points.len()
    );
    std::fs::write(folder.path().join("points.ply"), header + &points.concat()).unwrap();
    let flip = DMat4::from_mat3(DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)));
    let told = |change: &dyn Fn(DMat4) -> DMat4| {
        let row = |view: &View| {
            let pose = DMat4::from_translation(view.camera.translation.as_dvec3())
                * DMat4::from_mat3(view.camera.rotation.as_dmat3());
            let m = change(pose).transpose().to_cols_array();
            let m = &m.as_chunks::<4>().0[..3];
            format!("{{\"file_path\": \"images/{}\", \"transform_matrix\": {m:?}}}", view.name)
        };
        let rows = dataset.views.iter().map(row).collect::<Vec<_>>().join(",");
        let file = folder.path().join("transforms.json");
        let text = format!("{{{LENS}, \"ply_file_path\": \"points.ply\", \"frames\": [{rows}]}}");
        std::fs::write(&file, text).unwrap();
        let warnings = load(&file).warnings;
        warnings.into_iter().filter(|warning| warning.contains("in front of")).collect::<Vec<_>>()
    };
    assert_eq!(told(&|pose| pose.inverse() * flip), [""; 0]);
    assert!(told(&|pose| flip * pose)[0].contains("from world to camera it would be"));
    let opencv = told(&|pose| pose);
    assert!(opencv[0].contains("from world to camera with OpenCV's axes"), "{opencv:?}");
}

#[test]
fn poses_of_another_convention_are_named_with_the_way() {
    // Around the origin, or from all sides, inverted poses show points too.
    const AWAY: DVec3 = DVec3::new(9.0, 1.0, -3.0);
    let folder = tempfile::tempdir().unwrap();
    copy_sample(folder.path());
    let mut views = load(folder.path()).views;
    views.truncate(4);
    let points: String = load(folder.path())
        .points
        .iter()
        .map(|p| p.position.as_dvec3() + AWAY)
        .map(|p| format!("{} {} {}\n", p.x, p.y, p.z))
        .collect();
    let header = "ply\nformat ascii 1.0\nelement vertex 1500\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    std::fs::write(folder.path().join("points.ply"), format!("{header}{points}")).unwrap();
    let flip = DMat4::from_mat3(DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)));
    let pose = |view: &View| {
        let rotation = view.camera.rotation.as_dmat3();
        let translation = view.camera.translation.as_dvec3() - rotation * AWAY;
        DMat4::from_translation(translation) * DMat4::from_mat3(rotation)
    };
    let warnings = |change: &dyn Fn(DMat4) -> DMat4| {
        let row = |view: &View| {
            let m = change(pose(view)).transpose().to_cols_array();
            format!(
                "{{\"file_path\": \"images/{}\", \"transform_matrix\": {:?}}}",
                view.name,
                &m.as_chunks::<4>().0[..3]
            )
        };
        let rows = views.iter().map(row).collect::<Vec<_>>().join(",");
        let text = format!("{{{LENS}, \"ply_file_path\": \"points.ply\", \"frames\": [{rows}]}}");
        let file = folder.path().join("transforms.json");
        std::fs::write(&file, text).unwrap();
        let mut warnings = load(&file).warnings;
        warnings.retain(|warning| warning.contains("of the points"));
        warnings
    };
    assert!(warnings(&|pose| pose.inverse() * flip).is_empty());
    let mistakes: [(&dyn Fn(DMat4) -> DMat4, &str); 3] = [
        (
            &|pose| pose.inverse(),
            "OpenCV's axes (x right, y down, z forward) it would be 85%: multiply",
        ),
        (&|pose| flip * pose, "from world to camera it would be"),
        (&|pose| pose, "from world to camera with OpenCV's axes it would be 85%: invert"),
    ];
    for (change, part) in mistakes {
        let warnings = warnings(change);
        assert!(warnings.iter().any(|warning| warning.contains(part)), "{part}: {warnings:?}");
    }
    // Points of another scene have no reason.
    let moved = warnings(&|pose| DMat4::from_translation(DVec3::Y * 1e3) * pose.inverse() * flip);
    assert!(moved[0].contains("of two worlds"), "{moved:?}");
    // A model without observations, whose poses are from camera to world.
    let mut rows = String::new();
    for (id, view) in views.iter().enumerate() {
        let q = DQuat::from_mat3(&view.camera.rotation.as_dmat3().transpose());
        let DVec3 { x, y, z } = view.camera.position().as_dvec3() + AWAY;
        writeln!(rows, "{id} {} {} {} {} {x} {y} {z} 1 {}\n", q.w, q.x, q.y, q.z, view.name)
            .unwrap();
    }
    std::fs::write(folder.path().join("sparse/0/images.txt"), rows).unwrap();
    let rows = points.lines().enumerate().map(|(id, place)| format!("{id} {place} 9 9 9 1\n"));
    std::fs::write(folder.path().join("sparse/0/points3D.txt"), rows.collect::<String>()).unwrap();
    let warnings = load(folder.path()).warnings;
    assert!(
        warnings[0].contains("from camera to world it would be 85%: invert each pose"),
        "{warnings:?}"
    );
}

#[test]
fn poses_that_are_none_are_left_out_if_that_is_wanted() {
    let (folder, views) = six_photos("images");
    let file = folder.path().join("transforms.json");
    let skip = DatasetOptions { skip_broken: true, ..DatasetOptions::default() };
    let right = frames(&views, |v| format!("images/{}", v.name), |_| String::new());
    let lists = "\"test_filenames\": [\"images/view_0001.png\", \"images/view_0003.png\"]";
    let turn = views[3].camera.rotation.as_dmat3();
    let first = format!("[[{:?},", turn.row(0).x);
    for fault in ["NaN", "-Infinity", "null", "Infinity"] {
        let broken = right.replacen(&first, &format!("[[{fault},"), 1);
        assert_ne!(broken, right);
        std::fs::write(&file, format!("{{{LENS}, {lists}, \"frames\": [{broken}]}}")).unwrap();
        let error = error_of(&file);
        for part in
            ["frame 3 `images/view_0003.png`", "not a finite number", "1 of 6", "`skip_broken`"]
        {
            assert!(error.contains(part), "`{part}` is missing from: {error}");
        }
        let dataset = Dataset::load(&file, &skip).unwrap();
        assert_eq!((dataset.views.len(), dataset.test().count()), (5, 1), "{fault}");
        assert!(dataset.warnings.iter().any(|w| w.contains("1 of 6")), "{:?}", dataset.warnings);
    }
    std::fs::remove_file(&file).unwrap();
    let lost = xml(&[format!(
        "<cameras>{}</cameras>",
        views.iter().map(|view| camera(view, 0, DMat4::IDENTITY)).collect::<String>()
    )]);
    let lost = lost.replacen("<transform>", "<transform>nan ", 1);
    std::fs::write(folder.path().join("cameras.xml"), lost).unwrap();
    assert!(error_of(folder.path()).contains("`skip_broken`"));
    assert_eq!(Dataset::load(folder.path(), &skip).unwrap().views.len(), 5);
}

/// As phones store poses: camera to world with the axes of OpenGL.
fn gl(view: &View) -> DMat3 {
    let r = view.camera.rotation.as_dmat3().transpose();
    DMat3::from_cols(r.x_axis, -r.y_axis, -r.z_axis)
}

#[test]
fn raw_exports_of_polycam_are_read() {
    let (folder, views) = six_photos("keyframes/images");
    let at = |name: &str| folder.path().join(name);
    let write = |cameras: &str, moved: f64| {
        std::fs::create_dir_all(at(cameras)).unwrap();
        for view in &views {
            let m = gl(view);
            let center = view.camera.position().as_dvec3() + moved;
            let mut text = String::from("{");
            for row in 0..3 {
                let [x, y, z] = m.row(row).to_array();
                for (column, value) in [x, y, z, center[row]].into_iter().enumerate() {
                    write!(text, "\"t_{row}{column}\": {value:?}, ").unwrap();
                }
            }
            text += "\"fx\": 168, \"fy\": 167.2, \"cx\": 81.92, \"cy\": 58.92, \"width\": 160, \"height\": 120, \"blur_score\": 9}";
            let name = view.name.replace(".png", ".json");
            std::fs::write(at(cameras).join(name), text).unwrap();
        }
    };
    let assert_read = |path: &Path, moved: f32| {
        let dataset = load(path);
        assert_eq!((dataset.kind, dataset.views.len()), (DatasetKind::Polycam, 6));
        for (have, want) in dataset.views.iter().zip(&views) {
            assert_eq!(have.name, want.name);
            let position = have.camera.position() - moved;
            assert!(position.abs_diff_eq(want.camera.position(), 1e-4), "{position}");
            assert!(have.camera.rotation.abs_diff_eq(want.camera.rotation, 1e-5));
        }
    };
    write("keyframes/cameras", 5.0);
    assert_read(folder.path(), 5.0);
    assert!(Dataset::is_posed(folder.path()));
    let files = Dataset::files(folder.path(), Path::new("images"), &Limits::DEFAULT);
    assert!(files.contains(&at("keyframes/images/view_0003.png")), "{files:?}");
    // The app closed a loop here.
    std::fs::rename(at("keyframes/images"), at("keyframes/corrected_images")).unwrap();
    write("keyframes/corrected_cameras", 0.0);
    assert_read(folder.path(), 0.0);
    assert_read(&at("keyframes"), 0.0);
}

#[test]
fn raw_exports_of_record3d_are_read() {
    let (folder, views) = six_photos("rgb");
    let at = |name: &str| folder.path().join(name);
    let mut poses: Vec<String> = Vec::new();
    for view in &views {
        let q = DQuat::from_mat3(&gl(view));
        let c = view.camera.position().as_dvec3();
        poses.push(format!("{:?}", [q.x, q.y, q.z, q.w, c.x, c.y, c.z]));
    }
    let text = |poses: &[String], lens: &str| {
        format!("{{\"w\": 160, \"h\": 120, {lens}, \"poses\": [{}]}}", poses.join(","))
    };
    let k = "\"K\": [168, 0, 0, 0, 167.2, 0, 81.92, 58.92, 1]";
    let assert_read = |count: usize| {
        let dataset = load(folder.path());
        assert_eq!((dataset.kind, dataset.views.len()), (DatasetKind::Record3d, count));
        for (have, want) in dataset.views.iter().zip(&views) {
            assert_same_camera(&have.camera, &want.camera, &want.name);
        }
    };
    std::fs::write(at("metadata"), text(&poses, k)).unwrap();
    assert_read(6);
    std::fs::write(at("metadata"), text(&poses[..5], k)).unwrap();
    let error = error_of(folder.path());
    assert!(error.contains("are 5, and rgb holds 6 pictures"), "{error}");
    // Numbered pictures in another order than that of their names, each with its lens; lost
    // tracking.
    std::fs::remove_file(at("metadata")).unwrap();
    for (i, view) in views.iter().enumerate() {
        std::fs::rename(at("rgb").join(&view.name), at("rgb").join(format!("{}.png", 10 * i)))
            .unwrap();
    }
    let mut sparse = vec!["[0, 0, 0, 0, NaN, 0, 0]".to_owned(); 51];
    poses.iter().enumerate().for_each(|(i, pose)| sparse[10 * i].clone_from(pose));
    let each = format!(
        "\"perFrameIntrinsicCoeffs\": [{}]",
        vec!["[168, 167.2, 81.92, 58.92]"; 51].join(",")
    );
    std::fs::write(at("metadata.json"), text(&sparse, &each)).unwrap();
    let dataset = load(folder.path());
    let names: Vec<&str> = dataset.views.iter().map(|view| view.name.as_str()).collect();
    assert_eq!(names, ["0.png", "10.png", "20.png", "30.png", "40.png", "50.png"]);
    assert_same_camera(&dataset.views[2].camera, &views[2].camera, "20.png");
    std::fs::copy(at("rgb/0.png"), at("rgb/7.png")).unwrap();
    assert!(error_of(folder.path()).contains("`skip_broken`"));
    // An app whose poses are not read has its way.
    let other = tempfile::tempdir().unwrap();
    std::fs::write(other.path().join("odometry.csv"), "timestamp, frame, x").unwrap();
    let error = error_of(other.path());
    assert!(error.contains("Stray Scanner") && error.contains("trisplat capture"), "{error}");
}

#[test]
fn a_model_lacks_a_file_or_has_its_photos_elsewhere() {
    let folder = tempfile::tempdir().unwrap();
    copy_sample(folder.path());
    let at = |name: &str| folder.path().join(name);
    let views = load(folder.path()).views;
    std::fs::rename(at("images"), at("photos")).unwrap();
    let dataset = load(folder.path());
    assert_eq!(dataset.views.len(), views.len());
    assert_eq!(dataset.views[7].name, views[7].name);
    assert!(dataset.warnings[0].contains("40 files"), "{:?}", dataset.warnings);
    // Two sizes of each, and masks of the same names.
    std::fs::create_dir(at("photos_2")).unwrap();
    for view in &views {
        std::fs::copy(at("photos").join(&view.name), at("photos_2").join(&view.name)).unwrap();
    }
    let error = error_of(folder.path());
    assert!(error.contains("photos_2") && error.contains("with `images`"), "{error}");
    std::fs::rename(at("photos_2"), at("masks")).unwrap();
    assert!(load(folder.path()).views.iter().all(|view| view.photo.mask.is_some()));
    for (name, kept) in [("images.txt", "cameras.txt"), ("cameras.txt", "points3D.txt")] {
        std::fs::remove_file(at("sparse/0").join(name)).unwrap();
        let error = error_of(folder.path());
        assert!(error.contains("holds a COLMAP model without"), "{error}");
        assert!(error.contains(name), "{error}");
        assert!(error.contains("sparse/0 has only") && error.contains(kept), "{error}");
    }
}
