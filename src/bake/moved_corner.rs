//! A triangle with one of its corners moved at random, for searches by trial.

use crate::rng::Rng;
use glam::Vec3;

/// How far a corner is moved outwards and inwards, as shares of its distance from the middle of the opposite edge.
const MOVES: [f32; 3] = [0.3, 0.3, -0.18];
/// Largest sideways move, as a share of the opposite edge.
const ASIDE: f32 = 0.25;

/// The triangle with one of its corners moved; corner and move depend only on the face and the round.
pub(super) fn with_moved_corner(mut corners: [Vec3; 3], face: u32, round: u32) -> [Vec3; 3] {
    let which = (Rng::new(0, "corner", 0).bits(face.into()) % 3 + u64::from(round)) as usize % 3;
    let across = (corners[(which + 1) % 3] + corners[(which + 2) % 3]) / 2.0;
    let edge = corners[(which + 1) % 3] - corners[(which + 2) % 3];
    let draw = Rng::new(0, "move", round.into());
    let [out, aside] = [0, 1].map(|k| draw.uniform(2 * u64::from(face) + k));
    let out = MOVES[((out * MOVES.len() as f32) as usize).min(MOVES.len() - 1)];
    corners[which] += (corners[which] - across) * out + edge * (ASIDE * (2.0 * aside - 1.0));
    corners
}
