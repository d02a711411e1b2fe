//! Levels of detail: which triangles stay, and what they cover.

use glam::{Mat3, UVec2, Vec2, Vec3};
use std::ops::ControlFlow::{self, Continue};
use trisplat_bake::{
    Bake, BakeOptions, BakePreset, Decimation, LodDetails, LodOptions, LodRanking, SAMPLES,
    visible_px,
};
use trisplat_fixtures::shapes::loose;
use trisplat_raster::solid::{NO_FACE, SolidRasterOptions, SolidRasterizer};
use trisplat_scene::{
    Asset, ImportedScene, Scene,
    camera::Camera,
    mesh::{Colors, Mesh},
    report::{Report, StageEvent, StageProgress},
};

/// A wall of 2 · 16 · 16 triangles that shade into each other, and as many hidden behind it.
fn wall() -> Mesh {
    let at = |x: u32, y: u32, z: f32| Vec3::new(x as f32 / 8.0 - 1.0, y as f32 / 8.0 - 1.0, z);
    let square = |x: u32, y: u32, z: f32| {
        let [a, b, c, d] = [at(x, y, z), at(x + 1, y, z), at(x + 1, y + 1, z), at(x, y + 1, z)];
        [a, b, c, a, c, d]
    };
    let squares = |z: f32| (0..256).flat_map(move |i| square(i % 16, i / 16, z));
    let positions = loose(squares(0.0).chain(squares(0.5)).collect());
    let color = |i: usize| {
        if positions[i].z == 0.0 {
            [0.4 + 0.2 * positions[i].x, 0.4 + 0.2 * positions[i].y, 0.3]
        } else {
            [1.0, 0.0, 1.0]
        }
    };
    let colors = Colors::Face((0..positions.len() / 3).map(|f| color(3 * f)).collect());
    Mesh { positions, colors, ..Mesh::default() }
}

/// Cameras before the wall, all of it in view.
fn cameras() -> Vec<Camera> {
    let lens = Camera {
        rotation: Mat3::IDENTITY,
        translation: Vec3::ZERO,
        focal: Vec2::splat(120.0),
        center: Vec2::new(64.0, 48.0),
        size: UVec2::new(128, 96),
    };
    let eye = |i: u32| Vec3::new((i % 3) as f32 - 1.0, (i / 3) as f32 * 0.5 - 0.5, -3.5);
    (0..9).map(|i| lens.with_look_at(eye(i), Vec3::ZERO, Vec3::NEG_Y)).collect()
}

fn loaded(cameras: Vec<Camera>) -> ImportedScene {
    ImportedScene {
        scene: Scene::Mesh(wall()),
        provenance: Default::default(),
        warnings: Vec::new(),
        cameras,
    }
}

fn baked(
    cameras: Vec<Camera>,
    shares: &[f64],
    change: impl Fn(&mut BakeOptions),
) -> (Asset, Report) {
    let mut options = BakeOptions::preset(BakePreset::Fast);
    options.lod = LodOptions { lod: shares.to_vec() };
    change(&mut options);
    let mut report = Report::default();
    let asset = Bake::new(&options).report(&mut report).run([loaded(cameras)]).unwrap();
    (asset, report)
}

/// Corners of every face, as bits that can be looked up.
fn faces(mesh: &Mesh) -> Vec<[[u32; 3]; 3]> {
    (0..mesh.face_count())
        .map(|f| mesh.corners(f).map(|v| v.to_array().map(f32::to_bits)))
        .collect()
}

/// Share of the samples at which nothing is, or only what had been hidden.
fn holes(mesh: &Mesh) -> f64 {
    let mut holes = 0;
    let mut all = 0;
    for camera in cameras() {
        let options = SolidRasterOptions::default();
        let whole = SolidRasterizer::new().visibility(&wall(), &camera, &options).face.clone();
        let mut solid = SolidRasterizer::new();
        let seen = solid.visibility(mesh, &camera, &options);
        for (now, before) in seen.face.iter().zip(&whole).filter(|(_, before)| **before != NO_FACE)
        {
            let hidden = |f: u32| mesh.corners(f as usize)[0].z > 0.25;
            holes += usize::from(*now == NO_FACE || (*before < 512 && hidden(*now)));
            all += 1;
        }
    }
    holes as f64 / f64::from(all)
}

#[test]
fn every_prefix_of_the_order_is_a_level() {
    let mesh = wall();
    let cameras = cameras();
    let visible_area =
        visible_px(&mesh, &cameras, SAMPLES, StageProgress::new(&mut |_| Continue(())));
    let visible: Vec<u32> = (0..512).collect();
    let ranked = |fewest: usize| {
        let mut decimation = Decimation::new(&mesh, &cameras);
        let mut nobody = |_: StageEvent<'_>| Continue(());
        let progress = StageProgress::new(&mut nobody);
        decimation.rank_by_importance(&visible_area, &visible, fewest, progress)
    };
    let order = ranked(60);
    let mut sorted = order.clone();
    sorted.sort_unstable();
    assert_eq!(sorted, visible, "every face once");
    let serial = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(serial.install(|| ranked(60)), order);
    // Stopping earlier changes nothing above: one order serves all levels.
    let above = ranked(300);
    let set =
        |order: &[u32]| order[..362].iter().copied().collect::<std::collections::BTreeSet<u32>>();
    assert_eq!(set(&above), set(&order));
}

#[test]
fn a_budget_keeps_the_shell_whole() {
    let sample = trisplat_fixtures::sample("soups/trained.ply");
    let baked = |max_triangles: Option<u64>| {
        let mut options = BakeOptions::preset(BakePreset::Default);
        options.prune.max_triangles = max_triangles;
        Bake::new(&options)
            .run([trisplat_formats::read(&sample, &Default::default()).unwrap()])
            .unwrap()
    };
    let whole = baked(None);
    let shell = trisplat_formats::read(&sample, &Default::default()).unwrap().scene.shell_count();
    let budget = 8 * shell + 500;
    assert!(shell > 0 && budget < whole.mesh.face_count());
    let fewer = baked(Some(budget as u64));
    assert_eq!((fewer.mesh.face_count(), fewer.provenance.backdrop_faces), (budget, shell as u32));
    assert_eq!(
        whole.provenance.backdrop_faces,
        4 * shell as u32,
        "without a budget it is cut in four"
    );
    // Parts before it place it, so its position may differ a little, but not its shape.
    let area = |asset: &Asset| {
        (asset.scene_faces()..asset.mesh.face_count()).map(|f| asset.mesh.area(f)).sum::<f64>()
    };
    assert!(
        (area(&fewer) / area(&whole) - 1.0).abs() < 1e-5,
        "{} of {}",
        area(&fewer),
        area(&whole)
    );
}

#[test]
fn finer_levels_hold_the_triangles_of_coarser_ones() {
    for cameras in [cameras(), Vec::new()] {
        let has_cameras = !cameras.is_empty();
        let (asset, report) = baked(cameras, &[0.5, 0.25, 0.1], |o| o.unseen.enlarge = false);
        let total = asset.mesh.face_count();
        assert_eq!(total, if has_cameras { 512 } else { 1024 });
        let counts: Vec<usize> = asset.levels.iter().map(|l| l.mesh.face_count()).collect();
        assert_eq!(counts, [0.5, 0.25, 0.1].map(|share| (total as f64 * share) as usize));
        let mut finer = faces(&asset.mesh);
        for level in &asset.levels {
            let these = faces(&level.mesh);
            assert!(these.iter().all(|face| finer.contains(face)));
            finer = these;
        }
        let details = report.details::<LodDetails>().unwrap();
        assert_eq!(
            details.ordered_by,
            if has_cameras { LodRanking::Importance } else { LodRanking::Size }
        );
        assert_eq!(details.levels[2].triangles, counts[2] as u64);
    }
}

#[test]
fn kept_triangles_cover_for_dropped_ones() {
    for (cameras, most) in [(cameras(), 0.45), (Vec::new(), 0.8)] {
        let open = baked(cameras.clone(), &[0.5], |o| o.unseen.enlarge = false).0;
        let closed = baked(cameras, &[0.5], |_| ()).0;
        let open = holes(&open.levels[0].mesh);
        let closed = holes(&closed.levels[0].mesh);
        assert!(open > 0.2, "{open} of the wall are missing");
        assert!(closed < most * open, "{closed} of the wall are missing, {open} without enlarging");
    }
}

#[test]
fn levels_are_placed_like_the_scene() {
    let (asset, _) = baked(cameras(), &[0.3], |o| {
        o.place.center = true;
        o.place.scale = 3.0;
        o.unseen.enlarge = false;
    });
    let scene = faces(&asset.mesh);
    assert!(faces(&asset.levels[0].mesh).iter().all(|face| scene.contains(face)));
    assert_eq!(asset.levels[0].provenance, asset.provenance);
}

#[test]
fn shares_must_fall() {
    for shares in [&[0.5, 0.5][..], &[1.0], &[0.0], &[f64::NAN], &[0.2, 0.4], &[0.5; 9]] {
        let error = LodOptions { lod: shares.to_vec() }.validate().unwrap_err().to_string();
        assert!(error.starts_with("lod "), "{error}");
    }
}

#[test]
fn long_stages_say_how_far_they_have_come() {
    let mut options = BakeOptions::preset(BakePreset::Fast);
    options.lod = LodOptions { lod: vec![0.5, 0.25] };
    options.prune.max_triangles = Some(300);
    // Every fraction that a stage has told.
    let mut fractions: Vec<(String, Vec<f64>)> = Vec::new();
    let mut observer = |event: StageEvent<'_>| {
        match event {
            StageEvent::Started(name) => fractions.push((name.to_owned(), Vec::new())),
            StageEvent::Progressed(fraction) => {
                fractions.last_mut().expect("a stage").1.push(fraction)
            }
            _ => {}
        }
        Continue(())
    };
    Bake::new(&options).observer(&mut observer).run([loaded(cameras())]).unwrap();
    for stage in ["unseen", "lod"] {
        let (_, told) = fractions.iter().find(|(name, _)| name == stage).unwrap();
        assert!(told.is_sorted(), "{stage}: {told:?}");
        assert!(told.len() >= 20, "{stage}: {told:?}");
        assert!(told[0] < 0.05 && told[told.len() - 1] > 0.7, "{stage}: {told:?}");
        assert!(told.iter().all(|f| (0.0..=1.0).contains(f)), "{stage}: {told:?}");
    }
}

#[test]
fn corners_move_alike_on_any_number_of_threads() {
    let mesh = wall();
    let cameras = cameras();
    let kept: Vec<u32> = (0..512).step_by(3).collect();
    let moved = || {
        let mut decimation = Decimation::new(&mesh, &cameras);
        let mut nobody = |_: StageEvent<'_>| Continue(());
        decimation.move_corners(&kept, StageProgress::new(&mut nobody))
    };
    let serial = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let parallel = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap();
    let moves = serial.install(moved);
    assert!(moves.moves > 50, "{}", moves.moves);
    assert_eq!(parallel.install(moved), moves);
    let mut after = mesh.clone();
    moves.apply(&mut after);
    let changed = |f: usize| after.corners(f) != mesh.corners(f);
    assert!(
        (0..1024).filter(|f| changed(*f)).all(|f| kept.contains(&(f as u32))),
        "only those that stay"
    );
}

#[test]
fn an_observer_stops_a_bake_between_two_stages() {
    let mut ended = Vec::new();
    let mut observer = |event: StageEvent<'_>| match event {
        StageEvent::Finished(stage) => {
            ended.push(stage.name.clone());
            if stage.name == "prune" { ControlFlow::Break(()) } else { Continue(()) }
        }
        _ => Continue(()),
    };
    let options = BakeOptions::preset(BakePreset::Fast);
    let error = Bake::new(&options).observer(&mut observer).run([loaded(cameras())]).unwrap_err();
    assert!(matches!(&error, trisplat_scene::Error::Stopped { .. }), "{error}");
    assert_eq!(ended.last().map(String::as_str), Some("prune"));
}
