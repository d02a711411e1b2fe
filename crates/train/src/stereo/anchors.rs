//! Depth anchors: points of surfaces that are measured in the photos before training, tracked ones
//! and the points propagated from them.
//!
//! An anchor gives a ray of known length from each photo that shows it. In a solid scene, a
//! triangle that stands before anchors in most of its photos is removed. An anchor that most photos
//! see through gets a triangle if the photos agree on its colour: a shiny surface looks better
//! where the reflection seems to lie. A triangle a little off its anchors moves towards them.

use super::color_agreement::{MAX_COLOR_DEVIATION, color_deviations};
use super::consistency::SurfacePoint;
use super::gray_image::{gray_images, read_depths};
use super::matching::{propagate, shared_points};
use super::propagation::SeedPoint;
use crate::initial::in_even_subset;
use crate::params::{OptimizerState, Params};
use crate::pyramid::Pyramid;
use crate::visibility::VisibilityStats;
use glam::Vec3;
use trisplat_dataset::{Dataset, Point, View};
use trisplat_scene::camera::Camera;
use trisplat_scene::math::neighbours::nearest;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::{RayTree, Result, Rng, SceneNormalization, sh0_from_rgb};

/// Largest reprojection error of an anchor, px.
const MAX_ERROR: f32 = 2.0;
/// Minimum number of photos that show an anchor, or that an occluding triangle stands in.
const MIN_PHOTOS: u32 = 2;
/// Largest difference of two depths of one surface, as a share of the depth.
const DEPTH_TOLERANCE: f32 = 0.02;
/// Largest distance of a triangle from its anchors at which it moves, as a share of the depth.
const MAX_ADJUSTMENT: f32 = 0.03;
/// Share of that distance that a triangle moves at a densification: training moves it too.
const PULL: f32 = 0.5;
/// Longest side of the matched photos, px.
const MAX_PHOTO_SIDE: f64 = 480.0;
/// Maximum number of rays to an anchor.
const MAX_RAYS_PER_POINT: usize = 4;
/// Number of neighbours that define the plane of an anchor.
const NEIGHBOURS: usize = 8;
/// Number of neighbours whose mean distance is the gap around an anchor.
const GAP_NEIGHBOURS: usize = 3;
/// Radius of a new triangle in gaps: turned at random, triangles leave a twentieth of the surface
/// open.
const RADIUS: f32 = 1.6;
/// Largest radius, px of the nearest photo.
const MAX_RADIUS_PX: f32 = 6.5;
/// Opacity's logit and σ's logarithm of a new triangle: solid.
const SOLID_RAW: [f32; 2] = [6.0, -3.0];

/// Measured points of surfaces, and the photos that show them.
#[derive(Debug, Default)]
pub(crate) struct DepthAnchors {
    points: Vec<SurfacePoint>,
    /// Radius of the triangle at each point.
    radius: Vec<f32>,
    /// Deviation of the photos' colours at each point.
    color_deviation: Vec<f32>,
    /// Photo and point of each ray, sorted.
    rays: Vec<(u32, u32)>,
}

/// The first face on a ray to an anchor.
#[derive(Debug, Clone, Copy)]
struct RayHit {
    face: u32,
    /// Distance of the face as a share of the anchor's, minus 1: negative before the anchor.
    offset: f32,
}

/// Changes of a scene that its anchors demand.
#[derive(Debug, Default)]
pub(crate) struct DepthRepair {
    /// Flags of triangles that hide anchors. `[N]`
    pub(crate) occludes: Vec<bool>,
    /// Anchors that most of their photos see through.
    pub(crate) holes: Vec<u32>,
    /// Shifts of triangles towards their anchors; empty unless they may move. `[N]`
    pub(crate) shifts: Vec<Vec3>,
}

impl DepthAnchors {
    /// Anchors at the points of `dataset` that its training photos track, and at points propagated
    /// from them and from depth maps for a scene of up to `triangles`; empty without both.
    ///
    /// # Errors
    ///
    /// Photos or depth maps that cannot be decoded.
    pub(crate) fn new(
        dataset: &Dataset,
        space: &SceneNormalization,
        cameras: &[Camera],
        photos: &mut Pyramid,
        level: u32,
        triangles: u64,
    ) -> Result<Self> {
        let mut anchors = Self::default();
        let mut seeds = anchors.add_tracks(dataset, space, cameras);
        let views: Vec<&View> = dataset.train().collect();
        if seeds.is_empty() && views.iter().all(|view| view.photo.depth().is_none()) {
            return Ok(anchors);
        }
        let mut images = gray_images(photos, level, cameras, MAX_PHOTO_SIDE)?;
        read_depths(&mut images, &views, space.scale)?;
        seeds.extend(shared_points(&images, anchors.points.len()));
        for matched in propagate(&images, &seeds, triangles) {
            let number = anchors.points.len() as u32;
            anchors.rays.extend(matched.photos.iter().map(|&photo| (photo, number)));
            anchors.points.push(matched.point);
        }
        anchors.rays.sort_unstable();
        anchors.fit_planes(cameras);
        let positions: Vec<Vec3> = anchors.points.iter().map(|point| point.position).collect();
        anchors.color_deviation = color_deviations(&positions, &anchors.rays, &images);
        anchors.thin_rays();
        Ok(anchors)
    }

    /// True without rays: no surface is measured.
    pub(crate) fn is_empty(&self) -> bool {
        self.rays.is_empty()
    }

    /// Adds the tracked points; returns a seed per point and photo.
    fn add_tracks(
        &mut self,
        dataset: &Dataset,
        space: &SceneNormalization,
        cameras: &[Camera],
    ) -> Vec<SeedPoint> {
        let mut numbers = vec![None; dataset.points.len()];
        let mut seeds = Vec::new();
        for (photo, (view, camera)) in dataset.train().zip(cameras).enumerate() {
            let shown =
                |(_, point): &(usize, &Point)| view.camera.project(point.position).is_some();
            for (i, Point { position, rgb, .. }) in
                dataset.tracked(view).filter(is_usable).filter(shown)
            {
                let position = space.to_training(*position);
                let number = *numbers[i].get_or_insert_with(|| {
                    let normal = (camera.position() - position).normalize_or_zero();
                    self.points.push(SurfacePoint { position, rgb: *rgb, normal });
                    self.points.len() as u32 - 1
                });
                seeds.push(SeedPoint { photo: photo as u32, point: number, position });
            }
        }
        let mut photos = vec![0; self.points.len()];
        for seed in &seeds {
            photos[seed.point as usize] += 1;
        }
        let is_anchor = |seed: &&SeedPoint| photos[seed.point as usize] >= MIN_PHOTOS;
        self.rays.extend(seeds.iter().filter(is_anchor).map(|seed| (seed.photo, seed.point)));
        seeds
    }

    /// Fits the plane of each point to its neighbours, and chooses the radius of its triangle:
    /// triangles that face a camera would stick out of a table.
    fn fit_planes(&mut self, cameras: &[Camera]) {
        let mut pixels = vec![f32::INFINITY; self.points.len()];
        for &(photo, point) in &self.rays {
            let camera = &cameras[photo as usize];
            let pixel = &mut pixels[point as usize];
            let distance = self.points[point as usize].position.distance(camera.position());
            *pixel = pixel.min(distance / camera.focal.x);
        }
        let positions: Vec<Vec3> = self.points.iter().map(|point| point.position).collect();
        let planes = nearest::<NEIGHBOURS, _>(&positions, |i, near| {
            let distances = near.iter().take(GAP_NEIGHBOURS).map(|(d, _)| d.sqrt());
            let gap = distances.sum::<f32>() / near.len().clamp(1, GAP_NEIGHBOURS) as f32;
            let offsets: Vec<Vec3> =
                near.iter().map(|(_, k)| positions[*k as usize] - positions[i]).collect();
            let mut normal = Vec3::ZERO;
            for (k, a) in offsets.iter().enumerate() {
                for b in &offsets[k + 1..] {
                    // Towards the photo; large triangles have most weight.
                    let area = a.cross(*b);
                    normal += area * area.dot(self.points[i].normal).signum();
                }
            }
            (
                (RADIUS * gap).min(MAX_RADIUS_PX * pixels[i]),
                normal.normalize_or(self.points[i].normal),
            )
        });
        for (point, (radius, normal)) in self.points.iter_mut().zip(planes) {
            point.normal = normal;
            self.radius.push(radius);
        }
    }

    /// Keeps some rays of each point, evenly over its photos: all of them would be a sixth of the
    /// training.
    fn thin_rays(&mut self) {
        let mut counts = vec![(0, 0); self.points.len()];
        for &(_, point) in &self.rays {
            counts[point as usize].1 += 1;
        }
        self.rays.retain(|&(_, point)| {
            let (i, count) = &mut counts[point as usize];
            *i += 1;
            in_even_subset(*i - 1, MAX_RAYS_PER_POINT, *count)
        });
    }

    /// Finds the changes of a solid scene of the triangles that are `alive`; `eyes` are the places
    /// of the photos. Pinned triangles stay as they are, and others move only if `pull`.
    pub(crate) fn repair(
        &self,
        state: &OptimizerState,
        alive: &[bool],
        visibility: &VisibilityStats,
        eyes: &[Vec3],
        pull: bool,
    ) -> DepthRepair {
        let hits = self.cast_rays(&state.params, alive, eyes);
        let mut occludes = self.occluders(&hits, &visibility.views);
        occludes[..state.pinned].fill(false);
        let shifts = if pull { self.shifts(&hits, state, eyes) } else { Vec::new() };
        DepthRepair { occludes, holes: self.holes(&hits), shifts }
    }

    /// Finds the first triangle on each ray among those that are `alive`. `[rays]`
    fn cast_rays(&self, params: &Params, alive: &[bool], eyes: &[Vec3]) -> Vec<Option<RayHit>> {
        let is_finite = |i: u32| params.vertices[i as usize].iter().all(|v| v.is_finite());
        let drawn: Vec<u32> =
            (0..alive.len() as u32).filter(|&i| alive[i as usize] && is_finite(i)).collect();
        let positions = drawn.iter().flat_map(|&i| params.vertices[i as usize]).collect();
        let mesh = Mesh { positions, ..Mesh::default() };
        let tree = RayTree::default();
        parallel::collect(self.rays.len(), GRAIN, |ray| {
            let (photo, point) = self.rays[ray];
            let eye = eyes[photo as usize];
            let to = self.points[point as usize].position - eye;
            let hit = tree.first_hit(&mesh, drawn.len(), eye, to)?;
            let face = drawn[hit.face as usize];
            Some(RayHit { face, offset: (hit.distance / f64::from(to.length())) as f32 - 1.0 })
        })
    }

    /// Flags of triangles that stand before anchors in half of the photos that show them, and before
    /// more anchors than they stand at. `[N]`
    fn occluders(&self, hits: &[Option<RayHit>], views: &[u32]) -> Vec<bool> {
        let mut counts = vec![
            OcclusionCounts { last_photo: u32::MAX, ..OcclusionCounts::default() };
            views.len()
        ];
        for ((photo, _), hit) in self.rays.iter().zip(hits) {
            let Some(RayHit { face, offset }) = *hit else { continue };
            let face = &mut counts[face as usize];
            if offset < -DEPTH_TOLERANCE {
                face.photos += u32::from(face.last_photo != *photo);
                face.occluded_rays += 1;
                face.last_photo = *photo;
            } else if offset <= DEPTH_TOLERANCE {
                face.matching_rays += 1;
            }
        }
        let occludes = |(face, views): (&OcclusionCounts, &u32)| {
            face.photos >= MIN_PHOTOS
                && face.occluded_rays > face.matching_rays
                && 2 * face.photos >= *views
        };
        counts.iter().zip(views).map(occludes).collect()
    }

    /// Shift of each triangle along its normal: the mean over the rays whose anchors it is a little
    /// before or behind. `[N]`
    fn shifts(&self, hits: &[Option<RayHit>], state: &OptimizerState, eyes: &[Vec3]) -> Vec<Vec3> {
        let mut sums = vec![(Vec3::ZERO, 0.0f32); state.params.len()];
        for (&(photo, point), hit) in self.rays.iter().zip(hits) {
            let Some(RayHit { face, offset }) = *hit else { continue };
            // A NaN fails.
            if !(offset.abs() <= MAX_ADJUSTMENT) {
                continue;
            }
            let (sum, count) = &mut sums[face as usize];
            *sum -= offset * (self.points[point as usize].position - eyes[photo as usize]);
            *count += 1.0;
        }
        sums[..state.pinned].fill((Vec3::ZERO, 0.0));
        let along_normal = |([a, b, c], (sum, count)): (&[Vec3; 3], (Vec3, f32))| {
            let normal = (*b - *a).cross(*c - *a).normalize_or_zero();
            PULL * sum.dot(normal) / count.max(1.0) * normal
        };
        state.params.vertices.iter().zip(sums).map(along_normal).collect()
    }

    /// Anchors that most of their photos see through, and whose colour is the same in all.
    fn holes(&self, hits: &[Option<RayHit>]) -> Vec<u32> {
        let mut through = vec![0i32; self.points.len()];
        for (&(_, point), hit) in self.rays.iter().zip(hits) {
            let is_behind = hit.is_none_or(|hit| hit.offset > DEPTH_TOLERANCE);
            through[point as usize] += if is_behind { 1 } else { -1 };
        }
        let is_hole = |&point: &u32| {
            through[point as usize] > 0
                && self.color_deviation[point as usize] <= MAX_COLOR_DEVIATION
        };
        (0..through.len() as u32).filter(is_hole).collect()
    }

    /// Solid triangles at these anchors, in their planes.
    pub(crate) fn fill_triangles(&self, points: &[u32], sh_degree: u8, rng: Rng) -> Params {
        let mut params = Params { sh_degree, ..Params::default() };
        for &point in points {
            let SurfacePoint { position, rgb, normal } = self.points[point as usize];
            let radius = self.radius[point as usize];
            let (right, up) = normal.any_orthonormal_pair();
            let turn = rng.uniform(u64::from(point));
            params.vertices.push(std::array::from_fn(|corner| {
                let (sin, cos) = (std::f32::consts::TAU * (turn + corner as f32 / 3.0)).sin_cos();
                position + radius * (right * cos + up * sin)
            }));
            params.opacity.push(SOLID_RAW[0]);
            params.sigma.push(SOLID_RAW[1]);
            params.sh.push(rgb.map(|c| sh0_from_rgb(f32::from(c) / 255.0)));
            params.sh.resize(params.len() * params.sh_count(), [0.0; 3]);
        }
        params
    }
}

/// True for a tracked point that may be an anchor or a seed.
pub(super) fn is_usable((i, point): &(usize, &Point)) -> bool {
    !Dataset::is_validation_point(*i) && point.error.is_none_or(|error| error <= MAX_ERROR)
}

/// Counts of the rays that meet a triangle first.
#[derive(Debug, Clone, Copy, Default)]
struct OcclusionCounts {
    /// Photos with an anchor behind it.
    photos: u32,
    /// The last of these photos.
    last_photo: u32,
    /// Rays to anchors behind it.
    occluded_rays: u32,
    /// Rays to anchors on it.
    matching_rays: u32,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three photos of nine points in the plane z = 2, all of one colour.
    fn anchors() -> DepthAnchors {
        let points = (0..9).map(|i| SurfacePoint {
            position: Vec3::new((i % 3) as f32 * 0.1, (i / 3) as f32 * 0.1, 2.0),
            rgb: [128; 3],
            normal: Vec3::NEG_Z,
        });
        DepthAnchors {
            points: points.collect(),
            radius: vec![0.16; 9],
            color_deviation: vec![0.01; 9],
            rays: (0..3).flat_map(|photo| (0..9).map(move |point| (photo, point))).collect(),
        }
    }

    /// A triangle across all rays at depth `z`.
    fn across(z: f32) -> [Vec3; 3] {
        [Vec3::new(-9.0, -9.0, z), Vec3::new(9.0, -9.0, z), Vec3::new(0.0, 9.0, z)]
    }

    fn state(vertices: &[[Vec3; 3]]) -> OptimizerState {
        let n = vertices.len();
        OptimizerState::new(Params {
            vertices: vertices.to_vec(),
            opacity: vec![6.0; n],
            sigma: vec![-3.0; n],
            sh: vec![[0.0; 3]; n],
            sh_degree: 0,
        })
    }

    fn repair(anchors: &DepthAnchors, state: &OptimizerState, views: u32) -> DepthRepair {
        let mut visibility = VisibilityStats::new(state.params.len(), 3);
        visibility.views.fill(views);
        let eyes = [Vec3::ZERO, Vec3::X * 0.2, Vec3::Y * 0.2];
        anchors.repair(state, &vec![true; state.params.len()], &visibility, &eyes, true)
    }

    #[test]
    fn anchors_pull_a_triangle_half_way_along_its_normal() {
        for (z, pinned, shift) in [(2.04, 0, -0.02), (1.96, 0, 0.02), (2.2, 0, 0.0), (2.04, 1, 0.0)]
        {
            let state = OptimizerState { pinned, ..state(&[across(z)]) };
            let shifts = repair(&anchors(), &state, 3).shifts;
            assert!(
                shifts.len() == 1 && shifts[0].distance(shift * Vec3::Z) < 1e-5,
                "{z}: {shifts:?}"
            );
        }
    }

    #[test]
    fn anchors_add_a_triangle_where_photos_see_through() {
        let anchors = anchors();
        let mut state = state(&[across(3.0)]);
        let before = repair(&anchors, &state, 3);
        assert_eq!((before.occludes, before.holes.len()), (vec![false], 9));
        let filled = anchors.fill_triangles(&before.holes, 0, Rng::new(1, "known", 0));
        for i in 0..filled.len() {
            state.push_fresh(&filled, i);
        }
        assert!(filled.vertices.as_flattened().iter().all(|v| (v.z - 2.0).abs() < 1e-5));
        assert!(repair(&anchors, &state, 3).holes.is_empty());
        assert!(
            state.params.is_finite(3)
                && (filled.sh[0][0] - sh0_from_rgb(128.0 / 255.0)).abs() < 1e-6
        );
    }

    #[test]
    fn a_point_whose_colour_changes_with_the_photo_stays_open() {
        let anchors = DepthAnchors { color_deviation: vec![0.2; 9], ..anchors() };
        assert!(repair(&anchors, &state(&[across(3.0)]), 3).holes.is_empty());
    }

    #[test]
    fn anchors_remove_a_triangle_before_points() {
        let anchors = anchors();
        let scene = state(&[across(1.0), across(2.0)]);
        assert_eq!(repair(&anchors, &scene, 3).occludes, [true, false]);
        assert_eq!(
            repair(&anchors, &scene, 7).occludes,
            [false, false],
            "7 photos show it, 3 see a point behind it"
        );
        assert_eq!(
            repair(&anchors, &OptimizerState { pinned: 1, ..scene }, 3).occludes,
            [false, false]
        );
        let one_photo = DepthAnchors { rays: (0..9).map(|point| (0, point)).collect(), ..anchors };
        assert_eq!(
            repair(&one_photo, &state(&[across(1.0)]), 1).occludes,
            [false],
            "one photo is no evidence"
        );
    }

    #[test]
    fn points_lie_in_the_plane_of_their_neighbours_and_stay_small() {
        let camera = Camera::look_at(Vec3::ZERO, Vec3::Z, Vec3::NEG_Y, 1.0, [100, 100]);
        let mut anchors = anchors();
        for point in &mut anchors.points {
            point.normal = Vec3::new(0.8, 0.0, -0.6);
        }
        anchors.radius.clear();
        anchors.fit_planes(&[camera; 3]);
        let max_radius = MAX_RADIUS_PX * 2.1 / camera.focal.x;
        for (point, radius) in anchors.points.iter().zip(&anchors.radius) {
            assert!(point.normal.dot(Vec3::NEG_Z) > 0.999, "{point:?}");
            assert!(*radius > 0.1 && *radius < max_radius, "{radius}");
        }
        assert_eq!(anchors.radius.len(), 9);
    }
}
