//! The shell that closes a scene where it has no points.

use super::{psnr, scene, trained};
use glam::UVec2;
use std::path::Path;
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_scene::{Soup, image::RgbImage};
use trisplat_synthetic::SyntheticOptions;
use trisplat_train::{TrainOptions, TrainPreset};

/// So few photos that much of the background is seen by one or two.
fn few() -> SyntheticOptions {
    SyntheticOptions { views: 12, width: 64, points: 400, ..SyntheticOptions::default() }
}

fn options(steps: u64, shell_subdivisions: u32) -> TrainOptions {
    let mut options =
        TrainOptions { steps, max_triangles: 1500, ..TrainOptions::preset(TrainPreset::Outdoor) };
    options.init.shell_subdivisions = shell_subdivisions;
    options
}

/// The corners of the triangles both soups begin with.
fn common(a: &Soup, b: &Soup) -> usize {
    a.vertices.iter().zip(&b.vertices).take_while(|(a, b)| a == b).count()
}

#[test]
fn a_scene_of_few_photos_holds_up_better_from_elsewhere() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = scene(folder.path(), &few());
    let [without, with] = [0, 2].map(|subdivisions| trained(&dataset, &options(300, subdivisions)));
    assert!(
        psnr(&with) > psnr(&without) + 0.5,
        "{:.2} dB, {:.2} dB without",
        psnr(&with),
        psnr(&without)
    );
}

#[test]
fn it_stays_where_it_is_and_takes_colours() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = scene(folder.path(), &few());
    for preset in [TrainPreset::Outdoor, TrainPreset::Solid] {
        let run = |steps| {
            let options =
                TrainOptions { steps, max_triangles: 1500, ..TrainOptions::preset(preset) };
            trained(&dataset, &options).soup
        };
        let early = run(30);
        let late = run(120);
        let shell = common(&early, &late);
        assert!((40..=128).contains(&shell), "{preset:?}: {shell}");
        assert!((0..shell).any(|i| early.rgb(i) != late.rgb(i)), "{preset:?}");
    }
}

#[test]
fn photos_with_masks_have_none() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = scene(folder.path(), &few());
    mask_photos(folder.path(), &dataset);
    let masked = Dataset::load(folder.path(), &DatasetOptions::default()).unwrap();
    let [without, with] =
        [0, 2].map(|subdivisions| trained(&masked, &options(20, subdivisions)).soup);
    assert_eq!(with, without);
}

/// Masks beside the photos that leave out a corner.
fn mask_photos(folder: &Path, dataset: &Dataset) {
    std::fs::create_dir(folder.join("masks")).unwrap();
    for view in &dataset.views {
        let size: UVec2 = view.photo.size;
        let counts = |i: u32| if i % size.x < 5 && i / size.x < 5 { [0; 3] } else { [255; 3] };
        let rgb = (0..size.x * size.y).map(counts).collect();
        RgbImage { size, rgb, alpha: None }
            .save_png(folder.join("masks").join(&view.name))
            .unwrap();
    }
}
