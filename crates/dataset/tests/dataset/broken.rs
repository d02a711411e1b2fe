//! Files that lie, and files that are cut short.

use super::*;

#[test]
fn missing_and_broken_photos_are_errors_unless_skipped() {
    let folder = tempfile::tempdir().unwrap();
    copy_sample(folder.path());
    let photo = |i: u32| folder.path().join(format!("images/view_{i:04}.png"));
    std::fs::remove_file(photo(3)).unwrap();
    let bytes = std::fs::read(photo(7)).unwrap();
    std::fs::write(photo(7), &bytes[..bytes.len() / 2]).unwrap();
    let error = error_of(folder.path());
    for part in ["images.txt", "view_0003.png", "2 of 40", "`skip_broken`"] {
        assert!(error.contains(part), "`{part}` is missing from: {error}");
    }
    let options = DatasetOptions { skip_broken: true, ..DatasetOptions::default() };
    let dataset = Dataset::load(folder.path(), &options).unwrap();
    assert_eq!(dataset.views.len(), 38);
    assert!(dataset.warnings.iter().any(|w| w.contains("2 of 40")), "{:?}", dataset.warnings);
    for index in 0..40 {
        std::fs::write(photo(index), "").unwrap();
    }
    assert!(
        Dataset::load(folder.path(), &options)
            .unwrap_err()
            .to_string()
            .contains("no photo is left")
    );
}

#[test]
fn a_strip_is_no_photo() {
    let folder = tempfile::tempdir().unwrap();
    copy_sample(folder.path());
    image::GrayImage::new(1, 30_000).save(folder.path().join("images/view_0003.png")).unwrap();
    let error = error_of(folder.path());
    for part in ["view_0003.png", "is 1x30000 px; expected one side at most 64 times the other"] {
        assert!(error.contains(part), "`{part}` is missing from: {error}");
    }
}

#[test]
fn a_lens_beyond_the_range_is_refused_with_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    copy_sample(folder.path());
    let file = folder.path().join("sparse/0/cameras.txt");
    let text = std::fs::read_to_string(&file).unwrap();
    for [from, to] in [["168", "1e30"], ["81.92", "1e38"]] {
        assert!(text.contains(from));
        std::fs::write(&file, text.replacen(from, to, 1)).unwrap();
        let error = error_of(folder.path());
        assert!(error.contains("0.001 to 100,000 times the longer side"), "{error}");
    }
}

#[test]
fn cameras_beyond_float_range_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    copy_sample(folder.path());
    let scaled = |name: &str, columns: std::ops::Range<usize>, scale: f64, every: usize| {
        let text = std::fs::read_to_string(sample("dataset").join("sparse/0").join(name)).unwrap();
        let rows = text.lines().filter(|line| !line.starts_with('#')).enumerate();
        let row = |(row, line): (usize, &str)| {
            let moved = |(column, word): (usize, &str)| match word.parse::<f64>() {
                Ok(number) if columns.contains(&column) && row % every == 0 => {
                    format!("{:e}", scale * number)
                }
                _ => word.to_owned(),
            };
            line.split(' ').enumerate().map(moved).collect::<Vec<_>>().join(" ")
        };
        let text = rows.map(row).collect::<Vec<_>>().join("\n") + "\n";
        std::fs::write(folder.path().join("sparse/0").join(name), text).unwrap();
    };
    for scale in [1e16, 1e20, 1e30, 1e200] {
        scaled("images.txt", 5..8, scale, 2);
        let error = error_of(folder.path());
        assert!(
            error.contains("images.txt: photo `view_") && error.contains("the limit is 1e15"),
            "{error}"
        );
    }
    scaled("images.txt", 5..8, 1.0, 2);
    scaled("points3D.txt", 1..4, 1e18, 100);
    let dataset = load(folder.path());
    assert!(
        dataset.warnings.iter().any(|w| w.contains("or farther than 1e15")),
        "{:?}",
        dataset.warnings
    );
}

#[test]
fn a_long_word_of_a_file_is_an_excerpt_in_the_message() {
    let folder = tempfile::tempdir().unwrap();
    copy_sample(folder.path());
    let long = "9x".repeat(1 << 20);
    let says = |error: String, part: &str| {
        assert!(
            error.contains(part) && error.chars().count() < 400 + folder.path().as_os_str().len(),
            "{error:.900}"
        );
    };
    std::fs::write(
        folder.path().join("sparse/0/cameras.txt"),
        format!("1 PINHOLE {long} 120 1 1 1 1\n"),
    )
    .unwrap();
    says(error_of(folder.path()), "the width `9x9x");
    std::fs::remove_dir_all(folder.path().join("sparse")).unwrap();
    std::fs::write(folder.path().join("transforms.json"), format!(r#"{{"frames": "{long}"}}"#))
        .unwrap();
    says(error_of(folder.path()), "transforms.json");
    std::fs::remove_file(folder.path().join("transforms.json")).unwrap();
    std::fs::write(
        folder.path().join("poses.csv"),
        format!("#name,x,y,alt,yaw,pitch,roll,f_35mm\n{long},a"),
    )
    .unwrap();
    says(error_of(&folder.path().join("poses.csv")), "poses.csv");
    std::fs::write(folder.path().join("cameras.xml"), format!("<a>{long}</b>")).unwrap();
    says(error_of(folder.path()), "cameras.xml");
}

#[test]
fn errors_name_the_file_and_the_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    assert!(error_of(path).contains("COLMAP"), "an empty folder");
    assert!(error_of(&path.join("nowhere")).contains("nowhere"));
    std::fs::write(path.join("a.txt"), "").unwrap();
    assert!(error_of(&path.join("a.txt")).contains("transforms.json"));
    copy_sample(path);

    let spoil = |name: &str, from: &str, to: &str, parts: &[&str]| {
        let file = path.join(name);
        let text = std::fs::read_to_string(&file).unwrap();
        assert!(text.contains(from), "{name} holds no {from}");
        std::fs::write(&file, text.replacen(from, to, 1)).unwrap();
        let error = error_of(path);
        for part in [name].iter().chain(parts) {
            assert!(error.contains(part), "`{part}` is missing from: {error}");
        }
        std::fs::write(&file, text).unwrap();
    };
    spoil("sparse/0/cameras.txt", "PINHOLE", "FOV", &["FOV", "image_undistorter"]);
    spoil("sparse/0/cameras.txt", "160 120", "0 120", &["0x120"]);
    spoil("sparse/0/cameras.txt", "168", "one", &["line 2", "one"]);
    spoil(
        "sparse/0/images.txt",
        "1 view_0004.png",
        "9 view_0004.png",
        &["view_0004.png", "camera 9"],
    );
    spoil("sparse/0/images.txt", "view_0004.png", "view_0005.png", &["view_0005.png", "twice"]);
    spoil("sparse/0/points3D.txt", "\n1 ", "\n1 x ", &["line 2", "position"]);
}

#[test]
fn a_test_list_may_be_wrong_in_part_but_not_in_whole() {
    let folder = tempfile::tempdir().unwrap();
    copy_sample(folder.path());
    let list = folder.path().join("test.txt");
    std::fs::write(&list, "view_0001\nview_9999.png\n\n").unwrap();
    let dataset = load(folder.path());
    assert_eq!(dataset.test().map(|v| v.name.as_str()).collect::<Vec<_>>(), ["view_0001.png"]);
    assert!(dataset.warnings[0].contains("view_9999.png"));
    std::fs::write(&list, "other.png\n").unwrap();
    assert!(error_of(folder.path()).contains("test.txt"));
    let everything: String = dataset.views.iter().map(|v| v.name.clone() + "\n").collect();
    std::fs::write(&list, everything).unwrap();
    assert!(error_of(folder.path()).contains("`test_every` 0"));
    std::fs::remove_file(&list).unwrap();
    let every = |n| DatasetOptions { test_every: n, ..DatasetOptions::default() };
    for (n, count) in [(8, 5), (3, 14), (0, 0), (100, 1)] {
        assert_eq!(
            Dataset::load(folder.path(), &every(n)).unwrap().test().count(),
            count,
            "every {n}"
        );
    }
}

#[test]
fn photos_of_another_shape_than_their_camera_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    copy_sample(folder.path());
    let turned = RgbImage { size: UVec2::new(120, 160), rgb: vec![[9; 3]; 160 * 120], alpha: None };
    turned.save_png(folder.path().join("images/view_0002.png")).unwrap();
    let error = error_of(folder.path());
    assert!(error.contains("120x160") && error.contains("view_0002.png"), "{error}");
}

/// A small model in COLMAP's binary files.
fn binary_model() -> [(&'static str, Vec<u8>); 3] {
    let u64s = |n: u64| n.to_le_bytes().to_vec();
    let f64s = |numbers: &[f64]| numbers.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let mut cameras = [u64s(1), 1u32.to_le_bytes().to_vec(), 1i32.to_le_bytes().to_vec()].concat();
    cameras.extend([u64s(160), u64s(120), f64s(&[168.0, 167.2, 81.92, 58.92])].concat());
    let mut images = u64s(2);
    for index in 0..2u32 {
        images.extend((index + 1).to_le_bytes());
        images.extend(f64s(&[1.0, 0.0, 0.1, 0.0, f64::from(index), 0.5, 2.0]));
        images.extend(1u32.to_le_bytes());
        images.extend(format!("view_{index:04}.png\0").bytes());
        images.extend(u64s(3));
        for point in [7u64, u64::MAX, 9] {
            images.extend(f64s(&[80.0, 60.0]));
            images.extend(u64s(point));
        }
    }
    let mut points = u64s(2);
    for id in [7u64, 9] {
        points.extend(u64s(id));
        points.extend(f64s(&[0.1, -0.2, 3.0]));
        points.extend([10, 20, 30]);
        points.extend(f64s(&[0.5]));
        points.extend(u64s(1));
        points.extend([1, 0, 0, 0, 0, 0, 0, 0]);
    }
    [("cameras.bin", cameras), ("images.bin", images), ("points3D.bin", points)]
}

#[test]
fn poses_of_colmap_that_are_none_are_left_out_if_wanted() {
    let folder = tempfile::tempdir().unwrap();
    copy_sample(folder.path());
    let sparse = folder.path().join("sparse/0");
    let list = sparse.join("images.txt");
    let text = std::fs::read_to_string(&list).unwrap();
    let skipping = DatasetOptions { skip_broken: true, ..DatasetOptions::default() };
    let pose = |line: &str, numbers: &str| {
        let tail: Vec<&str> = line.split(' ').skip(8).collect();
        format!("1 {numbers} {}", tail.join(" "))
    };
    let first = text.lines().find(|line| line.ends_with("view_0000.png")).unwrap();
    for numbers in ["nan nan nan nan 0 0 4", "1 0 0 0 0 -nan 4", "0 0 0 0 0 0 4", "1 0 0 0 inf 0 4"]
    {
        std::fs::write(&list, text.replace(first, &pose(first, numbers))).unwrap();
        let error = error_of(folder.path());
        for part in
            ["images.txt", "view_0000.png", "line 3", "has no pose", "1 of 40", "skip_broken"]
        {
            assert!(error.contains(part), "`{part}` is missing from: {error}");
        }
        let dataset = Dataset::load(folder.path(), &skipping).unwrap();
        assert_eq!(dataset.views.len(), 39);
        assert!(dataset.warnings[0].contains("left out"), "{:?}", dataset.warnings);
        assert!(dataset.reprojection(&Limits::DEFAULT).unwrap().unwrap().mean_px < 1.0);
    }
    std::fs::remove_file(folder.path().join("test.txt")).unwrap();
    let mut model = binary_model();
    model[1].1[12..20].copy_from_slice(&f64::NAN.to_le_bytes());
    for (name, bytes) in &model {
        std::fs::write(sparse.join(name), bytes).unwrap();
    }
    assert!(error_of(folder.path()).contains("image `view_0000.png` has no pose"));
    assert_eq!(Dataset::load(folder.path(), &skipping).unwrap().views.len(), 1);
}

#[test]
fn colmap_binary_cuts_and_flipped_bytes_are_survived() {
    let folder = tempfile::tempdir().unwrap();
    copy_sample(folder.path());
    let sparse = folder.path().join("sparse/0");
    let model = binary_model();
    for (name, bytes) in &model {
        std::fs::write(sparse.join(name), bytes).unwrap();
    }
    let whole = load(folder.path());
    assert_eq!(
        (whole.kind, whole.views.len(), whole.points.len()),
        (DatasetKind::ColmapBinary, 2, 2)
    );
    assert_eq!(whole.points[0].rgb, [10, 20, 30]);
    let measured = whole.reprojection(&Limits::DEFAULT).unwrap().unwrap();
    assert_eq!(measured.observations, 4, "the observation without a point does not count");
    for (name, bytes) in &model {
        let file = sparse.join(name);
        for len in 0..bytes.len() {
            std::fs::write(&file, &bytes[..len]).unwrap();
            let error = error_of(folder.path());
            assert!(error.contains(name), "{name} cut at {len}: {error}");
        }
        std::fs::write(&file, [bytes.as_slice(), &[0]].concat()).unwrap();
        assert!(error_of(folder.path()).contains(name), "{name} with a byte too many");
        for at in 0..bytes.len() {
            for flip in [0xff, 0x80, 0x01] {
                let mut spoilt = bytes.clone();
                spoilt[at] ^= flip;
                std::fs::write(&file, &spoilt).unwrap();
                // Either it still is a data set, and then a valid one, or it says what is wrong.
                if let Ok(dataset) = Dataset::load(folder.path(), &DatasetOptions::default()) {
                    assert!(
                        dataset
                            .views
                            .iter()
                            .all(|v| v.camera.validate(&trisplat_scene::Limits::DEFAULT).is_ok()),
                        "{name} {at}"
                    );
                    assert!(dataset.points.iter().all(|p| p.position.is_finite()), "{name} {at}");
                }
            }
        }
        std::fs::write(&file, bytes).unwrap();
    }
}
