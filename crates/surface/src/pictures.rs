//! Draws the depth pictures of a scene.

use super::picture::{DepthPicture, FREE, UNKNOWN};
use glam::{UVec2, Vec3};
use trisplat_raster::{
    soft::SoftOptions,
    solid::{Barycentrics, NO_FACE, SolidRasterOptions, SolidRasterizer},
};
use trisplat_scene::{
    Scene, SceneNormalization, Soup, camera::Camera, math::srgb8::srgb8_from_linear, mesh::Mesh,
    report::StageProgress,
};
use trisplat_teacher::Teacher;

/// Pixels of all pictures together: they are in memory at once, with 7 bytes each.
const MOST_PIXELS: f64 = 48_000_000.0;
/// From this transmittance on a pixel counts as empty.
const FREE_FROM: f32 = 0.9;
/// Depth of the near plane in units of training space, as in training.
const NEAR: f32 = 0.01;

/// What every camera sees of `scene`, with its `shell` or without. Where all pictures together would be too
/// large, each is smaller.
pub(super) fn pictures(
    scene: &Scene,
    shell: bool,
    cameras: &[Camera],
    progress: StageProgress<'_>,
) -> Vec<DepthPicture> {
    let pixels: f64 = cameras.iter().map(|c| f64::from(c.size.x) * f64::from(c.size.y)).sum();
    let ratio = (MOST_PIXELS / pixels).sqrt().min(1.0);
    let smaller =
        |camera: &Camera| camera.resized((camera.size.as_dvec2() * ratio).as_uvec2().max(UVec2::ONE));
    let cameras: Vec<Camera> = cameras.iter().map(|c| if ratio < 1.0 { smaller(c) } else { *c }).collect();
    match scene {
        Scene::Soup(soup) => of_soup(soup, shell, &cameras, progress),
        Scene::Mesh(mesh) if shell || mesh.shell.is_empty() => of_mesh(mesh, &cameras, progress),
        Scene::Mesh(mesh) => {
            let mut mesh = mesh.clone();
            mesh.take_shell();
            of_mesh(&mesh, &cameras, progress)
        }
    }
}

/// Median depths of the soft drawing.
fn of_soup(
    soup: &Soup,
    shell: bool,
    cameras: &[Camera],
    mut progress: StageProgress<'_>,
) -> Vec<DepthPicture> {
    let mut soup = soup.clone();
    if !shell {
        soup.take_shell();
    }
    let options = SoftOptions { geometry: true, ..SoftOptions::default() };
    let mut teacher = Teacher::new(soup, cameras, &options);
    let unit = teacher.depth_unit();
    let mut one = |(i, camera): (usize, &Camera)| {
        progress.set(i, cameras.len());
        let frame = teacher.frame(camera);
        let depth = frame.median_depth.iter().zip(&frame.transmittance).map(|(depth, through)| {
            if *depth > 0.0 {
                depth * unit
            } else if *through >= FREE_FROM {
                FREE
            } else {
                UNKNOWN
            }
        });
        DepthPicture { camera: *camera, depth: depth.collect(), rgb: frame.to_pixels().rgb }
    };
    cameras.iter().enumerate().map(&mut one).collect()
}

/// Depths of the nearest faces.
fn of_mesh(mesh: &Mesh, cameras: &[Camera], mut progress: StageProgress<'_>) -> Vec<DepthPicture> {
    let centroids: Vec<Vec3> = (0..mesh.face_count()).map(|face| mesh.centroid(face)).collect();
    let near = NEAR / SceneNormalization::new(cameras, &centroids).scale;
    let options = SolidRasterOptions { near, ..SolidRasterOptions::default() };
    let mut solid = SolidRasterizer::new();
    let mut one = |(i, camera): (usize, &Camera)| {
        progress.set(i, cameras.len());
        let seen = solid.visibility(mesh, camera, &options);
        let weights = Barycentrics::new(mesh, camera, 1);
        let color = |(pixel, face): (usize, &u32)| {
            if *face == NO_FACE {
                return [0; 3];
            }
            let (x, y) = (pixel as u32 % camera.size.x, pixel as u32 / camera.size.x);
            let weights = weights.weights(&weights.face(*face), x, y);
            let corners = mesh.corner_colors(*face as usize).map(Vec3::from);
            let linear = corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2];
            linear.to_array().map(srgb8_from_linear)
        };
        let rgb = seen.face.iter().enumerate().map(color).collect();
        DepthPicture { camera: *camera, depth: seen.depth.clone(), rgb }
    };
    cameras.iter().enumerate().map(&mut one).collect()
}
