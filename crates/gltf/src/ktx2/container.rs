//! Writes a KTX2 file: header, index of mip levels, data format descriptor, key-value pairs, codebooks, blocks.

use super::basis::{Basis, Slice};
use super::blocks::{BLOCK, Blocks};
use super::header::{HEADER_BYTES, IDENTIFIER, MODEL_ETC1S, MODEL_UASTC, TRANSFER_SRGB};
use glam::UVec2;
use ruzstd::encoding::{CompressionLevel, compress_to_vec};
use std::borrow::Cow;

/// Bytes of an entry of the index of mip levels, and of one of a picture among the codebooks.
const LEVEL_BYTES: usize = 24;
const IMAGE_BYTES: usize = 20;
/// The colours' primaries: those of sRGB.
const PRIMARIES_BT709: u8 = 1;
/// How blocks are packed: by the codebooks that are global data, or each mip level by zstd.
const SCHEME_BASIS_LZ: u32 = 1;
const SCHEME_ZSTD: u32 = 2;
/// Bytes of a block of UASTC.
const UASTC_BYTES: u32 = 16;

/// Lists numbers of 16, 32 and 64 bits one after the other.
macro_rules! put {
    ($bytes:ident: $($number:expr),* $(,)?) => { $($bytes.extend(($number).to_le_bytes());)* };
}

/// A mip level as it is in the file.
struct Level<'a> {
    bytes: Cow<'a, [u8]>,
    /// Its bytes after zstd is undone; 0 of ETC1S.
    unpacked: u64,
}

/// The file of these blocks.
pub(super) fn bytes(basis: &Basis) -> Vec<u8> {
    let levels = levels(basis);
    let global = global_data(basis);
    let descriptor = descriptor(basis.blocks);
    let pairs = key_value_pairs();
    let descriptor_at = HEADER_BYTES + LEVEL_BYTES * levels.len();
    let pairs_at = descriptor_at + descriptor.len();
    let pairs_end = pairs_at + pairs.len();
    let global_at = if global.is_empty() { 0 } else { pairs_end.next_multiple_of(8) };
    let mut end = pairs_end.max(global_at + global.len());
    // The coarsest is the first in the file. What is packed needs no alignment.
    let mut places = vec![0; levels.len()];
    for (place, level) in places.iter_mut().zip(&levels).rev() {
        *place = end;
        end += level.bytes.len();
    }

    let mut file = Vec::with_capacity(end);
    file.extend(IDENTIFIER);
    let size = basis.slices.first().map_or(UVec2::ZERO, |finest| finest.size);
    let scheme = if basis.blocks == Blocks::Etc1s { SCHEME_BASIS_LZ } else { SCHEME_ZSTD };
    // No Vulkan format; no depth, no layers, one face.
    put!(file: 0u32, 1u32, size.x, size.y, 0u32, 0u32, 1u32, levels.len() as u32, scheme);
    put!(file: descriptor_at as u32, descriptor.len() as u32, pairs_at as u32, pairs.len() as u32);
    put!(file: global_at as u64, global.len() as u64);
    for (level, place) in levels.iter().zip(&places) {
        put!(file: *place as u64, level.bytes.len() as u64, level.unpacked);
    }
    file.extend(&descriptor);
    file.extend(&pairs);
    if !global.is_empty() {
        file.resize(global_at, 0);
        file.extend(&global);
    }
    levels.iter().rev().for_each(|level| file.extend(&*level.bytes));
    file
}

/// The mip levels: ETC1S as it is, UASTC packed by zstd, which saves a third where a texture has even areas
/// (docs/benchmarks/texture.md).
fn levels<'a>(basis: &Basis<'a>) -> Vec<Level<'a>> {
    let level = |slice: &Slice<'a>| match basis.blocks {
        Blocks::Etc1s => Level { bytes: slice.bytes.into(), unpacked: 0 },
        Blocks::Uastc => Level {
            bytes: compress_to_vec(slice.bytes, CompressionLevel::Fastest).into(),
            unpacked: slice.bytes.len() as u64,
        },
    };
    basis.slices.iter().map(level).collect()
}

/// One block of opaque sRGB colours.
fn descriptor(blocks: Blocks) -> Vec<u8> {
    let (model, bits, plane) = match blocks {
        Blocks::Etc1s => (MODEL_ETC1S, 64u8, 0u32),
        Blocks::Uastc => (MODEL_UASTC, 128, UASTC_BYTES),
    };
    let side = (BLOCK - 1) as u8;
    let mut bytes = Vec::new();
    // All bytes; Khronos' basic descriptor, version 2, of 40 bytes.
    put!(bytes: 44u32, 0u32, 2u16, 40u16);
    bytes.extend([model, PRIMARIES_BT709, TRANSFER_SRGB, 0]);
    bytes.extend([side, side, 0, 0]);
    put!(bytes: plane, 0u32);
    // One sample of all channels, from the first bit on, from 0 to the largest number.
    put!(bytes: 0u16);
    bytes.extend([bits - 1, 0]);
    put!(bytes: 0u32, 0u32, u32::MAX);
    bytes
}

/// Which corner is the first, and who wrote it; sorted by key.
fn key_value_pairs() -> Vec<u8> {
    let writer = trisplat_scene::report::generator();
    let mut bytes = Vec::new();
    for (key, value) in [("KTXorientation", "rd"), ("KTXwriter", writer.as_str())] {
        put!(bytes: (key.len() + value.len() + 2) as u32);
        for text in [key, value] {
            bytes.extend(text.as_bytes());
            bytes.push(0);
        }
        bytes.resize(bytes.len().next_multiple_of(4), 0);
    }
    bytes
}

/// The codebooks of ETC1S, and where each mip level's picture is among its blocks: it is all of them.
fn global_data(basis: &Basis) -> Vec<u8> {
    let mut bytes = Vec::new();
    if basis.blocks != Blocks::Etc1s {
        return bytes;
    }
    let [endpoints, selectors] = [&basis.endpoints, &basis.selectors];
    put!(bytes: endpoints.entries, selectors.entries);
    put!(bytes: endpoints.bytes.len() as u32, selectors.bytes.len() as u32, basis.tables.len() as u32, 0u32);
    bytes.reserve(basis.slices.len() * IMAGE_BYTES);
    for slice in &basis.slices {
        put!(bytes: 0u32, 0u32, slice.bytes.len() as u32, 0u32, 0u32);
    }
    for part in [endpoints.bytes, selectors.bytes, basis.tables] {
        bytes.extend(part);
    }
    bytes
}
