//! Cameras in a list beside Gaussians.

use super::*;

#[test]
fn splat_cameras_are_found_and_broken_ones_are_a_warning() {
    let folder = tempfile::tempdir().expect("a folder");
    let output = folder.path().join("point_cloud/iteration_30000");
    std::fs::create_dir_all(&output).expect("a folder");
    let one = r#"[{"id":0,"img_name":"a.jpg","width":64,"height":48,"position":[1,2,3],
        "rotation":[[0,0,1],[1,0,0],[0,1,0]],"fx":50,"fy":51}]"#;
    let bytes = ply(&owned(&PLAIN), "float", &[plain_row()]);
    std::fs::write(folder.path().join("cameras.json"), one).expect("writable");
    let loaded = read_in(&output, "point_cloud.ply", &bytes, &options()).expect("valid");
    let (name, camera) = &loaded.cameras[0];
    assert_eq!((name.as_str(), camera.center.to_array()), ("a.jpg", [32.0, 24.0]));
    assert!(close(camera.position(), Vec3::new(1.0, 2.0, 3.0), 1e-6));
    // The third column of the rotation is where the camera looks.
    assert!(close(camera.rotation.transpose() * Vec3::Z, Vec3::X, 1e-6));

    for broken in
        ["[{]", "[]", &one.replace("[0,0,1]", "[0,0,2]"), &one.replace("\"fx\":50", "\"fx\":-1")]
    {
        std::fs::write(folder.path().join("a.cameras.json"), broken).expect("writable");
        let loaded = read_in(folder.path(), "a.ply", &bytes, &options()).expect("valid");
        assert!(
            loaded.cameras.is_empty() && loaded.warnings[0].contains("a.cameras.json"),
            "{:?}",
            loaded.warnings
        );
    }
}

/// Gaussians on an ellipsoid beside the origin, and a list of cameras around it; `file` moves the
/// Gaussians.
fn seen_from_around(folder: &Path, file: impl Fn(DVec3) -> DVec3) -> ImportedSplats {
    let middle = DVec3::new(4.0, 3.0, -2.0);
    let row = |i: usize| {
        let turn = 2.4 * i as f64;
        let z = 1.0 - 2.0 * (i as f64 + 0.5) / 900.0;
        let round = (1.0 - z * z).sqrt();
        let place =
            file(middle + DVec3::new(2.0 * round * turn.cos(), round * turn.sin(), 0.6 * z));
        [&place.to_array()[..], &[0.5, -0.5, 1.0, 3.0, -3.0, -3.0, -3.0, 1.0, 0.0, 0.0, 0.0]]
            .concat()
    };
    let rows: Vec<Vec<f64>> = (0..900).map(row).collect();
    let camera = |i: usize| {
        let turn = 0.3 * i as f64;
        let eye = middle + DVec3::new(3.0 * turn.cos(), 2.0 * turn.sin(), 2.0);
        let forward = (middle - eye).normalize();
        let right = forward.cross(DVec3::Z).normalize();
        let down = forward.cross(right);
        let rows = [0, 1, 2].map(|axis| [right[axis], down[axis], forward[axis]]);
        serde_json::json!({"img_name": format!("{i}.jpg"), "width": 64, "height": 48, "position": eye.to_array(),
            "rotation": rows, "fx": 40.0, "fy": 40.0})
    };
    let cameras: Vec<_> = (0..21).map(camera).collect();
    std::fs::write(folder.join("cameras.json"), serde_json::Value::from(cameras).to_string())
        .expect("writable");
    read_in(folder, "a.ply", &ply(&owned(&PLAIN), "float", &rows), &options()).expect("valid")
}

#[test]
fn cameras_of_another_frame_are_turned_of_another_scene_unused() {
    let folder = tempfile::tempdir().expect("a folder");
    let own = seen_from_around(folder.path(), |place| place);
    assert_eq!((own.cameras.len(), &own.warnings), (21, &Vec::new()));
    let other = seen_from_around(folder.path(), |place| DVec3::new(place.x, -place.y, -place.z));
    assert!(other.warnings[0].contains("(x, -y, -z)"), "{:?}", other.warnings);
    for ((_, camera), (_, turned)) in own.cameras.iter().zip(&other.cameras) {
        for (point, other) in own.splats.positions.iter().zip(&other.splats.positions) {
            let [a, b] = [camera.project(*point), turned.project(*other)];
            assert!(
                a.zip(b).is_none_or(|((a, _), (b, _))| a.distance(b) < 1e-3),
                "the same picture"
            );
        }
    }
    let other = seen_from_around(folder.path(), |place| place + 100.0 * DVec3::Z);
    assert!(
        other.cameras.is_empty() && other.warnings[0].contains("not used"),
        "{:?}",
        other.warnings
    );
}
