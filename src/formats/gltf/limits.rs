//! Sizes and counts that files are held to, each stated once for reading and for writing.

const GIB: u64 = 1 << 30;

/// Files above this size are written with a warning.
pub(super) const WARN_BYTES: u64 = GIB;
/// The largest signed 32-bit number: Unity's glTFast, JavaScript buffers and older Godot stop here.
pub(crate) const READABLE_BYTES: u64 = i32::MAX as u64;
/// GLB lengths are unsigned 32-bit numbers.
pub(super) const GLB_BYTES: u64 = u32::MAX as u64;
/// Chunks of a GLB; glTF 2.0 knows two, and a file of empty chunks has one every 8 bytes.
pub(super) const MAX_GLB_CHUNKS: usize = 64;
/// No file unpacks to more than this many times its size. A block of 256 compressed vertices costs at least
/// one byte for every four channels, so meshopt reaches about 1000; a mesh that many nodes show can promise
/// any number.
pub(super) const MAX_UNPACK_RATIO: u64 = 1024;
/// What even the smallest file may unpack to.
pub(super) const FREE_UNPACKED_BYTES: u64 = 16 << 20;
/// Vertices that 16-bit indices can name: 65,535 itself means "restart" to many drawing interfaces.
pub(crate) const MAX_SHORT_VERTICES: u64 = u16::MAX as u64;
