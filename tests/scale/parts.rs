//! A run that trains a part of a scene.

use glam::{UVec2, Vec3};
use std::path::Path;
use trisplat::dataset::synthetic::{self, SyntheticOptions};
use trisplat::space::Space;
use trisplat::train::{Part, RunOptions, TrainPreset, checkpoint};
use trisplat::{Dataset, DatasetOptions, Loaded, Soup, TrainOptions, TrainRun, train};

fn photos(folder: &Path) -> Dataset {
    let options = SyntheticOptions { views: 12, width: 48, points: 300, ..SyntheticOptions::default() };
    synthetic::write(folder, &options).unwrap();
    Dataset::load(folder, &DatasetOptions::default()).unwrap()
}

fn space(dataset: &Dataset) -> Space {
    let cameras: Vec<_> = dataset.train().map(|view| view.camera).collect();
    let points: Vec<Vec3> = dataset.points.iter().map(|point| point.position).collect();
    Space::new(&cameras, &points)
}

fn options(preset: TrainPreset) -> TrainOptions {
    TrainOptions { steps: 60, max_triangles: 900, ..TrainOptions::from_scene(preset) }
}

/// A soft scene, without a shell.
fn soft(dataset: &Dataset) -> Loaded {
    let mut options =
        TrainOptions { steps: 60, max_triangles: 400, ..TrainOptions::preset(TrainPreset::Outdoor) };
    options.init.shell_subdivisions = 0;
    train(dataset, &options).unwrap().into()
}

fn soup(loaded: &Loaded) -> &Soup {
    match &loaded.scene {
        trisplat::Scene::Soup(soup) => soup,
        trisplat::Scene::Mesh(_) => panic!("a mesh"),
    }
}

#[test]
fn a_part_that_is_everything_is_a_plain_run() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = photos(folder.path());
    let from = Some(soft(&dataset));
    let options = options(TrainPreset::Solid);
    let plain = TrainRun { from, ..TrainRun::new(&dataset, &options) };
    let part = Some(Part { space: space(&dataset), frozen: 0 });
    let whole = TrainRun { part, ..plain.clone() };
    assert_eq!(plain.run(&mut ()).unwrap().soup, whole.run(&mut ()).unwrap().soup);
}

#[test]
fn frozen_triangles_stay_as_they_are_and_count_for_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = photos(folder.path());
    let from = soft(&dataset);
    let frozen = 150;
    for preset in [TrainPreset::Outdoor, TrainPreset::Solid] {
        let checkpoint_at = folder.path().join("a.checkpoint");
        let outputs = RunOptions {
            checkpoint: Some(checkpoint_at.clone()),
            checkpoint_every: 30,
            ..RunOptions::default()
        };
        // No more than there are: none of them is the budget of others.
        let own = soup(&from).len() - frozen;
        let options = TrainOptions { max_triangles: own as u64, ..options(preset) };
        let part = Some(Part { space: space(&dataset), frozen });
        let run = TrainRun { from: Some(from.clone()), part, outputs, ..TrainRun::new(&dataset, &options) };
        let trained = run.run(&mut ()).unwrap();
        assert!((1..=own).contains(&trained.soup.len()), "{} of {own}", trained.soup.len());
        let state = checkpoint::read(&checkpoint_at).unwrap().state;
        assert_eq!((state.frozen, state.pinned), (frozen, frozen));
        let first = trisplat::train::params::Params::from_soup(soup(&from), state.params.sh_degree);
        let space = space(&dataset);
        for i in 0..frozen {
            let corners = first.vertices[i].map(|corner| space.to_training(corner));
            assert!((0..3).all(|c| state.params.vertices[i][c].distance(corners[c]) < 1e-5), "{i}");
            assert_eq!((state.params.opacity[i], state.params.sigma[i]), (first.opacity[i], first.sigma[i]));
            let k = state.params.sh_count();
            assert_eq!(state.params.sh[i * k..(i + 1) * k], first.sh[i * k..(i + 1) * k]);
        }
        // A run that goes on has the same part.
        let resumed = TrainRun::from_checkpoint(&dataset, checkpoint::read(&checkpoint_at).unwrap());
        assert_eq!(resumed.run(&mut ()).unwrap().soup, trained.soup);
    }
}

#[test]
fn a_part_of_a_view_is_that_part_of_its_photo() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = photos(folder.path());
    let view = &dataset.views[3];
    let (corner, size) = (UVec2::new(8, 4), UVec2::new(20, 16));
    let part = view.cropped(corner, size).unwrap();
    let (whole, cut) = (view.photo.decode().unwrap(), part.photo.decode().unwrap());
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
    let pixel = |camera: &trisplat::Camera| {
        let q = camera.rotation * point + camera.translation;
        q.truncate() / q.z * camera.focal + camera.center
    };
    assert!((pixel(&view.camera) - pixel(&part.camera)).distance(corner.as_vec2()) < 1e-3);
    let error = view.cropped(UVec2::new(40, 0), UVec2::new(20, 4)).unwrap_err().to_string();
    assert!(error.contains("a part of the 48x36 px"), "{error}");
}
