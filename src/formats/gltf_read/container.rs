//! The containers: a GLB's two chunks, or a bare JSON file.

use crate::error::{Error, Result};
use crate::formats::Source;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// The largest JSON we hold in memory. Buffers embedded as base64 count.
const MAX_JSON_BYTES: u64 = 1 << 30;

const GLB_HEADER_BYTES: u64 = 12;
const CHUNK_HEADER_BYTES: u64 = 8;
const JSON_CHUNK: u32 = u32::from_le_bytes(*b"JSON");
pub(crate) const BIN_CHUNK: u32 = u32::from_le_bytes(*b"BIN\0");

/// Where the parts of a glTF file lie.
#[derive(Debug)]
pub(crate) struct Container {
    /// The JSON text, padding included.
    pub(crate) json: Vec<u8>,
    /// The chunks of a GLB in order; empty for a bare JSON file.
    pub(crate) chunks: Vec<ChunkPlace>,
    /// The length a GLB's header gives; the file's own for bare JSON.
    pub(crate) length: u64,
}

/// One chunk of a GLB.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ChunkPlace {
    /// Four characters, little-endian.
    pub(crate) kind: u32,
    /// First byte of its data in the file.
    pub(crate) start: u64,
    /// Bytes of data.
    pub(crate) length: u64,
}

impl Container {
    /// Reads the header and the JSON; the binary chunk stays on disk.
    pub(crate) fn read(source: &mut Source) -> Result<Self> {
        let path = source.path.clone();
        let is_glb = source.head()?.starts_with(b"glTF");
        let (chunks, length) = if is_glb { chunks(source)? } else { (Vec::new(), source.len) };
        let (start, bytes) = match chunks.first() {
            Some(chunk) => (chunk.start, chunk.length),
            None => (0, source.len),
        };
        if bytes > MAX_JSON_BYTES {
            return Err(Error::TooLarge {
                what: format!("{}: JSON", path.display()),
                bytes,
                limit: MAX_JSON_BYTES,
                remedy: "store the scene as .glb".into(),
            });
        }
        let mut json = vec![0; bytes as usize];
        read_at(source, start, &mut json)?;
        Ok(Self { json, chunks, length })
    }

    /// The binary chunk of a GLB.
    pub(crate) fn bin(&self) -> Option<ChunkPlace> {
        self.chunks.iter().copied().find(|chunk| chunk.kind == BIN_CHUNK)
    }
}

/// The chunks of a GLB and the length its header gives.
fn chunks(source: &mut Source) -> Result<(Vec<ChunkPlace>, u64)> {
    let path = source.path.clone();
    let header: [u8; 12] = read_array(source, 0, "header")?;
    let [_, version, length] = words(&header);
    if version != 2 {
        return Err(Error::unsupported(&path, format!("is binary glTF {version}; convert it to glTF 2.0")));
    }
    let length = u64::from(length);
    if length > source.len {
        return Err(truncated(&path, "header", length, source.len));
    }
    let mut chunks = Vec::new();
    let mut at = GLB_HEADER_BYTES;
    while at + CHUNK_HEADER_BYTES <= length {
        let place = format!("chunk {}", chunks.len());
        let head: [u8; 8] = read_array(source, at, &place)?;
        let [bytes, kind] = words(&head);
        let chunk = ChunkPlace { kind, start: at + CHUNK_HEADER_BYTES, length: u64::from(bytes) };
        if chunk.start + chunk.length > length {
            return Err(truncated(&path, &place, chunk.start + chunk.length, length));
        }
        if chunks.is_empty() && kind != JSON_CHUNK {
            return Err(Error::malformed(path, place, "is not JSON, which must come first"));
        }
        at = chunk.start + chunk.length;
        chunks.push(chunk);
        // A file of empty chunks has one every 8 bytes.
        if chunks.len() > 64 {
            return Err(Error::malformed(path, place, "has more than 64 chunks; wants two"));
        }
    }
    if chunks.is_empty() {
        return Err(Error::malformed(path, "chunk 0", "is missing; wants JSON"));
    }
    Ok((chunks, length))
}

fn truncated(path: &Path, place: &str, wants: u64, has: u64) -> Error {
    Error::malformed(path, place, format!("promises {wants} bytes, but only {has} are there: truncated?"))
}

fn read_array<const N: usize>(source: &mut Source, at: u64, place: &str) -> Result<[u8; N]> {
    let mut bytes = [0; N];
    if at + N as u64 > source.len {
        return Err(truncated(&source.path, place, at + N as u64, source.len));
    }
    read_at(source, at, &mut bytes)?;
    Ok(bytes)
}

fn read_at(source: &mut Source, at: u64, bytes: &mut [u8]) -> Result<()> {
    let read = source.file.seek(SeekFrom::Start(at)).and_then(|_| source.file.read_exact(bytes));
    read.map_err(|e| Error::io(&source.path, e))
}

/// Little-endian 32-bit words.
fn words<const N: usize, const W: usize>(bytes: &[u8; N]) -> [u32; W] {
    let (words, _) = bytes.as_chunks::<4>();
    std::array::from_fn(|i| words.get(i).map_or(0, |w| u32::from_le_bytes(*w)))
}
