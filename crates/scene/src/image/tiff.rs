//! TIFF files that are read smaller: one row of strips or tiles at a time, so that memory holds neither the file nor
//! the whole picture.

use super::shrink::AreaAverage;
use crate::error::Result;
use crate::guard::guarded;
use crate::input;
use crate::limits::Limits;
use glam::UVec2;
use std::io::{BufReader, Read, Seek};
use std::path::Path;
use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::Tag;

const LITTLE_ENDIAN: &[u8; 4] = b"II*\0";
const BIG_ENDIAN: &[u8; 4] = b"MM\0*";

/// A TIFF of colours or greys in 8 or 16 bits, shrunk to `wanted`, and its full size; `None` of another file, of
/// one that is not larger, and of one that the whole decoder is to judge.
///
/// Errors: those of opening the file.
pub(super) fn reduced(
    path: &Path,
    wanted: UVec2,
    limits: &Limits,
) -> Result<Option<(image::DynamicImage, UVec2)>> {
    let (mut file, _) = input::open(path, limits)?;
    let mut start = [0; 4];
    let known = file.read_exact(&mut start).is_ok() && [LITTLE_ENDIAN, BIG_ENDIAN].contains(&&start);
    if !known || file.rewind().is_err() {
        return Ok(None);
    }
    guarded(path, || Ok(shrunk(BufReader::new(file), wanted, limits)))
}

fn shrunk(file: impl Read + Seek, wanted: UVec2, limits: &Limits) -> Option<(image::DynamicImage, UVec2)> {
    let mut decoder = Decoder::new(file).ok()?;
    let size = UVec2::from(decoder.dimensions().ok()?);
    let channels = match decoder.colortype().ok()? {
        tiff::ColorType::Gray(8 | 16) => 1,
        tiff::ColorType::RGB(8 | 16) => 3,
        _ => return None,
    };
    // Planes one after the other, and numbers that are not codes.
    let plain = |decoder: &mut Decoder<_>, tag| {
        let values = decoder.find_tag_unsigned_vec::<u16>(tag).ok()?;
        values.unwrap_or_default().iter().all(|value| *value == 1).then_some(())
    };
    plain(&mut decoder, Tag::PlanarConfiguration)?;
    plain(&mut decoder, Tag::SampleFormat)?;
    limits.picture("picture", size).ok()?;
    if !wanted.cmplt(size).all() || wanted == UVec2::ZERO {
        return None;
    }
    let mut held = tiff::decoder::Limits::default();
    held.decoding_buffer_size = usize::try_from(limits.array_bytes).unwrap_or(usize::MAX);
    let mut decoder = decoder.with_limits(held);
    let chunk = UVec2::from(decoder.chunk_dimensions());
    let across = size.x.div_ceil(chunk.x);
    let mut average = AreaAverage::<3>::new(size, wanted);
    for band in 0..size.y.div_ceil(chunk.y) {
        let height = chunk.y.min(size.y - band * chunk.y) as usize;
        let mut rows = vec![[0u8; 3]; size.x as usize * height];
        for column in 0..across {
            let index = band * across + column;
            let width = decoder.chunk_data_dimensions(index).0 as usize;
            let pixels = codes(decoder.read_chunk(index).ok()?, channels)?;
            let from = (column * chunk.x) as usize;
            let lines = rows.chunks_exact_mut(size.x as usize);
            for (line, chunk) in lines.zip(pixels.chunks_exact(width)) {
                line.get_mut(from..from + width)?.copy_from_slice(chunk);
            }
        }
        rows.chunks_exact(size.x as usize).for_each(|row| average.push(row));
    }
    let rgb = bytemuck::cast_vec(average.finish());
    Some((image::RgbImage::from_raw(wanted.x, wanted.y, rgb)?.into(), size))
}

/// Pixels in 8 bits, rounded as the whole decoder rounds them.
fn codes(chunk: DecodingResult, channels: usize) -> Option<Vec<[u8; 3]>> {
    let codes = match chunk {
        DecodingResult::U8(codes) => codes,
        DecodingResult::U16(codes) => {
            codes.into_iter().map(|code| ((u32::from(code) + 128) / 257) as u8).collect()
        }
        _ => return None,
    };
    Some(match channels {
        1 => codes.into_iter().map(|code| [code; 3]).collect(),
        _ => codes.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::RgbImage;
    use image::{DynamicImage, ImageBuffer, ImageFormat, Luma, Rgb};
    use std::io::Cursor;
    use tiff::encoder::{TiffEncoder, colortype};

    #[test]
    fn a_tiff_that_is_read_smaller_is_the_mean_of_its_pixels() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.tif");
        let (size, limits) = (UVec2::new(161, 97), &Limits::DEFAULT);
        let code = |i: u32| 257 * (((i % 161) * 3 / 2 + (i / 161)) % 256) as u16;
        let deep: Vec<u16> = (0..3 * 161 * 97).map(|k| code(k / 3) / (1 + k as u16 % 3)).collect();
        let deep: DynamicImage = ImageBuffer::<Rgb<u16>, _>::from_raw(161, 97, deep).unwrap().into();
        let grey: Vec<u16> = (0..161 * 97).map(code).collect();
        let grey: DynamicImage = ImageBuffer::<Luma<u16>, _>::from_raw(161, 97, grey).unwrap().into();
        for picture in [&deep, &deep.to_rgb8().into(), &grey, &grey.to_luma8().into()] {
            let mut bytes = Cursor::new(Vec::new());
            picture.write_to(&mut bytes, ImageFormat::Tiff).unwrap();
            let bytes = bytes.into_inner();
            std::fs::write(&path, &bytes).unwrap();
            let whole = RgbImage::load(&path).unwrap();
            for wanted in [UVec2::new(53, 32), UVec2::new(160, 96), UVec2::ONE] {
                let (small, full) = RgbImage::load_reduced(&path, wanted, limits).unwrap();
                assert_eq!((full, &small), (size, &whole.downscaled(wanted)));
            }
            let same = RgbImage::load_reduced(&path, size, limits).unwrap();
            assert_eq!(same, (whole, size), "not larger than wanted");
            std::fs::write(&path, &bytes[..bytes.len() - 30]).unwrap();
            assert!(RgbImage::load_reduced(&path, UVec2::ONE, limits).is_err(), "cut short");
        }
    }

    #[test]
    fn strips_are_read_one_by_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.tif");
        let rgb: Vec<u8> = (0..3 * 64 * 50).map(|k| (k % 251) as u8).collect();
        let mut file = std::fs::File::create(&path).unwrap();
        let mut encoder = TiffEncoder::new(&mut file).unwrap();
        let mut picture = encoder.new_image::<colortype::RGB8>(64, 50).unwrap();
        picture.rows_per_strip(7).unwrap();
        picture.write_data(&rgb).unwrap();
        let wanted = UVec2::new(20, 11);
        // A strip of seven rows fits, the picture does not.
        let limits = Limits { array_bytes: 3 * 64 * 7, ..Limits::DEFAULT };
        let (small, full) = RgbImage::load_reduced(&path, wanted, &limits).unwrap();
        assert_eq!(full, UVec2::new(64, 50));
        assert_eq!(small, RgbImage::load(&path).unwrap().downscaled(wanted));
    }
}
