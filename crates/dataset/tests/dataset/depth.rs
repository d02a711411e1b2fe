//! Depth maps of phones and networks.

use super::*;
use image::{ImageBuffer, Luma};
use trisplat_dataset::describe;

const PHOTOS: SyntheticOptions = SyntheticOptions {
    views: 6,
    width: 160,
    points: 300,
    seed: 0,
    transparent: false,
    phone: false,
    depth: true,
};

/// A COLMAP model with depth maps beside its photos.
fn measured() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    trisplat_synthetic::write(folder.path(), &PHOTOS).unwrap();
    folder
}

/// Ratio of the measured to the true depth in the middle of each pixel of the map.
fn ratios(view: &View) -> Vec<f64> {
    let picture = view.photo.decode_depth().unwrap().expect("a depth map");
    let camera = &view.camera;
    let mut ratios = Vec::new();
    for i in 0..80 * 60 {
        let pixel = Vec2::new((i % 80) as f32 + 0.5, (i / 80) as f32 + 0.5) * 2.0;
        let Some(depth) = picture.depth(pixel) else { continue };
        let ray = ((pixel - camera.center) / camera.focal).extend(1.0);
        let origin = camera.position().as_dvec3();
        let direction = (camera.rotation.transpose() * ray).as_dvec3();
        let hit = trace(Ray { origin, direction }).unwrap();
        ratios.push(f64::from(depth) / hit.distance);
    }
    ratios
}

/// Share of the ratios within 3% of 1.
fn right(ratios: &[f64]) -> f64 {
    let right = ratios.iter().filter(|ratio| (*ratio - 1.0).abs() < 0.03).count();
    right as f64 / ratios.len() as f64
}

#[test]
fn depth_maps_beside_a_model_are_read_by_its_scales() {
    let folder = measured();
    let dataset = load(folder.path());
    assert_eq!(dataset.warnings, Vec::<String>::new());
    for view in &dataset.views {
        let ratios = ratios(view);
        assert!((1000..4700).contains(&ratios.len()), "{} of 4800", ratios.len());
        assert!(right(&ratios) > 0.98, "{}", right(&ratios));
    }
    let figures = describe(&dataset, &Limits::DEFAULT).unwrap();
    let error = figures.depth_error.unwrap();
    assert!(figures.depths == 6 && (0.003..0.012).contains(&error), "{error}");
    // Without the file of scales, and with scales that are none.
    let params = folder.path().join("sparse/0/depth_params.json");
    let text = std::fs::read_to_string(&params).unwrap();
    std::fs::write(&params, text.replacen("2.0", "NaN", 1).replacen("2.0", "-1.0", 1)).unwrap();
    let dataset = load(folder.path());
    assert_eq!(describe(&dataset, &Limits::DEFAULT).unwrap().depths, 4);
    assert!(dataset.warnings[0].starts_with("2 of 6 photos have no depth map in"));
    std::fs::write(&params, "{\"view_0000\": 3").unwrap();
    assert!(error_of(folder.path()).contains("depth_params.json: line 1"));
    std::fs::remove_file(&params).unwrap();
    let warnings = load(folder.path()).warnings;
    assert!(warnings[0].contains("depth_params.json, which make_depth_scale.py"), "{warnings:?}");
}

#[test]
fn depth_maps_follow_distortion_and_crops() {
    let folder = measured();
    let exact = load(folder.path());
    // The photos stay, so that only the mapping from pixels to the map is tested.
    let cameras = folder.path().join("sparse/0/cameras.txt");
    let text = std::fs::read_to_string(&cameras).unwrap();
    let line = text.lines().find(|line| line.contains("PINHOLE")).unwrap();
    let bent = line.replace("PINHOLE", "OPENCV") + " 0.2 0.05 0.01 -0.01";
    std::fs::write(&cameras, bent).unwrap();
    let dataset = load(folder.path());
    let [bent, whole] = [&dataset, &exact].map(|dataset| &dataset.views[1]);
    let [bent_map, map] = [bent, whole].map(|view| view.photo.decode_depth().unwrap().unwrap());
    let pixels = bent.photo.decode().unwrap();
    let source = whole.photo.decode().unwrap();
    assert!(pixels.size != source.size);
    // A pixel at the middle stays there, one at the border moves.
    let middle = bent.camera.center;
    let [a, b] = [(bent_map, middle), (map.clone(), whole.camera.center)]
        .map(|(map, at)| map.depth(at).unwrap());
    // Maps are scaled to the points, whose places differ.
    assert!((a / b - 1.0).abs() < 0.02, "{a} {b}");
    let part = whole.cropped(UVec2::new(40, 30), UVec2::new(80, 60)).unwrap();
    let part = part.photo.decode_depth().unwrap().unwrap();
    for i in 0..80 * 60 {
        let pixel = Vec2::new((i % 80) as f32 + 0.5, (i / 80) as f32 + 0.5);
        assert_eq!(part.depth(pixel), map.depth(pixel + Vec2::new(40.0, 30.0)));
    }
}

/// A `transforms.json` of the photos and points, whose frames have these keys too.
fn transforms(folder: &Path, shared: &str, own: impl Fn(&View) -> String) -> PathBuf {
    let dataset = load(folder);
    let points: String = dataset
        .points
        .iter()
        .map(|p| format!("{} {} {}\n", p.position.x, p.position.y, p.position.z))
        .collect();
    let header = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
        dataset.points.len()
    );
    std::fs::write(folder.join("points.ply"), header + &points).unwrap();
    let rows = super::transforms::frames(&dataset.views, |v| format!("images/{}", v.name), own);
    let lens = "\"fl_x\": 168, \"fl_y\": 167.2, \"cx\": 81.92, \"cy\": 58.92";
    let file = folder.join("transforms.json");
    let text =
        format!("{{{lens}, {shared} \"ply_file_path\": \"points.ply\", \"frames\": [{rows}]}}");
    std::fs::write(&file, text).unwrap();
    file
}

/// Writes a map of 40x30 px of the true depth, times `scale`, for each view.
fn write_depths(folder: &Path, scale: f64) {
    std::fs::create_dir_all(folder.join("lidar")).unwrap();
    for view in load(folder).views {
        let camera = view.camera;
        let map = ImageBuffer::from_fn(40, 30, |x, y| {
            let pixel = (Vec2::new(x as f32, y as f32) + 0.5) * 4.0;
            let ray = ((pixel - camera.center) / camera.focal).extend(1.0);
            let origin = camera.position().as_dvec3();
            let direction = (camera.rotation.transpose() * ray).as_dvec3();
            let hit = trace(Ray { origin, direction }).filter(|hit| !hit.sky);
            Luma([hit.map_or(0, |hit| (scale * hit.distance).round() as u16)])
        });
        map.save(folder.join("lidar").join(&view.name)).unwrap();
    }
}

#[test]
fn depth_of_transforms_is_millimetres_or_what_the_file_says() {
    let folder = measured();
    write_depths(folder.path(), 1000.0);
    let own = |view: &View| format!("\"depth_file_path\": \"./lidar/{}\",", view.name);
    let error = |file: &Path, warning: Option<&str>| {
        let dataset = load(file);
        let told = dataset.warnings.iter().any(|line| line.contains(warning.unwrap_or("depth")));
        assert_eq!(told, warning.is_some(), "{:?}", dataset.warnings);
        let figures = describe(&dataset, &Limits::DEFAULT).unwrap();
        figures.depth_error.filter(|_| figures.depths == 6)
    };
    let file = transforms(folder.path(), "", own);
    let first = error(&file, None).unwrap();
    assert!(first < 0.02, "{first}");
    write_depths(folder.path(), 400.0);
    let file = transforms(folder.path(), "\"depth_unit_scale_factor\": 0.0025,", own);
    assert!(error(&file, None).unwrap() < 0.02);
    // Of another unit than the poses.
    let file = transforms(folder.path(), "", own);
    assert!(error(&file, Some("are multiplied by 2.5")).unwrap() < 0.02);
    let file = transforms(folder.path(), "\"depth_unit_scale_factor\": -1,", own);
    assert!(error_of(&file).contains("depth_unit_scale_factor is -1"), "{}", error_of(&file));
    // Of another scene.
    for view in load(folder.path()).views {
        let noise = |x: u32, y: u32| Luma([1000 + ((x * 7919 + y * 104_729) % 9000) as u16]);
        ImageBuffer::from_fn(40, 30, noise)
            .save(folder.path().join("lidar").join(&view.name))
            .unwrap();
    }
    let file = transforms(folder.path(), "", own);
    assert_eq!(error(&file, Some("depth maps are not used: at half of the points")), None);
}

#[test]
fn bad_depth_maps_are_told_or_refused_by_name() {
    let folder = measured();
    write_depths(folder.path(), 1000.0);
    let own = |name: &'static str| {
        move |view: &View| {
            let name = if view.name == "view_0002.png" { name } else { &view.name };
            format!("\"depth_file_path\": \"lidar/{name}\",")
        }
    };
    for name in ["missing.png", "map.npy"] {
        std::fs::write(folder.path().join("lidar/map.npy"), "").unwrap();
        let dataset = load(&transforms(folder.path(), "", own(name)));
        let line = format!("missing or no PNG, first `lidar/{name}`");
        assert!(dataset.warnings.iter().any(|w| w.contains(&line)), "{:?}", dataset.warnings);
        assert_eq!(describe(&dataset, &Limits::DEFAULT).unwrap().depths, 5);
    }
    let odd = folder.path().join("lidar/odd.png");
    let file = transforms(folder.path(), "", own("odd.png"));
    let square = image::GrayImage::new(30, 30);
    let colours = image::RgbImage::from_fn(40, 30, |x, y| image::Rgb([x as u8, y as u8, 9]));
    for (picture, part) in [
        (image::DynamicImage::from(square), "odd.png: size: is 30x30, its photo 160x120"),
        (colours.into(), "odd.png: is no grey PNG"),
    ] {
        picture.save(&odd).unwrap();
        assert!(error_of(&file).contains(part), "{}", error_of(&file));
    }
    let whole = std::fs::read(folder.path().join("lidar/view_0001.png")).unwrap();
    std::fs::write(&odd, &whole[..whole.len() / 2]).unwrap();
    assert!(error_of(&file).contains("odd.png"), "{}", error_of(&file));
}

#[test]
fn depth_of_polycam_is_found_beside_its_cameras() {
    let folder = tempfile::tempdir().unwrap();
    trisplat_synthetic::write(folder.path(), &PHOTOS).unwrap();
    write_depths(folder.path(), 1000.0);
    let views = load(folder.path()).views;
    let raw = tempfile::tempdir().unwrap();
    let at = |name: &str| raw.path().join("keyframes").join(name);
    for name in ["cameras", "images", "depth"] {
        std::fs::create_dir_all(at(name)).unwrap();
    }
    for view in &views {
        let stem = view.name.trim_end_matches(".png");
        std::fs::copy(&view.photo.path, at("images").join(&view.name)).unwrap();
        std::fs::copy(folder.path().join("lidar").join(&view.name), at("depth").join(&view.name))
            .unwrap();
        let turn = view.camera.rotation.transpose();
        let place = view.camera.position();
        let rows: String = (0..3)
            .map(|r| {
                let row = [turn.x_axis[r], -turn.y_axis[r], -turn.z_axis[r], place[r]];
                (0..4).map(|c| format!("\"t_{r}{c}\": {}, ", row[c])).collect::<String>()
            })
            .collect();
        let lens = "\"fx\": 168, \"fy\": 167.2, \"cx\": 81.92, \"cy\": 58.92, \"width\": 160, \"height\": 120";
        std::fs::write(at("cameras").join(format!("{stem}.json")), format!("{{{rows}{lens}}}"))
            .unwrap();
    }
    let dataset = load(raw.path());
    assert_eq!(dataset.kind, DatasetKind::Polycam);
    for view in &dataset.views {
        let picture = view.photo.decode_depth().unwrap().expect("a depth map");
        assert!(picture.depth(Vec2::new(80.0, 70.0)).is_some(), "{}", view.name);
    }
}
