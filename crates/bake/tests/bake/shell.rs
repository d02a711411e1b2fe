//! The shell of a trained scene is its backdrop, and nothing else is.

use super::hostile::{random_triangle, soup_of};
use super::{photos, sky};
use glam::{Mat3, UVec2, Vec2, Vec3};
use trisplat_bake::{BackdropWhen, Bake, BakeOptions, BakePreset, ReshapeOptions};
use trisplat_dataset::Dataset;
use trisplat_raster::solid::{NO_FACE, SolidRasterOptions, SolidRasterizer};
use trisplat_scene::{
    Asset, ImportedScene, Rng, Scene, Soup,
    camera::Camera,
    math::{color::linear_from_srgb, geometry::octasphere},
    mesh::{Colors, Mesh},
};

/// Eight huge triangles around the origin.
fn octahedron() -> Soup {
    let corner =
        |axis: Vec3, bit: usize, i: usize| axis * if i >> bit & 1 == 0 { 3.0 } else { -3.0 };
    let face = |i| [corner(Vec3::X, 0, i), corner(Vec3::Y, 1, i), corner(Vec3::Z, 2, i)];
    let mut shell = soup_of((0..8).map(|i| (face(i), 0.98, 0.02)));
    shell.set_shell(0..8);
    shell
}

/// A thing right before a triangle of the shell, nearer than the thickness that was once guessed
/// for it: flat pieces in its plane.
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
    assert_eq!((asset.provenance.backdrop_faces, asset.mesh.face_count()), (128, 528));
    assert!((0..400).all(|face| asset.mesh.area(face) < 1.0), "the backdrop comes last");
    // Two scenes, each with its own.
    let both = baked([with_shell(100), with_shell(60)], |_| {});
    // Together they are cut in four.
    assert_eq!((both.provenance.backdrop_faces, both.mesh.face_count()), (64, 224));
}

#[test]
fn a_shell_of_a_scene_without_backdrop_is_part_of_it() {
    let asset = baked([with_shell(40)], |options| options.backdrop.backdrop = BackdropWhen::Off);
    assert_eq!((asset.provenance.backdrop_faces, asset.mesh.face_count()), (0, 48));
    let none = baked([subject(40)], |_| {});
    assert_eq!((none.provenance.backdrop_faces, none.mesh.face_count()), (0, 40));
}

#[test]
fn a_closed_far_shell_of_any_soup_is_the_backdrop() {
    // The dome of the sample, which no flag names.
    let path = trisplat_fixtures::sample("soups/studio.ply");
    let studio =
        || trisplat_formats::read(&path, &trisplat_formats::ReadOptions::default()).unwrap();
    let bake = |when| {
        let mut options = BakeOptions::preset(BakePreset::Fast);
        options.backdrop.backdrop = when;
        Bake::new(&options).run([studio()]).unwrap()
    };
    let asset = bake(BackdropWhen::Auto);
    let behind = asset.mesh.face_count() - asset.provenance.backdrop_faces as usize;
    // The dome's 402 triangles touch nowhere: one closed surface, cut in four, is in their place.
    assert_eq!(asset.provenance.backdrop_faces, 2048);
    let far = |face: usize| asset.mesh.centroid(face).length();
    let reach = (0..behind).map(far).fold(0.0, f32::max);
    assert!(
        (behind..asset.mesh.face_count()).all(|face| far(face) > reach),
        "what stands before it stays"
    );
    // One lies edge-on to the origin, which is not the middle of the dome.
    let inward = |face: &usize| {
        asset.mesh.flat_normal(*face).dot(asset.mesh.centroid(*face)) < 0.01 * far(*face)
    };
    assert!((behind..asset.mesh.face_count()).all(|face| inward(&face)), "fronts are inside");
    assert_eq!(bake(BackdropWhen::Off).provenance.backdrop_faces, 0);
    // Of two inputs each has its own, wherever they stand.
    let mut beside = studio();
    let trisplat_scene::Scene::Soup(soup) = &mut beside.scene else { panic!("a soup") };
    soup.vertices.iter_mut().flatten().for_each(|p| p.x += 90.0);
    let both = Bake::new(&BakeOptions::preset(BakePreset::Fast)).run([studio(), beside]).unwrap();
    assert_eq!(both.provenance.backdrop_faces, 2 * 4 * 402, "the domes of several inputs stay");
}

/// A dome of radius 20 with one grey per face, which is at least 100 codes from those of its
/// neighbours.
fn gems() -> Mesh {
    const CUTS: u32 = 2;
    let (corners, faces) = octasphere(CUTS);
    let rng = Rng::new(17, "test gem", 0);
    let code = |face: usize| {
        // Neighbours differ in one bit of the octant, or one of them is the middle one of four.
        let middles = (0..CUTS).filter(|cut| face >> (2 * cut) & 3 == 3).count() as u32;
        let is_light = ((face >> (2 * CUTS)).count_ones() + middles) % 2 == 1;
        let least = if is_light { 180.0 } else { 20.0 };
        least + 60.0 * rng.uniform(face as u64)
    };
    let colors = (0..faces.len()).map(|face| [linear_from_srgb(code(face) / 255.0); 3]).collect();
    let positions =
        faces.iter().flat_map(|face| face.map(|i| 20.0 * corners[i as usize])).collect();
    Mesh {
        positions,
        colors: Colors::Face(colors),
        shell: vec![true; faces.len()],
        ..Mesh::default()
    }
}

/// `copies` of the triangles of the photos, each a little turned, in the dome.
fn in_dome(copies: usize) -> Mesh {
    let mut all = Mesh { colors: Colors::Face(Vec::new()), ..Mesh::default() };
    for copy in 0..copies {
        let turn = Mat3::from_rotation_y(0.1 * copy as f32);
        let mut part = photos::grey(&photos::scene());
        part.positions.iter_mut().for_each(|place| *place = turn * *place);
        all.append(part).unwrap();
    }
    all.append(gems()).unwrap();
    all
}

fn baked_dome(copies: usize, photos: Option<&Dataset>, when: BackdropWhen) -> Asset {
    // Photos of surroundings whose colour changes all around are no photos of different white
    // balance.
    let exposure = BakeOptions::preset(BakePreset::Fast).exposure;
    let mut options = BakeOptions {
        force_dataset: true,
        reshape: ReshapeOptions::OFF,
        exposure,
        ..BakeOptions::DEFAULT
    };
    options.backdrop.backdrop = when;
    options.place.up = "y".parse().unwrap();
    let mut views = photos.map(photos::views);
    let scene = ImportedScene::from(Scene::Mesh(in_dome(copies)));
    Bake::new(&options).photos(views.as_mut()).run([scene]).unwrap()
}

/// A turn from beside the scene: the largest step between neighbouring pixels of the dome, codes,
/// and the pixels that show nothing.
fn largest_step(mesh: &Mesh) -> (u8, usize) {
    let size = UVec2::new(160, 120);
    let center = Vec2::new(80.0, 60.0);
    let lens = Camera {
        rotation: Mat3::IDENTITY,
        translation: Vec3::ZERO,
        focal: Vec2::splat(70.0),
        center,
        size,
    };
    let mut step = 0;
    let mut open = 0;
    for i in 0..18_u8 {
        let turn = f32::from(i) * 0.7;
        let height = [-1.5, 0.0, 1.5][usize::from(i % 3)];
        let eye = Vec3::new(0.0, 0.5, 4.0);
        let camera =
            lens.with_look_at(eye, eye + Vec3::new(turn.sin(), height, turn.cos()), Vec3::Y);
        let mut solid = SolidRasterizer::new();
        let drawing = SolidRasterOptions::default();
        let picture = solid.render(mesh, &camera, &drawing).rgb;
        let face = solid.visibility(mesh, &camera, &drawing).face.clone();
        open += face.iter().filter(|face| **face == NO_FACE).count();
        let is_far = |pixel: usize| {
            face[pixel] != NO_FACE && mesh.centroid(face[pixel] as usize).length() > 10.0
        };
        let width = size.x as usize;
        for pixel in
            (0..picture.len() - width).filter(|pixel| (pixel + 1) % width > 0 && is_far(*pixel))
        {
            let beside = [pixel + 1, pixel + width].into_iter().filter(|beside| is_far(*beside));
            step = beside
                .map(|beside| picture[pixel][0].abs_diff(picture[beside][0]))
                .fold(step, u8::max);
        }
    }
    (step, open)
}

#[test]
fn no_edge_of_a_dome_is_left_and_it_stays_closed() {
    let mut truth = photos::grey(&photos::scene());
    truth.append(sky::sphere(false)).unwrap();
    let (_folder, dataset) = photos::photograph(&truth, |_, photo| photo);
    let (edges, _) = largest_step(&baked_dome(1, None, BackdropWhen::Off).mesh);
    assert!(edges >= 100, "{edges}");
    // Of a large scene the dome is cut finer. In a small one photos would take many passes to pull
    // such colours to theirs.
    for (copies, with) in [(1, None), (11, None), (11, Some(&dataset))] {
        let asset = baked_dome(copies, with, BackdropWhen::Auto);
        let finer = if copies > 1 { 4 } else { 1 };
        assert_eq!(asset.provenance.backdrop_faces, 128 * finer);
        let (step, open) = largest_step(&asset.mesh);
        let name = format!("{copies} copies, photos {}", with.is_some());
        assert!(
            3 * u32::from(step) < u32::from(edges) && open == 0,
            "{name}: {step} of {edges}, {open} open"
        );
    }
}
