//! Decimation: which triangles to drop, and how those that stay cover for them.
//!
//! The importance of a triangle is how much worse the scene would look without it: the squared differences between
//! what was visible and what lies behind, summed over the samples that it covers. It is measured by rendering the
//! scene without some of its triangles, chosen at random, and looking at what appears in their place. There are
//! several rounds, each dropping the least important share, as what lies behind one triangle may be gone in the next.
//!
//! The triangles that stay then take over where that helps: in every round each tries to move one of its corners, at
//! random outwards or inwards and aside, and keeps the move if the scene looks more like the whole one with it.
//!
//! Without cameras there is only size to go by: see [`rank_by_size`] and [`enlarge`].

mod compare;
mod size;

pub use size::{enlarge, rank_by_size};

use crate::camera::Camera;
use crate::mesh::Mesh;
use crate::rng::Rng;
use compare::{Comparison, GROUPS, Variant, group_of, part};
use glam::Vec3;

/// Share of the triangles that is left after a round.
const ROUND_SHARE: f64 = 0.84;
/// Rounds in which corners may move.
const MOVE_ROUNDS: u32 = 12;
/// How far a corner is moved outwards and inwards, as shares of its distance from the middle of the opposite edge.
const MOVES: [f32; 3] = [0.3, 0.3, -0.18];
/// How far it is moved aside at most, as a share of the opposite edge.
const ASIDE: f32 = 0.25;

/// `faces`, all of them visible and in any order, ordered so that the first n of them are the n best to keep, for
/// every n from `fewest` on. `visible_px` is the area of every face of the mesh that is seen. `[F]`
pub fn rank_by_importance(
    mesh: &Mesh,
    cameras: &[Camera],
    visible_px: &[f32],
    faces: &[u32],
    fewest: usize,
) -> Vec<u32> {
    let comparison = Comparison::new(mesh, cameras);
    let mut kept = faces.to_vec();
    kept.sort_unstable();
    let mut dropped = Vec::new();
    for round in 0.. {
        let keep = ((kept.len() as f64 * ROUND_SHARE) as usize).max(fewest);
        let importance = comparison.importance(&kept, visible_px, round);
        let mut order: Vec<usize> = (0..kept.len()).collect();
        order.sort_unstable_by(|&a, &b| importance[b].total_cmp(&importance[a]).then(a.cmp(&b)));
        let sorted: Vec<u32> = order.iter().map(|&i| kept[i]).collect();
        let last = keep <= fewest || keep >= sorted.len();
        dropped.extend(sorted[if last { 0 } else { keep }..].iter().rev());
        if last {
            break;
        }
        kept = sorted[..keep].to_vec();
        kept.sort_unstable();
    }
    dropped.reverse();
    dropped
}

/// Moves corners of `faces` where `mesh` then looks more like it did with all faces; returns how many moves there
/// were. A mesh with shared vertices is left as it is.
pub fn move_corners(mesh: &mut Mesh, cameras: &[Camera], faces: &[u32]) -> usize {
    if !mesh.indices.is_empty() {
        return 0;
    }
    let mut kept = faces.to_vec();
    kept.sort_unstable();
    let (whole, mut moves) = (mesh.clone(), 0);
    let comparison = Comparison::new(&whole, cameras);
    for round in 0..MOVE_ROUNDS {
        let moved: Vec<[Vec3; 3]> =
            kept.iter().map(|&f| with_moved_corner(mesh.corners(f as usize), f, round)).collect();
        let base = part(mesh, &kept);
        let variant = |group: u32| {
            let mut variant = base.clone();
            for (i, corners) in moved.iter().enumerate().filter(|(i, _)| group_of(kept[*i], round) == group) {
                variant.positions[3 * i..3 * i + 3].copy_from_slice(corners);
            }
            Variant { mesh: variant, faces: None }
        };
        let variants: Vec<Variant> = (0..GROUPS).map(variant).collect();
        let effects = comparison.effects(&base, &kept, &variants, round);
        for (i, &face) in kept.iter().enumerate().filter(|(i, _)| effects[*i].error_change < 0.0) {
            mesh.positions[3 * face as usize..3 * face as usize + 3].copy_from_slice(&moved[i]);
            moves += 1;
        }
    }
    moves
}

/// A triangle with one of its corners moved, at random.
fn with_moved_corner(mut corners: [Vec3; 3], face: u32, round: u32) -> [Vec3; 3] {
    let which = (Rng::new(0, "corner", 0).bits(face.into()) % 3 + u64::from(round)) as usize % 3;
    let across = (corners[(which + 1) % 3] + corners[(which + 2) % 3]) / 2.0;
    let edge = corners[(which + 1) % 3] - corners[(which + 2) % 3];
    let draw = Rng::new(0, "move", round.into());
    let [out, aside] = [0, 1].map(|k| draw.uniform(2 * u64::from(face) + k));
    let out = MOVES[((out * MOVES.len() as f32) as usize).min(MOVES.len() - 1)];
    corners[which] += (corners[which] - across) * out + edge * (ASIDE * (2.0 * aside - 1.0));
    corners
}
