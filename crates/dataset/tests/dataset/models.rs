//! Models that fell apart, points of others, poses that hang on nothing, photos that are none.

use super::*;
use glam::DMat3;

/// The rows of the sample's images.txt: a pose and its observations.
fn image_rows(sparse: &Path) -> Vec<[String; 2]> {
    let text = std::fs::read_to_string(sparse.join("images.txt")).unwrap();
    let lines: Vec<&str> = text.lines().filter(|line| !line.starts_with('#')).collect();
    lines.chunks(2).map(|pair| [pair[0].to_owned(), pair[1].to_owned()]).collect()
}

fn write_rows(sparse: &Path, rows: &[[String; 2]]) {
    let text: String = rows.iter().map(|[pose, seen]| format!("{pose}\n{seen}\n")).collect();
    std::fs::write(sparse.join("images.txt"), text).unwrap();
}

#[test]
fn of_several_models_the_largest_is_taken_and_named() {
    let folder = tempfile::tempdir().unwrap();
    copy_sample(folder.path());
    let [first, second] = ["sparse/0", "sparse/10"].map(|name| folder.path().join(name));
    std::fs::create_dir_all(&second).unwrap();
    for name in ["cameras.txt", "images.txt", "points3D.txt"] {
        std::fs::copy(first.join(name), second.join(name)).unwrap();
    }
    write_rows(&first, &image_rows(&second)[..2]);
    for path in [folder.path().to_owned(), folder.path().join("sparse")] {
        let dataset = load(&path);
        assert_eq!(dataset.views.len(), 40);
        let [warning] = &dataset.warnings[..] else { panic!("{:?}", dataset.warnings) };
        assert!(warning.contains("10 is used, of 40 photos; the others have 2"), "{warning}");
        assert!(dataset.reprojection(&Limits::DEFAULT).unwrap().unwrap().observations > 8000);
    }
    assert_eq!(load(&second).warnings, [""; 0], "a model that was asked for");
    assert_eq!(load(&first).views.len(), 2);
}

#[test]
fn a_model_of_another_convention_is_named_with_the_way() {
    let folder = tempfile::tempdir().unwrap();
    copy_sample(folder.path());
    let views = load(folder.path()).views;
    let sparse = folder.path().join("sparse/0");
    let rows = image_rows(&sparse);
    type Change = fn(DMat3, DVec3) -> (DMat3, DVec3);
    let changes: [(Change, &str); 2] = [
        (
            |rotation, t| (rotation.transpose(), -(rotation.transpose() * t)),
            "from camera to world: invert each pose",
        ),
        (
            |rotation, t| {
                let turn = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
                (turn * rotation, turn * t)
            },
            "with OpenGL's axes (x right, y up, z back): multiply rows 2 and 3",
        ),
    ];
    for (change, part) in changes {
        let changed: Vec<[String; 2]> = rows
            .iter()
            .zip(&views)
            .map(|([_, seen], view)| {
                let camera = view.camera;
                let (rotation, t) =
                    change(camera.rotation.as_dmat3(), camera.translation.as_dvec3());
                let q = glam::DQuat::from_mat3(&rotation);
                let pose = format!(
                    "1 {} {} {} {} {} {} {} 1 {}",
                    q.w, q.x, q.y, q.z, t.x, t.y, t.z, view.name
                );
                [pose, seen.clone()]
            })
            .collect();
        write_rows(&sparse, &changed);
        let dataset = load(folder.path());
        assert!(dataset.warnings[0].contains(part), "{:?}", dataset.warnings);
        assert_eq!(dataset.points, []);
    }
}

#[test]
fn points_of_another_reconstruction_are_named_and_not_used() {
    let folder = tempfile::tempdir().unwrap();
    copy_sample(folder.path());
    let points = folder.path().join("sparse/0/points3D.txt");
    let text = std::fs::read_to_string(&points).unwrap();
    let rows = || text.lines().filter(|line| !line.starts_with('#'));
    let renumbered = |row: &str| format!("70000{row}\n");
    std::fs::write(&points, rows().map(renumbered).collect::<String>()).unwrap();
    let dataset = load(folder.path());
    assert!(
        dataset.warnings[0].contains("none of the points of 8833 observations exists"),
        "{:?}",
        dataset.warnings
    );
    assert_eq!(dataset.points, []);
    // The same numbers at other places.
    let places: Vec<&str> = rows().map(|row| row.split_once(' ').unwrap().1).collect();
    let mixed = |(i, row): (usize, &str)| {
        format!("{} {}\n", row.split_once(' ').unwrap().0, places[(i + 700) % places.len()])
    };
    std::fs::write(&points, rows().enumerate().map(mixed).collect::<String>()).unwrap();
    let dataset = load(folder.path());
    assert!(dataset.warnings[0].contains("another reconstruction"), "{:?}", dataset.warnings);
    // A part of the right ones is right, and so are observations at twice the size.
    let some: String = rows().step_by(20).map(|row| format!("{row}\n")).collect();
    std::fs::write(&points, some).unwrap();
    assert_eq!((load(folder.path()).points.len(), load(folder.path()).warnings), (75, vec![]));
}

#[test]
fn a_pose_that_hangs_on_nothing_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    copy_sample(folder.path());
    let sparse = folder.path().join("sparse/0");
    let mut rows = image_rows(&sparse);
    let words: Vec<&str> = rows[7][1].split(' ').collect();
    rows[7][1] = words[..6].join(" ");
    write_rows(&sparse, &rows);
    let dataset = load(folder.path());
    assert_eq!(dataset.views.len(), 39);
    let [warning] = &dataset.warnings[..] else { panic!("{:?}", dataset.warnings) };
    assert!(
        warning.contains("1 of 40 photos left out") && warning.contains("`view_0007.png`: 2"),
        "{warning}"
    );
}

#[test]
fn a_pose_far_outside_is_left_out_and_a_far_photo_is_not() {
    for (far, left) in [(40.0, 40), (190_000.0, 39)] {
        let folder = tempfile::tempdir().unwrap();
        copy_sample(folder.path());
        let sparse = folder.path().join("sparse/0");
        let mut rows = image_rows(&sparse);
        let mut words: Vec<String> = rows[3][0].split(' ').map(str::to_owned).collect();
        words[7] = far.to_string();
        rows[3][0] = words.join(" ");
        write_rows(&sparse, &rows);
        let dataset = load(folder.path());
        assert_eq!(dataset.views.len(), left, "{:?}", dataset.warnings);
        assert_eq!(dataset.origin, DVec3::ZERO);
        if left < 40 {
            assert!(
                dataset.warnings[0].contains("far outside (`view_0003.png`"),
                "{:?}",
                dataset.warnings
            );
        }
    }
}

#[test]
fn good_captures_keep_all_their_photos() {
    for name in [
        "banana",
        "bonsai",
        "bonsai24",
        "brighton_beach",
        "dtu_scan24",
        "fox",
        "fox480",
        "mug",
        "plush",
    ] {
        let Some(path) = real(name) else { continue };
        if !path.join("sparse").is_dir() {
            continue;
        }
        let all = DatasetOptions { test_every: 0, ..DatasetOptions::default() };
        let warnings = Dataset::load(&path, &all).unwrap().warnings;
        assert!(
            !warnings.iter().any(|w| w.contains("left out") || w.contains("another recon")),
            "{name}: {warnings:?}"
        );
    }
}

#[test]
fn photos_that_are_none_say_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    copy_sample(folder.path());
    let photo = folder.path().join("images/view_0002.png");
    for (bytes, part) in [
        ("", "is empty (0 bytes)"),
        ("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n", "`git lfs pull`"),
    ] {
        std::fs::write(&photo, bytes).unwrap();
        let error = error_of(folder.path());
        assert!(error.contains("view_0002.png") && error.contains(part), "{error}");
    }
}

#[test]
fn a_photo_that_exif_turns_is_told() {
    let folder = tempfile::tempdir().unwrap();
    copy_sample(folder.path());
    let turned = RgbImage { size: UVec2::new(120, 160), rgb: vec![[9; 3]; 160 * 120], alpha: None };
    let jpeg = turned.to_jpeg(90).unwrap();
    // One entry: the orientation, 6.
    let exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";
    let length = (2 + exif.len() as u16).to_be_bytes();
    let bytes = [&jpeg[..2], &[0xff, 0xe1], &length, exif, &jpeg[2..]].concat();
    std::fs::write(folder.path().join("images/view_0002.png"), bytes).unwrap();
    let error = error_of(folder.path());
    assert!(error.contains("EXIF orientation, 6") && error.contains("auto-orient"), "{error}");
}
