//! The stage `collision`.

use glam::Vec3;
use std::ops::ControlFlow::Continue;
use trisplat_fixtures::shapes::{around, ball};
use trisplat_scene::{
    ImportedScene,
    mesh::Mesh,
    report::{Outcome, StageEvent, StageProgress},
};
use trisplat_surface::{CollisionDetails, CollisionOptions, collision};

const COLLISION: CollisionOptions =
    CollisionOptions { collision: true, collision_triangles: Some(1000) };

/// A ball off the origin, with cameras around it.
fn scene() -> ImportedScene {
    ImportedScene { cameras: around(24, 4.0, 128), ..ImportedScene::from(ball(Vec3::ZERO)) }
}

fn run(found: &mut Option<Mesh>, scene: &ImportedScene, options: &CollisionOptions) -> Outcome<()> {
    let mut details = CollisionDetails::default();
    let mut nobody = |_: StageEvent<'_>| Continue(());
    collision(found, scene, &[], options, &mut details, &mut StageProgress::new(&mut nobody))
        .unwrap()
}

#[test]
fn it_is_made_once_and_when_it_is_asked_for() {
    let mut found = None;
    let skipped =
        |outcome: Outcome<()>, why: &str| matches!(outcome, Outcome::Skipped(w) if w.contains(why));
    assert!(skipped(
        run(&mut found, &scene(), &CollisionOptions::DEFAULT),
        "`collision` was not asked for"
    ));
    assert_eq!(found, None);
    assert_eq!(run(&mut found, &scene(), &COLLISION), Outcome::Changed(()));
    assert!(found.as_ref().is_some_and(|mesh| (1..=1000).contains(&mesh.face_count())));
    let kept = found.clone();
    assert!(skipped(run(&mut found, &scene(), &COLLISION), "already"));
    assert_eq!(found, kept);
    let mut none = None;
    assert!(skipped(
        run(&mut none, &ImportedScene::from(Mesh::default()), &COLLISION),
        "no connected surface"
    ));
    assert!(CollisionOptions { collision_triangles: Some(0), ..COLLISION }.validate().is_err());
}
