//! The backdrop of a scene with photos: a picture of everything around, by pixels.

use super::photos::{camera, grey, photograph, scene, views};
use glam::{UVec2, Vec2, Vec3};
use trisplat::ReadOptions;
use trisplat_bake::{BackdropWhen, Bake, BakeOptions, BakePreset};
use trisplat_raster::solid::{SolidRasterOptions, SolidRasterizer};
use trisplat_scene::{
    Asset, ImportedScene, Scene,
    camera::Camera,
    image::RgbImage,
    math::octasphere::octasphere,
    mesh::{Colors, Mesh},
};

/// The colour of the surroundings in a direction.
fn around(direction: Vec3) -> [f32; 3] {
    let d = direction.normalize();
    [0.3 + 0.25 * d.x, 0.4 - 0.3 * d.y, 0.3 + 0.25 * d.z]
}

/// A sphere of radius 20 with a colour per corner, or with one per face that has nothing to do with it.
fn sphere(gems: bool) -> Mesh {
    let (corners, faces) = octasphere(if gems { 2 } else { 5 });
    let positions: Vec<Vec3> = faces.iter().flat_map(|f| f.map(|i| 20.0 * corners[i as usize])).collect();
    let colors = match gems {
        true => Colors::Face((0..faces.len()).map(|i| [(i * 7 % 10) as f32 / 10.0; 3]).collect()),
        false => Colors::Vertex(positions.iter().map(|p| around(*p)).collect()),
    };
    Mesh { shell: vec![gems; faces.len()], positions, colors, ..Mesh::default() }
}

/// The scene of the photos with a shell of gems behind it, and photos of it with the true surroundings.
fn photographed() -> (Mesh, tempfile::TempDir, trisplat_dataset::Dataset) {
    let (mut truth, mut trained) = (grey(&scene()), grey(&scene()));
    truth.append(sphere(false)).unwrap();
    let (folder, dataset) = photograph(&truth, |_, photo| photo);
    trained.append(sphere(true)).unwrap();
    (trained, folder, dataset)
}

fn baked(
    input: impl Into<ImportedScene>,
    dataset: Option<&trisplat_dataset::Dataset>,
    when: BackdropWhen,
) -> Asset {
    let mut options = BakeOptions { force_dataset: true, ..BakeOptions::DEFAULT };
    options.backdrop.backdrop = when;
    options.place.up = "y".parse().unwrap();
    // Photos of surroundings whose colour changes all around are no photos of different white balance.
    options.exposure = BakeOptions::preset(BakePreset::Fast).exposure;
    let mut views = dataset.map(views);
    Bake::new(&options).photos(views.as_mut()).run([input.into()]).unwrap()
}

fn looking(ahead: Vec3) -> Camera {
    let lens =
        Camera { focal: Vec2::splat(60.0), center: Vec2::splat(48.0), size: UVec2::splat(96), ..camera(0) };
    lens.looking(Vec3::ZERO, ahead, if ahead.x == 0.0 && ahead.z == 0.0 { Vec3::X } else { Vec3::Y })
}

/// What stands behind the scene, as an eye in the middle sees it.
fn seen(asset: &Asset, ahead: Vec3) -> RgbImage {
    let mut behind = asset.mesh.clone();
    behind.retain(|face| asset.mesh.centroid(face).length() > 10.0);
    let options = SolidRasterOptions { samples: 2, ..Default::default() };
    SolidRasterizer::new().render(&behind, &looking(ahead), &options)
}

fn apart(a: [u8; 3], b: [u8; 3]) -> i32 {
    (0..3).map(|c| (i32::from(a[c]) - i32::from(b[c])).abs()).max().unwrap()
}

/// The mean and the largest difference of two pictures, codes.
fn difference(a: &RgbImage, b: &RgbImage) -> (f64, i32) {
    let apart = a.rgb.iter().zip(&b.rgb).map(|(a, b)| apart(*a, *b));
    (f64::from(apart.clone().sum::<i32>()) / a.rgb.len() as f64, apart.max().unwrap())
}

/// The largest step between neighbouring pixels, and the mean difference from the surroundings, codes.
fn step_and_error(picture: &RgbImage, ahead: Vec3) -> (i32, f64) {
    let truth =
        SolidRasterizer::new().render(&sphere(false), &looking(ahead), &SolidRasterOptions::default());
    let width = picture.size.x as usize;
    let steps = (0..picture.rgb.len() - width).map(|i| {
        let right = if (i + 1) % width == 0 { i } else { i + 1 };
        apart(picture.rgb[i], picture.rgb[right]).max(apart(picture.rgb[i], picture.rgb[i + width]))
    });
    (steps.max().unwrap(), difference(picture, &truth).0)
}

#[test]
fn a_shell_of_gems_becomes_what_photos_show_and_is_smooth_where_none_looks() {
    let (trained, _folder, dataset) = photographed();
    let asset = baked(trained, Some(&dataset), BackdropWhen::Auto);
    let texture = asset.mesh.texture.as_ref().expect("a picture");
    assert!((0..asset.scene_faces()).all(|face| texture.page(face).is_none()), "the scene keeps its colours");
    for ahead in [Vec3::X, Vec3::NEG_X, Vec3::Z, Vec3::NEG_Z, Vec3::new(1.0, 0.2, 1.0)] {
        let (step, error) = step_and_error(&seen(&asset, ahead), ahead);
        assert!(step < 12 && error < 8.0, "{ahead}: steps of {step}, {error} codes off");
    }
    // No photo shows what is right above and below.
    for ahead in [Vec3::Y, Vec3::NEG_Y] {
        let (step, error) = step_and_error(&seen(&asset, ahead), ahead);
        assert!(step < 12 && error < 40.0, "{ahead}: steps of {step}, {error} codes off");
    }
}

#[test]
fn files_keep_the_picture_and_another_bake_does_too() {
    let (trained, _folder, dataset) = photographed();
    let asset = baked(trained, Some(&dataset), BackdropWhen::Auto);
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.glb", "a.gltf", "a.ply", "a.obj"] {
        let path = folder.path().join(name);
        trisplat_formats::write(&asset, &path, &Default::default()).unwrap();
        let read = trisplat_formats::read(&path, &ReadOptions::default()).unwrap();
        let Scene::Mesh(mesh) = &read.scene else { panic!("a mesh") };
        assert_eq!(mesh.texture.is_some(), name.starts_with("a.gl"), "{name}");
        let again = baked(read, None, BackdropWhen::Auto);
        // An OBJ names no backdrop that is read.
        let backdrop = if name == "a.obj" { 0 } else { asset.provenance.backdrop };
        assert_eq!((again.provenance.backdrop, again.mesh.face_count()), (backdrop, asset.mesh.face_count()));
        // JPEG changes little; PLY and OBJ have the colours of the corners.
        let (mean, most) = if name.starts_with("a.gl") { (1.0, 4) } else { (4.0, 16) };
        for ahead in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::Z] {
            let off = difference(&seen(&again, ahead), &seen(&asset, ahead));
            assert!(off.0 < mean && off.1 <= most, "{name}, {ahead}: {off:?} codes off");
        }
    }
}

#[test]
fn a_shell_without_photos_is_smooth_and_keeps_its_colours() {
    let mut dome = sphere(false);
    dome.shell = vec![true; dome.face_count()];
    // As trained: one colour per triangle.
    let flat = (0..dome.face_count()).map(|face| around(dome.centroid(face))).collect();
    dome.colors = Colors::Face(flat);
    let mut trained = grey(&scene());
    trained.append(dome).unwrap();
    let asset = baked(trained, None, BackdropWhen::Auto);
    for ahead in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Z] {
        let (step, error) = step_and_error(&seen(&asset, ahead), ahead);
        assert!(step < 5 && error < 4.0, "{ahead}: steps of {step}, {error} codes off");
    }
}

#[test]
fn a_sky_is_a_panorama_beside_a_scene_without_backdrop() {
    let (trained, _folder, dataset) = photographed();
    let asset = baked(trained, Some(&dataset), BackdropWhen::Sky);
    assert_eq!((asset.provenance.backdrop, asset.mesh.texture.is_some()), (0, false));
    let folder = tempfile::tempdir().unwrap();
    let written = trisplat_formats::write(&asset, &folder.path().join("a.glb"), &Default::default()).unwrap();
    assert_eq!(written.files.len(), 2);
    let sky = RgbImage::load(&folder.path().join("a.sky.jpg")).unwrap();
    let size = sky.size;
    assert_eq!(size.x, 2 * size.y);
    // As three.js reads it: the middle is +X, a quarter from the left -Z.
    for (column, direction) in [(0.25, Vec3::NEG_Z), (0.5, Vec3::X), (0.75, Vec3::Z), (0.99, Vec3::NEG_X)] {
        let pixel = sky.rgb[(size.y / 2 * size.x + (column * size.x as f32) as u32) as usize];
        let wants = around(direction).map(|c| 255.0 * trisplat_scene::math::color::srgb_from_linear(c));
        let off = (0..3).map(|c| (f32::from(pixel[c]) - wants[c]).abs()).fold(0.0, f32::max);
        assert!(off < 14.0, "{direction}: {pixel:?} {wants:?}");
    }
    // A page is a file alone.
    let page = trisplat_formats::write(&asset, &folder.path().join("a.html"), &Default::default());
    assert!(page.unwrap_err().to_string().contains("`backdrop` sky"));
}
