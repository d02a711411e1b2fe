//! The containers: where the streams lie, how large a file may be, and the GLB framing.

use crate::error::{Error, Result};
use std::io::{self, Write};
use std::path::Path;

const MIB: u64 = 1 << 20;
const GIB: u64 = 1 << 30;

/// Sizes above this are worth a word.
const WARN_BYTES: u64 = GIB;
/// The largest signed 32-bit number: Unity's glTFast, JavaScript buffers and older Godot stop here.
const READABLE_BYTES: u64 = i32::MAX as u64;
/// GLB lengths are unsigned 32-bit numbers.
const GLB_BYTES: u64 = u32::MAX as u64;

const HEADER_BYTES: u64 = 12;
const CHUNK_HEADER_BYTES: u64 = 8;

/// Which kind of file holds the binary buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Container {
    /// One binary file with 32-bit lengths.
    Glb,
    /// A JSON document beside a .bin of any length.
    Gltf,
}

/// Start of each stream, every one on a multiple of 4 bytes, and the end of the last.
pub fn place(lengths: impl Iterator<Item = u64>) -> (Vec<u64>, u64) {
    let mut end = 0;
    let starts = lengths
        .map(|length| {
            let start = padded(end);
            end = start + length;
            start
        })
        .collect();
    (starts, end)
}

/// Size in bytes of a GLB whose JSON and binary chunks hold these many bytes before padding.
pub fn glb_bytes(json_bytes: u64, bin_bytes: u64) -> u64 {
    HEADER_BYTES + 2 * CHUNK_HEADER_BYTES + padded(json_bytes) + padded(bin_bytes)
}

/// A warning for a file above 1 GiB, or an error for one that cannot be written.
///
/// # Errors
/// [`Error::TooLarge`] for a GLB above 2 GiB unless `allow_huge`, and above 4 GiB always.
pub fn check_size(path: &Path, container: Container, bytes: u64, allow_huge: bool) -> Result<Option<String>> {
    let too_large = |limit: u64, remedy: &str| {
        Err(Error::TooLarge { what: path.display().to_string(), bytes, limit, remedy: remedy.to_owned() })
    };
    if container == Container::Glb && bytes > GLB_BYTES {
        return too_large(
            GLB_BYTES,
            "a GLB holds its length in 32 bits; write .gltf, keep fewer triangles with --max-triangles, \
             or crop the scene into several files",
        );
    }
    if container == Container::Glb && bytes > READABLE_BYTES && !allow_huge {
        return too_large(
            READABLE_BYTES,
            "Unity, web pages and older Godot cannot read more; keep fewer triangles with \
             --max-triangles, crop, or insist with --allow-huge",
        );
    }
    let size = format!("{} is {} MiB", path.display(), bytes / MIB);
    Ok(if bytes > READABLE_BYTES {
        Some(format!("{size}: Unity, web pages and older Godot cannot read more than 2 GiB"))
    } else if bytes > WARN_BYTES {
        Some(format!("{size}: above 1 GiB many readers run out of memory"))
    } else {
        None
    })
}

/// Writes the GLB header, the JSON chunk and the header of the binary chunk.
pub(super) fn write_head(out: &mut dyn Write, json: &[u8], bin_bytes: u64) -> io::Result<()> {
    let json_bytes = padded(json.len() as u64);
    let mut head = Vec::with_capacity((HEADER_BYTES + 2 * CHUNK_HEADER_BYTES + json_bytes) as usize);
    head.extend_from_slice(b"glTF");
    head.extend_from_slice(&2u32.to_le_bytes());
    head.extend_from_slice(&length(glb_bytes(json.len() as u64, bin_bytes))?);
    head.extend_from_slice(&length(json_bytes)?);
    head.extend_from_slice(b"JSON");
    head.extend_from_slice(json);
    head.resize((HEADER_BYTES + CHUNK_HEADER_BYTES + json_bytes) as usize, b' ');
    head.extend_from_slice(&length(padded(bin_bytes))?);
    head.extend_from_slice(b"BIN\0");
    out.write_all(&head)
}

/// Writes the zeros that bring a buffer of `bytes` to a multiple of 4.
pub(super) fn write_padding(out: &mut dyn Write, bytes: u64) -> io::Result<()> {
    out.write_all(&[0; 3][..(padded(bytes) - bytes) as usize])
}

fn padded(bytes: u64) -> u64 {
    bytes.next_multiple_of(4)
}

fn length(bytes: u64) -> io::Result<[u8; 4]> {
    let bytes = u32::try_from(bytes).map_err(|_| io::Error::other("longer than a GLB can say"))?;
    Ok(bytes.to_le_bytes())
}
