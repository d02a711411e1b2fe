//! PNG files, decoded row by row into 8 bits: memory holds neither the file nor a picture of 16
//! bits. Colour profiles and texts, which unpack to a thousand times their size, are skipped:
//! colours are taken as sRGB anyway.

use super::shrink::AreaAverage;
use crate::error::{Error, Result};
use crate::input::guarded;
use crate::limits::Limits;
use glam::UVec2;
use image::DynamicImage;
use png::{BitDepth, ColorType, DecodingError, InterlaceInfo, Reader, Transformations};
use std::io::{self, BufRead, Read, Seek, SeekFrom};
use std::path::Path;

pub(super) const PNG_START: [u8; 8] = *b"\x89PNG\r\n\x1a\n";

type Decoded<T> = std::result::Result<T, DecodingError>;

/// The size in a file's header; everything before the pixels is checked.
pub(super) fn size(file: impl BufRead + Seek) -> Decoded<UVec2> {
    Ok(UVec2::from(open_reader(file)?.info().size()))
}

/// True when a file has an opacity per pixel or a transparent colour.
pub(super) fn has_alpha(file: impl BufRead + Seek) -> Decoded<bool> {
    let (color, _) = open_reader(file)?.output_color_type();
    Ok(matches!(color, ColorType::GrayscaleAlpha | ColorType::Rgba))
}

/// The picture in 8 bits per channel. Its size has been checked.
pub(super) fn decode(
    path: &Path,
    file: impl BufRead + Seek,
    limits: &Limits,
) -> Result<DynamicImage> {
    let bad = |e| broken(path, e);
    guarded(path, || {
        let mut reader = open_reader(file).map_err(bad)?;
        let size = UVec2::from(reader.info().size());
        let (color, _) = reader.output_color_type();
        let channels = color.samples();
        let stride = size.x as usize * channels;
        let mut pixels: Vec<u8> =
            limits.zeroed(path.display(), stride.saturating_mul(size.y as usize))?;
        let mut rest = &mut pixels[..];
        if reader.info().interlaced {
            each_row(&mut reader, &mut |row, place| {
                if let InterlaceInfo::Adam7(pass) = place {
                    png::expand_interlaced_row(rest, stride, row, pass, 8 * channels as u8);
                }
            })
        } else {
            each_row(&mut reader, &mut |row, _| {
                if let Some((to, below)) = std::mem::take(&mut rest).split_at_mut_checked(row.len())
                {
                    to.copy_from_slice(row);
                    rest = below;
                }
            })
        }
        .map_err(bad)?;
        picture(color, size, pixels)
            .ok_or_else(|| Error::malformed(path, "picture", "has colours of no known kind"))
    })
}

/// The codes of a grey picture as stored, and its size; `None` of colours or opacity. Its size has
/// been checked.
pub(super) fn codes(
    path: &Path,
    file: impl BufRead + Seek,
    limits: &Limits,
) -> Result<Option<(UVec2, Vec<u16>)>> {
    let bad = |e| broken(path, e);
    guarded(path, || {
        let mut reader = open_reader(file).map_err(bad)?;
        let size = UVec2::from(reader.info().size());
        let (color, bits) = reader.output_color_type();
        let bytes = reader.output_buffer_size().unwrap_or(usize::MAX);
        let mut pixels: Vec<u8> = limits.zeroed(path.display(), bytes)?;
        reader.next_frame(&mut pixels).map_err(bad)?;
        let codes = match (color, bits) {
            (ColorType::Grayscale, BitDepth::Sixteen) => {
                pixels.chunks_exact(2).map(|b| u16::from_be_bytes([b[0], b[1]])).collect()
            }
            (ColorType::Grayscale, _) => pixels.into_iter().map(u16::from).collect(),
            (ColorType::Rgb, BitDepth::Eight) => {
                let pixels: &[[u8; 3]] = bytemuck::cast_slice(&pixels);
                if !pixels.iter().all(|[r, g, b]| r == g && g == b) {
                    return Ok(None);
                }
                pixels.iter().map(|pixel| u16::from(pixel[0])).collect()
            }
            _ => return Ok(None),
        };
        Ok(Some((size, codes)))
    })
}

/// A picture of opaque colours or greys, shrunk to `size` while it is read, and its full size;
/// `None` for one that is not larger, is not stored row after row, or that the decoder of whole
/// pictures is to judge.
pub(super) fn reduced(
    path: &Path,
    file: impl BufRead + Seek,
    size: UVec2,
) -> Result<Option<(DynamicImage, UVec2)>> {
    guarded(path, || Ok(shrink(file, size)))
}

fn shrink(file: impl BufRead + Seek, size: UVec2) -> Option<(DynamicImage, UVec2)> {
    let mut reader = open_reader(file).ok()?;
    let full = UVec2::from(reader.info().size());
    let channels = match reader.output_color_type().0 {
        ColorType::Grayscale => 1,
        ColorType::Rgb => 3,
        _ => return None,
    };
    if reader.info().interlaced || !size.cmplt(full).all() || size == UVec2::ZERO {
        return None;
    }
    let mut average = AreaAverage::<3>::new(full, size);
    let mut grey: Vec<[u8; 3]> = Vec::new();
    each_row(&mut reader, &mut |row, _| {
        if channels == 3 {
            average.push(bytemuck::cast_slice(row));
        } else {
            grey.clear();
            grey.extend(row.iter().map(|code| [*code; 3]));
            average.push(&grey);
        }
    })
    .ok()?;
    Some((picture(ColorType::Rgb, size, bytemuck::cast_vec(average.finish()))?, full))
}

/// A decoder at the first pixels; palettes and fewer than 8 bits are expanded.
fn open_reader<R: BufRead + Seek>(file: R) -> Decoded<Reader<R>> {
    let mut decoder = png::Decoder::new(file);
    decoder.set_ignore_iccp_chunk(true);
    decoder.set_ignore_text_chunk(true);
    decoder.set_transformations(Transformations::EXPAND);
    decoder.read_info()
}

/// Every row in 8 bits, in the order of the file, up to the end of the pixels.
fn each_row(
    reader: &mut Reader<impl BufRead + Seek>,
    take: &mut dyn FnMut(&[u8], &InterlaceInfo),
) -> Decoded<()> {
    let is_deep = reader.output_color_type().1 == BitDepth::Sixteen;
    let mut codes = Vec::new();
    while let Some(row) = reader.next_interlaced_row()? {
        if is_deep {
            codes.clear();
            let deep =
                row.data().chunks_exact(2).map(|b| u32::from(u16::from_be_bytes([b[0], b[1]])));
            codes.extend(deep.map(|code| ((code + 128) / 257) as u8));
            take(&codes, row.interlace());
        } else {
            take(row.data(), row.interlace());
        }
    }
    Ok(())
}

fn picture(color: ColorType, size: UVec2, pixels: Vec<u8>) -> Option<DynamicImage> {
    let UVec2 { x, y } = size;
    match color {
        ColorType::Grayscale => image::GrayImage::from_raw(x, y, pixels).map(Into::into),
        ColorType::GrayscaleAlpha => image::GrayAlphaImage::from_raw(x, y, pixels).map(Into::into),
        ColorType::Rgb => image::RgbImage::from_raw(x, y, pixels).map(Into::into),
        ColorType::Rgba => image::RgbaImage::from_raw(x, y, pixels).map(Into::into),
        ColorType::Indexed => None,
    }
}

/// The error of a file that cannot be decoded.
pub(super) fn broken(path: &Path, error: DecodingError) -> Error {
    use std::io::ErrorKind::{InvalidData, UnexpectedEof};
    match error {
        // About the content of the file, not of the system.
        DecodingError::IoError(e) if !matches!(e.kind(), InvalidData | UnexpectedEof) => {
            Error::io(path, e)
        }
        e => Error::malformed(path, "picture", format!("is damaged ({e}); copy it again")),
    }
}

// ---- The palette of a PNG file: its decoder trusts it, so it is checked first -------------------

/// Maximum number of colours of a palette, of 3 bytes each (PNG specification, 11.2.2).
const MAX_COLORS: u32 = 256;

/// # Errors
///
/// A palette that is not of 1 to 256 whole colours. Checks the chunks up to the first pixels; other
/// formats have no palette.
pub(super) fn check(path: &Path, file: &mut (impl Read + Seek)) -> Result<()> {
    match bad_palette(file).map_err(|e| Error::io(path, e))? {
        None => Ok(()),
        Some((at, bytes)) => {
            let reason =
                format!("{bytes} bytes are no palette of 1 to {MAX_COLORS} colours; copy it again");
            Err(Error::malformed(path, format!("PLTE chunk at byte {at}"), reason))
        }
    }
}

/// Place and length of the first invalid palette, bytes.
fn bad_palette(file: &mut (impl Read + Seek)) -> io::Result<Option<(u64, u32)>> {
    let mut head = [0; 8];
    let mut at = PNG_START.len() as u64;
    if !read(file, &mut head)? || head != PNG_START {
        return Ok(None);
    }
    // The decoder refuses a file that ends here.
    while read(file, &mut head)? {
        let [a, b, c, d, name @ ..] = head;
        let len = u32::from_be_bytes([a, b, c, d]);
        match &name {
            b"PLTE" if !len.is_multiple_of(3) || !(3..=3 * MAX_COLORS).contains(&len) => {
                return Ok(Some((at, len)));
            }
            b"IDAT" => break,
            _ => {}
        }
        // Name, length and checksum.
        at += 12 + u64::from(len);
        file.seek(SeekFrom::Start(at))?;
    }
    Ok(None)
}

/// False at the end of the file.
fn read(file: &mut impl Read, bytes: &mut [u8; 8]) -> io::Result<bool> {
    match file.read_exact(bytes) {
        Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => Ok(false),
        read => read.map(|()| true),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::RgbImage;
    use image::{GenericImageView, ImageBuffer, ImageFormat, Rgba};
    use std::io::Cursor;

    /// A picture of many colours, some of them between two codes of 8 bits.
    fn deep(size: UVec2) -> DynamicImage {
        let pixel = |x: u32, y: u32| {
            Rgba([x * 997, y * 1013, (x + y) * 691, 65_535 - x * y].map(|c| c as u16))
        };
        ImageBuffer::from_fn(size.x, size.y, pixel).into()
    }

    fn encoded(picture: &DynamicImage) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        picture.write_to(&mut bytes, ImageFormat::Png).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn a_png_of_16_bits_is_read_row_by_row() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let size = UVec2::new(61, 43);
        let deep = deep(size);
        let kinds: [DynamicImage; 8] = [
            deep.to_luma8().into(),
            deep.to_luma_alpha8().into(),
            deep.to_rgb8().into(),
            deep.to_rgba8().into(),
            deep.to_luma16().into(),
            deep.to_luma_alpha16().into(),
            deep.to_rgb16().into(),
            deep,
        ];
        for picture in kinds {
            let bytes = encoded(&picture);
            std::fs::write(&path, &bytes).unwrap();
            // As the decoder of whole pictures reads it.
            let whole = image::load_from_memory(&bytes).unwrap();
            let read = decode(&path, Cursor::new(&bytes), &Limits::DEFAULT).unwrap();
            assert_eq!(read.to_rgba8(), whole.to_rgba8(), "{:?}", picture.color());
            assert_eq!(has_alpha(Cursor::new(&bytes)).unwrap(), picture.color().has_alpha());
            // Smaller, too.
            let wanted = UVec2::new(20, 14);
            let (small, full) = RgbImage::load_reduced(&path, wanted, &Limits::DEFAULT).unwrap();
            let whole = RgbImage::load(&path).unwrap();
            let wants = if picture.color().has_alpha() { whole } else { whole.downscaled(wanted) };
            assert_eq!((small, full), (wants, size), "{:?}", picture.color());
        }
    }

    #[test]
    fn an_interlaced_png_is_put_together() {
        // 9 x 9 px, RGB of 16 bits.
        let text = "iVBORw0KGgoAAAANSUhEUgAAAAkAAAAJEAIAAAFIZH2SAAABb0lEQVR42kVQsWqCMRD+KS0EoXAgQiHLP0hBnAQJulXo4OCUpRkKhk4ZDBSnjo\
                    VSyOgqdHDIKDSDQ4ZC7hEcJZOP4AN0aO5XaOCO3H139913VdW8jNX/J2PG76qyuslYnfHpvTrHVlvdL7DVJSUC4R6aMhGs7hw9WD3ZlCBjHz1k\
                    /HhoMDIRWierRaAqEep9RhH6eJkggod6b7WHycaDh5fXXPpLN1c0XTLyLpJPpiHkSoSbN8lEAOOiCFwlI8L9tABWt06SWV3vXSTGZKyerQrgAY\
                    xkHgYjFz1IloyH5aEAGTtHyTJONi6SumQyruuGhYyrqx9iID6u2NBqrlonF7m63XrgCkwyXLW7GbnqHC/7ciUZG4ogGZFKdvdltWS0k2S9a6If\
                    jFJBxouMkpWrnQVy5eLtVgSaLpmLvWurSZ+LLj4+e6D2VBTPdxlJ3uUiJL/dJa33UyoYL0jFbOViMvOdh2SWh1TW/PzNmMy6/gMCCbAyVgZpIQ\
                    AAAABJRU5ErkJggg==";
        let bytes =
            base64::Engine::decode(&base64::engine::general_purpose::STANDARD, text).unwrap();
        let whole = image::load_from_memory(&bytes).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(whole.dimensions(), (9, 9));
        let read = RgbImage::load(&path).unwrap();
        assert_eq!(read.rgb.as_flattened(), whole.to_rgb8().as_raw().as_slice());
        let (same, full) =
            RgbImage::load_reduced(&path, UVec2::new(3, 3), &Limits::DEFAULT).unwrap();
        assert_eq!((same, full), (read, UVec2::new(9, 9)), "its rows do not come in order");
    }
}
