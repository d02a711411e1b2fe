//! Surfaces whose place is known without training: points that photos track, and those grown from
//! them.
//!
//! Each gives rays of known length from the photos that show it. In a solid scene, a triangle that
//! stands before such points in most of its photos goes. A point that most photos see through gets
//! a triangle, where the photos agree on its colour: what shines looks better from what seems to
//! lie behind it. A triangle that lies a little off its points moves towards them.

use super::grow::{Grey, KnownPoint, Seed, grow};
use super::params::{OptimizerState, Params};
use super::pyramid::Pyramid;
use super::start::is_among;
use super::visibility::VisibilityStats;
use glam::{UVec2, Vec3};
use trisplat_dataset::{Dataset, Point};
use trisplat_scene::camera::Camera;
use trisplat_scene::math::neighbours::nearest;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::{RayTree, Result, Rng, SceneNormalization, sh0_from_rgb};

/// Largest reprojection error of a point that is known, px.
const MAX_ERROR: f32 = 2.0;
/// Fewest photos of a point that is known, and of a triangle that blocks points.
const MIN_PHOTOS: u32 = 2;
/// Depths that differ by more are of different surfaces, as a share.
const SAME_SURFACE: f32 = 0.02;
/// A triangle that is off its points by less, as a share of the depth, moves ...
const NEARLY_RIGHT: f32 = 0.03;
/// ... by this share of it at a time: training moves it too.
const PULL: f32 = 0.5;
/// Largest deviation of the photos' colours at a point that is filled, root mean square in [0, 1].
const MAX_SPREAD: f32 = 0.03;
/// Longest side of the photos that points grow in, px.
const GROWN_SIZE: f64 = 480.0;
/// Maximum number of pixels of all these photos together.
const GROWN_PIXELS: f64 = 32e6;
/// Maximum number of rays to a point.
const MAX_RAYS: usize = 4;
/// Neighbours of a point that give its plane.
const NEIGHBOURS: usize = 8;
/// Those that give its gap.
const GAP_NEIGHBOURS: usize = 3;
/// Radius of a new triangle in gaps: turned at random, triangles leave a twentieth of the surface
/// open.
const RADIUS: f32 = 1.6;
/// Largest radius, px of the nearest photo.
const MAX_RADIUS_PX: f32 = 6.5;
/// Opacity's logit and σ's logarithm of a new triangle: solid.
const SOLID_RAW: [f32; 2] = [6.0, -3.0];

/// Points of surfaces, and the photos that show them.
#[derive(Debug, Default)]
pub(crate) struct KnownDepth {
    points: Vec<KnownPoint>,
    /// Radius of the triangle at each point.
    radius: Vec<f32>,
    /// Deviation of the photos' colours at each point.
    spread: Vec<f32>,
    /// Photo and point, photo by photo.
    rays: Vec<(u32, u32)>,
}

/// The first face on a ray, and its distance as a share of the point's, minus 1.
type Seen = Option<(u32, f32)>;

/// What the known points change in a scene.
#[derive(Debug, Default)]
pub(crate) struct DepthRepair {
    /// Triangles that block points. `[N]`
    pub(crate) blocks: Vec<bool>,
    /// Points that most of their photos see through.
    pub(crate) holes: Vec<u32>,
    /// How far triangles that are a little off their points are to move; empty unless they may.
    /// `[N]`
    pub(crate) moves: Vec<Vec3>,
}

impl KnownDepth {
    /// The points of `dataset` that its training photos track, with those grown from them for a
    /// scene of up to `triangles`; empty without tracks.
    ///
    /// # Errors
    ///
    /// Photos that cannot be decoded.
    pub(crate) fn of(
        dataset: &Dataset,
        space: &SceneNormalization,
        cameras: &[Camera],
        photos: &mut Pyramid,
        level: u32,
        triangles: u64,
    ) -> Result<Self> {
        let mut known = Self::default();
        let seeds = known.read_tracks(dataset, space, cameras);
        if seeds.is_empty() {
            return Ok(known);
        }
        let greys = greys(photos, level, cameras, GROWN_SIZE)?;
        for grown in grow(&greys, &seeds, triangles) {
            let number = known.points.len() as u32;
            known.rays.extend(grown.photos.iter().map(|&photo| (photo, number)));
            known.points.push(grown.point);
        }
        known.rays.sort_unstable();
        known.lay_in_surfaces(cameras);
        known.spread = known.color_spread(&greys);
        known.thin_rays();
        Ok(known)
    }

    /// True without rays: nothing is known.
    pub(crate) fn is_empty(&self) -> bool {
        self.rays.is_empty()
    }

    /// Reads the tracks; returns a seed per tracked point and photo.
    fn read_tracks(
        &mut self,
        dataset: &Dataset,
        space: &SceneNormalization,
        cameras: &[Camera],
    ) -> Vec<Seed> {
        let is_usable = |(i, point): &(usize, &Point)| {
            !Dataset::is_validation_point(*i) && point.error.is_none_or(|error| error <= MAX_ERROR)
        };
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
                    self.points.push(KnownPoint { position, rgb: *rgb, normal });
                    self.points.len() as u32 - 1
                });
                seeds.push(Seed { photo: photo as u32, point: number, position });
            }
        }
        let mut photos = vec![0; self.points.len()];
        seeds.iter().for_each(|seed| photos[seed.point as usize] += 1);
        let is_known = |seed: &&Seed| photos[seed.point as usize] >= MIN_PHOTOS;
        self.rays.extend(seeds.iter().filter(is_known).map(|seed| (seed.photo, seed.point)));
        seeds
    }

    /// Gives each point the plane of its neighbours, and a radius: triangles that face a camera
    /// would stick out of a table.
    fn lay_in_surfaces(&mut self, cameras: &[Camera]) {
        let mut pixels = vec![f32::INFINITY; self.points.len()];
        for &(photo, point) in &self.rays {
            let camera = &cameras[photo as usize];
            let pixel = &mut pixels[point as usize];
            let distance = self.points[point as usize].position.distance(camera.position());
            *pixel = pixel.min(distance / camera.focal.x);
        }
        let positions: Vec<Vec3> = self.points.iter().map(|point| point.position).collect();
        let planes = nearest::<NEIGHBOURS, _>(&positions, |i, found| {
            let near = found.iter().take(GAP_NEIGHBOURS).map(|(d, _)| d.sqrt());
            let gap = near.sum::<f32>() / found.len().clamp(1, GAP_NEIGHBOURS) as f32;
            let offsets: Vec<Vec3> =
                found.iter().map(|(_, k)| positions[*k as usize] - positions[i]).collect();
            let mut normal = Vec3::ZERO;
            for (k, a) in offsets.iter().enumerate() {
                for b in &offsets[k + 1..] {
                    // Towards the photo; large triangles count most.
                    let across = a.cross(*b);
                    normal += across * across.dot(self.points[i].normal).signum();
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

    /// The deviation of each point's colour over its photos, after one gain per photo and channel
    /// for its exposure.
    fn color_spread(&self, greys: &[Grey]) -> Vec<f32> {
        let color = |&(photo, point): &(u32, u32)| {
            let color = greys[photo as usize].color(self.points[point as usize].position)?;
            Some((photo as usize, point as usize, color))
        };
        let seen: Vec<(usize, usize, Vec3)> = self.rays.iter().filter_map(color).collect();
        let mut gains = vec![Vec3::ONE; greys.len()];
        let mut means = self.mean_colors(&seen, &gains);
        for _ in 0..2 {
            // Least squares of gain · colour - mean.
            let mut sums = vec![[Vec3::ZERO; 2]; greys.len()];
            for &(photo, point, color) in &seen {
                let [both, square] = &mut sums[photo];
                *both += means[point] * color;
                *square += color * color;
            }
            let gain = |[both, square]: &[Vec3; 2]| {
                Vec3::select(square.cmpgt(Vec3::splat(1e-3)), *both / *square, Vec3::ONE)
            };
            gains = sums.iter().map(gain).collect();
            means = self.mean_colors(&seen, &gains);
        }
        let mut squares = vec![(0.0f32, 0u32); self.points.len()];
        for &(photo, point, color) in &seen {
            let (sum, count) = &mut squares[point];
            *sum += (color * gains[photo] - means[point]).length_squared() / 3.0;
            *count += 1;
        }
        let deviation = |&(sum, count): &(f32, u32)| match count {
            0 | 1 => f32::INFINITY,
            count => (sum / (count - 1) as f32).sqrt(),
        };
        squares.iter().map(deviation).collect()
    }

    /// The mean colour of each point.
    fn mean_colors(&self, seen: &[(usize, usize, Vec3)], gains: &[Vec3]) -> Vec<Vec3> {
        let mut sums = vec![(Vec3::ZERO, 0.0f32); self.points.len()];
        for &(photo, point, color) in seen {
            let (sum, count) = &mut sums[point];
            *sum += color * gains[photo];
            *count += 1.0;
        }
        sums.iter().map(|(sum, count)| *sum / count.max(1.0)).collect()
    }

    /// Keeps some rays of each point, evenly over its photos: all of them would be a sixth of the
    /// training.
    fn thin_rays(&mut self) {
        let mut counts = vec![(0, 0); self.points.len()];
        self.rays.iter().for_each(|&(_, point)| counts[point as usize].1 += 1);
        self.rays.retain(|&(_, point)| {
            let (i, count) = &mut counts[point as usize];
            *i += 1;
            is_among(*i - 1, MAX_RAYS, *count)
        });
    }

    /// What to change in a solid scene, of the triangles that are `alive`; `eyes` are the places of
    /// the photos. Pinned ones neither block nor move, and others move only if `pull`.
    pub(crate) fn repair(
        &self,
        state: &OptimizerState,
        alive: &[bool],
        visibility: &VisibilityStats,
        eyes: &[Vec3],
        pull: bool,
    ) -> DepthRepair {
        let seen = self.cast(&state.params, alive, eyes);
        let mut blocks = self.blockers(&seen, &visibility.views);
        blocks.iter_mut().take(state.pinned).for_each(|blocks| *blocks = false);
        let moves = if pull { self.moves(&seen, state, eyes) } else { Vec::new() };
        DepthRepair { blocks, holes: self.holes(&seen), moves }
    }

    /// What each ray meets first among the triangles that are `alive`.
    fn cast(&self, params: &Params, alive: &[bool], eyes: &[Vec3]) -> Vec<Seen> {
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
            Some((drawn[hit.face as usize], (hit.distance / f64::from(to.length())) as f32 - 1.0))
        })
    }

    /// Which triangles stand before points in half of the photos that show them, and before more
    /// than they stand at.
    fn blockers(&self, seen: &[Seen], views: &[u32]) -> Vec<bool> {
        let mut found = vec![Blocked { last: u32::MAX, ..Blocked::default() }; views.len()];
        for ((photo, _), seen) in self.rays.iter().zip(seen) {
            let Some((face, error)) = *seen else { continue };
            let face = &mut found[face as usize];
            if error < -SAME_SURFACE {
                face.photos += u32::from(face.last != *photo);
                face.rays += 1;
                face.last = *photo;
            } else if error <= SAME_SURFACE {
                face.right += 1;
            }
        }
        let blocks = |(face, views): (&Blocked, &u32)| {
            face.photos >= MIN_PHOTOS && face.rays > face.right && 2 * face.photos >= *views
        };
        found.iter().zip(views).map(blocks).collect()
    }

    /// How far each triangle is to move along its normal, by the mean over its rays, for photos see
    /// it a little before or behind its points. `[N]`
    fn moves(&self, seen: &[Seen], state: &OptimizerState, eyes: &[Vec3]) -> Vec<Vec3> {
        let mut sums = vec![(Vec3::ZERO, 0.0f32); state.params.len()];
        for (&(photo, point), seen) in self.rays.iter().zip(seen) {
            let Some((face, error)) = seen.filter(|(_, error)| error.abs() <= NEARLY_RIGHT) else {
                continue;
            };
            let (sum, count) = &mut sums[face as usize];
            *sum -= error * (self.points[point as usize].position - eyes[photo as usize]);
            *count += 1.0;
        }
        sums[..state.pinned].fill((Vec3::ZERO, 0.0));
        let along_normal = |([a, b, c], (sum, count)): (&[Vec3; 3], (Vec3, f32))| {
            let normal = (*b - *a).cross(*c - *a).normalize_or_zero();
            PULL * sum.dot(normal) / count.max(1.0) * normal
        };
        state.params.vertices.iter().zip(sums).map(along_normal).collect()
    }

    /// The points that most of their photos see through, and whose colour is the same in all.
    fn holes(&self, seen: &[Seen]) -> Vec<u32> {
        let mut through = vec![0i32; self.points.len()];
        for (&(_, point), seen) in self.rays.iter().zip(seen) {
            through[point as usize] +=
                if seen.is_none_or(|(_, error)| error > SAME_SURFACE) { 1 } else { -1 };
        }
        let is_hole =
            |&point: &u32| through[point as usize] > 0 && self.spread[point as usize] <= MAX_SPREAD;
        (0..through.len() as u32).filter(is_hole).collect()
    }

    /// Solid triangles at these points, in their surfaces.
    pub(crate) fn triangles(&self, points: &[u32], sh_degree: u8, rng: Rng) -> Params {
        let mut params = Params { sh_degree, ..Params::default() };
        for &point in points {
            let KnownPoint { position, rgb, normal } = self.points[point as usize];
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

/// The rays that meet a triangle first.
#[derive(Debug, Clone, Copy, Default)]
struct Blocked {
    /// Photos with a point behind it.
    photos: u32,
    /// The last of them.
    last: u32,
    /// Rays to points behind it.
    rays: u32,
    /// Rays to points on it.
    right: u32,
}

/// The photos in grey, with sides of at most `longest` px; decoded at `level`.
pub(crate) fn greys(
    photos: &mut Pyramid,
    level: u32,
    cameras: &[Camera],
    longest: f64,
) -> Result<Vec<Grey>> {
    let sizes = (0..cameras.len()).map(|i| photos.size(i, level).as_dvec2());
    let sizes: Vec<_> = sizes.map(|size| size * (longest / size.max_element()).min(1.0)).collect();
    let pixels: f64 = sizes.iter().map(|size| size.element_product()).sum();
    let share = (GROWN_PIXELS / pixels).sqrt().min(1.0);
    let mut greys = Vec::with_capacity(cameras.len());
    for (i, camera) in cameras.iter().enumerate() {
        let photo = photos.take(i, level)?;
        let size = (sizes[i] * share).round().as_uvec2().max(UVec2::ONE);
        greys.push(Grey::new(camera, photo.shared_at(size)));
    }
    Ok(greys)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three photos of nine points in the plane z = 2, all of one colour.
    fn known() -> KnownDepth {
        let points = (0..9).map(|i| KnownPoint {
            position: Vec3::new((i % 3) as f32 * 0.1, (i / 3) as f32 * 0.1, 2.0),
            rgb: [128; 3],
            normal: Vec3::NEG_Z,
        });
        KnownDepth {
            points: points.collect(),
            radius: vec![0.16; 9],
            spread: vec![0.01; 9],
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

    fn repair(known: &KnownDepth, state: &OptimizerState, views: u32) -> DepthRepair {
        let mut visibility = VisibilityStats::new(state.params.len(), 3);
        visibility.views.fill(views);
        let eyes = [Vec3::ZERO, Vec3::X * 0.2, Vec3::Y * 0.2];
        known.repair(state, &vec![true; state.params.len()], &visibility, &eyes, true)
    }

    #[test]
    fn a_triangle_that_is_a_little_off_its_points_moves_half_of_the_way_along_its_normal() {
        for (z, pinned, wanted) in
            [(2.04, 0, -0.02), (1.96, 0, 0.02), (2.2, 0, 0.0), (2.04, 1, 0.0)]
        {
            let state = OptimizerState { pinned, ..state(&[across(z)]) };
            let moves = repair(&known(), &state, 3).moves;
            assert!(
                moves.len() == 1 && moves[0].distance(wanted * Vec3::Z) < 1e-5,
                "{z}: {moves:?}"
            );
        }
    }

    #[test]
    fn a_point_that_photos_see_through_gets_a_triangle_in_its_surface() {
        let known = known();
        let mut state = state(&[across(3.0)]);
        let before = repair(&known, &state, 3);
        assert_eq!((before.blocks, before.holes.len()), (vec![false], 9));
        let filled = known.triangles(&before.holes, 0, Rng::new(1, "known", 0));
        (0..filled.len()).for_each(|i| state.push_fresh(&filled, i));
        assert!(filled.vertices.as_flattened().iter().all(|v| (v.z - 2.0).abs() < 1e-5));
        assert!(repair(&known, &state, 3).holes.is_empty());
        assert!(
            state.params.is_finite(3)
                && (filled.sh[0][0] - sh0_from_rgb(128.0 / 255.0)).abs() < 1e-6
        );
    }

    #[test]
    fn a_point_whose_colour_changes_with_the_photo_stays_open() {
        let known = KnownDepth { spread: vec![0.2; 9], ..known() };
        assert!(repair(&known, &state(&[across(3.0)]), 3).holes.is_empty());
    }

    #[test]
    fn a_triangle_before_points_goes_unless_most_of_its_photos_know_nothing_against_it() {
        let known = known();
        let scene = state(&[across(1.0), across(2.0)]);
        assert_eq!(repair(&known, &scene, 3).blocks, [true, false]);
        assert_eq!(
            repair(&known, &scene, 7).blocks,
            [false, false],
            "7 photos show it, 3 see a point behind it"
        );
        assert_eq!(
            repair(&known, &OptimizerState { pinned: 1, ..scene }, 3).blocks,
            [false, false]
        );
        let alone = KnownDepth { rays: (0..9).map(|point| (0, point)).collect(), ..known };
        assert_eq!(
            repair(&alone, &state(&[across(1.0)]), 1).blocks,
            [false],
            "one photo is no evidence"
        );
    }

    #[test]
    fn points_lie_in_the_plane_of_their_neighbours_and_stay_small() {
        let camera = Camera::look_at(Vec3::ZERO, Vec3::Z, Vec3::NEG_Y, 1.0, [100, 100]);
        let mut known = known();
        known.points.iter_mut().for_each(|point| point.normal = Vec3::new(0.8, 0.0, -0.6));
        known.radius.clear();
        known.lay_in_surfaces(&[camera; 3]);
        let most = MAX_RADIUS_PX * 2.1 / camera.focal.x;
        for (point, radius) in known.points.iter().zip(&known.radius) {
            assert!(point.normal.dot(Vec3::NEG_Z) > 0.999, "{point:?}");
            assert!(*radius > 0.1 && *radius < most, "{radius}");
        }
        assert_eq!(known.radius.len(), 9);
    }
}
