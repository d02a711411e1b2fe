//! The stages that use photos: `unseen`, `backdrop` and `refit`. The photos are drawn from a scene
//! with known colours.

mod recolouring;
mod visibility;

use super::hostile::random_triangle;
use glam::{UVec2, Vec2, Vec3};
use std::fmt::Write;
use std::ops::ControlFlow::Continue;
use std::path::Path;
use tempfile::TempDir;
use trisplat_bake::{
    BackdropDetails, BackdropOptions, BackdropWhen, Bake, BakeOptions, Views, backdrop,
    refit::{self, RefitColors, RefitDetails, RefitOptions},
    unseen::{self, FaceLimit, UnseenDetails, UnseenOptions},
};
use trisplat_dataset::{Dataset, DatasetOptions, Masks};
use trisplat_raster::solid::{SolidRasterOptions, SolidRasterizer};
use trisplat_scene::{
    Asset, ImportedScene, Placement, Result, UpAxis,
    camera::Camera,
    image::RgbImage,
    mesh::{Colors, Mesh},
    report::{Outcome, StageEvent, StageProgress},
};

const VIEWS: usize = 24;

fn refit(
    mesh: &mut Mesh,
    views: Option<&mut Views>,
    options: &RefitOptions,
    details: &mut RefitDetails,
) -> Result<Outcome<()>> {
    let behind = mesh.face_count();
    refit::refit(
        mesh,
        behind,
        views,
        options,
        details,
        &mut StageProgress::new(&mut |_| Continue(())),
    )
    .map(|found| found.outcome)
}

fn unseen(
    mesh: &mut Mesh,
    cameras: &[Camera],
    views: Option<&mut Views>,
    options: &UnseenOptions,
    most: Option<u64>,
    details: &mut UnseenDetails,
) -> Result<Outcome<()>> {
    let limit = FaceLimit { max_faces: most, ..FaceLimit::default() };
    unseen::unseen(
        mesh,
        cameras,
        views,
        options,
        &limit,
        details,
        &mut StageProgress::new(&mut |_| Continue(())),
    )
}

/// Triangles of some size around the origin, with a colour per corner.
pub(super) fn scene() -> Mesh {
    let place = |i: u64| {
        Vec3::new((i % 5) as f32 - 2.0, (i / 5 % 5) as f32 - 2.0, (i / 25) as f32 - 1.5) * 0.5
    };
    let positions: Vec<Vec3> = (0..100).flat_map(|i| random_triangle(i, place(i), 0.5)).collect();
    let color = |i: usize| [7, 11, 13].map(|p| ((i * p) % 19) as f32 / 20.0);
    let colors = Colors::Vertex((0..positions.len()).map(color).collect());
    Mesh { positions, colors, indices: Vec::new(), opacity: Vec::new(), ..Mesh::default() }
}

/// The same triangles, all of one grey.
pub(super) fn grey(mesh: &Mesh) -> Mesh {
    Mesh { colors: Colors::Face(vec![[0.2; 3]; mesh.face_count()]), ..mesh.clone() }
}

fn camera(view: usize) -> Camera {
    let lens = Camera {
        rotation: glam::Mat3::IDENTITY,
        translation: Vec3::ZERO,
        focal: Vec2::splat(110.0),
        center: Vec2::new(50.0, 37.0),
        size: UVec2::new(96, 72),
    };
    let angle = view as f32 * 2.4;
    let height = (view % 7) as f32 * 0.5 - 1.5;
    lens.with_look_at(
        Vec3::new(3.0 * angle.cos(), height, 3.0 * angle.sin()),
        Vec3::ZERO,
        Vec3::NEG_Y,
    )
}

/// Photographs `mesh` into a data set on disk, as finely sampled as photos are; `develop` may
/// change a photo.
pub(super) fn photograph(
    mesh: &Mesh,
    develop: impl Fn(usize, RgbImage) -> RgbImage,
) -> (TempDir, Dataset) {
    photograph_at(mesh, 4, develop)
}

fn photograph_at(
    mesh: &Mesh,
    samples: u32,
    develop: impl Fn(usize, RgbImage) -> RgbImage,
) -> (TempDir, Dataset) {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("sparse/0");
    let images = folder.path().join("images");
    std::fs::create_dir_all(&model).unwrap();
    std::fs::create_dir_all(&images).unwrap();
    let options = SolidRasterOptions { samples, ..SolidRasterOptions::default() };
    let mut list = String::new();
    for view in 0..VIEWS {
        let c = camera(view);
        let q = glam::Quat::from_mat3(&c.rotation);
        let t = c.translation;
        let id = view + 1;
        writeln!(
            list,
            "{id} {} {} {} {} {} {} {} 1 {view:02}.png\n",
            q.w, q.x, q.y, q.z, t.x, t.y, t.z
        )
        .unwrap();
        let photo = develop(view, SolidRasterizer::new().render(mesh, &c, &options));
        photo.save_png(images.join(format!("{view:02}.png"))).unwrap();
    }
    std::fs::write(model.join("cameras.txt"), "1 PINHOLE 96 72 110 110 50 37\n").unwrap();
    std::fs::write(model.join("images.txt"), list).unwrap();
    std::fs::write(model.join("points3D.txt"), "1 0 0 0 9 9 9 0\n").unwrap();
    let dataset = load(folder.path());
    (folder, dataset)
}

fn load(folder: &Path) -> Dataset {
    Dataset::load(folder, &DatasetOptions { test_every: 0, ..DatasetOptions::default() }).unwrap()
}

pub(super) fn views(dataset: &Dataset) -> Views {
    Views::new(dataset, &DatasetOptions::default())
}

/// Root of the mean squared difference of the pictures that two meshes give, codes.
fn difference(a: &Mesh, b: &Mesh) -> f64 {
    let options = SolidRasterOptions { samples: 4, ..SolidRasterOptions::default() };
    let mut sum = 0.0;
    let mut count = 0.0;
    for view in 0..VIEWS {
        let c = camera(view);
        let a = SolidRasterizer::new().render(a, &c, &options);
        let b = SolidRasterizer::new().render(b, &c, &options);
        for (a, b) in a.rgb.as_flattened().iter().zip(b.rgb.as_flattened()) {
            sum += (f64::from(*a) - f64::from(*b)).powi(2);
            count += 1.0;
        }
    }
    f64::sqrt(sum / count)
}

fn fitted(dataset: &Dataset, start: &Mesh, options: &RefitOptions) -> (Mesh, RefitDetails) {
    let mut mesh = start.clone();
    let mut details = RefitDetails::default();
    let outcome = refit(&mut mesh, Some(&mut views(dataset)), options, &mut details).unwrap();
    assert_eq!(outcome, Outcome::Changed(()), "{details:?}");
    mesh.validate().unwrap();
    (mesh, details)
}

/// The stage with all photos of a data set.
fn cull(
    mesh: &mut Mesh,
    dataset: &Dataset,
    options: &UnseenOptions,
    most: Option<u64>,
    details: &mut UnseenDetails,
) -> Result<Outcome<()>> {
    let mut views = views(dataset);
    let cameras = views.cameras().to_vec();
    unseen(mesh, &cameras, Some(&mut views), options, most, details)
}

/// A closed box around the origin, two triangles per side.
fn room(half: f32) -> Vec<Vec3> {
    let corner = |i: usize| {
        Vec3::from([i & 1, i >> 1 & 1, i >> 2 & 1].map(|b| half * (2.0 * b as f32 - 1.0)))
    };
    let sides =
        [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    sides.iter().flat_map(|[a, b, c, d]| [a, b, c, a, c, d].map(|i| corner(*i))).collect()
}

#[test]
fn holes_are_closed_with_what_photos_show_through_them() {
    let mesh = grey(&scene());
    let mut truth = mesh.clone();
    truth.positions.extend(room(20.0));
    let sky = [0.1, 0.4, 0.6];
    truth.colors = Colors::Face((0..100).map(|_| [0.2; 3]).chain([sky; 12]).collect());
    let (_folder, dataset) = photograph(&truth, |_, photo| photo);
    let mut closed = mesh.clone();
    let mut details = BackdropDetails::default();
    let mut views = views(&dataset);
    backdrop(&mut closed, Some(&mut views), &BackdropOptions::DEFAULT, None, &mut details).unwrap();
    assert!(details.holes.unwrap() > 0.3, "{details:?}");
    assert_eq!(closed.face_count(), 100 + 128);
    refit(&mut closed, Some(&mut views), &RefitOptions::DEFAULT, &mut RefitDetails::default())
        .unwrap();
    let open = difference(&mesh, &truth);
    let shut = difference(&closed, &truth);
    assert!(shut < 0.05 * open, "{open} codes with holes, {shut} without: {details:?}");
    let again =
        backdrop(&mut closed, Some(&mut views), &BackdropOptions::DEFAULT, None, &mut details)
            .unwrap();
    assert_eq!(again, Outcome::Skipped("triangles cover the photos"));
}

#[test]
fn backdrop_stays_separate_through_another_bake() {
    let mesh = grey(&scene());
    let mut truth = mesh.clone();
    truth.positions.extend(room(20.0));
    truth.colors = Colors::Face(vec![[0.3; 3]; 112]);
    let (_folder, dataset) = photograph(&truth, |_, photo| photo);
    // Photos of one colour are closer to a picture of that colour than to any scene.
    let mut options = BakeOptions { force_dataset: true, ..BakeOptions::DEFAULT };
    options.chunk.chunk_triangles = 30;
    options.lod.lod = vec![0.5];
    let baked = |input: ImportedScene, options: &BakeOptions, views: Option<&mut Views>| {
        Bake::new(options).photos(views).run([input]).unwrap()
    };
    let first = baked(mesh.clone().into(), &options, Some(&mut views(&dataset)));
    let scene = first.scene_faces();
    assert_eq!((first.provenance.backdrop_faces, first.mesh.face_count() - scene), (128, 128));
    let last = *first.chunks.last().unwrap();
    assert_eq!((last.first as usize, last.count), (scene, 128));
    assert!(
        first.chunks.len() > 3
            && first.chunks[..first.chunks.len() - 1].iter().all(|c| c.count <= 30)
    );
    // Whoever draws a level alone sees no hole either.
    let level = &first.levels[0];
    assert_eq!((level.scene_faces(), level.provenance.backdrop_faces), (scene / 2, 128));
    let corners = |asset: &Asset| -> Vec<_> {
        (asset.scene_faces()..asset.mesh.face_count()).map(|f| asset.mesh.corners(f)).collect()
    };
    assert_eq!(corners(level), corners(&first));
    let far = |mesh: &Mesh, face: usize| mesh.corners(face).into_iter().all(|v| v.length() > 3.0);
    assert!(
        (scene..scene + 128).all(|face| far(&first.mesh, face))
            && !(0..scene).any(|f| far(&first.mesh, f))
    );
    let (front, behind) = first.split_backdrop().unwrap();
    assert_eq!((front.mesh.face_count(), behind.mesh.face_count()), (scene, 128));
    assert_eq!((front.provenance.backdrop_faces, behind.scene_faces()), (0, 0));

    let again = |options: &BakeOptions| {
        let input = ImportedScene {
            provenance: first.provenance.clone(),
            ..ImportedScene::from(first.mesh.clone())
        };
        baked(input, options, None)
    };
    let kept = again(&BakeOptions::DEFAULT);
    assert_eq!((kept.provenance.backdrop_faces, kept.mesh.face_count()), (128, scene + 128));
    assert!((scene..scene + 128).all(|face| far(&kept.mesh, face)));
    let mut off = BakeOptions::DEFAULT;
    off.backdrop.backdrop = BackdropWhen::Off;
    let without = again(&off);
    assert_eq!((without.provenance.backdrop_faces, without.mesh.face_count()), (0, scene));

    // In a file of its own, as the program writes it.
    let mut apart = BakeOptions::DEFAULT;
    apart.backdrop.backdrop = BackdropWhen::File;
    let folder = tempfile::tempdir().unwrap();
    let written =
        trisplat_formats::write(&again(&apart), &folder.path().join("a.glb"), &apart.output)
            .unwrap();
    let names: Vec<&str> =
        written.files.iter().filter_map(|f| f.path.rsplit(['/', '\\']).next()).collect();
    assert_eq!(names, ["a.glb", "a.backdrop.glb"]);
    let faces = |name: &str| {
        let file = trisplat_formats::read(
            &folder.path().join(name),
            &trisplat_formats::ReadOptions::default(),
        )
        .unwrap();
        file.scene.triangle_count()
    };
    assert_eq!((faces("a.glb"), faces("a.backdrop.glb")), (scene, 128));
}

#[test]
fn without_photos_nothing_is_needed_and_errors_name_the_remedy() {
    let mut mesh = scene();
    let mut details = UnseenDetails::default();
    let none =
        refit(&mut mesh, None, &RefitOptions::DEFAULT, &mut RefitDetails::default()).unwrap();
    assert_eq!(none, Outcome::Skipped("no photos were given"));
    let none = unseen(&mut mesh, &[], None, &UnseenOptions::DEFAULT, None, &mut details).unwrap();
    assert!(matches!(none, Outcome::Skipped(why) if why.contains("`dataset`")));
    let options = UnseenOptions { max_error: Some(0.1), ..UnseenOptions::DEFAULT };
    let error = unseen(&mut mesh, &[], None, &options, None, &mut details).unwrap_err().to_string();
    assert!(error.starts_with("max_error ") && error.contains("`dataset`"), "{error}");
    let (_folder, dataset) = photograph(&mesh, |_, photo| photo);
    mesh.positions.iter_mut().for_each(|v| *v = Vec3::new(v.x, v.y + 1000.0, v.z));
    let error = cull(&mut mesh, &dataset, &UnseenOptions::DEFAULT, None, &mut details)
        .unwrap_err()
        .to_string();
    assert!(error.starts_with("dataset "), "{error}");
}

#[test]
fn colours_for_later_stages_have_not_seen_the_held_out_photos() {
    let mesh = scene();
    // Photos that are held out have bright and dark squares, which leave their brightness as it is.
    let chequered = |view: usize, mut photo: RgbImage| {
        for (i, rgb) in photo.rgb.iter_mut().enumerate().filter(|_| view % 8 == 4) {
            let x = i as u32 % photo.size.x;
            let y = i as u32 / photo.size.x;
            let bright = (x / 12 + y / 12).is_multiple_of(2);
            *rgb = rgb.map(|c| if bright { c.saturating_add(50) } else { c.saturating_sub(50) });
        }
        photo
    };
    let (_folder, dataset) = photograph(&mesh, chequered);
    let mut views = views(&dataset);
    let (held_out, others) = views.held_out();
    assert_eq!((&held_out[..], others.len()), (&[4, 12, 20][..], 21));
    for (colors, which) in [(RefitColors::Flat, "flat"), (RefitColors::Auto, "auto")] {
        let mut fitted = grey(&mesh);
        let options = RefitOptions { refit: colors, ..RefitOptions::default() };
        let mut details = RefitDetails::default();
        let mut nobody = |_: StageEvent<'_>| Continue(());
        let mut progress = StageProgress::new(&mut nobody);
        let behind = mesh.face_count();
        let found = refit::refit(
            &mut fitted,
            behind,
            Some(&mut views),
            &options,
            &mut details,
            &mut progress,
        );
        let unseen = Mesh { colors: found.unwrap().unseen.unwrap().colors, ..mesh.clone() };
        let on_others = |mesh: &Mesh| views.mean_psnr(mesh, &others).unwrap();
        let [seen, unseen] = [&fitted, &unseen].map(on_others);
        assert_eq!(details.photos_out_of_line, None, "{which}");
        assert!(unseen > seen + 0.1, "{which}: {unseen} is not above {seen}");
    }
}
