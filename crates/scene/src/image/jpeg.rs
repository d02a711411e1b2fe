//! JPEG files: whether they are whole, and how they are read at a part of their size.

use crate::error::Result;
use crate::guard::guarded;
use glam::UVec2;
use std::path::Path;

pub(super) const JPEG_START: [u8; 2] = [0xff, 0xd8];
pub(super) const JPEG_END: [u8; 2] = [0xff, 0xd9];

/// A JPEG of colours or greys, reduced to `wanted`; `None` of another kind, or one that the whole decoder is to judge.
pub(super) fn reduced(path: &Path, bytes: &[u8], wanted: UVec2) -> Result<Option<image::DynamicImage>> {
    if !is_whole(bytes) {
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

/// Walks the segments of a JPEG file up to its end marker; what cameras append behind it does not count.
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
            Some(&[_, _, high, low]) => at += 2 + usize::from(u16::from_be_bytes([high, low])).max(2),
            _ => return false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::RgbImage;
    use crate::limits::Limits;

    #[test]
    fn a_jpeg_that_is_read_smaller_is_the_mean_of_its_pixels() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.jpg");
        let size = UVec2::new(160, 96);
        let code = |x: u32, y: u32| {
            let (x, y) = (f64::from(x), f64::from(y));
            [128.0 + 90.0 * (x / 19.0).sin(), 128.0 + 80.0 * (y / 13.0).cos(), 2.0 * y].map(|c| c as u8)
        };
        let rgb = (0..size.x * size.y).map(|i| code(i % size.x, i / size.x)).collect();
        let limits = &Limits::DEFAULT;
        std::fs::write(&path, RgbImage { size, rgb, alpha: None }.to_jpeg(95).unwrap()).unwrap();
        let whole = RgbImage::load(&path).unwrap();
        for (least, part) in [(20, 8), (21, 4), (40, 4), (41, 2), (80, 2), (81, 1), (400, 1)] {
            let (small, full) = RgbImage::load_reduced(&path, UVec2::new(least, 1), limits).unwrap();
            assert_eq!((small.size, full), (size / part, size), "{least}");
            let mean = whole.downscaled(small.size);
            for (a, b) in small.rgb.iter().zip(&mean.rgb) {
                assert!((0..3).all(|c| a[c].abs_diff(b[c]) <= 4), "{least}: {a:?} {b:?}");
            }
        }
        // Odd sides are read whole, as is what is cut short, which is an error.
        let odd = RgbImage { size: UVec2::new(161, 96), rgb: vec![[7; 3]; 161 * 96], alpha: None };
        let bytes = odd.to_jpeg(90).unwrap();
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(RgbImage::load_reduced(&path, UVec2::splat(10), limits).unwrap().0.size, odd.size);
        std::fs::write(&path, &bytes[..bytes.len() - 20]).unwrap();
        assert!(RgbImage::load_reduced(&path, UVec2::splat(10), limits).is_err());
    }
}
