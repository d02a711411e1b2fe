//! Limits on sizes and counts of files, shared by reading and writing.

const GIB: u64 = 1 << 30;

/// Files above this size are written with a warning.
pub(crate) const WARN_BYTES: u64 = GIB;
/// The largest signed 32-bit number: Unity's glTFast, JavaScript buffers and older Godot stop here.
pub(crate) const READABLE_BYTES: u64 = i32::MAX as u64;
/// GLB lengths are unsigned 32-bit numbers.
pub(crate) const GLB_BYTES: u64 = u32::MAX as u64;
/// Chunks of a GLB; glTF 2.0 knows two, and a file of empty chunks has one every 8 bytes.
pub(crate) const MAX_GLB_CHUNKS: usize = 64;
/// Most unpacked bytes of a file, as a multiple of its size. A block of 256 compressed vertices costs at
/// least one byte for every four channels, so meshopt reaches about 1000; a mesh that many nodes show can
/// promise any number.
pub(crate) const MAX_UNPACK_RATIO: u64 = 1024;
/// Permitted unpacked bytes for the smallest files.
pub(crate) const FREE_UNPACKED_BYTES: u64 = 16 << 20;
/// Most vertices for 16-bit indices: 65,535 itself means "restart" in many graphics APIs.
pub(crate) const MAX_SHORT_VERTICES: u64 = u16::MAX as u64;
