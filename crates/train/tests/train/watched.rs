//! A run whose scene is looked at while it trains.

use super::{options, scene, small, trained};
use std::ops::ControlFlow::Continue;
use trisplat_scene::{ImportedScene, Scene};
use trisplat_train::{TrainEvent, TrainInputs};

#[test]
fn preview_of_a_run_changes_no_bit() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = scene(folder.path(), &small());
    let unwatched = trained(&dataset, &options(120));
    let mut seen: Vec<(u64, ImportedScene)> = Vec::new();
    let mut watch = |event: TrainEvent<'_>| {
        match event {
            TrainEvent::Step { sample, wants_scene } => {
                *wants_scene = sample.step.is_multiple_of(40)
            }
            TrainEvent::Scene(sample, scene) => seen.push((sample.step, *scene)),
            _ => {}
        }
        Continue(())
    };
    let watched = TrainInputs::new(&dataset, &options(120)).run(&mut watch).unwrap();
    assert_eq!(watched.soup, unwatched.soup);
    assert_eq!(seen.iter().map(|(step, _)| *step).collect::<Vec<_>>(), [40, 80, 120]);
    // The last scene seen is the written one, the first is another.
    let (_, last) = seen.pop().unwrap();
    assert_eq!(last, ImportedScene::from(watched));
    assert!(
        seen.iter().all(|(_, scene)| scene.scene != last.scene && scene.cameras == last.cameras)
    );
    assert!(matches!(last.scene, Scene::Soup(_)));
}
