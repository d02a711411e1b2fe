//! The stage that draws triangles from the side that photos saw.

use super::photos::{photograph, views};
use glam::{Mat3, UVec2, Vec2, Vec3};
use std::ops::ControlFlow::Continue;
use trisplat_bake::{Bake, BakeOptions, Sides, SidesDetails, SidesOptions, sides};
use trisplat_raster::solid::{NO_FACE, SolidRasterOptions, SolidRasterizer};
use trisplat_scene::{
    Asset, ImportedScene, Result,
    camera::Camera,
    math::geometry::octasphere,
    mesh::{Colors, Mesh},
    report::{Outcome, StageEvent, StageProgress},
};

fn stage(
    mesh: &mut Mesh,
    cameras: &[Camera],
    sides_of: Sides,
) -> (Result<Outcome<()>>, SidesDetails) {
    let mut details = SidesDetails::default();
    let options = SidesOptions { sides: sides_of };
    let outcome = sides(
        mesh,
        None,
        cameras,
        None,
        &options,
        &mut details,
        &mut StageProgress::new(&mut |_| Continue(())),
    );
    (outcome, details)
}

/// A camera at `eye` that looks at the origin.
fn camera(eye: Vec3) -> Camera {
    let lens = Camera {
        rotation: Mat3::IDENTITY,
        translation: Vec3::ZERO,
        focal: Vec2::splat(100.0),
        center: Vec2::splat(50.0),
        size: UVec2::splat(100),
    };
    lens.with_look_at(eye, Vec3::ZERO, Vec3::NEG_Y)
}

/// A triangle of this size about `middle`, in the plane z = const, with its front towards -z or
/// towards +z.
fn upright(middle: Vec3, size: f32, towards_minus_z: bool) -> [Vec3; 3] {
    let [a, b, c] =
        [Vec3::new(-size, -size, 0.0), Vec3::new(size, -size, 0.0), Vec3::new(0.0, size, 0.0)];
    let corners = if towards_minus_z { [a, c, b] } else { [a, b, c] };
    corners.map(|corner| middle + corner)
}

fn cards() -> Mesh {
    let triangles = [
        // One turned away from the cameras and one towards them, one that stands behind another,
        // and one above all pictures.
        upright(Vec3::new(-0.5, 0.0, 0.0), 0.3, false),
        upright(Vec3::new(0.5, 0.0, 0.0), 0.3, true),
        upright(Vec3::new(0.5, 0.0, 0.3), 0.1, true),
        upright(Vec3::new(0.0, 20.0, 0.0), 0.3, true),
    ];
    Mesh::from_triangles(&triangles, &[[0.5; 3]; 4]).unwrap()
}

#[test]
fn what_cameras_see_from_one_side_turns_its_front_to_them() {
    let mut mesh = cards();
    let cameras = [camera(Vec3::new(0.0, 0.0, -3.0)), camera(Vec3::new(0.5, 0.0, -3.0))];
    let (outcome, details) = stage(&mut mesh, &cameras, Sides::Auto);
    assert!(matches!(outcome, Ok(Outcome::Changed(()))));
    assert_eq!(details, SidesDetails { single_sided: 2, two_sided: 0, unseen: 2 });
    assert_eq!(mesh.single_sided, [true, true, false, false]);
    assert!((0..2).all(|face| mesh.flat_normal(face) == Vec3::NEG_Z), "fronts face the cameras");
    assert_eq!(mesh.corners(2), cards().corners(2));
    // From there nothing changes; from behind only what nobody saw is drawn.
    let drawn = |mesh: &Mesh, eye: Vec3| {
        let options = SolidRasterOptions::default();
        let seen = SolidRasterizer::new().visibility(mesh, &camera(eye), &options).clone();
        let mut faces: Vec<u32> = seen.face.into_iter().filter(|face| *face != NO_FACE).collect();
        faces.dedup();
        faces.sort_unstable();
        faces.dedup();
        faces
    };
    assert_eq!(drawn(&mesh, Vec3::new(0.0, 0.0, -3.0)), [0, 1]);
    assert_eq!(drawn(&mesh, Vec3::new(0.0, 0.0, 3.0)), [2]);
    assert_eq!(drawn(&cards(), Vec3::new(0.0, 0.0, 3.0)), [0, 1, 2]);
    // A second time there is nothing to do.
    let (outcome, _) = stage(&mut mesh, &cameras, Sides::Auto);
    assert!(matches!(outcome, Ok(Outcome::Skipped(_))));
}

#[test]
fn sides_seen_from_both_or_by_nobody_stay_double() {
    let count = |front: usize, back: usize| {
        let mut mesh = cards();
        let cameras =
            [vec![camera(Vec3::Z * -3.0); front], vec![camera(Vec3::Z * 3.0); back]].concat();
        let (_, details) = stage(&mut mesh, &cameras, Sides::Auto);
        (details.single_sided, details.two_sided, mesh.single_sided.len())
    };
    // A third card is seen from behind only, and hides some of another there.
    assert_eq!(count(10, 1), (1, 2, 4));
    assert_eq!(count(0, 0), (0, 0, 0));
}

#[test]
fn both_sides_stay_where_they_are_asked_for_or_given() {
    let cameras = [camera(Vec3::Z * -3.0)];
    let mut mesh = cards();
    assert!(matches!(stage(&mut mesh, &cameras, Sides::Both).0, Ok(Outcome::Skipped(_))));
    assert_eq!(mesh, cards());
    assert!(matches!(stage(&mut mesh, &[], Sides::Auto).0, Ok(Outcome::Skipped(_))));
    assert_eq!(mesh, cards());
    mesh.single_sided = vec![false, false, true, false];
    let given = mesh.clone();
    assert!(matches!(stage(&mut mesh, &cameras, Sides::Auto).0, Ok(Outcome::Skipped(_))));
    assert_eq!(mesh, given, "a mesh that says it keeps its sides");
}

/// A ball, which photos all around show from outside, and cards around it, which they show from
/// both sides.
fn ball_and_cards() -> Mesh {
    let (corners, faces) = octasphere(3);
    let ball = faces.iter().map(|face| face.map(|i| corners[i as usize]));
    let cards = (0..12).map(|i| {
        let (sin, cos) = (i as f32 * std::f32::consts::TAU / 12.0).sin_cos();
        upright(Vec3::new(1.6 * cos, 1.2 * sin, 0.0), 0.2, i % 2 == 0)
    });
    let triangles: Vec<[Vec3; 3]> = ball.chain(cards).collect();
    let color = |i: usize| [3, 5, 7].map(|k| (i * k % 16) as f32 / 15.0);
    Mesh::from_triangles(&triangles, &(0..triangles.len()).map(color).collect::<Vec<_>>()).unwrap()
}

#[test]
fn backs_are_drawn_where_photos_look_better_with_them() {
    // Red cards around a blue ball; in truth every other card has one side.
    let ball = ball_and_cards().face_count() - 12;
    let color = |face| if face < ball { [0.1, 0.2, 0.6] } else { [0.9, 0.1, 0.1] };
    let colored = || {
        let mesh = ball_and_cards();
        Mesh { colors: Colors::Face((0..mesh.face_count()).map(color).collect()), ..mesh }
    };
    let mut truth = colored();
    truth.single_sided = (0..truth.face_count()).map(|face| face < ball || face % 2 == 0).collect();
    let (_folder, dataset) = photograph(&truth, |_, photo| photo);
    let mut scene = colored();
    let mut photos = views(&dataset);
    let cameras = photos.cameras().to_vec();
    let mut details = SidesDetails::default();
    let mut quiet = |_: StageEvent<'_>| Continue(());
    let progress = &mut StageProgress::new(&mut quiet);
    let options = SidesOptions::DEFAULT;
    sides(&mut scene, None, &cameras, Some(&mut photos), &options, &mut details, progress).unwrap();
    let cards = (ball..scene.face_count()).filter(|face| scene.is_single_sided(*face));
    let cards: Vec<usize> = cards.collect();
    assert!(cards.len() >= 3, "{cards:?}");
    for face in cards {
        assert_eq!(face % 2, 0, "a card of two sides lost one");
        assert_eq!(scene.flat_normal(face), truth.flat_normal(face));
    }
    assert!(scene.single_sided[..ball].iter().filter(|single| **single).count() > ball / 2);
    // Cameras alone keep every back that they see.
    let mut scene = colored();
    stage(&mut scene, &cameras, Sides::Auto).0.unwrap();
    assert!((ball..scene.face_count()).all(|face| !scene.is_single_sided(face)));
}

#[test]
fn sides_by_photos_are_in_levels_and_tiles() {
    let scene = ball_and_cards();
    let (_folder, dataset) = photograph(&scene, |_, photo| photo);
    let bake = |change: &dyn Fn(&mut BakeOptions)| {
        let mut options = BakeOptions::default();
        change(&mut options);
        let mut photos = views(&dataset);
        Bake::new(&options).photos(&mut photos).run([ImportedScene::from(scene.clone())]).unwrap()
    };
    // Without what is behind the scene.
    let single = |asset: &Asset| {
        (0..asset.scene_faces()).filter(|face| asset.mesh.is_single_sided(*face)).count()
    };
    let asset = bake(&|options| options.lod.lod = vec![0.5]);
    let counts = [&asset, &asset.levels[0]].map(single);
    assert!(counts[0] > 400 && counts[1] > 100 && counts[1] < counts[0], "{counts:?}");
    assert!(counts[0] < asset.scene_faces(), "cards have both sides");
    for chunk in &asset.chunks {
        let flags = &asset.mesh.single_sided[chunk.first as usize..][..chunk.count as usize];
        assert!(flags.iter().all(|flag| *flag == flags[0]), "a chunk has one material");
    }
    let tiled = bake(&|options| options.tiles.tiles = true);
    let mut all = 0;
    tiled.tiles.as_ref().unwrap().visit(&mut |tile| {
        let runs = tile.mesh.single_sided.chunk_by(|a, b| a == b).count();
        assert!(runs <= 2, "{runs} runs of faces of one kind");
        all += runs;
    });
    assert!(all > 0);
    let both = bake(&|options| options.sides.sides = Sides::Both);
    assert_eq!(single(&both), 0);
}
