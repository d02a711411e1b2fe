//! Numbers in a picture's EXIF data, and the light that the photo caught.

use exif::{Exif, In, Reader, Tag, Value};
use std::fs::File;
use std::io::{BufRead, BufReader, Seek};
use std::path::Path;

/// The EXIF data of a picture file, as far as they can be read; `None` without any.
pub fn read(file: &mut (impl BufRead + Seek)) -> Option<Exif> {
    let mut reader = Reader::new();
    reader.continue_on_error(true);
    let found = reader.read_from_container(file);
    found.or_else(|e| e.distill_partial_result(|_| {})).ok()
}

/// The first number of an entry of the first picture.
pub fn first_number(exif: &Exif, tag: Tag) -> Option<f64> {
    match &exif.get_field(tag, In::PRIMARY)?.value {
        Value::Rational(list) => list.first().map(|r| r.to_f64()),
        Value::SRational(list) => list.first().map(|r| r.to_f64()),
        other => other.get_uint(0).map(f64::from),
    }
}

/// [`first_number`], if it is finite and above zero.
pub fn above_zero(exif: &Exif, tag: Tag) -> Option<f64> {
    first_number(exif, tag).filter(|n| *n > 0.0 && n.is_finite())
}

/// Stops of light that the sensor got, and the amplification: seconds · ISO / 100 / f². Twice the light is 1 more. `None`
/// without exposure time or ISO; a camera that does not tell its aperture counts as one of a fixed aperture.
pub fn exposure_stops(exif: &Exif) -> Option<f64> {
    let seconds = above_zero(exif, Tag::ExposureTime)?;
    let iso = above_zero(exif, Tag::PhotographicSensitivity)?;
    let aperture = above_zero(exif, Tag::FNumber).unwrap_or(1.0);
    Some((seconds * iso / (100.0 * aperture * aperture)).log2())
}

/// [`exposure_stops`] of a picture file; only its first part is read. `None` of a file that cannot be read, too: an
/// error belongs to the reader of its pixels.
pub fn stops_of(path: &Path) -> Option<f64> {
    exposure_stops(&read(&mut BufReader::new(File::open(path).ok()?))?)
}
