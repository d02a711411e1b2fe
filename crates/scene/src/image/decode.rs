//! Decodes picture files; their stated sizes are checked before memory is allocated.

use super::png::{self, PNG_START};
use crate::error::{Error, Result};
use crate::input::{self, guarded};
use crate::limits::Limits;
use glam::UVec2;
use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::Path;

/// Decodes a picture; its first bytes decide the format, not its name. Its stated size is checked
/// before memory is allocated.
pub(super) fn decode(path: &Path, limits: &Limits) -> Result<image::DynamicImage> {
    OpenPicture::new(path, limits)?.decode(path, limits)
}

/// The same for bytes in memory; `path` is for messages.
pub(super) fn decode_bytes(
    path: &Path,
    bytes: &[u8],
    limits: &Limits,
) -> Result<image::DynamicImage> {
    if bytes.starts_with(&JPEG_START) && !is_whole(bytes) {
        // The decoder would silently fill the rest with grey.
        return Err(Error::malformed(path, "picture", "the JPEG is cut short; copy it again"));
    }
    decode_from(path, Cursor::new(bytes), bytes.len() as u64, limits)
}

/// A picture file at byte 0.
pub(super) struct OpenPicture {
    file: BufReader<File>,
    len: u64,
    /// Its first bytes.
    start: Vec<u8>,
}

impl OpenPicture {
    pub(super) fn new(path: &Path, limits: &Limits) -> Result<Self> {
        let (file, len) = input::open(path, limits)?;
        limits.document(path.display(), len)?;
        let mut file = BufReader::new(file);
        let start = file.fill_buf().map_err(|e| Error::io(path, e))?;
        let start = start[..start.len().min(PNG_START.len())].to_vec();
        Ok(Self { file, len, start })
    }

    /// True for a JPEG file.
    pub(super) fn is_jpeg(&self) -> bool {
        self.start.starts_with(&JPEG_START)
    }

    /// Only the decoder of JPEG needs the file in memory.
    pub(super) fn decode(self, path: &Path, limits: &Limits) -> Result<image::DynamicImage> {
        if self.is_jpeg() {
            return decode_bytes(path, &self.bytes(path, limits)?, limits);
        }
        decode_from(path, self.file, self.len, limits)
    }

    fn bytes(self, path: &Path, limits: &Limits) -> Result<Vec<u8>> {
        input::read_all(path, self.file, self.len, limits.document_bytes, limits)
    }
}

/// A picture of `len` bytes; of WebP and TIFF the decoders hold the whole picture, but not the
/// file.
fn decode_from(
    path: &Path,
    mut file: impl BufRead + Seek,
    len: u64,
    limits: &Limits,
) -> Result<image::DynamicImage> {
    let io = |e| Error::io(path, e);
    let is_png = file.fill_buf().map_err(io)?.starts_with(&PNG_START);
    header_size(path, &mut file, len, limits)?;
    file.rewind().map_err(io)?;
    if is_png {
        return png::decode(path, file, limits);
    }
    guarded(path, || {
        let mut reader = image::ImageReader::new(file).with_guessed_format().map_err(io)?;
        let mut decoder_limits = image::Limits::no_limits();
        decoder_limits.max_alloc = Some(limits.array_bytes);
        reader.limits(decoder_limits);
        reader.decode().map_err(|e| broken(path, e))
    })
}

/// Decodes a picture smaller if its format supports it and no side falls below `min_size`: a
/// JPEG at 1/2, 1/4 or 1/8, an opaque PNG at `min_size`; otherwise in full. Returns its full size
/// too.
pub(super) fn decode_reduced(
    path: &Path,
    min_size: UVec2,
    limits: &Limits,
) -> Result<(image::DynamicImage, UVec2)> {
    let io = |e| Error::io(path, e);
    let mut opened = OpenPicture::new(path, limits)?;
    if opened.is_jpeg() {
        let bytes = opened.bytes(path, limits)?;
        let full = header_size(path, Cursor::new(&bytes), bytes.len() as u64, limits)?;
        // Sides that are not multiples would end with a fraction of a pixel.
        let fits = |part: &u32| (min_size * *part).cmple(full).all() && full % *part == UVec2::ZERO;
        if let Some(part) = [8, 4, 2].into_iter().find(fits)
            && let Some(small) = reduced(path, &bytes, full / part)?
        {
            return Ok((small, full));
        }
        return Ok((decode_bytes(path, &bytes, limits)?, full));
    }
    if opened.start.starts_with(&PNG_START) {
        header_size(path, &mut opened.file, opened.len, limits)?;
        opened.file.rewind().map_err(io)?;
        if let Some(small) = png::reduced(path, &mut opened.file, min_size)? {
            return Ok(small);
        }
        opened.file.rewind().map_err(io)?;
    }
    let whole = opened.decode(path, limits)?;
    let full = UVec2::new(whole.width(), whole.height());
    Ok((whole, full))
}

/// The size in the first bytes of a picture of `len` bytes, checked for plausibility.
pub(super) fn header_size(
    path: &Path,
    mut file: impl BufRead + Seek,
    len: u64,
    limits: &Limits,
) -> Result<UVec2> {
    png::check(path, &mut file)?;
    file.rewind().map_err(|e| Error::io(path, e))?;
    let is_png = file.fill_buf().map_err(|e| Error::io(path, e))?.starts_with(&PNG_START);
    let (format, (width, height)) = guarded(path, || {
        if is_png {
            let UVec2 { x, y } = png::size(file).map_err(|e| png::broken(path, e))?;
            return Ok((Some(image::ImageFormat::Png), (x, y)));
        }
        let reader =
            image::ImageReader::new(file).with_guessed_format().map_err(|e| Error::io(path, e))?;
        let format = reader.format();
        reader.into_dimensions().map(|size| (format, size)).map_err(|e| broken(path, e))
    })?;
    let malformed = |reason: String| Err(Error::malformed(path, "picture header", reason));
    if width == 0 || height == 0 {
        return malformed(format!("its size is {width}x{height}"));
    }
    limits.picture(path.display(), UVec2::new(width, height))?;
    let pixels = u64::from(width) * u64::from(height);
    if pixels > len.saturating_mul(max_pixels_per_byte(format)) {
        return malformed(format!(
            "claims {width}x{height} px, which {len} bytes cannot hold; copy it again"
        ));
    }
    Ok(UVec2::new(width, height))
}

/// Maximum bytes that decoding a picture of `size` px takes, the result included.
pub(super) fn max_decoding_bytes(path: &Path, mut file: impl BufRead, size: UVec2) -> Result<u64> {
    /// Chunk of a WebP file that may have an opacity per pixel.
    const EXTENDED: &[u8] = b"VP8X";
    let start = file.fill_buf().map_err(|e| Error::io(path, e))?;
    let per_pixel = if start.starts_with(&PNG_START) {
        // Row by row into the result.
        4
    } else if start.starts_with(&JPEG_START) {
        // A progressive one: coefficients of three channels in 16 bits, and the result.
        9
    } else if start.starts_with(b"RIFF") {
        // The decoder has planes of its own beside the result, also for opacity.
        if start.get(12..16) == Some(EXTENDED) { 11 } else { 7 }
    } else {
        // TIFF: four channels of 16 bits, and the result.
        12
    };
    Ok(per_pixel * u64::from(size.x) * u64::from(size.y))
}

/// True when a picture has an opacity per pixel, according to its first bytes.
pub(super) fn has_alpha(path: &Path, mut file: impl BufRead + Seek) -> Result<bool> {
    use image::ImageDecoder;
    let start = file.fill_buf().map_err(|e| Error::io(path, e))?;
    // JPEG, the usual format of large data sets, has no opacity.
    if start.starts_with(&JPEG_START) {
        return Ok(false);
    }
    if start.starts_with(&PNG_START) {
        return png::has_alpha(file).map_err(|e| png::broken(path, e));
    }
    let reader =
        image::ImageReader::new(file).with_guessed_format().map_err(|e| Error::io(path, e))?;
    let decoder = reader.into_decoder().map_err(|e| broken(path, e))?;
    Ok(decoder.color_type().has_alpha())
}

/// Maximum number of pixels per byte of a file.
///
/// Deflate reaches 1032 bytes per byte (zlib's technical details), and a PNG has one bit per pixel
/// at min_size. A JPEG spends a bit on the mean of every block of 8x8 pixels. WebP can say "all of
/// it is grey" in a few bytes.
fn max_pixels_per_byte(format: Option<image::ImageFormat>) -> u64 {
    match format {
        Some(image::ImageFormat::Png) => 1032 * 8,
        Some(image::ImageFormat::Jpeg) => 64 * 8,
        _ => u64::MAX,
    }
}

/// The end of every PNG: an empty chunk and its checksum.
const PNG_END: &[u8; 12] = b"\0\0\0\0IEND\xaeB\x60\x82";

/// False when a file's last bytes, or for WebP its stated length, look truncated.
pub(super) fn is_complete(file: &mut std::fs::File) -> std::io::Result<bool> {
    let len = file.metadata()?.len();
    let mut head = Vec::new();
    let mut tail = Vec::new();
    (&mut *file).take(8).read_to_end(&mut head)?;
    file.seek(SeekFrom::Start(len.saturating_sub(PNG_END.len() as u64)))?;
    file.read_to_end(&mut tail)?;
    let is_whole_riff = match head[..] {
        [b'R', b'I', b'F', b'F', a, b, c, d] => {
            u64::from(u32::from_le_bytes([a, b, c, d])) + 8 == len
        }
        _ => false,
    };
    Ok(is_whole_riff || tail.ends_with(&JPEG_END) || tail.ends_with(PNG_END))
}

fn broken(path: &Path, error: image::ImageError) -> Error {
    use std::io::ErrorKind::{InvalidData, UnexpectedEof};
    match error {
        // An error of the decoder about the content of the file, not one of the system.
        image::ImageError::IoError(e) if matches!(e.kind(), InvalidData | UnexpectedEof) => {
            Error::malformed(path, "picture", format!("is damaged ({e}); copy it again"))
        }
        image::ImageError::IoError(e) => Error::io(path, e),
        image::ImageError::Unsupported(e) => Error::unsupported(
            path,
            placeholder_reason(path)
                .unwrap_or_else(|| format!("{e}; convert it to PNG, JPEG, WebP or TIFF")),
        ),
        other => Error::malformed(path, "picture", other.to_string()),
    }
}

/// Reason why a file is no picture: empty, or a pointer of git-lfs.
fn placeholder_reason(path: &Path) -> Option<String> {
    let mut start = Vec::new();
    let file = path.is_file().then(|| File::open(path).ok())??;
    file.take(23).read_to_end(&mut start).ok()?;
    match start[..] {
        [] => Some("is empty (0 bytes); copy it again".into()),
        _ if input::is_lfs_pointer(&start) => {
            Some("is a pointer of git-lfs, not the picture; run `git lfs pull`".into())
        }
        _ => None,
    }
}

// ---- JPEG files: whether they are whole, and how they are read at a part of their size ----------

pub(super) const JPEG_START: [u8; 2] = [0xff, 0xd8];
pub(super) const JPEG_END: [u8; 2] = [0xff, 0xd9];

/// A JPEG of colours or greys, reduced to `size`; `None` for another kind, or one that the decoder
/// of whole pictures is to judge.
pub(super) fn reduced(
    path: &Path,
    bytes: &[u8],
    size: UVec2,
) -> Result<Option<image::DynamicImage>> {
    if !is_whole(bytes) {
        return Ok(None);
    }
    guarded(path, || {
        let mut decoder = jpeg_decoder::Decoder::new(bytes);
        let side = |length: u32| u16::try_from(length).unwrap_or(u16::MAX);
        let scaled = decoder.scale(side(size.x), side(size.y));
        let UVec2 { x: width, y: height } = size;
        if !scaled.is_ok_and(|(x, y)| (u32::from(x), u32::from(y)) == (width, height)) {
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

/// True when a JPEG file has all its segments up to the end marker; data that cameras append behind
/// it do not count.
pub(super) fn is_whole(bytes: &[u8]) -> bool {
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
            Some(&[_, _, high, low]) => {
                at += 2 + usize::from(u16::from_be_bytes([high, low])).max(2)
            }
            _ => return false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::tests::ramp;
    use crate::image::{RgbImage, area};

    #[test]
    fn what_is_not_a_picture_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture.png");
        assert!(matches!(RgbImage::load(&path), Err(Error::Io { .. })));
        std::fs::write(&path, "certainly not a picture").unwrap();
        assert!(matches!(RgbImage::load(&path), Err(Error::Unsupported { .. })));
    }

    /// One picture in every format that is read.
    fn encoded() -> [(&'static str, Vec<u8>); 3] {
        let source = ramp(UVec2::new(32, 24));
        let rgb = source.rgb.as_flattened();
        let rgb8 = image::ExtendedColorType::Rgb8;
        let mut jpeg = Vec::new();
        let mut webp = Vec::new();
        image::codecs::jpeg::JpegEncoder::new(&mut jpeg).encode(rgb, 32, 24, rgb8).unwrap();
        image::codecs::webp::WebPEncoder::new_lossless(&mut webp)
            .encode(rgb, 32, 24, rgb8)
            .unwrap();
        [("png", source.to_png().unwrap()), ("jpeg", jpeg), ("webp", webp)]
    }

    #[test]
    fn sixteen_bits_tiff_and_printing_colours_are_read() {
        use image::{DynamicImage, ImageBuffer, ImageFormat, Rgb};
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture.any");
        let source = ramp(UVec2::new(32, 24));
        let deep: Vec<u16> =
            source.rgb.as_flattened().iter().map(|&c| u16::from(c) * 257).collect();
        let deep: DynamicImage = ImageBuffer::<Rgb<u16>, _>::from_raw(32, 24, deep).unwrap().into();
        for (picture, format) in [
            (&deep, ImageFormat::Png),
            (&deep, ImageFormat::Tiff),
            (&DynamicImage::from(deep.to_rgb8()), ImageFormat::Tiff),
        ] {
            let mut bytes = Cursor::new(Vec::new());
            picture.write_to(&mut bytes, format).unwrap();
            let bytes = bytes.into_inner();
            std::fs::write(&path, &bytes).unwrap();
            assert_eq!(
                RgbImage::size_of(&path, &Limits::DEFAULT).unwrap(),
                source.size,
                "{format:?}"
            );
            assert_eq!(RgbImage::load(&path).unwrap(), source, "{format:?}");
            std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
            assert!(RgbImage::size_of(&path, &Limits::DEFAULT).is_err(), "{format:?} cut short");
        }
        // A red and a green half in cyan, magenta, yellow and black, as Adobe's programs write
        // them.
        let cmyk = "/9j/7gAOQWRvYmUAZAAAAAAA/9sAQwADAgIDAgIDAwMDBAMDBAUIBQUEBAUKBwcGCAwKDAwLCgsLDQ4SEA0OEQ4LCxAWEBETFBUVFQwP\
                    FxgWFBgSFBUU/8AAFAgACAAQBEMRAE0RAFkRAEsRAP/EABcAAAMBAAAAAAAAAAAAAAAAAAAICQf/xAAUEAEAAAAAAAAAAAAAAAAAAAAA/9oA\
                    DgRDAE0AWQBLAAA/AHAIoUpVNDpUBqAf/9k=";
        let bytes =
            base64::Engine::decode(&base64::engine::general_purpose::STANDARD, cmyk).unwrap();
        std::fs::write(&path, bytes).unwrap();
        let printed = RgbImage::load(&path).unwrap();
        for (at, wanted) in [(4 * 16 + 3, [200u8, 40, 60]), (4 * 16 + 12, [30, 160, 90])] {
            assert!(
                (0..3).all(|c| printed.rgb[at][c].abs_diff(wanted[c]) <= 3),
                "{:?}",
                printed.rgb[at]
            );
        }
    }

    #[test]
    fn a_picture_cut_short_is_an_error_in_every_format() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture.any");
        for (format, whole) in encoded() {
            std::fs::write(&path, &whole).unwrap();
            assert_eq!(RgbImage::load(&path).unwrap().size, UVec2::new(32, 24), "{format}");
            assert_eq!(
                RgbImage::size_of(&path, &Limits::DEFAULT).unwrap(),
                UVec2::new(32, 24),
                "{format}"
            );
            // The last chunk of a PNG holds nothing: without it no pixel is lost.
            let needed = whole.len() - if format == "png" { PNG_END.len() } else { 0 };
            for len in (0..needed).step_by(37).chain([needed - 1]) {
                std::fs::write(&path, &whole[..len]).unwrap();
                assert!(RgbImage::load(&path).is_err(), "{format} cut at {len} was read");
                assert!(
                    RgbImage::size_of(&path, &Limits::DEFAULT).is_err(),
                    "{format} cut at {len} passed for whole"
                );
            }
            // Phones append a film, an editor its own data.
            std::fs::write(&path, [whole.as_slice(), b"something else"].concat()).unwrap();
            assert!(
                RgbImage::load(&path).is_ok() && RgbImage::size_of(&path, &Limits::DEFAULT).is_ok(),
                "{format}"
            );
        }
    }

    /// A PNG whose header claims a size, with one row of pixels or none behind it.
    fn claiming(width: u32, height: u32, data: &[u8]) -> Vec<u8> {
        let mut png = b"\x89PNG\r\n\x1a\n".to_vec();
        let header = [&width.to_be_bytes()[..], &height.to_be_bytes(), &[8, 2, 0, 0, 0]].concat();
        for (name, data) in [(b"IHDR", header.as_slice()), (b"IDAT", data), (b"IEND", &[])] {
            let body = [&name[..], data].concat();
            png.extend((data.len() as u32).to_be_bytes());
            png.extend(&body);
            png.extend(crc32(&body).to_be_bytes());
        }
        png
    }

    fn crc32(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(!0u32, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
                (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg())
            })
        })
    }

    #[test]
    fn png_bomb_of_57_bytes_is_refused_by_its_header() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture.png");
        let errors = |bytes: &[u8], limits: &Limits| {
            std::fs::write(&path, bytes).unwrap();
            let all = [
                RgbImage::size_of(&path, limits).unwrap_err(),
                RgbImage::load_within(&path, limits).unwrap_err(),
                RgbImage::load_mask(&path, limits).unwrap_err(),
            ];
            all.map(|error| error.to_string())
        };
        let png = claiming(50_000, 50_000, &[]);
        assert_eq!(png.len(), 57);
        for message in errors(&png, &Limits::DEFAULT) {
            assert!(
                message.contains("picture.png: 2500000000 pixels") && message.contains("`limit`"),
                "{message}"
            );
        }
        // Within the limit, but not within the file.
        for message in errors(&claiming(16_000, 16_000, &[]), &Limits::DEFAULT) {
            assert!(
                message.contains("claims 16000x16000 px, which 57 bytes cannot hold"),
                "{message}"
            );
        }
        let small = Limits { picture_side: 31, ..Limits::DEFAULT };
        for (format, bytes) in encoded() {
            for message in errors(&bytes, &small) {
                assert!(message.contains("picture_side=32"), "{format}: {message}");
            }
        }
    }

    #[test]
    fn pictures_keep_to_the_pixels_per_byte_of_their_format() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture.any");
        let size = UVec2::splat(2048);
        let black = vec![0u8; 3 * area(size)];
        let mut jpeg = Vec::new();
        let mut encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 1);
        encoder.encode(&black, size.x, size.y, image::ExtendedColorType::Rgb8).unwrap();
        let grey = image::GrayImage::new(size.x, size.y);
        let mut png = Cursor::new(Vec::new());
        grey.write_to(&mut png, image::ImageFormat::Png).unwrap();
        for bytes in [jpeg, png.into_inner()] {
            std::fs::write(&path, bytes).unwrap();
            assert_eq!(RgbImage::size_of(&path, &Limits::DEFAULT).unwrap(), size);
            assert_eq!(RgbImage::load(&path).unwrap().size, size);
        }
    }
}

#[cfg(test)]
mod jpeg_tests {
    use super::*;
    use crate::image::RgbImage;
    use crate::limits::Limits;

    #[test]
    fn a_jpeg_that_is_read_smaller_is_the_mean_of_its_pixels() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.jpg");
        let size = UVec2::new(160, 96);
        let code = |x: u32, y: u32| {
            let x = f64::from(x);
            let y = f64::from(y);
            [128.0 + 90.0 * (x / 19.0).sin(), 128.0 + 80.0 * (y / 13.0).cos(), 2.0 * y]
                .map(|c| c as u8)
        };
        let rgb = (0..size.x * size.y).map(|i| code(i % size.x, i / size.x)).collect();
        let limits = &Limits::DEFAULT;
        std::fs::write(&path, RgbImage { size, rgb, alpha: None }.to_jpeg(95).unwrap()).unwrap();
        let whole = RgbImage::load(&path).unwrap();
        for (min_size, part) in [(20, 8), (21, 4), (40, 4), (41, 2), (80, 2), (81, 1), (400, 1)] {
            let (small, full) =
                RgbImage::load_reduced(&path, UVec2::new(min_size, 1), limits).unwrap();
            assert_eq!((small.size, full), (size / part, size), "{min_size}");
            let mean = whole.downscaled(small.size);
            for (a, b) in small.rgb.iter().zip(&mean.rgb) {
                assert!((0..3).all(|c| a[c].abs_diff(b[c]) <= 4), "{min_size}: {a:?} {b:?}");
            }
        }
        // Odd sides are read whole, as is what is cut short, which is an error.
        let odd = RgbImage { size: UVec2::new(161, 96), rgb: vec![[7; 3]; 161 * 96], alpha: None };
        let bytes = odd.to_jpeg(90).unwrap();
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(
            RgbImage::load_reduced(&path, UVec2::splat(10), limits).unwrap().0.size,
            odd.size
        );
        std::fs::write(&path, &bytes[..bytes.len() - 20]).unwrap();
        assert!(RgbImage::load_reduced(&path, UVec2::splat(10), limits).is_err());
    }
}
