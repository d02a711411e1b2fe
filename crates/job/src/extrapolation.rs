//! Novel-view coverage: depth at the tracked points, and views from beside the cameras.

use glam::{UVec2, Vec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_dataset::{Dataset, View};
use trisplat_raster::solid::{NO_FACE, SolidRasterOptions, SolidRasterizer};
use trisplat_scene::Rng;
use trisplat_scene::camera::Camera;
use trisplat_scene::math::lists::median;
use trisplat_scene::mesh::Mesh;

/// Maximum relative error of a right depth.
const RIGHT_DEPTH: f32 = 0.01;
/// Minimum relative error of a wrong depth.
const WRONG_DEPTH: f32 = 0.05;
/// Number of views from beside the cameras.
const VIEWS: usize = 120;
/// Maximum distance of such a view from its camera, in median depths of that camera.
const MAX_OFFSET: f32 = 0.4;
/// Width of the pixels of such a view, px of the photo; half as much again as that of the cameras'
/// own.
const NOVEL_STEP: u32 = 6;
/// The same for the cameras' own views.
const OWN_STEP: u32 = 4;
/// Minimum share of such a view that a triangle without support fills: smaller ones are detail.
const MIN_SHARE: f32 = 0.002;
/// A triangle lacks support where it fills this many times more of a view than of any photo.
const MIN_MAGNIFICATION: f32 = 16.0;

/// Depth along the rays from training photos to the points they track.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DepthScores {
    /// Number of rays, to the fifth of the points that no training uses.
    pub rays: u64,
    /// Share of rays that meet the scene within 1% of the point's depth.
    pub within: f64,
    /// Share that meet it more than 5% before the point.
    pub before: f64,
    /// Share that meet it more than 5% behind the point, or nothing: one sees through the surface.
    pub behind: f64,
}

/// Pixels of views that look as the training cameras do, from up to 0.4 of their median depth
/// beside them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CoverageScores {
    /// Share with a triangle that fills over 0.2% of the view, and over 16 times more of it than of
    /// any photo.
    pub unsupported: f64,
    /// Share with nothing.
    pub empty: f64,
}

/// The depth of `mesh`, in the data set's frame; `None` without tracks.
pub(super) fn depth(mesh: &Mesh, near: f32, dataset: &Dataset) -> Option<DepthScores> {
    if !dataset.has_tracks() {
        return None;
    }
    let options = options(near);
    let mut solid = SolidRasterizer::new();
    let [mut rays, mut within, mut before, mut behind] = [0u64; 4];
    for view in dataset.train() {
        let camera = &view.camera;
        let drawn = solid.visibility(mesh, camera, &options);
        for (_, point) in dataset.tracked(view).filter(|(i, _)| Dataset::is_validation_point(*i)) {
            let Some((at, z)) = camera.project(point.position) else { continue };
            let face = drawn.face[at.y as usize * camera.size.x as usize + at.x as usize];
            let error = if face == NO_FACE {
                f32::INFINITY
            } else {
                plane_depth(mesh, face, camera, point.position) / z - 1.0
            };
            rays += 1;
            within += u64::from(error.abs() < RIGHT_DEPTH);
            before += u64::from(error < -WRONG_DEPTH);
            // A plane along the ray has no depth there.
            behind += u64::from(!(error <= WRONG_DEPTH));
        }
    }
    let share = |count: u64| count as f64 / rays as f64;
    (rays > 0).then(|| DepthScores {
        rays,
        within: share(within),
        before: share(before),
        behind: share(behind),
    })
}

/// Depth at which the ray through `point` meets the plane of a face.
fn plane_depth(mesh: &Mesh, face: u32, camera: &Camera, point: Vec3) -> f32 {
    let [a, b, c] = mesh.corners(face as usize);
    let normal = camera.rotation * (b - a).cross(c - a);
    let ray = camera.rotation * point + camera.translation;
    normal.dot(camera.rotation * a + camera.translation) / normal.dot(ray / ray.z)
}

/// Coverage of `mesh`, in the data set's frame, in views beside the training cameras; `None` without
/// a camera.
pub(super) fn coverage(mesh: &Mesh, near: f32, dataset: &Dataset) -> Option<CoverageScores> {
    let cameras: Vec<Camera> = dataset.train().map(|view: &View| view.camera).collect();
    let options = options(near);
    let mut solid = SolidRasterizer::new();
    let mut shares = vec![0.0f32; mesh.face_count()];
    // A triangle below 16 photo pixels counts as that large.
    let mut best =
        vec![16.0 / cameras.first()?.size.as_vec2().element_product(); mesh.face_count()];
    let mut reach = Vec::with_capacity(cameras.len());
    for camera in &cameras {
        let drawn = solid.visibility(mesh, &coarse(camera, OWN_STEP), &options);
        count(&drawn.face, &mut shares);
        for (best, share) in best.iter_mut().zip(&shares) {
            *best = best.max(*share);
        }
        let depths = drawn.depth.iter().copied().filter(|z| z.is_finite()).collect();
        reach.push(median(depths, f32::total_cmp).unwrap_or(1.0));
    }
    let rng = Rng::new(0, "beside", 0);
    let mut unsupported = 0.0f64;
    let mut empty = 0.0f64;
    for k in 0..VIEWS {
        let camera = &cameras[k % cameras.len()];
        let reach = reach[k % cameras.len()];
        let [height, turn, far] = [0, 1, 2].map(|axis| rng.uniform(3 * k as u64 + axis));
        let height = 2.0 * height - 1.0;
        let (sin, cos) = (std::f32::consts::TAU * turn).sin_cos();
        let level = (1.0 - height * height).sqrt();
        let offset =
            Vec3::new(level * cos, level * sin, height) * (MAX_OFFSET * reach * far.sqrt());
        let moved =
            Camera { translation: camera.translation - camera.rotation * offset, ..*camera };
        let drawn = solid.visibility(mesh, &coarse(&moved, NOVEL_STEP), &options);
        let nothing = count(&drawn.face, &mut shares);
        let lacks = |(share, best): &(&f32, &f32)| {
            **share > MIN_SHARE && **share > MIN_MAGNIFICATION * **best
        };
        unsupported +=
            shares.iter().zip(&best).filter(lacks).map(|(share, _)| f64::from(*share)).sum::<f64>();
        empty += f64::from(nothing);
    }
    Some(CoverageScores { unsupported: unsupported / VIEWS as f64, empty: empty / VIEWS as f64 })
}

/// The share of samples that each face fills, in `shares`; returns that of none.
fn count(faces: &[u32], shares: &mut [f32]) -> f32 {
    shares.fill(0.0);
    let one = 1.0 / faces.len().max(1) as f32;
    let mut nothing = 0.0;
    for face in faces {
        *shares.get_mut(*face as usize).unwrap_or(&mut nothing) += one;
    }
    nothing
}

fn coarse(camera: &Camera, step: u32) -> Camera {
    camera.resized((camera.size / step).max(UVec2::ONE))
}

fn options(near: f32) -> SolidRasterOptions {
    SolidRasterOptions { near, ..SolidRasterOptions::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_dataset::{DatasetOptions, Point};
    use trisplat_scene::math::geometry::octasphere;
    use trisplat_synthetic::SyntheticOptions;

    const PHOTOS: SyntheticOptions = SyntheticOptions {
        views: 6,
        width: 64,
        points: 200,
        seed: 0,
        transparent: false,
        phone: false,
        depth: false,
    };

    fn photos() -> Dataset {
        let folder = tempfile::tempdir().unwrap();
        trisplat_synthetic::write(folder.path(), &PHOTOS).unwrap();
        Dataset::load(folder.path(), &DatasetOptions::default()).unwrap()
    }

    /// A square across the view of `camera` at `depth`, of half this width.
    fn across(camera: &Camera, depth: f32, half: f32) -> [[Vec3; 3]; 2] {
        let back = camera.rotation.transpose();
        let corner =
            |x: f32, y: f32| back * (Vec3::new(x * half, y * half, depth) - camera.translation);
        let [a, b, c, d] =
            [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
        [[a, b, c], [a, c, d]]
    }

    fn mesh(triangles: &[[Vec3; 3]]) -> Mesh {
        Mesh::from_triangles(triangles, &vec![[0.5; 3]; triangles.len()]).unwrap()
    }

    #[test]
    fn depth_is_right_on_a_wall_and_wrong_before_and_behind_it() {
        let mut dataset = photos();
        let first = dataset.views.iter().position(|view| !view.test).unwrap();
        dataset.views = vec![dataset.views[first].clone()];
        let camera = dataset.views[0].camera;
        let place =
            |x: f32| camera.rotation.transpose() * (Vec3::new(x, 0.01, 2.0) - camera.translation);
        let point = |position| Point { position, rgb: [0; 3], error: None };
        // Every fifth point judges, and here each is one of them.
        dataset.points =
            [-0.3, -0.1, 0.1, 0.3].into_iter().flat_map(|x| vec![point(place(x)); 5]).collect();
        dataset.views[0].tracked = vec![0, 5, 10, 15];
        let shares = |depth_of_wall: f32| {
            let scores =
                depth(&mesh(&across(&camera, depth_of_wall, 9.0)), 0.01, &dataset).unwrap();
            assert_eq!(scores.rays, 4);
            [scores.before, scores.within, scores.behind]
        };
        assert_eq!(shares(2.01), [0.0, 1.0, 0.0]);
        assert_eq!(shares(1.8), [1.0, 0.0, 0.0]);
        assert_eq!(shares(2.2), [0.0, 0.0, 1.0]);
        assert_eq!(shares(-1.0), [0.0, 0.0, 1.0], "nothing there");
        dataset.views[0].tracked.clear();
        assert_eq!(depth(&mesh(&across(&camera, 2.0, 9.0)), 0.01, &dataset), None);
    }

    #[test]
    fn what_no_photo_shows_is_unsupported_beside_the_cameras() {
        let mut dataset = photos();
        dataset.views.retain(|view| !view.test);
        dataset.views.truncate(1);
        let (corners, faces) = octasphere(3);
        let ball: Vec<[Vec3; 3]> =
            faces.iter().map(|face| face.map(|i| corners[i as usize] * 40.0)).collect();
        let clean = coverage(&mesh(&ball), 0.01, &dataset).unwrap();
        assert!(clean.unsupported < 0.005 && clean.empty == 0.0, "{clean:?}");
        // A slat behind the camera, seen only by views from farther back.
        let slat = |view: &View| across(&view.camera, -0.5, 8.0);
        let slats: Vec<[Vec3; 3]> = dataset.train().flat_map(slat).chain(ball).collect();
        let found = coverage(&mesh(&slats), 0.01, &dataset).unwrap();
        assert!(found.unsupported > clean.unsupported + 0.01, "{found:?}");
        assert_eq!(coverage(&mesh(&slats[..1]), 0.01, &dataset).map(|b| b.empty > 0.8), Some(true));
    }
}
