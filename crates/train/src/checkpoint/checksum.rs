//! The XXH3 checksum of a checkpoint. It is stored in the file itself, and computed with zeros in its place.

use std::ops::Range;
use xxhash_rust::xxh3::xxh3_64;

/// The zeros in its place during the computation.
pub(super) const NONE: &str = "0000000000000000";

/// Its place in a file of this format, in a JSON text inside the JSON header.
fn place(bytes: &[u8], format: u32) -> Option<Range<usize>> {
    let before = format!(r#""trisplat":"{{\"format\":{format},\"checksum\":\""#);
    let start = bytes.windows(before.len()).position(|window| window == before.as_bytes())? + before.len();
    let place = start..start + NONE.len();
    (place.end <= bytes.len()).then_some(place)
}

/// Writes the checksum over the zeros; `None` when the file has no such field.
pub(super) fn fill_in(bytes: &mut [u8], format: u32) -> Option<()> {
    let place = place(bytes, format)?;
    let checksum = format!("{:016x}", xxh3_64(bytes));
    bytes[place].copy_from_slice(checksum.as_bytes());
    Some(())
}

/// Whether no byte has changed; `None` without a checksum. Leaves zeros in its place.
pub(super) fn fits(bytes: &mut [u8], format: u32) -> Option<bool> {
    let place = place(bytes, format)?;
    let found = bytes[place.clone()].to_vec();
    bytes[place].copy_from_slice(NONE.as_bytes());
    Some(found == format!("{:016x}", xxh3_64(bytes)).as_bytes())
}
