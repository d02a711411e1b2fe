//! Writes a KTX2 file: header, index of mip levels, data format descriptor, key-value pairs, codebooks, blocks.

use super::basis::Basis;
use super::header::{HEADER_BYTES, IDENTIFIER, MODEL_ETC1S, MODEL_UASTC, TRANSFER_SRGB};
use super::{BLOCK, Blocks};

/// Bytes of an entry of the index of mip levels, and of one of a picture among the codebooks.
const LEVEL_BYTES: usize = 24;
const IMAGE_BYTES: usize = 20;
/// The colours' primaries: those of sRGB.
const PRIMARIES_BT709: u8 = 1;
/// The scheme whose codebooks are global data.
const SCHEME_BASIS_LZ: u32 = 1;
/// Uncompressed blocks of 16 bytes begin at multiples of it.
const UASTC_BYTES: usize = 16;

/// Lists numbers of 16, 32 and 64 bits one after the other.
macro_rules! put {
    ($bytes:ident: $($number:expr),* $(,)?) => { $($bytes.extend(($number).to_le_bytes());)* };
}

/// The file of these blocks.
pub(super) fn bytes(basis: &Basis) -> Vec<u8> {
    let global = global_data(basis);
    let descriptor = descriptor(basis.blocks);
    let pairs = key_value_pairs();
    let levels = basis.slices.len();
    let descriptor_at = HEADER_BYTES + LEVEL_BYTES * levels;
    let pairs_at = descriptor_at + descriptor.len();
    let pairs_end = pairs_at + pairs.len();
    let global_at = if global.is_empty() { 0 } else { pairs_end.next_multiple_of(8) };
    let blocks_at = pairs_end.max(global_at + global.len());
    let (places, end) = places(basis, blocks_at);

    let mut file = Vec::with_capacity(end);
    file.extend(IDENTIFIER);
    let size = basis.slices.first().map_or(glam::UVec2::ZERO, |finest| finest.size);
    let scheme = if basis.blocks == Blocks::Etc1s { SCHEME_BASIS_LZ } else { 0 };
    // No Vulkan format; no depth, no layers, one face.
    put!(file: 0u32, 1u32, size.x, size.y, 0u32, 0u32, 1u32, levels as u32, scheme);
    put!(file: descriptor_at as u32, descriptor.len() as u32, pairs_at as u32, pairs.len() as u32);
    put!(file: global_at as u64, global.len() as u64);
    for (slice, place) in basis.slices.iter().zip(&places) {
        let bytes = slice.bytes.len() as u64;
        let unpacked = if basis.blocks == Blocks::Etc1s { 0 } else { bytes };
        put!(file: *place as u64, bytes, unpacked);
    }
    file.extend(&descriptor);
    file.extend(&pairs);
    if !global.is_empty() {
        file.resize(global_at, 0);
        file.extend(&global);
    }
    for (slice, place) in basis.slices.iter().zip(&places).rev() {
        file.resize(*place, 0);
        file.extend(slice.bytes);
    }
    file
}

/// Where each mip level's blocks are, the coarsest first in the file, and where the file ends.
fn places(basis: &Basis, start: usize) -> (Vec<usize>, usize) {
    let multiple = if basis.blocks == Blocks::Uastc { UASTC_BYTES } else { 1 };
    let (mut places, mut at) = (vec![0; basis.slices.len()], start);
    for (place, slice) in places.iter_mut().zip(&basis.slices).rev() {
        *place = at.next_multiple_of(multiple);
        at = *place + slice.bytes.len();
    }
    (places, at)
}

/// One block of opaque sRGB colours.
fn descriptor(blocks: Blocks) -> Vec<u8> {
    let (model, bits, plane) = match blocks {
        Blocks::Etc1s => (MODEL_ETC1S, 64u8, 0u32),
        Blocks::Uastc => (MODEL_UASTC, 128, UASTC_BYTES as u32),
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
