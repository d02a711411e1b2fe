//! Grey PNG files whose codes are numbers, as those of depth maps.

use super::decode::header_size;
use super::png::{self, PNG_START};
use crate::error::{Error, Result};
use crate::input;
use crate::limits::Limits;
use glam::UVec2;
use std::io::{BufRead, BufReader, Seek};
use std::path::Path;

/// Decodes a grey PNG: its size and the codes of its pixels as stored, rows from the top.
///
/// # Errors
///
/// Another format; colours: they are a drawing of the numbers, which cannot be undone.
pub(super) fn load(path: &Path, limits: &Limits) -> Result<(UVec2, Vec<u16>)> {
    let io = |e| Error::io(path, e);
    let (file, len) = input::open(path, limits)?;
    let mut file = BufReader::new(file);
    let is_png = file.fill_buf().map_err(io)?.starts_with(&PNG_START);
    let codes = if is_png {
        header_size(path, &mut file, len, limits)?;
        file.rewind().map_err(io)?;
        png::codes(path, file, limits)?
    } else {
        None
    };
    codes.ok_or_else(|| {
        let reason = "is no grey PNG, and colours are no numbers; write it as one of 16 bits";
        Error::unsupported(path, reason)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{DynamicImage, GrayImage, ImageBuffer, Luma, Rgb, RgbImage};

    #[test]
    fn codes_are_read_as_stored_and_colours_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("depth.png");
        let read = |picture: DynamicImage| {
            picture.save(&path).unwrap();
            load(&path, &Limits::DEFAULT)
        };
        let deep = ImageBuffer::from_fn(3, 2, |x, y| Luma([(1000 * x + y) as u16]));
        let (size, codes) = read(DynamicImage::ImageLuma16(deep)).unwrap();
        assert_eq!((size, codes), (UVec2::new(3, 2), vec![0, 1000, 2000, 1, 1001, 2001]));
        let grey = GrayImage::from_fn(2, 1, |x, _| Luma([7 + x as u8]));
        assert_eq!(read(grey.into()).unwrap().1, [7, 8]);
        let mut rgb = RgbImage::from_fn(2, 1, |x, _| Rgb([7 + x as u8; 3]));
        assert_eq!(read(rgb.clone().into()).unwrap().1, [7, 8]);
        rgb.put_pixel(0, 0, Rgb([1, 2, 3]));
        let error = read(rgb.into()).unwrap_err().to_string();
        assert!(error.contains("depth.png: is no grey PNG"), "{error}");
    }
}
