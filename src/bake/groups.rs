//! Faces in groups: what some of them do to a picture shows while most of the others are unchanged.

use crate::rng::Rng;

/// Number of groups.
pub(super) const GROUPS: usize = 4;

/// The group of a face in a round: another one every round. `purpose` names the random sequence.
pub(super) fn group_of(purpose: &str, face: u32, round: u32) -> u8 {
    (Rng::new(0, purpose, round.into()).bits(face.into()) % GROUPS as u64) as u8
}
