//! The header of a checkpoint, checked before the file is read: other files, of any size, are refused by their first bytes.

use serde::Deserialize;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;
use trisplat_scene::{Error, Result};

/// Bytes of the header's length, which is at the start of the file.
const LENGTH: u64 = 8;
/// Longest header that the safetensors format permits.
const MOST: u64 = 100_000_000;
/// What the header of every checkpoint holds.
const MARK: &[u8] = br#""trisplat":""#;

/// An entry of the header.
#[derive(Deserialize)]
struct Entry {
    /// Where an array begins and ends, bytes after the header.
    #[serde(default)]
    data_offsets: Option<[u64; 2]>,
}

/// Errors: a file of `len` bytes whose header is not that of a checkpoint of this length.
pub(super) fn check(path: &Path, file: &mut File, len: u64) -> Result<()> {
    let io = |e| Error::io(path, e);
    let mut file = BufReader::new(file);
    let mut start = Vec::new();
    file.by_ref().take(LENGTH + 1).read_to_end(&mut start).map_err(io)?;
    // Every safetensors file has a JSON object here, and hardly any other.
    if start.get(LENGTH as usize).is_some_and(|first| *first != b'{') {
        let reason = "is not a checkpoint of a training run; to start from a scene, give it as `from`";
        return Err(Error::unsupported(path, reason));
    }
    let size = start.first_chunk::<{ LENGTH as usize }>().map_or(u64::MAX, |size| u64::from_le_bytes(*size));
    if size > MOST.min(len.saturating_sub(LENGTH)) {
        let reason = "is not a checkpoint of a training run, or is cut short; resume from another one";
        return Err(Error::malformed(path, "byte 0", reason));
    }
    let mut header = start.split_off(LENGTH as usize);
    file.take(size.saturating_sub(header.len() as u64)).read_to_end(&mut header).map_err(io)?;
    if !header.windows(MARK.len()).any(|part| part == MARK) {
        return Err(Error::malformed(path, "__metadata__", "is not a trisplat checkpoint"));
    }
    let entries = serde_json::from_slice::<BTreeMap<String, Entry>>(&header).map_err(|_| damaged(path))?;
    let end = entries.values().filter_map(|entry| entry.data_offsets).map(|[_, end]| end).max();
    let whole = (LENGTH + size).checked_add(end.unwrap_or_default());
    if whole == Some(len) { Ok(()) } else { Err(damaged(path)) }
}

/// The error of a checkpoint whose bytes are not those that were written.
pub(super) fn damaged(path: &Path) -> Error {
    let reason = "does not fit: the file is damaged; resume from another checkpoint, or train again";
    Error::malformed(path, "checksum", reason)
}

#[cfg(test)]
mod tests {
    use crate::checkpoint::read;
    use std::io::Write;

    #[test]
    fn a_large_file_that_is_no_checkpoint_is_refused_by_its_first_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        let header = br#"{"__metadata__":{"format":"pt"}}"#;
        let ours = br#"{"__metadata__":{"trisplat":"{}"}}"#;
        let long = [&(1u64 << 40).to_le_bytes()[..], b"{"].concat();
        let framed = |text: &[u8]| [&(text.len() as u64).to_le_bytes()[..], text].concat();
        for (start, wants) in [
            (b"ply\nformat ascii".to_vec(), "is not a checkpoint of a training run; to start from a scene"),
            (long, "byte 0: is not a checkpoint"),
            (framed(header), "is not a trisplat checkpoint"),
            (framed(ours), "the file is damaged"),
        ] {
            let mut file = std::fs::File::create(&path).unwrap();
            file.write_all(&start).unwrap();
            // A hole, which no machine has the memory to read.
            file.set_len(200 << 30).unwrap();
            let message = read(&path).unwrap_err().to_string();
            assert!(message.contains(wants), "{message}");
        }
    }
}
