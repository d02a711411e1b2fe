//! The rows as a page: plots of any two quantities, the table, and the pictures behind every point.

use super::row::MeasuredRow;
use crate::atomic::AtomicFile;
use crate::error::{Error, Result};
use crate::image::Pixels;
use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use serde::Serialize;
use std::io::Write;
use std::path::Path;

/// The page without rows, built from `page/src/cost`.
const PAGE: &str = include_str!("../../../page/dist/cost.html");
/// Longer side of a picture, px.
const SIDE: u32 = 240;
/// Of 100.
const JPEG_QUALITY: u8 = 85;

/// What the page holds.
#[derive(Serialize)]
struct PageData<'a> {
    generator: String,
    rows: &'a [MeasuredRow],
    /// A picture per row as a data URL; null for none.
    pictures: Vec<Option<String>>,
    /// The photo that they show.
    photo: String,
}

/// Writes the page. `pictures` belong to `rows`, and all show what `photo` shows.
pub(super) fn write(
    path: &Path,
    rows: &[MeasuredRow],
    pictures: &[Option<Pixels>],
    photo: &Pixels,
) -> Result<()> {
    let pictures = pictures.iter().map(|picture| picture.as_ref().map(data_url).transpose());
    let data = PageData {
        generator: crate::report::generator(),
        rows,
        pictures: pictures.collect::<Result<_>>()?,
        photo: data_url(photo)?,
    };
    let mut file = AtomicFile::create(path)?;
    file.write_all(page(&data).as_bytes()).map_err(|e| Error::io(path, e))?;
    file.commit().map(drop)
}

/// The page with its data; "<" is escaped, so that no text in it ends the script.
fn page(data: &PageData<'_>) -> String {
    let json = serde_json::to_string(data).unwrap_or_default().replace('<', "\\u003c");
    PAGE.replace("@DATA@", &json)
}

/// A small JPEG as a data URL.
fn data_url(picture: &Pixels) -> Result<String> {
    let share = f64::from(SIDE) / f64::from(picture.size.max_element().max(1));
    let small = match share < 1.0 {
        true => {
            picture.downscaled((picture.size.as_dvec2() * share).round().as_uvec2().max(glam::UVec2::ONE))
        }
        false => picture.clone(),
    };
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY)
        .encode(bytemuck::cast_slice(&small.rgb), small.size.x, small.size.y, ExtendedColorType::Rgb8)
        .map_err(|e| Error::invalid("picture", small.size, e.to_string()))?;
    Ok(format!("data:image/jpeg;base64,{}", BASE64.encode(bytes)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::UVec2;

    #[test]
    fn the_page_holds_all_it_needs() {
        assert_eq!(PAGE.matches("@DATA@").count(), 1);
        assert!(PAGE.len() < 400_000, "{} bytes", PAGE.len());
        assert!(PAGE.contains("Chart.js") && PAGE.contains("Permission is hereby granted"));
        for outside in ["<script src", "<link", "@import"] {
            assert!(!PAGE.contains(outside), "{outside}: the page must hold all it needs");
        }
    }

    #[test]
    fn text_in_the_data_cannot_end_the_script() {
        let data = PageData {
            generator: "</script><b>".into(),
            rows: &[],
            pictures: Vec::new(),
            photo: String::new(),
        };
        assert!(!page(&data).contains("</script><b>"));
    }

    #[test]
    fn pictures_are_small_jpegs() {
        let picture = Pixels { size: UVec2::new(480, 30), rgb: vec![[200, 100, 50]; 480 * 30], alpha: None };
        let url = data_url(&picture).unwrap();
        let bytes = BASE64.decode(url.strip_prefix("data:image/jpeg;base64,").unwrap()).unwrap();
        let decoded = image::load_from_memory(&bytes).unwrap().into_rgb8();
        assert_eq!(decoded.dimensions(), (240, 15));
        assert!(decoded.get_pixel(100, 7).0.iter().zip([200, 100, 50]).all(|(a, b)| a.abs_diff(b) < 4));
    }
}
