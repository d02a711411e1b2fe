//! EXT_meshopt_compression: the extension of a buffer view, and the decoder of views of any file.
//!
//! The decoders of meshoptimizer tolerate hostile bytes but trust the caller's counts. So counts
//! are limited here to values that an encoder can reach.

use serde::{Deserialize, Serialize};

/// The extension of compressed buffer views.
pub(crate) const MESHOPT: &str = "EXT_meshopt_compression";
/// The later name of [`MESHOPT`].
pub(crate) const MESHOPT_KHR: &str = "KHR_meshopt_compression";
/// Maximum unpacked bytes of a file, as a multiple of its size. A block of 256 compressed vertices
/// costs at least one byte for every four channels, so meshopt reaches about 1000; a mesh that many
/// nodes show can promise any number.
pub(crate) const MAX_UNPACK_RATIO: u64 = 1024;

/// [`MESHOPT`] on a buffer view: the place of its compressed bytes, and their decoded form.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct CompressedView {
    pub(crate) buffer: usize,
    #[serde(default)]
    pub(crate) byte_offset: u64,
    pub(crate) byte_length: u64,
    pub(crate) byte_stride: u64,
    pub(crate) count: u64,
    /// "ATTRIBUTES", "TRIANGLES" or "INDICES".
    pub(crate) mode: String,
    /// "NONE", "EXPONENTIAL" or "COLOR"; filters of other data than positions and colours are not
    /// read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) filter: Option<String>,
}

/// Decoded bytes of a compressed view, or why it cannot be decoded.
pub(crate) fn check(view: &CompressedView) -> Result<u64, String> {
    let bytes = view.count.saturating_mul(view.byte_stride);
    if bytes > MAX_UNPACK_RATIO.saturating_mul(view.byte_length) {
        return Err(format!("promises {bytes} bytes from {} compressed ones", view.byte_length));
    }
    let fits = match view.mode.as_str() {
        "ATTRIBUTES" => view.byte_stride.is_multiple_of(4) && (4..=64).contains(&view.byte_stride),
        "TRIANGLES" => view.count.is_multiple_of(3) && matches!(view.byte_stride, 2 | 4),
        "INDICES" => matches!(view.byte_stride, 2 | 4),
        other => return Err(format!("has the unknown compression mode {other:?}")),
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
    let words = match (view.mode.as_str(), view.byte_stride) {
        ("ATTRIBUTES", stride) => return attributes(view, packed, stride / 4, count),
        ("TRIANGLES", 4) => ::meshopt::decode_index_buffer::<u32>(packed, count),
        ("TRIANGLES", _) => ::meshopt::decode_index_buffer::<u16>(packed, count).map(halves),
        (_, 4) => ::meshopt::decode_index_sequence::<u32>(packed, count),
        _ => ::meshopt::decode_index_sequence::<u16>(packed, count).map(halves),
    };
    // Index decoders write in the machine's order; the bytes of a view are little-endian.
    let words = words.map(|words| words.into_iter().map(u32::to_le).collect());
    words.map_err(|_| "has damaged compressed indices".to_owned())
}

fn attributes(
    view: &CompressedView,
    packed: &[u8],
    words: u64,
    count: usize,
) -> Result<Vec<u32>, String> {
    let filter = view.filter.as_deref().unwrap_or("NONE");
    // Colours have four channels of 8 or 16 bits.
    if !matches!((filter, words), ("NONE" | "EXPONENTIAL", _) | ("COLOR", ..=2)) {
        return Err(format!("has the filter {filter:?}, which is not for positions or colours"));
    }
    /// The decoder takes the size of an element as a type.
    macro_rules! of_words {
        ($($n:literal)*) => {
            match words {
                $($n => vertices::<$n>(packed, count, filter),)*
                _ => Err(format!("has {} bytes per element; expected at most 64", 4 * words)),
            }
        };
    }
    of_words!(1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16)
}

/// Decodes elements of N words; the filter is undone on whole elements.
fn vertices<const N: usize>(packed: &[u8], count: usize, filter: &str) -> Result<Vec<u32>, String>
where
    [u32; N]: Default,
{
    let mut cells: Vec<[u32; N]> = ::meshopt::decode_vertex_buffer(packed, count)
        .map_err(|_| "has damaged compressed vertices".to_owned())?;
    match (filter, N) {
        ("EXPONENTIAL", _) => ::meshopt::decode_filter_exp(&mut cells),
        ("COLOR", 1) => {
            ::meshopt::decode_filter_color::<u8>(bytemuck::cast_slice_mut(cells.as_flattened_mut()))
        }
        ("COLOR", _) => ::meshopt::decode_filter_color::<u16>(bytemuck::cast_slice_mut(
            cells.as_flattened_mut(),
        )),
        _ => {}
    }
    Ok(cells.into_flattened())
}

/// Pairs of 16-bit numbers as words, the first in the low half.
fn halves(numbers: Vec<u16>) -> Vec<u32> {
    let word = |pair: &[u16]| u32::from(pair[0]) | u32::from(*pair.get(1).unwrap_or(&0)) << 16;
    numbers.chunks(2).map(word).collect()
}
