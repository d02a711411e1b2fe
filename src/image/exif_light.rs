//! The light that a photo caught, by its EXIF data.

use exif::{Exif, In, Tag, Value};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Stops of light that the sensor got, and the amplification: seconds · ISO / 100 / f². Twice the light is 1 more. `None`
/// without exposure time or ISO; a camera that does not tell its aperture counts as one of a fixed aperture.
pub(crate) fn exposure_stops(exif: &Exif) -> Option<f64> {
    let number = |tag| exif.get_field(tag, In::PRIMARY).and_then(|field| first_number(&field.value));
    let above_zero = |tag| number(tag).filter(|n: &f64| *n > 0.0 && n.is_finite());
    let light = above_zero(Tag::ExposureTime).zip(above_zero(Tag::PhotographicSensitivity));
    light.map(|(seconds, iso)| {
        let aperture = above_zero(Tag::FNumber).unwrap_or(1.0);
        (seconds * iso / (100.0 * aperture * aperture)).log2()
    })
}

/// [`exposure_stops`] of a picture file; only its first part is read. `None` of a file that cannot be read, too: an
/// error belongs to the reader of its pixels.
pub(crate) fn stops_of(path: &Path) -> Option<f64> {
    let mut reader = exif::Reader::new();
    reader.continue_on_error(true);
    let found = reader.read_from_container(&mut BufReader::new(File::open(path).ok()?));
    exposure_stops(&found.or_else(|e| e.distill_partial_result(|_| {})).ok()?)
}

/// The first number of an entry.
pub(crate) fn first_number(value: &Value) -> Option<f64> {
    match value {
        Value::Rational(list) => list.first().map(|r| r.to_f64()),
        Value::SRational(list) => list.first().map(|r| r.to_f64()),
        other => other.get_uint(0).map(f64::from),
    }
}
