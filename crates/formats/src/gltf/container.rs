//! The containers, written and read: a GLB's header and chunks, or a bare JSON file.

use super::document::{GLB_BYTES, MAX_GLB_CHUNKS, READABLE_BYTES, WARN_BYTES};
use crate::Source;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;
use trisplat_scene::{Error, Limits, Result};

const MAGIC: &[u8; 4] = b"glTF";
const VERSION: u32 = 2;
const HEADER_BYTES: u64 = 12;
const CHUNK_HEADER_BYTES: u64 = 8;
const JSON_CHUNK: u32 = u32::from_le_bytes(*b"JSON");
const BIN_CHUNK: u32 = u32::from_le_bytes(*b"BIN\0");
/// Alignment of chunks and buffer views, bytes.
const ALIGNMENT: u64 = 4;

/// The kind of file for the binary buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Container {
    /// One binary file with 32-bit lengths.
    Glb,
    /// A JSON document beside a .bin of any length.
    Gltf,
}

// ---- Writing ------------------------------------------------------------------------------------

/// Start of each stream, every one on a multiple of 4 bytes, and the end of the last.
pub fn stream_offsets(lengths: impl Iterator<Item = u64>) -> (Vec<u64>, u64) {
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

/// Size in bytes of a GLB, from the bytes of its JSON and binary chunks before padding.
pub fn glb_size(json_bytes: u64, bin_bytes: u64) -> u64 {
    HEADER_BYTES + 2 * CHUNK_HEADER_BYTES + padded(json_bytes) + padded(bin_bytes)
}

/// A warning for a file above 1 GiB, or an error for one that cannot be written.
///
/// # Errors
/// [`Error::TooLarge`] for a GLB above 2 GiB unless `allow_huge`, and above 4 GiB always.
pub fn check_size(
    path: &Path,
    container: Container,
    bytes: u64,
    allow_huge: bool,
) -> Result<Option<String>> {
    let too_large = |limit: u64, remedy: &str| {
        Err(Error::TooLarge {
            what: path.display().to_string(),
            bytes,
            limit,
            remedy: remedy.to_owned(),
        })
    };
    if container == Container::Glb && bytes > GLB_BYTES {
        return too_large(
            GLB_BYTES,
            "a GLB holds its length in 32 bits; write .gltf, keep fewer triangles with `max_triangles`, \
             or crop the scene into several files",
        );
    }
    if container == Container::Glb && bytes > READABLE_BYTES && !allow_huge {
        return too_large(
            READABLE_BYTES,
            "Unity, web pages and older Godot cannot read more; keep fewer triangles with \
             `max_triangles`, crop, or insist with `allow_huge`",
        );
    }
    let size = format!("{} is {} MiB", path.display(), bytes >> 20);
    Ok(if bytes > READABLE_BYTES {
        Some(format!("{size}: Unity, web pages and older Godot cannot read more than 2 GiB"))
    } else if bytes > WARN_BYTES {
        Some(format!("{size}: above 1 GiB many readers run out of memory"))
    } else {
        None
    })
}

/// Writes the GLB header, the JSON chunk and the header of the binary chunk.
pub(crate) fn write_head(out: &mut dyn Write, json: &[u8], bin_bytes: u64) -> io::Result<()> {
    let json_bytes = padded(json.len() as u64);
    let mut head =
        Vec::with_capacity((HEADER_BYTES + 2 * CHUNK_HEADER_BYTES + json_bytes) as usize);
    head.extend_from_slice(MAGIC);
    head.extend_from_slice(&VERSION.to_le_bytes());
    head.extend_from_slice(&length(glb_size(json.len() as u64, bin_bytes))?);
    head.extend_from_slice(&length(json_bytes)?);
    head.extend_from_slice(&JSON_CHUNK.to_le_bytes());
    head.extend_from_slice(json);
    head.resize((HEADER_BYTES + CHUNK_HEADER_BYTES + json_bytes) as usize, b' ');
    head.extend_from_slice(&length(padded(bin_bytes))?);
    head.extend_from_slice(&BIN_CHUNK.to_le_bytes());
    out.write_all(&head)
}

/// Writes the zeros that bring a buffer of `bytes` to a multiple of 4.
pub(crate) fn write_padding(out: &mut dyn Write, bytes: u64) -> io::Result<()> {
    out.write_all(&[0; 3][..(padded(bytes) - bytes) as usize])
}

fn padded(bytes: u64) -> u64 {
    bytes.next_multiple_of(ALIGNMENT)
}

fn length(bytes: u64) -> io::Result<[u8; 4]> {
    let bytes = u32::try_from(bytes).map_err(|_| io::Error::other("longer than a GLB can say"))?;
    Ok(bytes.to_le_bytes())
}

// ---- Reading ------------------------------------------------------------------------------------

/// The JSON of a glTF file, and the places of its chunks.
#[derive(Debug)]
pub(crate) struct ContainerFile {
    /// The JSON text, padding included.
    pub(crate) json: Vec<u8>,
    /// The chunks of a GLB in order; empty for a bare JSON file.
    pub(crate) chunks: Vec<GlbChunk>,
}

/// The place of a chunk of a GLB.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct GlbChunk {
    /// Four characters, little-endian.
    kind: u32,
    /// First byte of its data in the file.
    pub(crate) start: u64,
    /// Bytes of data.
    pub(crate) length: u64,
}

impl ContainerFile {
    /// Reads the header and the JSON; the binary chunk stays on disk.
    pub(crate) fn read(source: &mut Source, limits: &Limits) -> Result<Self> {
        let path = source.path.clone();
        let is_glb = source.head()?.starts_with(MAGIC);
        let chunks = if is_glb { chunks(source)? } else { Vec::new() };
        let start = chunks.first().map_or(0, |chunk| chunk.start);
        let bytes = chunks.first().map_or(source.len, |chunk| chunk.length);
        // Buffers embedded as base64 count.
        limits.document(format_args!("{}: JSON", path.display()), bytes)?;
        let mut json = limits.zeroed(path.display(), bytes as usize)?;
        read_at(source, start, &mut json)?;
        Ok(Self { json, chunks })
    }

    /// The binary chunk of a GLB.
    pub(crate) fn bin(&self) -> Option<GlbChunk> {
        self.chunks.iter().copied().find(|chunk| chunk.kind == BIN_CHUNK)
    }
}

/// The chunks of a GLB.
fn chunks(source: &mut Source) -> Result<Vec<GlbChunk>> {
    let path = source.path.clone();
    let [_, version, length] = read_words(source, 0, "header")?;
    if version != VERSION {
        return Err(Error::unsupported(
            &path,
            format!("is binary glTF {version}; convert it to glTF 2.0"),
        ));
    }
    let length = u64::from(length);
    if length > source.len {
        return Err(truncated(&path, "header", length, source.len));
    }
    let mut chunks = Vec::new();
    let mut at = HEADER_BYTES;
    while at + CHUNK_HEADER_BYTES <= length {
        let place = format!("chunk {}", chunks.len());
        let [bytes, kind] = read_words(source, at, &place)?;
        let chunk = GlbChunk { kind, start: at + CHUNK_HEADER_BYTES, length: u64::from(bytes) };
        if chunk.start + chunk.length > length {
            return Err(truncated(&path, &place, chunk.start + chunk.length, length));
        }
        if chunks.is_empty() && kind != JSON_CHUNK {
            return Err(Error::malformed(path, place, "is not JSON, which must come first"));
        }
        at = chunk.start + chunk.length;
        chunks.push(chunk);
        if chunks.len() > MAX_GLB_CHUNKS {
            let reason = format!("has more than {MAX_GLB_CHUNKS} chunks; expected two");
            return Err(Error::malformed(path, place, reason));
        }
    }
    if chunks.is_empty() {
        return Err(Error::malformed(path, "chunk 0", "is missing; expected JSON"));
    }
    Ok(chunks)
}

fn truncated(path: &Path, place: &str, wants: u64, has: u64) -> Error {
    Error::malformed(
        path,
        place,
        format!("promises {wants} bytes, but only {has} are there: truncated?"),
    )
}

/// Little-endian words from byte `at`.
fn read_words<const N: usize>(source: &mut Source, at: u64, place: &str) -> Result<[u32; N]> {
    let mut words = [[0; 4]; N];
    let end = at + size_of_val(&words) as u64;
    if end > source.len {
        return Err(truncated(&source.path, place, end, source.len));
    }
    read_at(source, at, words.as_flattened_mut())?;
    Ok(words.map(u32::from_le_bytes))
}

fn read_at(source: &mut Source, at: u64, bytes: &mut [u8]) -> Result<()> {
    let mut file = &*source.file;
    let read = file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(bytes));
    read.map_err(|e| Error::io(&source.path, e))
}
