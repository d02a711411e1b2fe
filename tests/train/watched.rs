//! A run whose scene is looked at while it trains.

use super::{options, scene, small, trained};
use trisplat_scene::{ImportedScene, Scene};
use trisplat_train::{TrainObserver, TrainRun, TrainSample};

/// Wants the scene after every 40th step.
#[derive(Default)]
struct Watch {
    asked: u64,
    seen: Vec<(u64, ImportedScene)>,
}

impl TrainObserver for Watch {
    fn wants_scene(&mut self) -> bool {
        self.asked += 1;
        self.asked.is_multiple_of(40)
    }

    fn scene(&mut self, sample: &TrainSample, scene: ImportedScene) {
        self.seen.push((sample.step, scene));
    }
}

#[test]
fn a_run_that_is_watched_gives_away_its_scenes_and_makes_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = scene(folder.path(), &small());
    let unwatched = trained(&dataset, &options(120));
    let mut watch = Watch::default();
    let watched = TrainRun::new(&dataset, &options(120)).run(&mut watch).unwrap();
    assert_eq!(watched.soup, unwatched.soup);
    assert_eq!(watch.seen.iter().map(|(step, _)| *step).collect::<Vec<_>>(), [40, 80, 120]);
    // What was seen last is what is written, the first something else.
    let (_, last) = watch.seen.pop().unwrap();
    assert_eq!(last, ImportedScene::from(watched));
    assert!(watch.seen.iter().all(|(_, scene)| scene.scene != last.scene && scene.cameras == last.cameras));
    assert!(matches!(last.scene, Scene::Soup(_)));
}
