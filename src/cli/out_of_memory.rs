//! Running out of memory: one error, and no incomplete file.

use indicatif::HumanBytes;
use std::io::{self, Write};
use trisplat_scene::atomic;
use trisplat_scene::process::memory;

/// Bytes of the longest message.
const LINE: usize = 320;

/// From now on an unexpected failure to allocate ends the program in this way.
pub(super) fn end_in_good_order() {
    memory::end_with(|bytes| {
        atomic::try_remove_temporaries();
        // There may be no memory for text either, so the line is composed on the stack.
        let mut line = [0u8; LINE];
        let _ = io::stderr().write_all(message(bytes, &mut line));
        std::process::exit(1)
    });
}

/// The error, in `line`.
fn message(bytes: usize, line: &mut [u8; LINE]) -> &[u8] {
    let mut rest = &mut line[..];
    let bytes = HumanBytes(bytes as u64);
    let remedy = "end other programs, or ask for less: fewer triangles, smaller pictures, --threads 1";
    // Cut off where the line ends.
    let _ = writeln!(
        rest,
        "error: out of memory: {bytes} more could not be allocated, and no file is incomplete; {remedy}"
    );
    let left = rest.len();
    &line[..LINE - left]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_message_is_whole() {
        let mut line = [0; LINE];
        let text = std::str::from_utf8(message(usize::MAX, &mut line)).unwrap();
        assert!(text.starts_with("error: out of memory: ") && text.ends_with("--threads 1\n"), "{text}");
    }
}
