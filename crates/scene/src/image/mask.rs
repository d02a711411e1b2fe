//! Masks: pictures whose brightness is the weight of a pixel, as their many writers mean it.

use super::decode::OpenPicture;
use crate::error::Result;
use crate::limits::Limits;
use glam::UVec2;
use image::DynamicImage;
use std::path::Path;

/// Codes that JPEG adds to black and takes from white.
const JPEG_NOISE: u8 = 16;

/// Decodes a mask: its size, and one weight per pixel, rows from the top.
pub(super) fn load(path: &Path, limits: &Limits) -> Result<(UVec2, Vec<u8>)> {
    let opened = OpenPicture::new(path, limits)?;
    let is_jpeg = opened.is_jpeg();
    let picture = opened.decode(path, limits)?;
    let size = UVec2::new(picture.width(), picture.height());
    let mut weights = weights(picture);
    if is_jpeg {
        weights.iter_mut().for_each(|weight| *weight = without_noise(*weight));
    }
    Ok((size, weights))
}

/// The luma of each pixel, where it is opaque. Masks of 0 and 1 mean 0 and 255.
fn weights(picture: DynamicImage) -> Vec<u8> {
    let mut weights = match picture {
        // Small numbers that are written with 16 bits.
        DynamicImage::ImageLuma16(picture) if picture.iter().all(|code| *code < 256) => {
            picture.iter().map(|code| *code as u8).collect()
        }
        picture if picture.color().has_alpha() => {
            let pixels = picture.into_luma_alpha8();
            let product = |[luma, alpha]: [u8; 2]| (u16::from(luma) * u16::from(alpha) / 255) as u8;
            pixels.pixels().map(|pixel| product(pixel.0)).collect()
        }
        picture => picture.into_luma8().into_raw(),
    };
    if weights.iter().all(|weight| *weight <= 1) {
        weights.iter_mut().for_each(|weight| *weight *= 255);
    }
    weights
}

fn without_noise(weight: u8) -> u8 {
    match weight {
        ..JPEG_NOISE => 0,
        weight if weight > u8::MAX - JPEG_NOISE => u8::MAX,
        weight => weight,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{GrayImage, ImageBuffer, Luma, Rgba, RgbaImage};

    /// The weights of a mask whose left half is kept, as `picture` writes it.
    fn read(name: &str, picture: &DynamicImage) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        picture.save(&path).unwrap();
        let (size, weights) = load(&path, &Limits::DEFAULT).unwrap();
        assert_eq!(size, UVec2::new(16, 8), "{name}");
        weights
    }

    #[test]
    fn masks_of_all_writers_mean_the_same() {
        let is_kept = |x: u32| x < 8;
        let grey =
            |white: u8| GrayImage::from_fn(16, 8, |x, _| Luma([u8::from(is_kept(x)) * white]));
        let deep =
            |white: u16| ImageBuffer::from_fn(16, 8, |x, _| Luma([u16::from(is_kept(x)) * white]));
        let shape =
            RgbaImage::from_fn(16, 8, |x, _| Rgba([255, 255, 255, u8::from(is_kept(x)) * 255]));
        let white = grey(255);
        for (name, picture) in [
            ("white.png", DynamicImage::from(white.clone())),
            ("one.png", grey(1).into()),
            ("one.tif", DynamicImage::ImageLuma16(deep(1))),
            ("code.png", DynamicImage::ImageLuma16(deep(255))),
            ("deep.png", DynamicImage::ImageLuma16(deep(u16::MAX))),
            ("shape.png", shape.into()),
            ("photo.JPG", white.clone().into()),
        ] {
            assert_eq!(read(name, &picture), *white.as_raw(), "{name}");
        }
        let soft = GrayImage::from_fn(16, 8, |x, _| Luma([16 * x as u8]));
        assert_eq!(read("soft.png", &soft.clone().into()), *soft.as_raw());
    }
}
