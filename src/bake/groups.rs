//! Faces in groups: a change of one group shows in a picture while most other faces are unchanged.

use crate::rng::Rng;

/// Number of groups.
pub(super) const GROUPS: usize = 4;

/// The group of a face in a round; it changes every round. `purpose` names the random sequence.
pub(super) fn group_of(purpose: &str, face: u32, round: u32) -> u8 {
    (Rng::new(0, purpose, round.into()).bits(face.into()) % GROUPS as u64) as u8
}
