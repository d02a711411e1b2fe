//! A run that trains a part of a scene.

use super::trained;
use glam::{UVec2, Vec3};
use std::ops::ControlFlow::Continue;
use std::path::Path;
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_scene::SceneNormalization;
use trisplat_scene::{ImportedScene, Soup};
use trisplat_synthetic::SyntheticOptions;
use trisplat_train::TrainOptions;
use trisplat_train::{Core, TrainInputs, TrainOutputs, TrainPreset, TrainedPart, checkpoint};

fn photos(folder: &Path) -> Dataset {
    let options =
        SyntheticOptions { views: 12, width: 48, points: 300, ..SyntheticOptions::default() };
    trisplat_synthetic::write(folder, &options).unwrap();
    Dataset::load(folder, &DatasetOptions::default()).unwrap()
}

fn space(dataset: &Dataset) -> SceneNormalization {
    let cameras: Vec<_> = dataset.train().map(|view| view.camera).collect();
    let points: Vec<Vec3> = dataset.points.iter().map(|point| point.position).collect();
    SceneNormalization::new(&cameras, &points)
}

fn options(preset: TrainPreset) -> TrainOptions {
    TrainOptions { steps: 60, max_triangles: 900, ..TrainOptions::from_scene(preset) }
}

/// A soft scene, without a shell.
fn soft(dataset: &Dataset) -> ImportedScene {
    let mut options = TrainOptions {
        steps: 60,
        max_triangles: 400,
        ..TrainOptions::preset(TrainPreset::Outdoor)
    };
    options.init.shell_subdivisions = 0;
    trained(dataset, &options).into()
}

fn soup(loaded: &ImportedScene) -> &Soup {
    match &loaded.scene {
        trisplat_scene::Scene::Soup(soup) => soup,
        trisplat_scene::Scene::Mesh(_) => panic!("a mesh"),
    }
}

#[test]
fn a_part_that_is_everything_is_a_plain_run() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = photos(folder.path());
    let from = Some(soft(&dataset));
    let options = options(TrainPreset::Solid);
    let plain = TrainInputs { from, ..TrainInputs::new(&dataset, &options) };
    let part = Some(TrainedPart { space: space(&dataset), frozen: 0, core: None, first_step: 0 });
    let whole = TrainInputs { part, ..plain.clone() };
    assert_eq!(
        plain.run(&mut |_| Continue(())).unwrap().soup,
        whole.run(&mut |_| Continue(())).unwrap().soup
    );
}

#[test]
fn frozen_triangles_stay_as_they_are_and_count_for_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = photos(folder.path());
    let from = soft(&dataset);
    let frozen = 150;
    for preset in [TrainPreset::Outdoor, TrainPreset::Solid] {
        let checkpoint_at = folder.path().join("a.checkpoint");
        let outputs = TrainOutputs {
            checkpoint: Some(checkpoint_at.clone()),
            checkpoint_every: 30,
            ..TrainOutputs::default()
        };
        // No more than there are: none of them is the budget of others.
        let own = soup(&from).len() - frozen;
        let options = TrainOptions { max_triangles: own as u64, ..options(preset) };
        let part = Some(TrainedPart { space: space(&dataset), frozen, core: None, first_step: 0 });
        let run = TrainInputs {
            from: Some(from.clone()),
            part,
            outputs,
            ..TrainInputs::new(&dataset, &options)
        };
        let trained = run.run(&mut |_| Continue(())).unwrap();
        assert!((1..=own).contains(&trained.soup.len()), "{} of {own}", trained.soup.len());
        let state = checkpoint::read(&checkpoint_at).unwrap().state;
        assert_eq!((state.frozen, state.pinned), (frozen, frozen));
        let first = trisplat_train::Params::from_soup(soup(&from), state.params.sh_degree);
        let space = space(&dataset);
        for i in 0..frozen {
            let corners = first.vertices[i].map(|corner| space.to_training(corner));
            assert!((0..3).all(|c| state.params.vertices[i][c].distance(corners[c]) < 1e-5), "{i}");
            assert_eq!(
                (state.params.opacity[i], state.params.sigma[i]),
                (first.opacity[i], first.sigma[i])
            );
            let k = state.params.sh_count();
            assert_eq!(state.params.sh[i * k..(i + 1) * k], first.sh[i * k..(i + 1) * k]);
        }
        // A run that goes on has the same part.
        let resumed =
            TrainInputs::from_checkpoint(&dataset, checkpoint::read(&checkpoint_at).unwrap());
        assert_eq!(resumed.run(&mut |_| Continue(())).unwrap().soup, trained.soup);
    }
}

#[test]
fn a_core_is_filled_up_to_its_budget_and_no_further() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = photos(folder.path());
    let from = soft(&dataset);
    let space = space(&dataset);
    // A cut through the middle: below is the core.
    let mut along: Vec<f32> = soup(&from).vertices.iter().map(|v| middle(v).x).collect();
    along.sort_unstable_by(f32::total_cmp);
    let place = along[along.len() / 2];
    let in_core = |v: &[Vec3; 3]| middle(v).x < place;
    let budget = along.len() / 2 + 60;
    let high = [Some(space.to_training(Vec3::splat(place)).x), None, None];
    let core = Some(Core { low: [None; 3], high, triangles: budget as u64 });
    let options = TrainOptions { max_triangles: 5000, ..options(TrainPreset::Outdoor) };
    let part = Some(TrainedPart { space, frozen: 0, core, first_step: 0 });
    let run =
        TrainInputs { from: Some(from.clone()), part, ..TrainInputs::new(&dataset, &options) };
    let trained = run.run(&mut |_| Continue(())).unwrap().soup;
    let held = trained.vertices.iter().filter(|v| in_core(v)).count();
    // Triangles cross the border as they move, and some are pruned at the end.
    assert!(held.abs_diff(budget) <= budget / 12, "{held} of {budget}");
    assert!(trained.len() > held && trained.len() < 5000, "{} and {held}", trained.len());
}

fn middle(corners: &[Vec3; 3]) -> Vec3 {
    (corners[0] + corners[1] + corners[2]) / 3.0
}

#[test]
fn a_run_that_goes_on_begins_with_what_it_was_given() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = photos(folder.path());
    let options =
        TrainOptions { steps: 600, max_triangles: 400, ..TrainOptions::preset(TrainPreset::Solid) };
    let whole = TrainInputs::new(&dataset, &options);
    let first: ImportedScene = TrainInputs { until_step: Some(240), ..whole.clone() }
        .run(&mut |_| Continue(()))
        .unwrap()
        .into();
    assert!(soup(&first).sigma.iter().all(|sigma| *sigma < 0.5), "its anneal has come some way");
    let part = Some(TrainedPart { space: space(&dataset), frozen: 0, core: None, first_step: 240 });
    let rest = TrainInputs { from: Some(first.clone()), part, until_step: Some(241), ..whole };
    let rest = rest.run(&mut |_| Continue(())).unwrap();
    assert_eq!((rest.steps, rest.soup.len()), (241, soup(&first).len()));
    // One step further on nothing looks much different.
    for i in 0..rest.soup.len() {
        let before = soup(&first);
        let after = &rest.soup;
        assert!(
            (before.opacity[i] - after.opacity[i]).abs() < 0.2,
            "{i}: {} {}",
            before.opacity[i],
            after.opacity[i]
        );
        assert!(
            (after.sigma[i] / before.sigma[i] - 1.0).abs() < 0.25,
            "{i}: {} {}",
            before.sigma[i],
            after.sigma[i]
        );
    }
}

#[test]
fn a_part_of_a_view_is_that_part_of_its_photo() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = photos(folder.path());
    let view = &dataset.views[3];
    let corner = UVec2::new(8, 4);
    let size = UVec2::new(20, 16);
    let part = view.cropped(corner, size).unwrap();
    let whole = view.photo.decode().unwrap();
    let cut = part.photo.decode().unwrap();
    assert_eq!(cut.size, size);
    for y in 0..size.y {
        for x in 0..size.x {
            let at = ((y + corner.y) * whole.size.x + x + corner.x) as usize;
            assert_eq!(cut.rgb[(y * size.x + x) as usize], whole.rgb[at]);
        }
    }
    // A part of a part.
    let inner = part.cropped(UVec2::new(4, 4), UVec2::new(8, 8)).unwrap();
    assert_eq!(inner.photo.decode().unwrap(), cut.part(UVec2::new(4, 4), UVec2::new(8, 8)));
    let point = dataset.points[0].position;
    let pixel = |camera: &trisplat_scene::camera::Camera| {
        let q = camera.rotation * point + camera.translation;
        q.truncate() / q.z * camera.focal + camera.center
    };
    assert!((pixel(&view.camera) - pixel(&part.camera)).distance(corner.as_vec2()) < 1e-3);
    let error = view.cropped(UVec2::new(40, 0), UVec2::new(20, 4)).unwrap_err().to_string();
    assert!(error.contains("a part of the 48x36 px"), "{error}");
}
