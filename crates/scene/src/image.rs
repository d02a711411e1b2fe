//! Pictures in memory and on disk.
//!
//! Colours are sRGB-encoded throughout, and averages are computed on encoded values, as in the
//! literature (3DGS, Held et al. 2025).

mod codes;
mod decode;
mod mask;
mod png;
mod shrink;

use crate::atomic::AtomicFile;
use crate::error::{Error, Result};
use crate::input;
use crate::limits::Limits;
use ::image::codecs::png::{CompressionType, FilterType, PngEncoder};
use decode::{decode, header_size, is_complete};
use glam::UVec2;
use shrink::area_average;
use std::io::{BufReader, Cursor, Seek};
use std::path::Path;
use std::sync::Arc;
use xxhash_rust::xxh3::Xxh3Default;

/// An RGB picture, sRGB-encoded, values usually in [0, 1].
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Width and height, px.
    pub size: UVec2,
    /// Rows from the top. `[H * W]`
    pub pixels: Vec<[f32; 3]>,
}

impl Image {
    /// A picture of one colour.
    pub fn filled(size: UVec2, rgb: [f32; 3]) -> Self {
        Self { size, pixels: vec![rgb; area(size)] }
    }

    /// The picture in 8 bits: clamped to [0, 1] and rounded to the nearest code; NaN becomes 0.
    pub fn to_pixels(&self) -> RgbImage {
        RgbImage::from_rgb(self.size, &self.pixels)
    }

    /// Writes an 8-bit PNG; see [`RgbImage::save_png`].
    pub fn save_png(&self, path: impl AsRef<Path>) -> Result<()> {
        self.to_pixels().save_png(path)
    }
}

/// An RGB picture of 8 bits per channel, sRGB-encoded, perhaps with a weight per pixel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RgbImage {
    /// Width and height, px.
    pub size: UVec2,
    /// Rows from the top. `[H * W]`
    pub rgb: Vec<[u8; 3]>,
    /// Weight of each pixel, up to 255: the opacity in a file, or a photo's mask in the loss. `[H *
    /// W]`
    pub alpha: Option<Vec<u8>>,
}

impl RgbImage {
    /// sRGB-encoded colours in 8 bits: clamped to [0, 1] and rounded to the nearest code; NaN
    /// becomes 0. `[H * W]`
    pub fn from_rgb(size: UVec2, rgb: &[[f32; 3]]) -> Self {
        let code = |c: f32| (c.clamp(0.0, 1.0) * 255.0).round() as u8;
        Self { size, rgb: rgb.iter().map(|p| p.map(code)).collect(), alpha: None }
    }

    /// Bytes it takes in memory.
    pub fn bytes(&self) -> u64 {
        self.rgb.len() as u64 * 3 + self.alpha.as_ref().map_or(0, |a| a.len() as u64)
    }

    /// Reads a PNG, JPEG, WebP or TIFF file; 16-bit channels are rounded to 8, grey becomes RGB.
    ///
    /// Pixels stay as stored: an EXIF rotation is not applied, because COLMAP does not apply it
    /// either.
    pub fn load(path: &Path) -> Result<Self> {
        Self::load_within(path, &Limits::DEFAULT)
    }

    /// [`RgbImage::load`] of a picture within `limits`.
    pub fn load_within(path: &Path, limits: &Limits) -> Result<Self> {
        Ok(Self::from_decoded(decode(path, limits)?))
    }

    /// [`RgbImage::load_within`] of a smaller picture if that takes less time or memory, with no
    /// side below `min_size`: a JPEG at 1/2, 1/4 or 1/8 of its size, a larger opaque PNG at
    /// `min_size`. Returns the full size too.
    pub fn load_reduced(path: &Path, min_size: UVec2, limits: &Limits) -> Result<(Self, UVec2)> {
        let (picture, full) = decode::decode_reduced(path, min_size, limits)?;
        Ok((Self::from_decoded(picture), full))
    }

    /// The picture turned upright by an EXIF `orientation`, 1 to 8.
    pub fn turned(&self, orientation: u8) -> Self {
        let UVec2 { x: width, y: height } = self.size;
        let size = if orientation >= 5 { UVec2::new(height, width) } else { self.size };
        let source = |i: u32| {
            let x = i % size.x;
            let y = i / size.x;
            let (x, y) = match orientation {
                2 => (width - 1 - x, y),
                3 => (width - 1 - x, height - 1 - y),
                4 => (x, height - 1 - y),
                5 => (y, x),
                6 => (y, height - 1 - x),
                7 => (width - 1 - y, height - 1 - x),
                8 => (width - 1 - y, x),
                _ => (x, y),
            };
            (y * width + x) as usize
        };
        let places = 0..size.x * size.y;
        Self {
            size,
            rgb: places.clone().map(|i| self.rgb[source(i)]).collect(),
            alpha: self.alpha.as_ref().map(|alpha| places.map(|i| alpha[source(i)]).collect()),
        }
    }

    fn from_decoded(picture: image::DynamicImage) -> Self {
        let size = UVec2::new(picture.width(), picture.height());
        if !picture.color().has_alpha() {
            return Self { size, rgb: triples(picture.into_rgb8().into_raw()), alpha: None };
        }
        let mut rgba = picture.into_rgba8().into_raw();
        let alpha: Vec<u8> = rgba.iter().skip(3).step_by(4).copied().collect();
        let opaque = alpha.iter().all(|&a| a == 255);
        // In place: a second picture would double the memory.
        for i in 0..alpha.len() {
            rgba.copy_within(4 * i..4 * i + 3, 3 * i);
        }
        rgba.truncate(3 * alpha.len());
        rgba.shrink_to_fit();
        Self { size, rgb: triples(rgba), alpha: if opaque { None } else { Some(alpha) } }
    }

    /// Reads a mask within `limits`: one channel per pixel, rows from the top; colours become their
    /// luma, and 0 and 1 become 0 and 255.
    pub fn load_mask(path: &Path, limits: &Limits) -> Result<(UVec2, Vec<u8>)> {
        mask::load(path, limits)
    }

    /// Reads a grey PNG of numbers, as a depth map, within `limits`: its size and the codes of
    /// its pixels as stored, rows from the top.
    ///
    /// # Errors
    ///
    /// As of [`RgbImage::load_within`]; another format; colours.
    pub fn load_codes(path: &Path, limits: &Limits) -> Result<(UVec2, Vec<u16>)> {
        codes::load(path, limits)
    }

    /// Width and height of a picture file, from its first bytes; an error when they exceed `limits`
    /// or the possible content of the file. The last bytes are checked too: a file with an unusual
    /// end is decoded to detect truncation.
    pub fn size_of(path: &Path, limits: &Limits) -> Result<UVec2> {
        let io = |e| Error::io(path, e);
        let (mut file, len) = input::open(path, limits)?;
        let is_complete = is_complete(&mut file).map_err(io)?;
        file.rewind().map_err(io)?;
        let size = header_size(path, BufReader::new(file), len, limits)?;
        if !is_complete {
            decode(path, limits)?;
        }
        Ok(size)
    }

    /// Maximum bytes that decoding a picture file of `size` px takes, by its first bytes: with the
    /// result, without the bytes of a JPEG file.
    pub fn decoding_bytes(path: &Path, size: UVec2, limits: &Limits) -> Result<u64> {
        let (file, _) = input::open(path, limits)?;
        decode::max_decoding_bytes(path, BufReader::new(file), size)
    }

    /// True when a picture file has a channel for opacity, according to its first bytes.
    pub fn has_alpha(path: &Path, limits: &Limits) -> Result<bool> {
        let (file, _) = input::open(path, limits)?;
        decode::has_alpha(path, BufReader::new(file))
    }

    /// Blends the picture with `background` by its alpha, and removes the alpha.
    pub fn over(mut self, background: [u8; 3]) -> Self {
        if let Some(alpha) = self.alpha.take() {
            for (pixel, &a) in self.rgb.iter_mut().zip(&alpha) {
                for (c, &under) in pixel.iter_mut().zip(&background) {
                    let sum =
                        u32::from(*c) * u32::from(a) + u32::from(under) * (255 - u32::from(a));
                    *c = ((sum + 127) / 255) as u8;
                }
            }
        }
        self
    }

    /// Adds a background to a picture with premultiplied colours, and removes the alpha.
    pub fn recomposited(&self, background: [u8; 3]) -> Self {
        let mut rgb = self.rgb.clone();
        for (pixel, &a) in rgb.iter_mut().zip(self.alpha.iter().flatten()) {
            for (c, &under) in pixel.iter_mut().zip(&background) {
                let through = (u32::from(under) * (255 - u32::from(a)) + 127) / 255;
                *c = c.saturating_add(through as u8);
            }
        }
        Self { size: self.size, rgb, alpha: None }
    }

    /// Divides premultiplied colours by their alpha; black where alpha is 0.
    pub fn unpremultiplied(&self) -> Self {
        let mut straight = self.clone();
        for (pixel, &a) in straight.rgb.iter_mut().zip(self.alpha.iter().flatten()) {
            let a = u32::from(a).max(1);
            *pixel = pixel.map(|c| ((u32::from(c) * 255 + a / 2) / a).min(255) as u8);
        }
        straight
    }

    /// The part of `size` px with its upper left corner at `corner`, within the picture.
    pub fn part(&self, corner: UVec2, size: UVec2) -> Self {
        let rows = (corner.y..corner.y + size.y).map(|y| (y * self.size.x + corner.x) as usize);
        let rows = rows.map(|from| from..from + size.x as usize);
        let alpha = self
            .alpha
            .as_ref()
            .map(|a| rows.clone().flat_map(|row| a[row].iter().copied()).collect());
        Self { size, rgb: rows.flat_map(|row| self.rgb[row].iter().copied()).collect(), alpha }
    }

    /// The picture shrunk to `size`: every new pixel is the average of its area, which may include
    /// fractions of pixels.
    pub fn downscaled(&self, size: UVec2) -> Self {
        if size == self.size {
            return self.clone();
        }
        let rgb = area_average(&self.rgb, self.size, size);
        let alpha = self.alpha.as_ref().map(|alpha| {
            let single: &[[u8; 1]] = bytemuck::cast_slice(alpha);
            bytemuck::cast_vec(area_average(single, self.size, size))
        });
        Self { size, rgb, alpha }
    }

    /// [`Self::downscaled`], without a copy if the picture has the size.
    pub fn shared_at(self: Arc<Self>, size: UVec2) -> Arc<Self> {
        if size == self.size { self } else { Arc::new(self.downscaled(size)) }
    }

    /// The picture as the bytes of a PNG file.
    pub fn to_png(&self) -> Result<Vec<u8>> {
        self.encode_png(CompressionType::default(), FilterType::default())
    }

    /// The same for numbers in place of a picture. A number says nothing of the numbers beside it,
    /// so filters, which store differences, would only enlarge the file.
    pub fn to_png_of_numbers(&self) -> Result<Vec<u8>> {
        self.encode_png(CompressionType::Best, FilterType::NoFilter)
    }

    fn encode_png(&self, compression: CompressionType, filter: FilterType) -> Result<Vec<u8>> {
        use image::{ExtendedColorType, ImageEncoder};
        let mut bytes = Cursor::new(Vec::new());
        let width = self.size.x;
        let height = self.size.y;
        let encoder = PngEncoder::new_with_quality(&mut bytes, compression, filter);
        let written = match &self.alpha {
            None => {
                let rgb: &[u8] = bytemuck::cast_slice(&self.rgb);
                encoder.write_image(rgb, width, height, ExtendedColorType::Rgb8)
            }
            Some(alpha) => {
                let rgba: Vec<u8> =
                    self.rgb.iter().zip(alpha).flat_map(|(p, &a)| [p[0], p[1], p[2], a]).collect();
                encoder.write_image(&rgba, width, height, ExtendedColorType::Rgba8)
            }
        };
        written.map_err(|e| unencodable(self.size, &e))?;
        Ok(bytes.into_inner())
    }

    /// The picture as the bytes of a JPEG file of full colour resolution; its alpha is left out.
    /// `quality` is 1 to 100.
    pub fn to_jpeg(&self, quality: u8) -> Result<Vec<u8>> {
        use image::{ExtendedColorType, ImageEncoder, codecs::jpeg::JpegEncoder};
        let mut bytes = Vec::new();
        let rgb: &[u8] = bytemuck::cast_slice(&self.rgb);
        let encoder = JpegEncoder::new_with_quality(&mut bytes, quality);
        let written = encoder.write_image(rgb, self.size.x, self.size.y, ExtendedColorType::Rgb8);
        written.map_err(|e| unencodable(self.size, &e))?;
        Ok(bytes)
    }

    /// Decodes a picture inside another file; `place` is for messages. Otherwise like
    /// [`RgbImage::load_within`].
    pub fn from_bytes(place: &Path, bytes: &[u8], limits: &Limits) -> Result<Self> {
        Ok(Self::from_decoded(decode::decode_bytes(place, bytes, limits)?))
    }

    /// The XXH3 hash of size, colours and alpha.
    pub fn digest(&self) -> u64 {
        let mut hash = Xxh3Default::new();
        hash.update(bytemuck::bytes_of(&self.size));
        hash.update(bytemuck::cast_slice(&self.rgb));
        hash.update(self.alpha.as_deref().unwrap_or_default());
        hash.digest()
    }

    /// Writes a PNG file that appears whole or not at all.
    pub fn save_png(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        AtomicFile::create(path)?.commit_with(self.to_png()?).map(drop)
    }
}

/// The error of a picture that cannot be encoded.
fn unencodable(size: UVec2, error: &image::ImageError) -> Error {
    Error::invalid_data(format!("a picture of {}x{} px cannot be encoded: {error}", size.x, size.y))
}

/// Number of pixels of a picture of this size.
fn area(size: UVec2) -> usize {
    size.x as usize * size.y as usize
}

/// Bytes as triples; copied only if the memory cannot be reused.
fn triples(bytes: Vec<u8>) -> Vec<[u8; 3]> {
    bytemuck::allocation::try_cast_vec(bytes)
        .unwrap_or_else(|(_, bytes)| bytemuck::cast_slice(&bytes).to_vec())
}

/// A picture's size from text such as 1280x720; the error states the expected form.
pub fn parse_size(text: &str) -> std::result::Result<UVec2, String> {
    let sides = text.split_once(['x', 'X']);
    let parsed = sides.and_then(|(w, h)| Some(UVec2::new(w.parse().ok()?, h.parse().ok()?)));
    let parsed = parsed.ok_or("expected WIDTHxHEIGHT, such as 1280x720")?;
    if parsed.min_element() == 0 || parsed.max_element() > MAX_SIDE {
        return Err(format!("expected 1 to {MAX_SIDE} px each way, such as 1280x720"));
    }
    Ok(parsed)
}

/// Maximum side of a picture that every graphics card of today can draw, px.
const MAX_SIDE: u32 = 8192;

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture of many colours.
    pub(super) fn ramp(size: UVec2) -> RgbImage {
        let at = |i: usize| [(i * 7 % 251) as u8, (i * 13 % 241) as u8, (i * 29 % 239) as u8];
        RgbImage { size, rgb: (0..area(size)).map(at).collect(), alpha: None }
    }

    #[test]
    fn numbers_take_fewer_bytes_without_filters() {
        // As coefficients are: most near the code of 0, none like the one beside it.
        let rng = crate::Rng::new(3, "numbers", 0);
        let code = |i: usize| 128.0 + 40.0 * (rng.uniform(i as u64) - 0.5).powi(3) * 8.0;
        let size = UVec2::new(128, 64);
        let texel = |i: usize| [0, 1, 2].map(|c| code(3 * i + c) as u8);
        let numbers = RgbImage { size, rgb: (0..area(size)).map(texel).collect(), alpha: None };
        let bytes = numbers.to_png_of_numbers().unwrap();
        let read = RgbImage::from_bytes(Path::new("numbers.png"), &bytes, &Limits::DEFAULT);
        assert_eq!(read.unwrap(), numbers);
        let filtered = numbers.to_png().unwrap();
        assert!(10 * bytes.len() < 9 * filtered.len(), "{}, {}", bytes.len(), filtered.len());
    }

    #[test]
    fn a_picture_is_turned_as_exif_says() {
        // 1 2 3
        // 4 5 6
        let picture = RgbImage {
            size: UVec2::new(3, 2),
            rgb: (1..=6).map(|c| [c, 0, 0]).collect(),
            alpha: None,
        };
        for (orientation, rows) in [
            (1, [[1, 2, 3], [4, 5, 6]].concat()),
            (2, [[3, 2, 1], [6, 5, 4]].concat()),
            (3, [[6, 5, 4], [3, 2, 1]].concat()),
            (4, [[4, 5, 6], [1, 2, 3]].concat()),
            (5, [[1, 4], [2, 5], [3, 6]].concat()),
            (6, [[4, 1], [5, 2], [6, 3]].concat()),
            (7, [[6, 3], [5, 2], [4, 1]].concat()),
            (8, [[3, 6], [2, 5], [1, 4]].concat()),
        ] {
            let turned = picture.turned(orientation);
            assert_eq!(turned.rgb.iter().map(|p| p[0]).collect::<Vec<u8>>(), rows, "{orientation}");
            let sides = if orientation < 5 { (3, 2) } else { (2, 3) };
            assert_eq!((turned.size.x, turned.size.y), sides, "{orientation}");
        }
    }

    #[test]
    fn alpha_blends_with_the_background() {
        let picture = RgbImage {
            size: UVec2::new(3, 1),
            rgb: vec![[200; 3]; 3],
            alpha: Some(vec![255, 0, 51]),
        };
        let flat = picture.over([100, 0, 255]);
        assert_eq!(flat.rgb, [[200, 200, 200], [100, 0, 255], [120, 40, 244]]);
        assert_eq!(flat.alpha, None);
    }

    #[test]
    fn a_saved_png_comes_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture.png");
        let mut picture = ramp(UVec2::new(9, 5));
        picture.save_png(&path).unwrap();
        assert_eq!(RgbImage::load(&path).unwrap(), picture);
        assert_eq!(RgbImage::size_of(&path, &Limits::DEFAULT).unwrap(), picture.size);
        picture.alpha = Some((0..45).collect());
        picture.save_png(&path).unwrap();
        assert_eq!(RgbImage::load(&path).unwrap(), picture);
        assert_eq!(
            std::fs::read_dir(folder.path()).unwrap().count(),
            1,
            "no temporary file stays behind"
        );
    }
}
