//! Compares variants of a scene with the whole scene, face by face.
//!
//! A camera draws a scene once, with a z-buffer for each group of faces. The nearest face among
//! some groups gives the picture of a scene with only those groups. So one drawing shows the scene
//! and all its variants.

use crate::trial::{GROUPS, group_of};
use crate::views;
use glam::Vec3;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicI64, AtomicU32};
use trisplat_raster::solid::{NO_FACE, Nearest, PlaneTile, SolidRasterOptions, SolidRasterizer};
use trisplat_scene::camera::Camera;
use trisplat_scene::math::color::srgb_from_linear;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel::{self, GRAIN};

/// Samples per pixel along each axis.
const SAMPLES: u32 = 1;
/// Longest side of the pictures, px: finer detail does not matter here.
const LONGEST_SIDE: u32 = 960;
/// A picture is halved while it has this many pixels per face: fewer lose up to 0.1 dB, more gain
/// nothing (commit 751a9c64).
const PX_PER_FACE: f64 = 6.0;
/// Minimum of their longest side, px.
const SHORTEST_SIDE: u32 = 32;
/// The random sequence of the groups. It determines the output, so it keeps its old name.
const GROUPING: &str = "thin";
/// The squared difference between a face and none, sRGB-encoded and summed over channels.
const HOLE_ERROR: f32 = 0.75;
/// A face's mean effect per sample is estimated with this many additional samples of average
/// effect.
const PRIOR_SAMPLES: f64 = 2.0;
/// Maximum memory for pictures of the whole scene, bytes; pictures that do not fit are drawn again
/// every round.
const MAX_TARGET_BYTES: usize = 256 << 20;

/// The whole scene, and how it is rendered.
pub(super) struct Comparison<'a> {
    whole: &'a Mesh,
    /// Mean colour of each face, sRGB-encoded. `[F]`
    colors: Vec<[f32; 3]>,
    cameras: Vec<Camera>,
    /// Number of times that the pixels are halved.
    halvings: u32,
    drawing: SolidRasterOptions,
    solid: SolidRasterizer,
    /// The visible faces of the whole scene for each camera that was used, if they fit in memory.
    /// `[cameras]`
    targets: Vec<Option<Vec<u32>>>,
}

/// The cameras of a round.
#[derive(Debug, Clone, Copy)]
pub(super) struct Round {
    /// Number of the round: the next one uses other cameras and groups.
    pub(super) number: u32,
    /// Maximum number of cameras.
    pub(super) views: usize,
}

impl<'a> Comparison<'a> {
    pub(super) fn new(whole: &'a Mesh, cameras: &[Camera]) -> Self {
        let color = |f: usize| {
            let [a, b, c] = whole.corner_colors(f);
            [0, 1, 2].map(|k| srgb_from_linear((a[k] + b[k] + c[k]) / 3.0))
        };
        Self {
            whole,
            colors: parallel::collect(whole.face_count(), GRAIN, color),
            halvings: 0,
            drawing: views::drawing(cameras, whole, SAMPLES),
            cameras: cameras.iter().map(|camera| camera.fit_within(LONGEST_SIDE)).collect(),
            solid: SolidRasterizer::new(),
            targets: vec![None; cameras.len()],
        }
    }

    /// The error that the scene `kept` gains without each of its faces. `[kept]`
    ///
    /// `visible_px`: the visible area of every face of the whole scene. `[F]`
    pub(super) fn importance(
        &mut self,
        kept: &[u32],
        visible_px: &[f32],
        round: Round,
    ) -> Vec<f64> {
        let effects = self.effects_of_removing(kept, round);
        let sum = effects.iter().fold(Effect::default(), |sum, e| Effect {
            error_change: sum.error_change + e.error_change,
            samples: sum.samples + e.samples,
        });
        // Only some cameras were used: the importance to the others is in proportion to the face's
        // visible area there.
        let average = sum.error_change / sum.samples.max(1.0);
        let importance = |(e, face): (&Effect, &u32)| {
            f64::from(visible_px[*face as usize]) * (e.error_change + PRIOR_SAMPLES * average)
                / (e.samples + PRIOR_SAMPLES)
        };
        effects.iter().zip(kept).map(importance).collect()
    }

    /// The effect of removing a face, while a quarter of the others is removed as well. `[kept]`
    fn effects_of_removing(&mut self, kept: &[u32], round: Round) -> Vec<Effect> {
        let positions = kept.iter().flat_map(|&f| self.whole.corners(f as usize)).collect();
        let scene = Mesh { positions, single_sided: self.single_sided(kept), ..Mesh::default() };
        let planes: Vec<u8> = kept.iter().map(|&f| group_of(GROUPING, f, round.number)).collect();
        let sums = EffectSums::new(kept.len());
        self.resize(kept.len());
        self.draw_round(round, &scene, (GROUPS, &planes), |tile, x, y, target| {
            let [before, after] =
                Nearest::two_of([0, 1, 2, 3].map(|group| tile.nearest(group, x, y)));
            let face = before.face();
            if face != NO_FACE {
                sums.add_sample(face);
                sums.add_change(
                    face,
                    target.error_of(kept, after.face()) - target.error_of(kept, face),
                );
            }
        });
        sums.into_effects()
    }

    /// The flags of faces that are drawn from their front only; empty where all are drawn from both
    /// sides. `[kept]`
    fn single_sided(&self, kept: &[u32]) -> Vec<bool> {
        let is_mixed = !self.whole.single_sided.is_empty();
        kept.iter()
            .filter(|_| is_mixed)
            .map(|&face| self.whole.is_single_sided(face as usize))
            .collect()
    }

    /// The effect of moving the corners of a face of the scene `kept` from `corners` to `moved`,
    /// while a quarter of the others is moved as well. `[kept]`
    pub(super) fn effects_of_moving(
        &mut self,
        kept: &[u32],
        corners: &[[Vec3; 3]],
        moved: &[[Vec3; 3]],
        round: Round,
    ) -> Vec<Effect> {
        let count = kept.len() as u32;
        let positions = corners.iter().chain(moved).flatten().copied().collect();
        let single_sided = self.single_sided(kept).repeat(2);
        let scene = Mesh { positions, single_sided, ..Mesh::default() };
        let groups = kept.iter().map(|&f| group_of(GROUPING, f, round.number));
        let planes: Vec<u8> =
            groups.clone().chain(groups.map(|group| group + GROUPS as u8)).collect();
        let sums = EffectSums::new(kept.len());
        self.resize(kept.len());
        self.draw_round(round, &scene, (2 * GROUPS, &planes), |tile, x, y, target| {
            let unmoved = [0, 1, 2, 3].map(|group| tile.nearest(group, x, y));
            let before = unmoved.into_iter().fold(Nearest::NONE, Nearest::max);
            let face_of = |nearest: Nearest| match nearest.face() {
                NO_FACE => NO_FACE,
                face => face % count,
            };
            let old = face_of(before);
            for group in 0..GROUPS {
                let others = (0..GROUPS).filter(|g| *g != group).map(|g| unmoved[g]);
                let after = others.fold(tile.nearest(GROUPS + group, x, y), Nearest::max);
                let new = face_of(after);
                if new != old {
                    let whose = if after.face() >= count && new != NO_FACE { new } else { old };
                    sums.add_change(whose, target.error_of(kept, new) - target.error_of(kept, old));
                }
            }
        });
        sums.into_effects()
    }

    /// Makes pictures as large as the comparison of `faces` needs.
    fn resize(&mut self, faces: usize) {
        let pixels: f64 =
            self.cameras.iter().map(|camera| camera.size.as_dvec2().element_product()).sum();
        let per_face = pixels / self.cameras.len().max(1) as f64 / faces.max(1) as f64;
        // In steps, because pictures of the whole scene must be drawn again for each size.
        let halvings = (per_face / PX_PER_FACE).log2().round().max(0.0) as u32;
        if halvings == self.halvings {
            return;
        }
        self.halvings = halvings;
        self.targets.fill(None);
    }

    /// A camera for pictures of the present size.
    fn camera(&self, view: usize) -> Camera {
        let camera = self.cameras[view];
        let side =
            f64::from(camera.size.max_element()) * 0.5f64.powf(f64::from(self.halvings) / 2.0);
        camera.fit_within((side.round() as u32).max(SHORTEST_SIDE))
    }

    /// Draws `scene` from the cameras of a round with a z-buffer per plane, and calls `on_sample`
    /// with every sample and the colour of the whole scene there.
    fn draw_round(
        &mut self,
        round: Round,
        scene: &Mesh,
        planes: (usize, &[u8]),
        on_sample: impl Fn(&PlaneTile<'_>, u32, u32, Target<'_>) + Sync,
    ) {
        let stride = self.cameras.len().div_ceil(round.views).max(1);
        for view in (round.number as usize % stride..self.cameras.len()).step_by(stride) {
            let targets = self.take_targets(view);
            let camera = self.camera(view);
            let colors = &self.colors;
            self.solid.planes(scene, &camera, &self.drawing, planes, |tile| {
                for y in 0..tile.size.y {
                    let first = (tile.corner.y + y) * camera.size.x * SAMPLES + tile.corner.x;
                    for x in 0..tile.size.x {
                        let face = targets[(first + x) as usize];
                        on_sample(tile, x, y, Target { colors, face });
                    }
                }
            });
            self.put_targets(view, targets);
        }
    }

    /// The faces that a camera sees of the whole scene.
    fn take_targets(&mut self, view: usize) -> Vec<u32> {
        self.targets[view].take().unwrap_or_else(|| {
            let camera = self.camera(view);
            self.solid.visibility(self.whole, &camera, &self.drawing).face.clone()
        })
    }

    /// Keeps the result of [`Self::take_targets`] for the next round, if it fits in memory.
    fn put_targets(&mut self, view: usize, faces: Vec<u32>) {
        let kept: usize = self.targets.iter().flatten().map(|faces| size_of_val(&faces[..])).sum();
        if kept + size_of_val(&faces[..]) <= MAX_TARGET_BYTES {
            self.targets[view] = Some(faces);
        }
    }
}

/// The whole scene at a sample.
#[derive(Clone, Copy)]
struct Target<'a> {
    /// Mean colour of each face of the whole scene. `[F]`
    colors: &'a [[f32; 3]],
    face: u32,
}

impl Target<'_> {
    /// The squared difference of the colours if face `face` of `kept` is seen there.
    #[inline(always)]
    fn error_of(&self, kept: &[u32], face: u32) -> f32 {
        if face == NO_FACE || self.face == NO_FACE {
            return if face == self.face { 0.0 } else { HOLE_ERROR };
        }
        let a = self.colors[kept[face as usize] as usize];
        let b = self.colors[self.face as usize];
        (0..3).map(|k| (a[k] - b[k]) * (a[k] - b[k])).sum()
    }
}

// ---- The effect of changing single faces on the error of a scene, summed from many threads ------

/// Units per squared difference in integer sums. Integers, because their sums do not depend on the
/// order.
const UNITS: f64 = (1u64 << 32) as f64;

/// Effect of changing one face.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Effect {
    /// Change of the squared error.
    pub(super) error_change: f64,
    /// Samples that see the face before it changes, where they were counted.
    pub(super) samples: f64,
}

/// Effects of all faces while they are summed.
pub(super) struct EffectSums {
    error_change: Vec<AtomicI64>,
    samples: Vec<AtomicU32>,
}

impl EffectSums {
    /// Zeros for `faces`.
    pub(super) fn new(faces: usize) -> Self {
        Self {
            error_change: (0..faces).map(|_| AtomicI64::new(0)).collect(),
            samples: (0..faces).map(|_| AtomicU32::new(0)).collect(),
        }
    }

    /// Adds a sample at which the face is seen.
    #[inline(always)]
    pub(super) fn add_sample(&self, face: u32) {
        self.samples[face as usize].fetch_add(1, Relaxed);
    }

    /// Adds the change of a sample's squared error when the face changes.
    #[inline(always)]
    pub(super) fn add_change(&self, face: u32, change: f32) {
        self.error_change[face as usize].fetch_add((f64::from(change) * UNITS) as i64, Relaxed);
    }

    /// The sums.
    pub(super) fn into_effects(self) -> Vec<Effect> {
        let sums = self.error_change.into_iter().zip(self.samples);
        let effect = |(change, samples): (AtomicI64, AtomicU32)| Effect {
            error_change: change.into_inner() as f64 / UNITS,
            samples: samples.into_inner().into(),
        };
        sums.map(effect).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_of_either_sign_add_up() {
        let sums = EffectSums::new(2);
        for change in [0.5, -0.25, 3.0, 2f32.powi(-30)] {
            sums.add_change(1, change);
            sums.add_sample(1);
        }
        let exact = Effect { error_change: 3.25 + 2f64.powi(-30), samples: 4.0 };
        assert_eq!(sums.into_effects(), [Effect::default(), exact]);
    }
}
