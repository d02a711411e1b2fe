//! EXIF: orientation and focal length.

use exif::{Exif, In, Reader, Tag, Value};
use glam::UVec2;
use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Seek};
use std::path::Path;

/// Diagonal of a frame of 35 mm film, mm.
const FILM_DIAGONAL: f64 = 43.266_615_305_567_87;
/// Tag of the orientation in the first directory.
const ORIENTATION: u16 = 0x0112;

/// A photo's EXIF data.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct PhotoNotes {
    /// EXIF orientation, 1 to 8; 1: upright.
    pub(crate) orientation: u8,
    /// Focal length equivalent on 35 mm film, mm.
    pub(crate) focal_35: Option<f64>,
    /// Width and height before it is turned, px.
    pub(crate) sensor: Option<UVec2>,
    /// The raw EXIF block, from its byte order mark on.
    pub(crate) raw: Vec<u8>,
}

impl PhotoNotes {
    /// EXIF of an image file; upright and otherwise empty if missing or unreadable.
    pub(crate) fn of(bytes: &[u8]) -> Self {
        let exif = read(&mut Cursor::new(bytes));
        exif.map_or(Self { orientation: 1, ..Self::default() }, |exif| Self::in_block(&exif))
    }

    fn in_block(exif: &Exif) -> Self {
        let orientation =
            first_number(exif, Tag::Orientation).filter(|o| (1.0..=8.0).contains(o)).unwrap_or(1.0);
        let side = |tag| above_zero(exif, tag).map(|side| side as u32);
        Self {
            orientation: orientation as u8,
            focal_35: above_zero(exif, Tag::FocalLengthIn35mmFilm),
            sensor: side(Tag::PixelXDimension).zip(side(Tag::PixelYDimension)).map(UVec2::from),
            raw: exif.buf().to_vec(),
        }
    }

    /// Focal length in pixels for this picture size.
    pub(crate) fn focal_px(&self, size: UVec2) -> Option<f64> {
        self.focal_35.map(|focal| focal / FILM_DIAGONAL * size.as_dvec2().length())
    }

    /// The same for a picture of `size` that another program made of the photo, and that is to be
    /// turned like `orientation`: some programs turn it, and say so still.
    pub(crate) fn of_copy(self, orientation: u8, size: UVec2) -> Self {
        let was_turned = orientation >= 5 && self.sensor.is_some_and(|sensor| sensor != size);
        Self { orientation: if was_turned { 1 } else { orientation }, ..self }
    }

    /// The EXIF block with orientation reset to upright.
    pub(crate) fn upright(&self) -> Vec<u8> {
        let mut raw = self.raw.clone();
        // An entry that is not found does not exist.
        let _ = set_upright(&mut raw);
        raw
    }
}

/// Sets the orientation entry of the first directory to 1. `None` without such an entry.
fn set_upright(tiff: &mut [u8]) -> Option<()> {
    let big = tiff.get(..2)? == b"MM";
    let short = |bytes: &[u8], at: usize| -> Option<u16> {
        let two = bytes.get(at..at + 2)?.try_into().ok()?;
        Some(if big { u16::from_be_bytes(two) } else { u16::from_le_bytes(two) })
    };
    let long: [u8; 4] = tiff.get(4..8)?.try_into().ok()?;
    let start = if big { u32::from_be_bytes(long) } else { u32::from_le_bytes(long) } as usize;
    let entries = usize::from(short(tiff, start)?);
    let entry = (0..entries)
        .map(|i| start + 2 + 12 * i)
        .find(|&at| short(tiff, at) == Some(ORIENTATION))?;
    let one = if big { 1u16.to_be_bytes() } else { 1u16.to_le_bytes() };
    tiff.get_mut(entry + 8..entry + 10)?.copy_from_slice(&one);
    Some(())
}

/// A JPEG file with an EXIF block inserted before all other segments.
pub(crate) fn with_notes(jpeg: &[u8], notes: &[u8]) -> Vec<u8> {
    const HEADER: &[u8] = b"Exif\0\0";
    let length = u16::try_from(2 + HEADER.len() + notes.len());
    match (length, jpeg.split_at_checked(2)) {
        (Ok(length), Some((start, rest))) if !notes.is_empty() => {
            [start, &[0xff, 0xe1], &length.to_be_bytes(), HEADER, notes, rest].concat()
        }
        _ => jpeg.to_vec(),
    }
}

/// The EXIF data of a picture file, as far as they can be read; `None` without any.
fn read(file: &mut (impl BufRead + Seek)) -> Option<Exif> {
    let mut reader = Reader::new();
    reader.continue_on_error(true);
    let exif = reader.read_from_container(file);
    exif.or_else(|e| e.distill_partial_result(|_| {})).ok()
}

/// The first number of an entry of the first picture.
fn first_number(exif: &Exif, tag: Tag) -> Option<f64> {
    match &exif.get_field(tag, In::PRIMARY)?.value {
        Value::Rational(list) => list.first().map(|r| r.to_f64()),
        Value::SRational(list) => list.first().map(|r| r.to_f64()),
        other => other.get_uint(0).map(f64::from),
    }
}

/// [`first_number`], if it is finite and above zero.
fn above_zero(exif: &Exif, tag: Tag) -> Option<f64> {
    first_number(exif, tag).filter(|n| *n > 0.0 && n.is_finite())
}

/// The orientation of a picture file, 1 to 8; `None` of a file without one.
pub(crate) fn orientation_of(path: &Path) -> Option<u8> {
    let exif = read(&mut BufReader::new(File::open(path).ok()?))?;
    Some(PhotoNotes::in_block(&exif).orientation)
}

/// An EXIF block as a camera writes it: orientation, focal length.
#[cfg(test)]
pub(crate) fn sample_notes(orientation: u16, focal_35: u16) -> Vec<u8> {
    let fields = [
        (Tag::Orientation, Value::Short(vec![orientation])),
        (Tag::FocalLengthIn35mmFilm, Value::Short(vec![focal_35])),
    ]
    .map(|(tag, value)| exif::Field { tag, ifd_num: In::PRIMARY, value });
    let mut writer = exif::experimental::Writer::new();
    for field in &fields {
        writer.push_field(field);
    }
    let mut bytes = Cursor::new(Vec::new());
    writer.write(&mut bytes, false).unwrap();
    bytes.into_inner()
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::image::RgbImage;

    #[test]
    fn exif_notes_come_back_and_upright_ones_differ_in_orientation() {
        let picture =
            RgbImage { size: UVec2::new(40, 30), rgb: vec![[90, 120, 30]; 1200], alpha: None };
        let plain = picture.to_jpeg(90).unwrap();
        assert_eq!(PhotoNotes::of(&plain), PhotoNotes { orientation: 1, ..PhotoNotes::default() });
        let noted = with_notes(&plain, &sample_notes(6, 26));
        let notes = PhotoNotes::of(&noted);
        assert_eq!((notes.orientation, notes.focal_35), (6, Some(26.0)));
        let focal = notes.focal_px(UVec2::new(4000, 3000)).unwrap();
        assert!((focal - 26.0 / FILM_DIAGONAL * 5000.0).abs() < 1e-9);
        let turned = PhotoNotes::of(&with_notes(&plain, &notes.upright()));
        assert_eq!(PhotoNotes { raw: notes.raw.clone(), orientation: 6, ..turned.clone() }, notes);
        assert_eq!(turned.orientation, 1);
        assert_eq!(PhotoNotes::of(b"not a picture").orientation, 1);
    }
}
