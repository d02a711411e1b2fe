//! The shell of a trained scene is its backdrop, and nothing else is.

use super::hostile::{random_triangle, soup_of};
use glam::Vec3;
use trisplat_bake::{BackdropWhen, Bake, BakeOptions, BakePreset};
use trisplat_scene::{Asset, ImportedScene, Soup};

/// Eight huge triangles around the origin.
fn octahedron() -> Soup {
    let corner = |axis: Vec3, bit: usize, i: usize| axis * if i >> bit & 1 == 0 { 3.0 } else { -3.0 };
    let face = |i| [corner(Vec3::X, 0, i), corner(Vec3::Y, 1, i), corner(Vec3::Z, 2, i)];
    let mut shell = soup_of((0..8).map(|i| (face(i), 0.98, 0.02)));
    shell.set_shell(0..8);
    shell
}

/// A thing right before a triangle of the shell, nearer than the thickness that was once guessed for it: flat pieces in its plane.
fn subject(count: u64) -> Soup {
    let normal = Vec3::ONE.normalize();
    let flat = |i: u64| {
        let triangle = random_triangle(i, Vec3::splat(0.995), 0.3);
        triangle.map(|p| p - normal * (p - Vec3::splat(0.995)).dot(normal))
    };
    soup_of((0..count).map(|i| (flat(i), 0.95, 0.05)))
}

fn baked(inputs: impl IntoIterator<Item = Soup>, edit: impl Fn(&mut BakeOptions)) -> Asset {
    let mut options = BakeOptions::preset(BakePreset::Fast);
    edit(&mut options);
    Bake::new(&options).run(inputs.into_iter().map(ImportedScene::from)).unwrap()
}

fn with_shell(count: u64) -> Soup {
    let mut soup = subject(count / 2);
    soup.append(octahedron());
    soup.append(subject(count / 2));
    soup
}

#[test]
fn the_subject_never_lands_in_the_backdrop() {
    let asset = baked([with_shell(400)], |_| {});
    // The solid triangles of the octahedron hardly touch: a closed surface stands in their place.
    assert_eq!((asset.provenance.backdrop, asset.mesh.face_count()), (128, 528));
    assert!((0..400).all(|face| asset.mesh.area(face) < 1.0), "the backdrop comes last");
    // Two scenes, each with its own.
    let both = baked([with_shell(100), with_shell(60)], |_| {});
    // Together they are cut in four.
    assert_eq!((both.provenance.backdrop, both.mesh.face_count()), (64, 224));
}

#[test]
fn a_shell_of_a_scene_without_backdrop_is_part_of_it() {
    let asset = baked([with_shell(40)], |options| options.backdrop.backdrop = BackdropWhen::Off);
    assert_eq!((asset.provenance.backdrop, asset.mesh.face_count()), (0, 48));
    let none = baked([subject(40)], |_| {});
    assert_eq!((none.provenance.backdrop, none.mesh.face_count()), (0, 40));
}

#[test]
fn a_closed_far_shell_of_any_soup_is_the_backdrop() {
    // The dome of the sample, which no flag names.
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/soups/studio.ply");
    let studio = || trisplat_formats::read(&path, &trisplat_formats::ReadOptions::default()).unwrap();
    let bake = |when| {
        let mut options = BakeOptions::preset(BakePreset::Fast);
        options.backdrop.backdrop = when;
        Bake::new(&options).run([studio()]).unwrap()
    };
    let asset = bake(BackdropWhen::Auto);
    let behind = asset.mesh.face_count() - asset.provenance.backdrop as usize;
    // The dome's 402 triangles touch nowhere: one closed surface, cut in four, is in their place.
    assert_eq!(asset.provenance.backdrop, 2048);
    let far = |face: usize| asset.mesh.centroid(face).length();
    let reach = (0..behind).map(far).fold(0.0, f32::max);
    assert!((behind..asset.mesh.face_count()).all(|face| far(face) > reach), "what stands before it stays");
    // One lies edge-on to the origin, which is not the middle of the dome.
    let inward =
        |face: &usize| asset.mesh.flat_normal(*face).dot(asset.mesh.centroid(*face)) < 0.01 * far(*face);
    assert!((behind..asset.mesh.face_count()).all(|face| inward(&face)), "fronts are inside");
    assert_eq!(bake(BackdropWhen::Off).provenance.backdrop, 0);
    // Of two inputs each has its own, wherever they stand.
    let mut beside = studio();
    let trisplat_scene::Scene::Soup(soup) = &mut beside.scene else { panic!("a soup") };
    soup.vertices.iter_mut().flatten().for_each(|p| p.x += 90.0);
    let both = Bake::new(&BakeOptions::preset(BakePreset::Fast)).run([studio(), beside]).unwrap();
    assert_eq!(both.provenance.backdrop, 2 * 4 * 402, "the domes of several inputs stay");
}
