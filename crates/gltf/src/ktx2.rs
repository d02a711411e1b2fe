//! KTX2: a picture and its mip levels in blocks that graphics cards read (KHR_texture_basisu).
//!
//! ```text
//! written: Texture ──► encode (the crate basis-universal: a .basis file) ──► basis (takes it apart) ──► container
//! read:    header (always) ──► decode (the crate basisu) ──► Texture
//! ```
//!
//! Encoder and decoder are there with the feature `ktx2`.

#[cfg(feature = "ktx2")]
mod basis;
mod blocks;
#[cfg(feature = "ktx2")]
mod container;
#[cfg(feature = "ktx2")]
mod decode;
#[cfg(feature = "ktx2")]
mod encode;
mod header;

pub(crate) use blocks::{BLOCK, Blocks};
pub(crate) use header::{Header, is_ktx2};

use std::path::Path;
use trisplat_scene::{Limits, Result, Texture};

/// Whether this build encodes and decodes.
pub(crate) const IS_BUILT: bool = cfg!(feature = "ktx2");
/// How to get a program that does.
pub(crate) const REMEDY: &str = "build it with `--features ktx2`";

/// The file of a texture whose sides are multiples of [`BLOCK`], with all its mip levels; the error is the reason why there is none.
#[cfg(feature = "ktx2")]
pub(crate) fn encode(texture: &Texture, blocks: Blocks) -> std::result::Result<Vec<u8>, String> {
    let file = encode::basis(texture, blocks)?;
    Ok(container::bytes(&basis::Basis::read(&file, texture.levels().len())?))
}

/// The texture in a KTX2 file; `place` is for messages.
///
/// Errors: a build without the feature; what is not of these blocks, is broken, or not within `limits`.
#[cfg(feature = "ktx2")]
pub(crate) fn decode(place: &Path, bytes: &[u8], limits: &Limits) -> Result<Texture> {
    decode::texture(place, bytes, limits)
}

#[cfg(not(feature = "ktx2"))]
pub(crate) fn encode(_: &Texture, _: Blocks) -> std::result::Result<Vec<u8>, String> {
    Err(format!("this program writes no KTX2; {REMEDY}"))
}

#[cfg(not(feature = "ktx2"))]
pub(crate) fn decode(place: &Path, bytes: &[u8], _: &Limits) -> Result<Texture> {
    let blocks = Header::read(bytes).map_or("of other blocks", |header| header.blocks.name());
    let reason = format!("its picture is KTX2 ({blocks}), which this program does not decode; {REMEDY}");
    Err(trisplat_scene::Error::unsupported(place, reason))
}
