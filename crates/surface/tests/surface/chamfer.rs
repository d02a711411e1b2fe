//! The surface of a trained scene against the truth of the synthetic scene that it was trained on.

use super::closed_form::made;
use glam::{DVec3, IVec3, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_fixtures::sample;
use trisplat_formats::{ReadOptions, read};
use trisplat_scene::{camera::Camera, mesh::Mesh};
use trisplat_surface::SurfaceOptions;
use trisplat_synthetic::{Ray, trace};

/// Side of the cells in which nearest points are looked for; also the largest distance.
const CELL: f32 = 0.25;
/// Points that distances are measured from.
const ASKED: usize = 10_000;
/// The scene without its far floor and sky.
const LOW: Vec3 = Vec3::new(-2.5, -2.0, -2.5);
const HIGH: Vec3 = Vec3::new(2.5, 0.1, 2.5);

/// Points by their cell.
struct Points(HashMap<IVec3, Vec<Vec3>>);

impl Points {
    fn new(points: &[Vec3]) -> Self {
        let mut cells: HashMap<IVec3, Vec<Vec3>> = HashMap::new();
        points
            .iter()
            .for_each(|p| cells.entry((*p / CELL).floor().as_ivec3()).or_default().push(*p));
        Self(cells)
    }

    /// Distance from `p` to the nearest of them, at most [`CELL`].
    fn distance(&self, p: Vec3) -> f32 {
        let cell = (p / CELL).floor().as_ivec3();
        let around =
            (-1..=1).flat_map(|x| (-1..=1).flat_map(move |y| (-1..=1).map(move |z| (x, y, z))));
        let near =
            around.filter_map(|(x, y, z)| self.0.get(&(cell + IVec3::new(x, y, z)))).flatten();
        near.map(|q| q.distance(p)).fold(CELL, f32::min)
    }
}

/// The surface that `cameras` truly see, one point every `step` pixels.
fn truth(cameras: &[Camera], step: f32) -> Vec<Vec3> {
    let mut points = Vec::new();
    for camera in cameras {
        let origin = camera.position().as_dvec3();
        let back = camera.rotation.transpose();
        let count = (camera.size.as_vec2() / step).as_uvec2();
        for (x, y) in (0..count.y).flat_map(|y| (0..count.x).map(move |x| (x, y))) {
            let at = (glam::Vec2::new(x as f32, y as f32) + 0.5) * step;
            let direction = back * ((at - camera.center) / camera.focal).extend(1.0);
            let hit = trace(Ray { origin, direction: direction.as_dvec3() });
            points.extend(hit.filter(|hit| !hit.sky).map(|hit| hit.position.as_vec3()));
        }
    }
    points.retain(|p| p.cmpge(LOW).all() && p.cmple(HIGH).all());
    points
}

/// Points all over a mesh, about `spacing` apart.
fn samples(mesh: &Mesh, spacing: f32) -> Vec<Vec3> {
    let mut points = Vec::new();
    for face in 0..mesh.face_count() {
        let [a, b, c] = mesh.corners(face);
        let n = ((a.distance(b).max(a.distance(c)) / spacing).ceil() as i32).max(1);
        for (i, j) in (0..n).flat_map(|i| (0..n - i).map(move |j| (i, j))) {
            let part = |k: i32| (k as f32 + 1.0 / 3.0) / n as f32;
            points.push(a + (b - a) * part(i) + (c - a) * part(j));
        }
    }
    points.retain(|p| p.cmpge(LOW).all() && p.cmple(HIGH).all());
    points
}

/// Mean and median of the distances from about [`ASKED`] of `points` to `others`.
fn distances(points: &[Vec3], others: &[Vec3]) -> (f64, f64) {
    let others = Points::new(others);
    let step = (points.len() / ASKED).max(1);
    let mut all: Vec<f32> = points.par_iter().step_by(step).map(|p| others.distance(*p)).collect();
    all.sort_unstable_by(f32::total_cmp);
    (all.iter().map(|d| f64::from(*d)).sum::<f64>() / all.len() as f64, all[all.len() / 2].into())
}

/// The sample soup, which the README's training writes. Figures for docs/benchmarks/surface.md.
#[test]
fn the_trained_sample_is_near_the_truth() {
    let dataset = Dataset::load(sample("dataset"), &DatasetOptions::default()).unwrap();
    assert_eq!(dataset.origin, DVec3::ZERO);
    let cameras: Vec<Camera> = dataset.train().map(|view| view.camera).collect();
    let scene = read(&sample("soups/trained.ply"), &ReadOptions::with_degree(0)).unwrap();
    let coarse = truth(&cameras, 2.0);
    let fine = truth(&cameras, 0.5);
    // More in a longer run: TRISPLAT_RESOLUTIONS=128,256,512.
    let asked = std::env::var("TRISPLAT_RESOLUTIONS").unwrap_or("128".into());
    for resolution in asked.split(',').map(|n| n.parse().unwrap()) {
        let options = SurfaceOptions { resolution: Some(resolution), ..SurfaceOptions::DEFAULT };
        let (mesh, details) = made(&scene, &cameras, &options);
        let mesh = mesh.unwrap();
        let voxel = details.voxel;
        let accuracy = distances(&samples(&mesh, voxel as f32), &fine);
        let completeness = distances(&coarse, &samples(&mesh, voxel as f32 / 3.0));
        let chamfer = (accuracy.0 + completeness.0) / 2.0;
        println!(
            "{resolution}: voxel {voxel:.4}, {} triangles; to the truth {:.4} (median {:.4}), from it {:.4} (median {:.4}), \
             Chamfer {chamfer:.4} = {:.2} voxels",
            mesh.face_count(),
            accuracy.0,
            accuracy.1,
            completeness.0,
            completeness.1,
            chamfer / voxel
        );
        // A pixel of the photos is about that wide, in the middle of the scene: finer voxels show
        // the soup's own error.
        assert!(chamfer < (0.75 * voxel).max(0.03), "{chamfer} of {voxel}");
    }
}
