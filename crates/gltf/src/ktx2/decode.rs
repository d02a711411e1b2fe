//! A KTX2 file becomes a picture, by the decoder `basisu`.

use super::header::Header;
use basisu::{DecodeFlags, TargetFormat, Transcoder};
use glam::UVec2;
use std::path::Path;
use trisplat_scene::guard::guarded;
use trisplat_scene::image::RgbImage;
use trisplat_scene::{Error, Limits, Result, StoredPicture, Texture};

/// The finest level of the file; its other levels are made anew. Alpha is not used.
pub(super) fn texture(place: &Path, bytes: &[u8], limits: &Limits) -> Result<Texture> {
    let broken = |reason: String| Error::malformed(place, "picture", reason);
    let header = Header::read(bytes).map_err(broken)?;
    limits.picture(place.display(), header.size)?;
    // The decoder allocates what the file says.
    if !header.is_unpacked_as_expected() {
        return Err(broken(
            "is KTX2 whose finest level has another size than it says; write it again".to_owned(),
        ));
    }
    let texels = guarded(place, || {
        let failed = |error| broken(format!("is KTX2 that cannot be decoded ({error:?}); write it again"));
        let file = Transcoder::new(bytes).map_err(failed)?;
        file.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE).map_err(failed)
    })?;
    let (rgba, _) = texels.as_chunks::<4>();
    let UVec2 { x, y } = header.size;
    if rgba.len() as u64 != u64::from(x) * u64::from(y) {
        return Err(broken(format!("has {} texels instead of {x}x{y}", rgba.len())));
    }
    let rgb = rgba.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect();
    let format = format!("KTX2, {}", header.blocks.name());
    let stored = StoredPicture { format, bytes: bytes.len() as u64 };
    Ok(Texture::new(RgbImage { size: header.size, rgb, alpha: None }).stored_as(stored))
}
