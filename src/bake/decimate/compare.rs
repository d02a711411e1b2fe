//! Renders variants of a scene and compares them with the whole scene, face by face.

use super::super::views;
use crate::camera::Camera;
use crate::math::color::srgb_from_linear;
use crate::mesh::Mesh;
use crate::raster::solid::{NO_FACE, Solid, SolidRasterOptions};
use crate::rng::Rng;
use glam::UVec2;
use rayon::prelude::*;

/// Samples per pixel along each axis.
const SAMPLES: u32 = 1;
/// Cameras that are used in a round; the next round uses others.
const ROUND_VIEWS: usize = 48;
/// Longest side of their pictures, px: finer detail does not matter here.
const LONGEST_SIDE: u32 = 960;
/// Faces change in so many groups: the effect of one shows while most of the others are unchanged.
pub(super) const GROUPS: u32 = 4;
/// The squared difference between a face and none, sRGB-encoded and summed over channels.
const HOLE_ERROR: f32 = 0.75;
/// A face's mean effect per sample is estimated as if it had been average on this many samples more.
const PRIOR_SAMPLES: f64 = 2.0;

/// The faces of one mesh alone.
pub(super) fn part(mesh: &Mesh, faces: &[u32]) -> Mesh {
    let mut part = mesh.clone();
    part.select(faces);
    part
}

/// The group in which a face changes: another one every round.
pub(super) fn group_of(face: u32, round: u32) -> u32 {
    // The purpose is part of the random sequence, so of the output: it keeps its old name.
    (Rng::new(0, "thin", round.into()).bits(face.into()) % u64::from(GROUPS)) as u32
}

/// A scene in which the faces of one group were changed or are missing.
pub(super) struct Variant {
    pub(super) mesh: Mesh,
    /// Which of the kept faces its faces are; `None` if they are the same.
    pub(super) faces: Option<Vec<u32>>,
}

/// What changing one face does.
#[derive(Clone, Copy, Default)]
pub(super) struct Effect {
    /// By how much it changes the squared error.
    pub(super) error_change: f64,
    /// Samples that the face covers unchanged.
    samples: f64,
}

/// The whole scene, and how it is rendered.
pub(super) struct Comparison<'a> {
    whole: &'a Mesh,
    /// Mean colour of each face, sRGB-encoded. `[F]`
    colors: Vec<[f32; 3]>,
    cameras: Vec<Camera>,
    drawing: SolidRasterOptions,
}

impl<'a> Comparison<'a> {
    pub(super) fn new(whole: &'a Mesh, cameras: &[Camera]) -> Self {
        let color = |f: usize| {
            let [a, b, c] = whole.corner_colors(f);
            [0, 1, 2].map(|k| srgb_from_linear((a[k] + b[k] + c[k]) / 3.0))
        };
        let colors = (0..whole.face_count()).into_par_iter().map(color).collect();
        let drawing = views::drawing(cameras, whole, SAMPLES);
        let cameras = cameras.iter().map(smaller).collect();
        Self { whole, colors, cameras, drawing }
    }

    /// How much worse the scene looks without each of the faces `kept`. `[kept]`
    ///
    /// `visible_px`: the visible area of every face of the whole scene. `[F]`
    pub(super) fn importance(&self, kept: &[u32], visible_px: &[f32], round: u32) -> Vec<f64> {
        let without = |group: u32| {
            let left = |i: &u32| group_of(kept[*i as usize], round) != group;
            let left: Vec<u32> = (0..kept.len() as u32).filter(left).collect();
            let faces: Vec<u32> = left.iter().map(|&i| kept[i as usize]).collect();
            Variant { mesh: part(self.whole, &faces), faces: Some(left) }
        };
        let variants: Vec<Variant> = (0..GROUPS).map(without).collect();
        let effects = self.effects(&part(self.whole, kept), kept, &variants, round);
        let sum = effects.iter().fold(Effect::default(), |sum, e| Effect {
            error_change: sum.error_change + e.error_change,
            samples: sum.samples + e.samples,
        });
        // Only some cameras were used: the importance to the others is in proportion to how much they see of a face.
        let average = sum.error_change / sum.samples.max(1.0);
        let importance = |(e, face): (&Effect, &u32)| {
            f64::from(visible_px[*face as usize]) * (e.error_change + PRIOR_SAMPLES * average)
                / (e.samples + PRIOR_SAMPLES)
        };
        effects.iter().zip(kept).map(importance).collect()
    }

    /// What each face's change does: `base` holds the faces `kept` unchanged, variant g those of group g changed.
    /// `[kept]`
    pub(super) fn effects(&self, base: &Mesh, kept: &[u32], variants: &[Variant], round: u32) -> Vec<Effect> {
        let stride = self.cameras.len().div_ceil(ROUND_VIEWS).max(1);
        let groups: Vec<u32> = kept.iter().map(|&f| group_of(f, round)).collect();
        let mut effects = vec![Effect::default(); kept.len()];
        let mut solid = Solid::new();
        for camera in self.cameras.iter().skip(round as usize % stride).step_by(stride) {
            let target = solid.visibility(self.whole, camera, &self.drawing).face.clone();
            let before = solid.visibility(base, camera, &self.drawing).face.clone();
            before.iter().filter(|f| **f != NO_FACE).for_each(|f| effects[*f as usize].samples += 1.0);
            for (group, variant) in (0..).zip(variants) {
                let drawn = solid.visibility(&variant.mesh, camera, &self.drawing);
                for ((&before, &after), &target) in before.iter().zip(&drawn.face).zip(&target) {
                    let after = match &variant.faces {
                        Some(faces) if after != NO_FACE => faces[after as usize],
                        _ => after,
                    };
                    let changed = |face: u32| face != NO_FACE && groups[face as usize] == group;
                    if before == after || !(changed(before) || changed(after)) {
                        continue;
                    }
                    let of = |face: u32| if face == NO_FACE { NO_FACE } else { kept[face as usize] };
                    let change = self.error(of(after), target) - self.error(of(before), target);
                    let whose = if changed(after) { after } else { before };
                    effects[whose as usize].error_change += f64::from(change);
                }
            }
        }
        effects
    }

    /// The squared difference between the colours of two faces of the whole scene.
    fn error(&self, face: u32, target: u32) -> f32 {
        if face == NO_FACE || target == NO_FACE {
            return if face == target { 0.0 } else { HOLE_ERROR };
        }
        let (a, b) = (self.colors[face as usize], self.colors[target as usize]);
        (0..3).map(|k| (a[k] - b[k]) * (a[k] - b[k])).sum()
    }
}

/// The same camera for a picture whose sides are at most [`LONGEST_SIDE`].
fn smaller(camera: &Camera) -> Camera {
    let share = f64::from(LONGEST_SIDE) / f64::from(camera.size.max_element());
    if share >= 1.0 {
        *camera
    } else {
        camera.resized((camera.size.as_dvec2() * share).as_uvec2().max(UVec2::ONE))
    }
}
