//! One round: measures how the pictures change if a triangle is dropped or moved.

use super::reshaped::{
    COUNT, ERROR, FaceRow, MOVING, Measures, REMOVING, RGB, ReshapedFaces, UNITS, add,
};
use crate::trial::{GROUPS, group_of};
use crate::views::Views;
use std::sync::atomic::AtomicI64;
use trisplat_raster::solid::{NO_FACE, Nearest, PlaneTile, SolidRasterOptions, SolidRasterizer};
use trisplat_scene::Result;
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::mesh::Mesh;

/// Samples per pixel along each axis.
const SAMPLES: u32 = 1;
/// Squared error of an empty sample in a scene that is closed all around. It exceeds that of any
/// colour, so no hole is opened, which other views would show.
const HOLE_ERROR: f32 = 100.0;
/// Squared error of a sample on the wrong side of the outline of an object without background: that
/// of grey on black.
const OUTLINE_ERROR: f32 = 0.75;

/// Draws the rounds.
pub(super) struct Rounds<'v> {
    views: &'v mut Views,
    drawing: SolidRasterOptions,
    solid: SolidRasterizer,
    is_closed: bool,
}

impl<'v> Rounds<'v> {
    /// Of a scene that starts as `mesh`; `is_closed`: no view should show holes.
    pub(super) fn new(mesh: &Mesh, views: &'v mut Views, is_closed: bool) -> Self {
        Self {
            drawing: views.drawing(mesh, SAMPLES),
            views,
            solid: SolidRasterizer::new(),
            is_closed,
        }
    }

    /// Compares some of the pictures, different ones in every round, with the scene and, if given,
    /// with its faces moved to `candidates`.
    ///
    /// # Errors
    ///
    /// A photo that cannot be decoded.
    pub(super) fn draw(
        &mut self,
        round: u32,
        effort: RoundEffort,
        faces: &ReshapedFaces,
        candidates: &[[glam::Vec3; 3]],
    ) -> Result<Measures> {
        let mut found = Measures::new(faces.len());
        let groups: Vec<u8> =
            faces.ids().iter().map(|&id| group_of("reshape", id, round)).collect();
        let moved = groups.iter().map(|g| g + GROUPS as u8).take(candidates.len());
        let planes: Vec<u8> = groups.iter().copied().chain(moved).collect();
        let moves = !candidates.is_empty();
        let plane_count = if moves { 2 * GROUPS } else { GROUPS };
        let positions = faces.corners.iter().chain(candidates).flatten().copied().collect();
        let sides = faces.single_sided();
        let single_sided = if moves { sides.repeat(2) } else { sides };
        let scene = Mesh { positions, single_sided, ..Mesh::default() };
        let colors = faces.encoded_colors();
        let background = self.drawing.background;
        let hole_error = self.is_closed.then_some(HOLE_ERROR);
        let chosen_views = effort.pictures_of_round(round, self.views.len());
        self.views.prefetch(&chosen_views);
        for view in chosen_views {
            let camera = self.views.camera(view).fit_within(effort.side);
            let picture = self.views.photo(view)?.shared_at(camera.size);
            let picture = &*picture;
            let colors = &colors[..];
            let rows = &found.rows[..];
            let cut = self.views.is_cut(view) && picture.alpha.is_some();
            let sums = PictureSums { picture, colors, background, hole_error, cut, moves, rows };
            let totals = [AtomicI64::new(0), AtomicI64::new(0)];
            self.solid.planes(&scene, &camera, &self.drawing, (plane_count, &planes), |tile| {
                let of_tile = sums.add_tile(tile);
                for (total, sum) in totals.iter().zip(of_tile) {
                    add(total, sum);
                }
            });
            let [error, weight] = totals.map(|total| total.into_inner() as f64 / UNITS);
            found.error += error;
            found.weight += weight;
        }
        Ok(found)
    }
}

/// One picture, and the sums for its samples.
struct PictureSums<'a> {
    picture: &'a RgbImage,
    /// sRGB-encoded. `[F]`
    colors: &'a [[f32; 3]],
    /// sRGB-encoded.
    background: [f32; 3],
    /// Error of a sample without a face, instead of its difference from the background.
    hole_error: Option<f32>,
    /// The picture shows an object without background: a face outside it is as wrong as a hole in
    /// it.
    cut: bool,
    /// There are candidates, in planes of their own.
    moves: bool,
    rows: &'a [FaceRow],
}

impl PictureSums<'_> {
    /// Adds the samples of a tile; returns the sums of squared errors and weights.
    fn add_tile(&self, tile: &PlaneTile<'_>) -> [f64; 2] {
        let mut totals = [0.0; 2];
        for y in 0..tile.size.y {
            let first = (tile.corner.y + y) * self.picture.size.x + tile.corner.x;
            for x in 0..tile.size.x {
                let pixel = (first + x) as usize;
                let weight = self
                    .picture
                    .alpha
                    .as_ref()
                    .map_or(1.0, |alpha| f32::from(alpha[pixel]) / 255.0);
                if weight > 0.0 || self.cut {
                    totals[0] += f64::from(self.add_sample(tile, x, y, pixel, weight));
                    totals[1] += if self.cut { 1.0 } else { f64::from(weight) };
                }
            }
        }
        totals
    }

    /// Adds a sample; returns its squared difference from the picture.
    #[inline(always)]
    fn add_sample(&self, tile: &PlaneTile<'_>, x: u32, y: u32, pixel: usize, weight: f32) -> f32 {
        let target = self.picture.rgb[pixel].map(|c| f32::from(c) / 255.0);
        let difference = |shown: [f32; 3]| {
            weight * (0..3).map(|k| (shown[k] - target[k]) * (shown[k] - target[k])).sum::<f32>()
        };
        let beyond = if self.cut { (1.0 - weight) * OUTLINE_ERROR } else { 0.0 };
        let empty = if self.cut { weight * OUTLINE_ERROR } else { difference(self.background) };
        let error = |face: u32| match (face, self.hole_error) {
            (NO_FACE, Some(error)) => weight * error,
            (NO_FACE, None) => empty,
            (face, _) => difference(self.colors[face as usize]) + beyond,
        };
        let groups = [0, 1, 2, 3].map(|group| tile.nearest(group, x, y));
        let [before, behind] = Nearest::two_of(groups);
        let old = self.face_of(before);
        // An existing hole counts by its colour, so that a face that closes it must look right too.
        let old_error = if old == NO_FACE { empty } else { error(old) };
        if old != NO_FACE {
            let row = &self.rows[old as usize];
            row.add(COUNT, weight);
            for (channel, value) in target.iter().enumerate() {
                row.add(RGB + channel, weight * value);
            }
            row.add(ERROR, old_error);
            row.add(REMOVING, error(self.face_of(behind)) - old_error);
        }
        if !self.moves {
            return old_error;
        }
        for (group, &unmoved) in groups.iter().enumerate() {
            // The nearest face after this group has moved.
            let others = if unmoved == before { behind } else { before };
            let after = others.max(tile.nearest(GROUPS + group, x, y));
            let new = self.face_of(after);
            if new != old {
                // A face that moved here, or the one that moved away.
                let moved_in = new != NO_FACE && after.face() as usize >= self.colors.len();
                let whose = if moved_in { new } else { old };
                self.rows[whose as usize].add(MOVING, error(new) - old_error);
            }
        }
        old_error
    }

    /// The face, whether moved or not.
    #[inline(always)]
    fn face_of(&self, nearest: Nearest) -> u32 {
        match nearest.face() {
            NO_FACE => NO_FACE,
            face => face % self.colors.len() as u32,
        }
    }
}

// ---- Pictures per round -------------------------------------------------------------------------

/// Preferred number of pictures per round; the next round uses others if there are more. A round
/// judges each triangle alone, so few pictures mislead it: with 12, scenes of 8,000 to 20,000
/// triangles lost up to 1.9 dB (docs/benchmarks/history.md).
const ROUND_VIEWS: u64 = 48;
/// Longest side of the pictures, px: finer detail is not fitted.
const LONGEST_SIDE: u32 = 960;
/// Longest side of the pictures for scenes of few triangles, px.
const SHORTEST_SIDE: u32 = 128;
/// Pixels per triangle that such scenes need.
const PIXELS_PER_FACE: f64 = 16.0;
/// Minimum number of pictures: with fewer, triangles would be fitted to single views.
const MIN_VIEWS: u64 = 12;
/// Number of rounds that large scenes stay below, even if more are requested.
const MAX_LARGE_SCENE_ROUNDS: u32 = 16;
/// Minimum number of rounds: fewer gain nothing.
const MIN_ROUNDS: u32 = 4;
/// Its multiples, less their whole part, never come close to an earlier one.
const GOLDEN_RATIO: f64 = 1.618_033_988_749_895;
/// Maximum number of triangles and samples drawn per round, on average. With a quarter, scenes of
/// 360,000 triangles were fitted to too few pictures to gain anything.
const MAX_DRAWN_PER_ROUND: u64 = 50_000_000;
/// Number of rounds between cuts of triangles.
const CUT_EVERY: u32 = 3;
/// Share of the rounds, the first ones, with cuts: the halves must still move.
const CUT_ROUNDS_SHARE: f64 = 0.8;

/// The number of rounds, and the pictures of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct RoundEffort {
    pub(super) rounds: u32,
    /// Pictures of a round.
    pub(super) pictures: usize,
    /// Longest side of the pictures, px.
    pub(super) side: u32,
}

impl RoundEffort {
    /// For `faces` and the pictures of `cameras`: large scenes get fewer pictures, and then fewer
    /// rounds.
    pub(super) fn new(faces: usize, cameras: &[Camera], rounds: u32) -> Self {
        let side =
            ((PIXELS_PER_FACE * faces as f64).sqrt() as u32).clamp(SHORTEST_SIDE, LONGEST_SIDE);
        let faces = faces as u64;
        let views = cameras.len() as u64;
        let pixels = |camera: &Camera| camera.fit_within(side).size.as_u64vec2().element_product();
        let pixels = (cameras.iter().map(pixels).sum::<u64>() / views.max(1)).max(1);
        // Every face twice, as it is and moved.
        let per_view = 2 * faces + pixels;
        let pictures = (MAX_DRAWN_PER_ROUND / per_view).clamp(MIN_VIEWS, ROUND_VIEWS).min(views);
        let affordable = MAX_DRAWN_PER_ROUND * u64::from(rounds.max(MAX_LARGE_SCENE_ROUNDS))
            / (pictures.max(1) * per_view);
        let affordable = u32::try_from(affordable).unwrap_or(u32::MAX).max(MIN_ROUNDS);
        Self { rounds: affordable.min(rounds), pictures: pictures as usize, side }
    }

    /// The pictures of `round`, of `views`: evenly spaced, and from round to round between those
    /// before.
    pub(super) fn pictures_of_round(self, round: u32, views: usize) -> Vec<usize> {
        let step = views as f64 / self.pictures as f64;
        let shift = (f64::from(round) * GOLDEN_RATIO).fract();
        (0..self.pictures).map(|k| ((k as f64 + shift) * step) as usize).collect()
    }

    /// True if triangles are cut after this round.
    pub(super) fn cuts(self, round: u32) -> bool {
        round.is_multiple_of(CUT_EVERY)
            && f64::from(round) < CUT_ROUNDS_SHARE * f64::from(self.rounds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat3, UVec2, Vec2, Vec3};

    fn cameras(count: usize, side: u32) -> Vec<Camera> {
        let size = UVec2::splat(side);
        let rotation = Mat3::IDENTITY;
        let translation = Vec3::ZERO;
        vec![
            Camera { rotation, translation, focal: Vec2::ONE, center: size.as_vec2() / 2.0, size };
            count
        ]
    }

    #[test]
    fn large_scenes_get_fewer_pictures_and_then_fewer_rounds() {
        let effort = |faces, count, side| RoundEffort::new(faces, &cameras(count, side), 16);
        let plan = |rounds, pictures, side| RoundEffort { rounds, pictures, side };
        assert_eq!(effort(40_000, 40, 300), plan(16, 40, 800));
        assert_eq!(
            effort(8_000, 96, 360),
            plan(16, 48, 357),
            "few triangles need as many pictures"
        );
        assert_eq!(effort(1_000_000, 96, 360), plan(16, 23, 960));
        let larger = effort(5_000_000, 96, 360);
        assert!(larger.pictures == 12 && (MIN_ROUNDS..16).contains(&larger.rounds), "{larger:?}");
        assert_eq!(effort(50_000_000, 96, 360), plan(MIN_ROUNDS, 12, 960));
        assert_eq!(effort(1, 1, 1), plan(16, 1, 128));
    }

    #[test]
    fn every_round_has_as_many_pictures_and_soon_all_had_their_turn() {
        for (pictures, views) in [(1, 1), (43, 43), (48, 49), (48, 96), (12, 255)] {
            let effort = RoundEffort { rounds: 16, pictures, side: 960 };
            let mut seen = vec![0; views];
            for round in 0..64 {
                let chosen_views = effort.pictures_of_round(round, views);
                assert_eq!(chosen_views.len(), pictures);
                assert!(chosen_views.windows(2).all(|pair| pair[0] < pair[1]), "{chosen_views:?}");
                for view in chosen_views {
                    seen[view] += 1;
                }
            }
            assert!(seen.iter().all(|&count| count > 0), "{pictures} of {views}: {seen:?}");
        }
    }

    #[test]
    fn the_last_rounds_cut_nothing() {
        let effort = RoundEffort { rounds: 16, pictures: 1, side: 960 };
        let cut: Vec<u32> = (1..16).filter(|&round| effort.cuts(round)).collect();
        assert_eq!(cut, [3, 6, 9, 12]);
    }
}
