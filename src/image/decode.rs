//! Pictures as files: what they claim is checked before anything is allocated for it.

use super::palette;
use crate::error::{Error, Result};
use crate::guard::guarded;
use crate::input;
use crate::limits::Limits;
use glam::UVec2;
use std::io::{BufRead, Cursor, Read, Seek, SeekFrom};
use std::path::Path;

/// Decodes a picture; its first bytes decide the format, not its name. What they claim is checked before anything is
/// allocated for it.
pub(super) fn decode(path: &Path, limits: &Limits) -> Result<image::DynamicImage> {
    decode_bytes(path, &input::read(path, limits)?, limits)
}

/// The same of bytes that are in memory; `path` is for messages.
pub(super) fn decode_bytes(path: &Path, bytes: &[u8], limits: &Limits) -> Result<image::DynamicImage> {
    if bytes.starts_with(&JPEG_START) && !jpeg_is_whole(bytes) {
        // The decoder would fill the rest with grey and say nothing.
        return Err(Error::malformed(path, "picture", "the JPEG is cut short; copy it again"));
    }
    header_size(path, Cursor::new(bytes), bytes.len() as u64, limits)?;
    guarded(path, || {
        let reader = image::ImageReader::new(Cursor::new(bytes)).with_guessed_format();
        let mut reader = reader.map_err(|e| Error::io(path, e))?;
        let mut held = image::Limits::no_limits();
        held.max_alloc = Some(limits.array_bytes);
        reader.limits(held);
        reader.decode().map_err(|e| broken(path, e))
    })
}

/// Decodes a picture at 1/2, 1/4 or 1/8 of its size where its format can and no side gets smaller than that of `least`; whole otherwise.
/// Returns its full size too.
pub(super) fn decode_reduced(
    path: &Path,
    least: UVec2,
    limits: &Limits,
) -> Result<(image::DynamicImage, UVec2)> {
    let bytes = input::read(path, limits)?;
    if bytes.starts_with(&JPEG_START) {
        let full = header_size(path, Cursor::new(&bytes), bytes.len() as u64, limits)?;
        // Sides that are no multiples would have a part of a pixel at their end.
        let fits = |part: &u32| (least * *part).cmple(full).all() && full % *part == UVec2::ZERO;
        if let Some(part) = [8, 4, 2].into_iter().find(fits)
            && let Some(small) = reduced_jpeg(path, &bytes, full / part)?
        {
            return Ok((small, full));
        }
    }
    let whole = decode_bytes(path, &bytes, limits)?;
    let full = UVec2::new(whole.width(), whole.height());
    Ok((whole, full))
}

/// A JPEG of colours or greys, reduced to `wanted`; `None` of another kind, or one that the whole decoder is to judge.
fn reduced_jpeg(path: &Path, bytes: &[u8], wanted: UVec2) -> Result<Option<image::DynamicImage>> {
    if !jpeg_is_whole(bytes) {
        return Ok(None);
    }
    guarded(path, || {
        let mut decoder = jpeg_decoder::Decoder::new(bytes);
        let side = |length: u32| u16::try_from(length).unwrap_or(u16::MAX);
        let size = decoder.scale(side(wanted.x), side(wanted.y));
        let UVec2 { x: width, y: height } = wanted;
        if !size.is_ok_and(|(x, y)| (u32::from(x), u32::from(y)) == (width, height)) {
            return Ok(None);
        }
        let format = decoder.info().map(|info| info.pixel_format);
        let Ok(pixels) = decoder.decode() else { return Ok(None) };
        Ok(match format {
            Some(jpeg_decoder::PixelFormat::RGB24) => {
                image::RgbImage::from_raw(width, height, pixels).map(Into::into)
            }
            Some(jpeg_decoder::PixelFormat::L8) => {
                image::GrayImage::from_raw(width, height, pixels).map(Into::into)
            }
            _ => None,
        })
    })
}

/// The size that the first bytes of a picture of `len` bytes claim, once it is known that it may be so.
pub(super) fn header_size(
    path: &Path,
    mut file: impl BufRead + Seek,
    len: u64,
    limits: &Limits,
) -> Result<UVec2> {
    palette::check(path, &mut file)?;
    file.rewind().map_err(|e| Error::io(path, e))?;
    let (format, (width, height)) = guarded(path, || {
        let reader = image::ImageReader::new(file).with_guessed_format().map_err(|e| Error::io(path, e))?;
        let format = reader.format();
        reader.into_dimensions().map(|size| (format, size)).map_err(|e| broken(path, e))
    })?;
    let malformed = |reason: String| Err(Error::malformed(path, "picture header", reason));
    if width == 0 || height == 0 {
        return malformed(format!("its size is {width}x{height}"));
    }
    limits.picture(path.display(), UVec2::new(width, height))?;
    let pixels = u64::from(width) * u64::from(height);
    if pixels > len.saturating_mul(most_pixels_per_byte(format)) {
        return malformed(format!(
            "claims {width}x{height} px, which {len} bytes cannot hold; copy it again"
        ));
    }
    Ok(UVec2::new(width, height))
}

/// True when the first bytes of a picture promise an opacity per pixel.
pub(super) fn has_alpha(path: &Path, mut file: impl BufRead + Seek) -> Result<bool> {
    use image::ImageDecoder;
    let start = file.fill_buf().map_err(|e| Error::io(path, e))?;
    // Data sets of many photos are of this kind, and it has none.
    if start.starts_with(&JPEG_START) {
        return Ok(false);
    }
    let reader = image::ImageReader::new(file).with_guessed_format().map_err(|e| Error::io(path, e))?;
    let decoder = reader.into_decoder().map_err(|e| broken(path, e))?;
    Ok(decoder.color_type().has_alpha())
}

/// Pixels that a byte of a file can stand for at most.
///
/// Deflate reaches 1032 bytes per byte (zlib's technical details), and a PNG has one bit per pixel at least. A JPEG spends
/// a bit on the mean of every block of 8x8 pixels. WebP can say "all of it is grey" in a few bytes.
fn most_pixels_per_byte(format: Option<image::ImageFormat>) -> u64 {
    match format {
        Some(image::ImageFormat::Png) => 1032 * 8,
        Some(image::ImageFormat::Jpeg) => 64 * 8,
        _ => u64::MAX,
    }
}

const JPEG_START: [u8; 2] = [0xff, 0xd8];
const JPEG_END: [u8; 2] = [0xff, 0xd9];
/// What every PNG ends with: an empty chunk and its checksum.
pub(super) const PNG_END: &[u8; 12] = b"\0\0\0\0IEND\xaeB\x60\x82";

/// False when a file's last bytes, or for WebP its stated length, give reason to look closer.
pub(super) fn ends_well(file: &mut std::fs::File) -> std::io::Result<bool> {
    let len = file.metadata()?.len();
    let (mut head, mut tail) = (Vec::new(), Vec::new());
    (&mut *file).take(8).read_to_end(&mut head)?;
    file.seek(SeekFrom::Start(len.saturating_sub(PNG_END.len() as u64)))?;
    file.read_to_end(&mut tail)?;
    let riff = match head[..] {
        [b'R', b'I', b'F', b'F', a, b, c, d] => u64::from(u32::from_le_bytes([a, b, c, d])) + 8 == len,
        _ => false,
    };
    Ok(riff || tail.ends_with(&JPEG_END) || tail.ends_with(PNG_END))
}

/// Walks the segments of a JPEG file up to its end marker; what cameras append behind it does not count.
fn jpeg_is_whole(bytes: &[u8]) -> bool {
    let mut at = JPEG_START.len();
    loop {
        // Entropy-coded bytes and padding; 0xff 0x00 and restarts belong to them.
        let Some(skip) = bytes.get(at..).and_then(|rest| {
            rest.windows(2).position(|w| w[0] == 0xff && !matches!(w[1], 0x00 | 0xd0..=0xd7 | 0xff))
        }) else {
            return false;
        };
        at += skip;
        match bytes.get(at..at + 4) {
            _ if bytes.get(at..at + 2) == Some(&JPEG_END) => return true,
            Some(&[_, 0x01 | 0xd8, ..]) => at += 2,
            Some(&[_, _, high, low]) => at += 2 + usize::from(u16::from_be_bytes([high, low])).max(2),
            _ => return false,
        }
    }
}

fn broken(path: &Path, error: image::ImageError) -> Error {
    use std::io::ErrorKind::{InvalidData, UnexpectedEof};
    match error {
        // Said by the decoder, not by the system: about what is in the file.
        image::ImageError::IoError(e) if matches!(e.kind(), InvalidData | UnexpectedEof) => {
            Error::malformed(path, "picture", format!("is damaged ({e}); copy it again"))
        }
        image::ImageError::IoError(e) => Error::io(path, e),
        image::ImageError::Unsupported(e) => {
            Error::unsupported(path, format!("{e}; convert it to PNG, JPEG, WebP or TIFF"))
        }
        other => Error::malformed(path, "picture", other.to_string()),
    }
}
