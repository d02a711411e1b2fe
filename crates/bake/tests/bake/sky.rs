//! `--backdrop sky`: a panorama of the surroundings, by pixels.

use super::photos::{grey, photograph, scene, views};
use base64::{Engine, engine::general_purpose::STANDARD as BASE64};
use glam::Vec3;
use std::path::Path;
use trisplat_bake::{BackdropWhen, Bake, BakeOptions, BakePreset};
use trisplat_scene::{
    Asset, ImportedScene,
    image::RgbImage,
    math::color::srgb_from_linear,
    math::geometry::octasphere,
    mesh::{Colors, Mesh},
    report::Report,
};

/// The colour of the surroundings in a direction.
fn around(direction: Vec3) -> [f32; 3] {
    let d = direction.normalize();
    [0.3 + 0.25 * d.x, 0.4 - 0.3 * d.y, 0.3 + 0.25 * d.z]
}

/// A sphere of radius 20 with a colour per corner, or with one per face that has nothing to do with
/// it.
pub(super) fn sphere(gems: bool) -> Mesh {
    let (corners, faces) = octasphere(if gems { 2 } else { 5 });
    let positions: Vec<Vec3> =
        faces.iter().flat_map(|f| f.map(|i| 20.0 * corners[i as usize])).collect();
    let colors = if gems {
        Colors::Face((0..faces.len()).map(|i| [(i * 7 % 10) as f32 / 10.0; 3]).collect())
    } else {
        Colors::Vertex(positions.iter().map(|p| around(*p)).collect())
    };
    Mesh { shell: vec![gems; faces.len()], positions, colors, ..Mesh::default() }
}

/// The scene of the photos with a shell of gems behind it, and photos of it with the true
/// surroundings.
fn photographed() -> (Mesh, tempfile::TempDir, trisplat_dataset::Dataset) {
    let mut truth = grey(&scene());
    let mut trained = grey(&scene());
    truth.append(sphere(false)).unwrap();
    let (folder, dataset) = photograph(&truth, |_, photo| photo);
    trained.append(sphere(true)).unwrap();
    (trained, folder, dataset)
}

fn baked(
    input: impl Into<ImportedScene>,
    dataset: Option<&trisplat_dataset::Dataset>,
    change: impl Fn(&mut BakeOptions),
) -> (Asset, Report) {
    let mut options = BakeOptions { force_dataset: true, ..BakeOptions::DEFAULT };
    options.backdrop.backdrop = BackdropWhen::Sky;
    options.place.up = "y".parse().unwrap();
    // Photos of surroundings whose colour changes all around are no photos of different white
    // balance.
    options.exposure = BakeOptions::preset(BakePreset::Fast).exposure;
    change(&mut options);
    let mut views = dataset.map(views);
    let mut report = Report::default();
    let asset =
        Bake::new(&options).photos(views.as_mut()).report(&mut report).run([input.into()]).unwrap();
    (asset, report)
}

/// The direction of a pixel as three.js reads it: the middle is +X, a quarter from the left -Z.
fn direction(sky: &RgbImage, pixel: usize) -> Vec3 {
    let column = pixel as u32 % sky.size.x;
    let row = pixel as u32 / sky.size.x;
    let [x, y] =
        [(column, sky.size.x), (row, sky.size.y)].map(|(at, of)| (at as f32 + 0.5) / of as f32);
    let turn = (x - 0.5) * std::f32::consts::TAU;
    let down = y * std::f32::consts::PI;
    Vec3::new(down.sin() * turn.cos(), down.cos(), down.sin() * turn.sin())
}

fn apart(a: [u8; 3], b: [u8; 3]) -> i32 {
    (0..3).map(|c| (i32::from(a[c]) - i32::from(b[c])).abs()).max().unwrap()
}

/// The largest step between neighbouring pixels of the rows between two shares of the height, and
/// the mean and largest difference from the surroundings, which are turned by `turn` in the file;
/// codes.
fn step_and_error(sky: &RgbImage, rows: [f32; 2], turn: impl Fn(Vec3) -> Vec3) -> (i32, f64, i32) {
    let width = sky.size.x as usize;
    let height = sky.size.y as usize;
    let [first, last] = rows.map(|share| (share * (height - 1) as f32) as usize);
    let mut step = 0;
    let mut worst = 0;
    let mut sum = 0;
    for pixel in first * width..last * width {
        // The last column is beside the first.
        let right = pixel - pixel % width + (pixel + 1) % width;
        step = step.max(apart(sky.rgb[pixel], sky.rgb[right]));
        step = step.max(apart(sky.rgb[pixel], sky.rgb[pixel + width]));
        let wants = around(turn(direction(sky, pixel)));
        let off = apart(sky.rgb[pixel], wants.map(|c| (255.0 * srgb_from_linear(c)).round() as u8));
        worst = worst.max(off);
        sum += off;
    }
    (step, f64::from(sum) / ((last - first) * width) as f64, worst)
}

/// The rows that photos of the scene show, which look at it from all around.
const SEEN: [f32; 2] = [0.35, 0.65];

#[test]
fn photos_decide_the_panorama_which_is_smooth_where_none_looks() {
    let (trained, _folder, dataset) = photographed();
    let (asset, _) = baked(trained, Some(&dataset), |_| ());
    assert_eq!((asset.provenance.backdrop_faces, asset.mesh.texture.is_some()), (0, false));
    assert!(asset.mesh.positions.iter().all(|v| v.length() < 10.0), "the scene alone");
    let sky = asset.sky().expect("a panorama");
    assert_eq!(sky.size.x, 2 * sky.size.y);
    let (step, error, _) = step_and_error(sky, SEEN, |d| d);
    assert!(step < 12 && error < 8.0, "steps of {step}, {error} codes off");
    // The gems differ by up to 230 codes from one to the next.
    let (step, _, _) = step_and_error(sky, [0.0, 1.0], |d| d);
    assert!(step < 12, "steps of {step} codes");
}

#[test]
fn the_panorama_turns_with_the_scene() {
    let (trained, _folder, dataset) = photographed();
    let (asset, _) = baked(trained, Some(&dataset), |options| {
        options.place.up = "z".parse().unwrap();
        options.place.rotate = 40.0;
    });
    let placement = asset.provenance.placement;
    let back = placement.rotation().transpose().as_mat3();
    // All rows: those that photos see are columns now.
    let (_, error, _) = step_and_error(asset.sky().unwrap(), [0.0, 1.0], |d| back * d);
    assert!(error < 30.0, "{error} codes off");
    let (_, not_turned, _) = step_and_error(asset.sky().unwrap(), [0.0, 1.0], |d| d);
    assert!(not_turned > error + 10.0, "{not_turned} {error}");
}

#[test]
fn a_shell_without_photos_keeps_its_colours_and_loses_its_edges() {
    let mut dome = sphere(false);
    dome.shell = vec![true; dome.face_count()];
    // As trained: one colour per triangle.
    let flat = (0..dome.face_count()).map(|face| around(dome.centroid(face))).collect();
    dome.colors = Colors::Face(flat);
    let mut trained = grey(&scene());
    trained.append(dome).unwrap();
    let (asset, _) = baked(trained, None, |_| ());
    let (step, error, _) = step_and_error(asset.sky().expect("a panorama"), [0.0, 1.0], |d| d);
    assert!(step < 6 && error < 8.0, "steps of {step}, {error} codes off");
    // Of facets that differ by up to 230 codes no edge is left.
    let mut trained = grey(&scene());
    trained.append(sphere(true)).unwrap();
    let (asset, _) = baked(trained, None, |_| ());
    let (step, _, _) = step_and_error(asset.sky().expect("a panorama"), [0.1, 0.9], |d| d);
    assert!(step < 12, "steps of {step} codes");
}

#[test]
fn sky_without_photos_and_shell_is_not_written() {
    let (asset, report) = baked(grey(&scene()), None, |_| ());
    assert!(asset.sky().is_none());
    assert!(
        report.warnings.iter().any(|warning| warning.starts_with("no sky is written")),
        "{report:?}"
    );
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(names(&asset, &folder.path().join("a.glb")), ["a.glb"]);
    // A page that asks for a picture that is not there complains.
    assert!(!names_sky(&folder.path().join("a.glb"), ""));
}

#[test]
fn the_picture_is_a_file_beside_the_scene_or_in_a_page() {
    let (trained, _folder, dataset) = photographed();
    let (mut asset, _) = baked(trained, Some(&dataset), |options| options.lod.lod = vec![0.5]);
    assert_eq!(asset.levels[0].provenance.backdrop_faces, 0);
    asset.levels.clear();
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    assert_eq!(names(&asset, &path("a.glb")), ["a.glb", "a.sky.jpg"]);
    assert!(names_sky(&path("a.glb"), "a.sky.jpg"));
    let file = RgbImage::load(&path("a.sky.jpg")).unwrap();
    let sky = asset.sky().unwrap();
    let worst = file.rgb.iter().zip(&sky.rgb).map(|(a, b)| apart(*a, *b)).max();
    assert!(file.size == sky.size && worst < Some(8), "{worst:?}");
    assert_eq!(names(&asset, &path("b.html")), ["b.html"]);
    let page = std::fs::read_to_string(path("b.html")).unwrap();
    let open = "<script type=\"image/jpeg;base64\" id=\"sky\">";
    let held = page
        .split(open)
        .nth(1)
        .and_then(|rest| rest.split("</script>").next())
        .expect("a panorama");
    assert!(BASE64.decode(held).unwrap() == std::fs::read(path("a.sky.jpg")).unwrap());
    // A phone shows the room around a scene.
    let phone = trisplat_formats::write(&asset, &path("c.usdz"), &Default::default());
    assert!(phone.unwrap_err().to_string().contains("`backdrop` sky"));
}

/// True if a GLB names a panorama whose name begins like this.
fn names_sky(path: &Path, name: &str) -> bool {
    let bytes = std::fs::read(path).unwrap();
    let word = format!("\"sky\":\"{name}");
    bytes.windows(word.len()).any(|window| window == word.as_bytes())
}

/// The names of the files that are written.
fn names(asset: &Asset, path: &Path) -> Vec<String> {
    let written = trisplat_formats::write(asset, path, &Default::default()).unwrap();
    let mut names: Vec<String> =
        written.files.iter().map(|f| f.path.rsplit('/').next().unwrap().to_owned()).collect();
    names.sort_unstable();
    names
}
