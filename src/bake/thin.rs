//! Which triangles to do without, and how those that stay cover for them.
//!
//! What a triangle is worth is how much worse the scene would look without it: the squares of the differences
//! between what was seen and what stands behind, summed over the samples that it covers. It is measured by
//! drawing the scene without some of its triangles, spread at random, and looking what comes forward where they
//! were; some rounds of that, each taking away the share that is worth least, as what stands behind one may be
//! gone in the next.
//!
//! Those that stay then take over where that helps: every turn each tries to move one of its corners, by chance
//! outwards or inwards and aside, and the move stands if the scene looks more like the whole one with it.

mod size;

pub use size::{by_size, cover};

use super::views;
use crate::camera::Camera;
use crate::math::color::srgb_from_linear;
use crate::mesh::Mesh;
use crate::raster::solid::{NO_FACE, Solid, SolidRasterOptions};
use crate::rng::Rng;
use glam::{UVec2, Vec3};
use rayon::prelude::*;

/// Samples a pixel along each axis.
const SAMPLES: u32 = 1;
/// Share that is left after a round.
const ROUND: f64 = 0.84;
/// Cameras that are asked in a round; others in the next.
const ROUND_VIEWS: usize = 48;
/// Longest side of their pictures, px: a share of a pixel is not asked about.
const LONGEST: u32 = 960;
/// Triangles are tried in so many groups: what one does shows while most of the others stand still.
const GROUPS: u32 = 4;
/// The square of the difference between anything and nothing, sRGB-encoded and summed over channels.
const HOLE: f32 = 0.75;
/// Samples for which a face is taken to be worth what faces are on average.
const PRIOR: f64 = 2.0;
/// Turns in which corners may move.
const TURNS: u32 = 12;
/// How far a corner is moved outwards and inwards, as shares of its way from the middle of the opposite edge.
const MOVES: [f32; 3] = [0.3, 0.3, -0.18];
/// How far it is moved aside at most, as a share of the opposite edge.
const ASIDE: f32 = 0.25;

/// The faces in `ranked` (those of which anything is seen, in any order), ordered so that the first n of them are
/// the n best to keep, for every n from `fewest` on. `seen` is how much of each is seen. `[F]`
pub fn order(mesh: &Mesh, cameras: &[Camera], seen: &[f32], ranked: &[u32], fewest: usize) -> Vec<u32> {
    let trial = Trial::new(mesh, cameras);
    let mut kept = ranked.to_vec();
    kept.sort_unstable();
    let mut gone = Vec::new();
    for round in 0.. {
        let keep = ((kept.len() as f64 * ROUND) as usize).max(fewest);
        let worth = trial.worth(&kept, seen, round);
        let mut by_worth: Vec<usize> = (0..kept.len()).collect();
        by_worth.sort_unstable_by(|&a, &b| worth[b].total_cmp(&worth[a]).then(a.cmp(&b)));
        let sorted: Vec<u32> = by_worth.iter().map(|&i| kept[i]).collect();
        let last = keep <= fewest || keep >= sorted.len();
        gone.extend(sorted[if last { 0 } else { keep }..].iter().rev());
        if last {
            break;
        }
        kept = sorted[..keep].to_vec();
        kept.sort_unstable();
    }
    gone.reverse();
    gone
}

/// Moves corners of `faces` where `mesh` then looks more like it did with all faces; returns how many
/// moves there were.
pub fn grow(mesh: &mut Mesh, cameras: &[Camera], faces: &[u32]) -> usize {
    if !mesh.indices.is_empty() {
        return 0;
    }
    let mut kept = faces.to_vec();
    kept.sort_unstable();
    let (whole, mut moves) = (mesh.clone(), 0);
    let trial = Trial::new(&whole, cameras);
    for turn in 0..TURNS {
        let grown: Vec<[Vec3; 3]> = kept.iter().map(|&f| grown(mesh.corners(f as usize), f, turn)).collect();
        let base = part(mesh, &kept);
        let variant = |group: u32| {
            let mut variant = base.clone();
            for (i, corners) in grown.iter().enumerate().filter(|(i, _)| group_of(kept[*i], turn) == group) {
                variant.positions[3 * i..3 * i + 3].copy_from_slice(corners);
            }
            Variant { mesh: variant, faces: None }
        };
        let variants: Vec<Variant> = (0..GROUPS).map(variant).collect();
        let told = trial.compare(&base, &kept, &variants, turn);
        for (i, &face) in kept.iter().enumerate().filter(|(i, _)| told[*i].change < 0.0) {
            mesh.positions[3 * face as usize..3 * face as usize + 3].copy_from_slice(&grown[i]);
            moves += 1;
        }
    }
    moves
}

/// A triangle one corner of which was moved.
fn grown(mut corners: [Vec3; 3], face: u32, turn: u32) -> [Vec3; 3] {
    let which = (Rng::new(0, "corner", 0).bits(face.into()) % 3 + u64::from(turn)) as usize % 3;
    let across = (corners[(which + 1) % 3] + corners[(which + 2) % 3]) / 2.0;
    let edge = corners[(which + 1) % 3] - corners[(which + 2) % 3];
    let draw = Rng::new(0, "move", turn.into());
    let [out, aside] = [0, 1].map(|k| draw.uniform(2 * u64::from(face) + k));
    let out = MOVES[((out * MOVES.len() as f32) as usize).min(MOVES.len() - 1)];
    corners[which] += (corners[which] - across) * out + edge * (ASIDE * (2.0 * aside - 1.0));
    corners
}

/// The same camera for a picture of at most [`LONGEST`] pixels a side.
fn smaller(camera: &Camera) -> Camera {
    let share = f64::from(LONGEST) / f64::from(camera.size.max_element());
    if share >= 1.0 {
        *camera
    } else {
        camera.resized((camera.size.as_dvec2() * share).as_uvec2().max(UVec2::ONE))
    }
}

/// The faces of one mesh alone.
fn part(mesh: &Mesh, faces: &[u32]) -> Mesh {
    let mut part = mesh.clone();
    part.select(faces);
    part
}

/// The group in which a face is tried: another one every round.
fn group_of(face: u32, round: u32) -> u32 {
    (Rng::new(0, "thin", round.into()).bits(face.into()) % u64::from(GROUPS)) as u32
}

/// A scene in which the faces of one group were changed or are missing.
struct Variant {
    mesh: Mesh,
    /// Which of the faces that are kept its faces are; `None` if they are the same.
    faces: Option<Vec<u32>>,
}

/// What was found about a face.
#[derive(Clone, Copy, Default)]
struct Told {
    /// By how much its change changes the error.
    change: f64,
    /// Samples that it covers unchanged.
    samples: f64,
}

/// Draws scenes and compares them with the whole one.
struct Trial<'a> {
    whole: &'a Mesh,
    /// Mean colour of each face, sRGB-encoded. `[F]`
    colors: Vec<[f32; 3]>,
    cameras: Vec<Camera>,
    drawing: SolidRasterOptions,
}

impl<'a> Trial<'a> {
    fn new(whole: &'a Mesh, cameras: &[Camera]) -> Self {
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
    fn worth(&self, kept: &[u32], seen: &[f32], round: u32) -> Vec<f64> {
        let without = |group: u32| {
            let left = |i: &u32| group_of(kept[*i as usize], round) != group;
            let left: Vec<u32> = (0..kept.len() as u32).filter(left).collect();
            let faces: Vec<u32> = left.iter().map(|&i| kept[i as usize]).collect();
            Variant { mesh: part(self.whole, &faces), faces: Some(left) }
        };
        let variants: Vec<Variant> = (0..GROUPS).map(without).collect();
        let told = self.compare(&part(self.whole, kept), kept, &variants, round);
        let sum = told.iter().fold(Told::default(), |sum, t| Told {
            change: sum.change + t.change,
            samples: sum.samples + t.samples,
        });
        // Only some cameras were asked: what a face is worth to others goes by how much they see of it.
        let usual = sum.change / sum.samples.max(1.0);
        let worth = |(t, face): (&Told, &u32)| {
            f64::from(seen[*face as usize]) * (t.change + PRIOR * usual) / (t.samples + PRIOR)
        };
        told.iter().zip(kept).map(worth).collect()
    }

    /// What each face's change does: `base` holds the faces `kept` as they are, variant g those of group g changed.
    fn compare(&self, base: &Mesh, kept: &[u32], variants: &[Variant], round: u32) -> Vec<Told> {
        let stride = self.cameras.len().div_ceil(ROUND_VIEWS).max(1);
        let groups: Vec<u32> = kept.iter().map(|&f| group_of(f, round)).collect();
        let mut told = vec![Told::default(); kept.len()];
        let mut solid = Solid::new();
        for camera in self.cameras.iter().skip(round as usize % stride).step_by(stride) {
            let wanted = solid.visibility(self.whole, camera, &self.drawing).face.clone();
            let now = solid.visibility(base, camera, &self.drawing).face.clone();
            now.iter().filter(|f| **f != NO_FACE).for_each(|f| told[*f as usize].samples += 1.0);
            for (group, variant) in (0..).zip(variants) {
                let drawn = solid.visibility(&variant.mesh, camera, &self.drawing);
                for ((&now, &then), &wanted) in now.iter().zip(&drawn.face).zip(&wanted) {
                    let then = match &variant.faces {
                        Some(faces) if then != NO_FACE => faces[then as usize],
                        _ => then,
                    };
                    let changed = |face: u32| face != NO_FACE && groups[face as usize] == group;
                    if now == then || !(changed(now) || changed(then)) {
                        continue;
                    }
                    let of = |face: u32| if face == NO_FACE { NO_FACE } else { kept[face as usize] };
                    let change = self.error(of(then), wanted) - self.error(of(now), wanted);
                    let whose = if changed(then) { then } else { now };
                    told[whose as usize].change += f64::from(change);
                }
            }
        }
        told
    }

    /// The square of the difference between the colours of two faces of the whole mesh.
    fn error(&self, face: u32, wanted: u32) -> f32 {
        if face == NO_FACE || wanted == NO_FACE {
            return if face == wanted { 0.0 } else { HOLE };
        }
        let (a, b) = (self.colors[face as usize], self.colors[wanted as usize]);
        (0..3).map(|k| (a[k] - b[k]) * (a[k] - b[k])).sum()
    }
}
