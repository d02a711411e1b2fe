//! Fuzzed bytes as the file a reader is given.

use std::io::{Seek, SeekFrom, Write};
use trisplat_formats::Source;

/// `bytes` in a nameless temporary file, at byte 0.
pub fn source(bytes: &[u8], name: &str) -> Source {
    let mut file = tempfile::tempfile().unwrap();
    file.write_all(bytes).unwrap();
    file.seek(SeekFrom::Start(0)).unwrap();
    Source { path: name.into(), file: file.into(), len: bytes.len() as u64 }
}
