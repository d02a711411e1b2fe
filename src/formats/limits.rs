//! How much a reader takes.

/// The most triangles a reader takes: ten times the largest scene in the literature. A file that
/// promises more is refused before anything is allocated for it.
pub const MAX_TRIANGLES: u64 = 1 << 26;

/// The most corners of one face: cutting a polygon may cost up to the cube of its corners.
pub const MAX_CORNERS: usize = 1 << 12;
