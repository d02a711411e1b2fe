//! Every depth and normal against what a ray of the scene meets.

use glam::{DVec3, Vec2, Vec3};
use trisplat::dataset::synthetic::{self, SyntheticOptions};
use trisplat::dataset::synthetic_scene::{Ray, SurfaceHit, trace};
use trisplat::dataset::{Dataset, DatasetOptions, View};
use trisplat::report::StageProgress;
use trisplat::stereo::{DepthMap, StereoOptions, estimate};
use trisplat::train::{StereoUse, TrainOptions, TrainRun};

/// Photos of the synthetic scene.
fn photos(options: &SyntheticOptions) -> (tempfile::TempDir, Dataset) {
    let folder = tempfile::tempdir().unwrap();
    synthetic::write(folder.path(), options).unwrap();
    let dataset = Dataset::load(folder.path(), &DatasetOptions::default()).unwrap();
    (folder, dataset)
}

fn maps(dataset: &Dataset, options: &StereoOptions) -> Vec<DepthMap> {
    let views: Vec<&View> = dataset.train().collect();
    estimate(&views, &dataset.points, options, &mut StageProgress::new(&mut ())).unwrap()
}

/// What the ray through a pixel's centre meets, and its depth.
fn truth(map: &DepthMap, pixel: usize) -> SurfaceHit {
    let (camera, width) = (&map.camera, map.camera.size.x as usize);
    let middle = Vec2::new((pixel % width) as f32 + 0.5, (pixel / width) as f32 + 0.5);
    let ray = ((middle - camera.center) / camera.focal).extend(1.0);
    let direction = (camera.rotation.transpose() * ray).as_dvec3();
    trace(Ray { origin: camera.position().as_dvec3(), direction }).unwrap()
}

/// Shares of what was answered, and of all pixels.
#[derive(Debug, Default)]
struct Shares {
    pixels: f64,
    surface: f64,
    known: f64,
    within_1: f64,
    within_2: f64,
    /// Off by more than 5%.
    false_answers: f64,
    normals: f64,
}

fn shares(maps: &[DepthMap]) -> Shares {
    let mut sum = Shares::default();
    for map in maps {
        for pixel in 0..map.depth.len() {
            let hit = truth(map, pixel);
            sum.pixels += 1.0;
            sum.surface += f64::from(u8::from(!hit.sky));
            if !map.is_known(pixel) {
                continue;
            }
            let error = (f64::from(map.depth[pixel]) / hit.distance - 1.0).abs();
            let cosine = map.normal[pixel].as_dvec3().dot(hit.normal);
            sum.known += 1.0;
            sum.within_1 += f64::from(u8::from(error < 0.01));
            sum.within_2 += f64::from(u8::from(error < 0.02));
            sum.false_answers += f64::from(u8::from(error > 0.05));
            sum.normals += f64::from(u8::from(cosine > 10f64.to_radians().cos()));
        }
    }
    let known = sum.known.max(1.0);
    Shares {
        surface: sum.surface / sum.pixels,
        known: sum.known / sum.pixels,
        within_1: sum.within_1 / known,
        within_2: sum.within_2 / known,
        false_answers: sum.false_answers / known,
        normals: sum.normals / known,
        ..sum
    }
}

#[test]
fn depths_are_those_of_the_scene() {
    let (_folder, dataset) = photos(&SyntheticOptions {
        views: 20,
        width: 192,
        points: 800,
        seed: 0,
        ..SyntheticOptions::default()
    });
    let found = shares(&maps(&dataset, &StereoOptions::default()));
    assert!(found.known > 0.2, "{found:?}");
    assert!(found.within_1 > 0.94 && found.within_2 > 0.96, "{found:?}");
    assert!(found.false_answers < 0.02 && found.normals > 0.88, "{found:?}");
}

#[test]
fn the_bits_are_the_same_on_any_number_of_threads() {
    let (_folder, dataset) = photos(&SyntheticOptions {
        views: 8,
        width: 96,
        points: 400,
        seed: 1,
        ..SyntheticOptions::default()
    });
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| maps(&dataset, &StereoOptions::default()))
    };
    let one = with(1);
    assert!(one.iter().any(|map| map.known_share() > 0.0));
    assert_eq!(one, with(3));
}

#[test]
fn photos_without_points_are_compared_by_their_poses() {
    let (_folder, mut dataset) = photos(&SyntheticOptions {
        views: 12,
        width: 96,
        points: 100,
        seed: 0,
        ..SyntheticOptions::default()
    });
    dataset.points.clear();
    let found = shares(&maps(&dataset, &StereoOptions::default()));
    assert!(found.known > 0.02 && found.within_2 > 0.8, "{found:?}");
}

#[test]
fn one_photo_has_no_depths() {
    let (_folder, mut dataset) =
        photos(&SyntheticOptions { views: 2, width: 64, points: 50, seed: 0, ..SyntheticOptions::default() });
    dataset.views.truncate(1);
    dataset.views[0].test = false;
    let maps = maps(&dataset, &StereoOptions::default());
    assert!(maps.len() == 1 && maps[0].known_share() == 0.0);
    assert!(maps[0].normal.iter().all(|normal| *normal == Vec3::ZERO));
    let _: DVec3 = truth(&maps[0], 0).normal;
}

#[test]
fn training_begins_on_the_surfaces_of_the_scene() {
    let (_folder, dataset) = photos(&SyntheticOptions {
        views: 16,
        width: 128,
        points: 400,
        seed: 0,
        ..SyntheticOptions::default()
    });
    let first = |stereo: StereoUse| {
        let options = TrainOptions { steps: 1, max_triangles: 4000, stereo, ..TrainOptions::default() };
        let trained = TrainRun::new(&dataset, &options).run(&mut ()).unwrap();
        trained.soup.vertices
    };
    let (with, without) = (first(StereoUse::On), first(StereoUse::Off));
    assert_eq!(first(StereoUse::Auto), without, "`auto` is off");
    // Of the triangles in view of a camera, those that lie on what its ray meets; the others are behind something, or wrong.
    let on_surface = |triangles: &[[Vec3; 3]]| {
        let lies = |triangle: &&[Vec3; 3]| {
            let middle = (triangle[0] + triangle[1] + triangle[2]) / 3.0;
            dataset.train().any(|view| {
                let origin = view.camera.position().as_dvec3();
                let direction = middle.as_dvec3() - origin;
                let hit = trace(Ray { origin, direction }).unwrap();
                view.camera.frames(middle) && (hit.distance - 1.0).abs() < 0.02
            })
        };
        triangles.iter().filter(lies).count()
    };
    let gained = on_surface(&with).saturating_sub(on_surface(&without));
    assert!(10 * gained > without.len(), "{gained} of {} more than of {}", with.len(), without.len());
}
