//! Searches by trial: a corner of each triangle is moved at random, and one drawing decides about a
//! group of them, because a change of one group shows in a picture while most other faces are
//! unchanged.

use glam::Vec3;
use trisplat_scene::Rng;

/// Number of groups.
pub(super) const GROUPS: usize = 4;
/// Moves of a corner outwards and inwards, as shares of its distance from the middle of the
/// opposite edge.
const CORNER_MOVES: [f32; 3] = [0.3, 0.3, -0.18];
/// Maximum sideways move, as a share of the opposite edge.
const MAX_SIDEWAYS: f32 = 0.25;

/// The group of a face in a round; it changes every round. `purpose` names the random sequence.
pub(super) fn group_of(purpose: &str, face: u32, round: u32) -> u8 {
    (Rng::new(0, purpose, round.into()).bits(face.into()) % GROUPS as u64) as u8
}

/// The triangle with one of its corners moved; corner and move depend only on the face and the
/// round.
pub(super) fn with_moved_corner(mut corners: [Vec3; 3], face: u32, round: u32) -> [Vec3; 3] {
    let corner = (Rng::new(0, "corner", 0).bits(face.into()) % 3 + u64::from(round)) as usize % 3;
    let across = (corners[(corner + 1) % 3] + corners[(corner + 2) % 3]) / 2.0;
    let edge = corners[(corner + 1) % 3] - corners[(corner + 2) % 3];
    let draw = Rng::new(0, "move", round.into());
    let [out, aside] = [0, 1].map(|k| draw.uniform(2 * u64::from(face) + k));
    let out =
        CORNER_MOVES[((out * CORNER_MOVES.len() as f32) as usize).min(CORNER_MOVES.len() - 1)];
    corners[corner] +=
        (corners[corner] - across) * out + edge * (MAX_SIDEWAYS * (2.0 * aside - 1.0));
    corners
}
