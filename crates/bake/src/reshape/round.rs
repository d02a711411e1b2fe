//! One round: measures how the pictures change if a triangle is dropped or moved.

use super::effort::Effort;
use super::found::{COUNT, ERROR, FaceRow, Found, MOVING, REMOVING, RGB, UNITS, add};
use super::reshaped::ReshapedFaces;
use crate::trial::{GROUPS, group_of};
use crate::views::Views;
use std::sync::Arc;
use std::sync::atomic::AtomicI64;
use trisplat_raster::solid::{NO_FACE, Nearest, PlaneTile, SolidRasterOptions, SolidRasterizer};
use trisplat_scene::{Result, image::RgbImage, mesh::Mesh};

/// Samples per pixel along each axis.
const SAMPLES: u32 = 1;
/// Squared error of an empty sample in a scene that is closed all around. It exceeds that of any colour, so
/// no hole is opened, which other views would show.
const HOLE_ERROR: f32 = 100.0;
/// Squared error of a sample on the wrong side of the outline of an object without background: that of grey
/// on black.
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
        Self { drawing: views.drawing(mesh, SAMPLES), views, solid: SolidRasterizer::new(), is_closed }
    }

    /// Compares some of the pictures, different ones in every round, with the scene and, if given, with its
    /// faces moved to `candidates`.
    ///
    /// Errors: a photo that cannot be decoded.
    pub(super) fn draw(
        &mut self,
        round: u32,
        effort: Effort,
        faces: &ReshapedFaces,
        candidates: &[[glam::Vec3; 3]],
    ) -> Result<Found> {
        let mut found = Found::new(faces.len());
        let groups: Vec<u8> = faces.ids().iter().map(|&id| group_of("reshape", id, round)).collect();
        let moved = groups.iter().map(|g| g + GROUPS as u8).take(candidates.len());
        let planes: Vec<u8> = groups.iter().copied().chain(moved).collect();
        let moves = !candidates.is_empty();
        let plane_count = if moves { 2 * GROUPS } else { GROUPS };
        let both = faces.corners.iter().chain(candidates).flatten().copied().collect();
        let scene = Mesh { positions: both, ..Mesh::default() };
        let (colors, background) = (faces.encoded_colors(), self.drawing.background);
        let hole_error = self.is_closed.then_some(HOLE_ERROR);
        let chosen = effort.chosen(round, self.views.len());
        self.views.prefetch(&chosen);
        for view in chosen {
            let camera = self.views.camera(view).within(effort.side);
            let photo = self.views.photo(view)?;
            let picture = match photo.size == camera.size {
                true => photo,
                false => Arc::new(photo.downscaled(camera.size)),
            };
            let (picture, colors, rows) = (&*picture, &colors[..], &found.rows[..]);
            let cut = self.views.is_cut(view) && picture.alpha.is_some();
            let sums = PictureSums { picture, colors, background, hole_error, cut, moves, rows };
            let totals = [AtomicI64::new(0), AtomicI64::new(0)];
            self.solid.planes(&scene, &camera, &self.drawing, (plane_count, &planes), |tile| {
                let of_tile = sums.add_tile(tile);
                totals.iter().zip(of_tile).for_each(|(total, sum)| add(total, sum));
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
    /// The picture shows an object without background: a face outside it is as wrong as a hole in it.
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
                let weight = self.picture.alpha.as_ref().map_or(1.0, |alpha| f32::from(alpha[pixel]) / 255.0);
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
            (0..3).for_each(|k| row.add(RGB + k, weight * target[k]));
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
