//! EXT_meshopt_compression: encodes the streams of all parts, and decodes views of any file.
//!
//! The decoders of meshoptimizer tolerate hostile bytes but trust the caller's counts. So counts are limited
//! here to values that an encoder can reach.

use super::document::MAX_UNPACK_RATIO;
use super::document::{CompressedView, CompressionMode, Filter};
use super::encode;
use super::options::GltfOptions;
use super::part::{ScenePart, Stream, all_streams};
use trisplat_scene::parallel;

/// EXT_meshopt_compression knows vertex codec version 0 only; the crate's own default is 1.
const VERTEX_CODEC: i32 = 0;

// ---- written -------------------------------------------------------------------------------------

/// The compressed streams in file order. At most one per thread is uncompressed at a time.
///
/// # Errors
/// Failures of the encoder, with the remedy.
pub(crate) fn compress(parts: &[ScenePart], options: &GltfOptions) -> Result<Vec<Vec<u8>>, String> {
    let streams: Vec<(&ScenePart, Stream)> = all_streams(parts).collect();
    let written = parallel::map(streams, |_, (part, stream)| {
        let encoded = match stream {
            Stream::Positions | Stream::Normals | Stream::Colors | Stream::TexCoords => {
                let bytes = encode::bytes(part, stream, options);
                encode_vertices(&bytes, part.stride(stream, options))
            }
            Stream::Indices => {
                let corners = 3 * part.faces.start..3 * part.faces.end;
                let local: Vec<u32> =
                    part.mesh.indices[corners].iter().map(|&v| part.local(v) as u32).collect();
                ::meshopt::encode_index_buffer(&local, part.vertex_count()).map_err(|e| e.to_string())
            }
        };
        match encoded {
            Ok(bytes) if !bytes.is_empty() => Ok(bytes),
            Ok(_) => Err(refused(part, "no bytes came out")),
            Err(e) => Err(refused(part, &e)),
        }
    });
    written.into_iter().collect()
}

fn encode_vertices(bytes: &[u8], stride: u64) -> Result<Vec<u8>, String> {
    fn cells<const N: usize>(bytes: &[u8]) -> Result<Vec<u8>, String> {
        let (cells, _) = bytes.as_chunks::<N>();
        ::meshopt::encode_vertex_buffer_level(cells, 0, Some(VERTEX_CODEC)).map_err(|e| e.to_string())
    }
    match stride {
        4 => cells::<4>(bytes),
        8 => cells::<8>(bytes),
        12 => cells::<12>(bytes),
        16 => cells::<16>(bytes),
        _ => Err(format!("no element has {stride} bytes")),
    }
}

fn refused(part: &ScenePart, why: &str) -> String {
    format!("meshopt could not encode {}: {why}; write without compression", part.name)
}

// ---- read ----------------------------------------------------------------------------------------

/// Decoded bytes of a compressed view, or why it cannot be decoded.
pub(crate) fn check(view: &CompressedView) -> Result<u64, String> {
    let bytes = view.count.saturating_mul(view.byte_stride);
    if bytes > MAX_UNPACK_RATIO.saturating_mul(view.byte_length) {
        return Err(format!("promises {bytes} bytes from {} compressed ones", view.byte_length));
    }
    let fits = match view.mode()? {
        CompressionMode::Attributes => {
            view.byte_stride.is_multiple_of(4) && (4..=64).contains(&view.byte_stride)
        }
        CompressionMode::Triangles => view.count.is_multiple_of(3) && matches!(view.byte_stride, 2 | 4),
        CompressionMode::Indices => matches!(view.byte_stride, 2 | 4),
    };
    if !fits {
        return Err(format!(
            "has {} elements of {} bytes, which mode {} cannot hold",
            view.count, view.byte_stride, view.mode
        ));
    }
    Ok(bytes)
}

/// The view's bytes as little-endian words; the last may be half used. [`check`] must have passed.
pub(crate) fn decode(view: &CompressedView, packed: &[u8]) -> Result<Vec<u32>, String> {
    let count = view.count as usize;
    let words = match (view.mode()?, view.byte_stride) {
        (CompressionMode::Attributes, stride) => return attributes(view, packed, stride / 4, count),
        (CompressionMode::Triangles, 4) => ::meshopt::decode_index_buffer::<u32>(packed, count),
        (CompressionMode::Triangles, _) => ::meshopt::decode_index_buffer::<u16>(packed, count).map(halves),
        (CompressionMode::Indices, 4) => ::meshopt::decode_index_sequence::<u32>(packed, count),
        (CompressionMode::Indices, _) => ::meshopt::decode_index_sequence::<u16>(packed, count).map(halves),
    };
    // Index decoders write in the machine's order; the bytes of a view are little-endian.
    let words = words.map(|words| words.into_iter().map(u32::to_le).collect());
    words.map_err(|_| "has damaged compressed indices".to_owned())
}

fn attributes(view: &CompressedView, packed: &[u8], words: u64, count: usize) -> Result<Vec<u32>, String> {
    // Colours have four channels of 8 or 16 bits.
    let filter = view.filter().filter(|filter| *filter != Filter::Color || words <= 2).ok_or_else(|| {
        let name = view.filter.as_deref().unwrap_or_default();
        format!("has the filter {name:?}, which is not for positions or colours")
    })?;
    match words {
        1 => vertices::<1>(packed, count, filter),
        2 => vertices::<2>(packed, count, filter),
        3 => vertices::<3>(packed, count, filter),
        4 => vertices::<4>(packed, count, filter),
        5 => vertices::<5>(packed, count, filter),
        6 => vertices::<6>(packed, count, filter),
        7 => vertices::<7>(packed, count, filter),
        8 => vertices::<8>(packed, count, filter),
        9 => vertices::<9>(packed, count, filter),
        10 => vertices::<10>(packed, count, filter),
        11 => vertices::<11>(packed, count, filter),
        12 => vertices::<12>(packed, count, filter),
        13 => vertices::<13>(packed, count, filter),
        14 => vertices::<14>(packed, count, filter),
        15 => vertices::<15>(packed, count, filter),
        16 => vertices::<16>(packed, count, filter),
        _ => Err(format!("has {} bytes per element; expected at most 64", 4 * words)),
    }
}

/// Decodes elements of N words; the filter is undone on whole elements.
fn vertices<const N: usize>(packed: &[u8], count: usize, filter: Filter) -> Result<Vec<u32>, String>
where
    [u32; N]: Default,
{
    let mut cells: Vec<[u32; N]> = ::meshopt::decode_vertex_buffer(packed, count)
        .map_err(|_| "has damaged compressed vertices".to_owned())?;
    match (filter, N) {
        (Filter::None, _) => {}
        (Filter::Exponential, _) => ::meshopt::decode_filter_exp(&mut cells),
        (Filter::Color, 1) => {
            ::meshopt::decode_filter_color::<u8>(bytemuck::cast_slice_mut(cells.as_flattened_mut()))
        }
        (Filter::Color, _) => {
            ::meshopt::decode_filter_color::<u16>(bytemuck::cast_slice_mut(cells.as_flattened_mut()))
        }
    }
    Ok(cells.into_flattened())
}

/// Pairs of 16-bit numbers as words, the first in the low half.
fn halves(numbers: Vec<u16>) -> Vec<u32> {
    let word = |pair: &[u16]| u32::from(pair[0]) | u32::from(*pair.get(1).unwrap_or(&0)) << 16;
    numbers.chunks(2).map(word).collect()
}
