//! Masks that are silhouettes of an object cut it out; others do not count.

use super::{copy_sample, real, sample};
use glam::{UVec2, Vec2, Vec3};
use std::path::Path;
use trisplat_dataset::{Dataset, DatasetOptions, Masks, View};
use trisplat_scene::image::RgbImage;

/// The choice of `auto` for masks that keep the pixels that `keeps` chooses.
fn decided(keeps: impl Fn(usize, &View, Vec2) -> bool) -> Masks {
    let folder = tempfile::tempdir().unwrap();
    masked(folder.path(), keeps);
    on_its_own(folder.path())
}

/// The sample with such masks.
fn masked(folder: &Path, keeps: impl Fn(usize, &View, Vec2) -> bool) {
    copy_sample(folder);
    let masks = folder.join("masks");
    std::fs::create_dir(&masks).unwrap();
    for (i, view) in Dataset::load(sample("dataset"), &DatasetOptions::default())
        .unwrap()
        .views
        .iter()
        .enumerate()
    {
        let size = view.camera.size;
        let at = |p: u32| UVec2::new(p % size.x, p / size.x).as_vec2();
        let rgb =
            (0..size.element_product()).map(|p| [if keeps(i, view, at(p)) { 255 } else { 0 }; 3]);
        let mask = RgbImage { size, rgb: rgb.collect(), alpha: None };
        mask.save_png(masks.join(Path::new(&view.name).with_extension("png"))).unwrap();
    }
}

fn on_its_own(path: &Path) -> Masks {
    let dataset = Dataset::load(path, &DatasetOptions::default()).unwrap();
    let decided = dataset.masks(Masks::Auto);
    assert_eq!(dataset.views[0].photo.is_cut(), decided == Masks::Cut);
    assert_eq!(dataset.masks(Masks::Off), Masks::Off);
    decided
}

/// True if a pixel shows a ball that holds a third of the points.
fn ball() -> impl Fn(&View, Vec2) -> bool {
    let dataset = Dataset::load(sample("dataset"), &DatasetOptions::default()).unwrap();
    let all: Vec<Vec3> = dataset.points.iter().map(|point| point.position).collect();
    let middle = all.iter().sum::<Vec3>() / all.len() as f32;
    let mut distances: Vec<f32> = all.iter().map(|point| point.distance(middle)).collect();
    distances.sort_by(f32::total_cmp);
    let radius = distances[all.len() / 3];
    move |view, px| {
        let camera = &view.camera;
        let ray = ((px + 0.5 - camera.center) / camera.focal).extend(1.0).normalize();
        let center = camera.rotation * middle + camera.translation;
        let along = ray.dot(center);
        along > 0.0 && center.length_squared() - along * along < radius * radius
    }
}

#[test]
fn silhouettes_of_an_object_cut_it_out() {
    let inside = ball();
    assert_eq!(decided(|_, view, px| inside(view, px)), Masks::Cut);
}

#[test]
fn masks_of_people_or_of_a_lens_are_no_silhouettes() {
    // Someone who walks past.
    let passing = |i: usize, view: &View, px: Vec2| {
        let size = view.camera.size.as_vec2();
        let at = size * Vec2::new(0.1 + 0.37 * i as f32 % 0.9, 0.5);
        px.distance(at) > size.y / 4.0
    };
    assert_eq!(decided(passing), Masks::Ignore);
    // The dark corners of a lens.
    let corners = |_: usize, view: &View, px: Vec2| {
        let middle = view.camera.size.as_vec2() / 2.0;
        px.distance(middle) < 0.9 * middle.length()
    };
    assert_eq!(decided(corners), Masks::Ignore);

    let folder = tempfile::tempdir().unwrap();
    let inside = ball();
    masked(folder.path(), |_, view, px| inside(view, px));
    let first =
        Dataset::load(sample("dataset"), &DatasetOptions::default()).unwrap().views[0].name.clone();
    std::fs::remove_file(folder.path().join("masks").join(Path::new(&first).with_extension("png")))
        .unwrap();
    assert_eq!(on_its_own(folder.path()), Masks::Ignore);
}

#[test]
fn a_house_with_masks_is_cut_out() {
    if let Some(path) = real("dtu_scan24") {
        assert_eq!(on_its_own(&path), Masks::Cut);
    }
}
