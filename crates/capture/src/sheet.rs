//! Draws a contact sheet of gaps in a capture.

use super::verdict::Gap;
use glam::UVec2;
use std::path::Path;
use trisplat_scene::{Limits, Result, image::RgbImage};

/// Most gaps on the sheet.
const ROWS: usize = 6;
/// Size of a cell and the space between cells, px.
const CELL: UVec2 = UVec2::new(320, 240);
const SPACE: u32 = 8;
const GROUND: [u8; 3] = [24; 3];

/// Draws three photos from `images` per gap: the one before it, one without a pose, the one after it.
///
/// Errors: photos that cannot be read.
pub(super) fn draw(images: &Path, gaps: &[Gap]) -> Result<RgbImage> {
    let rows = gaps.len().min(ROWS) as u32;
    let size = UVec2::new(3, rows) * (CELL + SPACE) + SPACE;
    let mut sheet = RgbImage { size, rgb: vec![GROUND; (size.x * size.y) as usize], alpha: None };
    for (gap, row) in gaps.iter().zip(0..rows) {
        for (name, column) in [&gap.after, &gap.example, &gap.before].into_iter().zip(0..) {
            let Some(name) = name else { continue };
            let corner = UVec2::new(column, row) * (CELL + SPACE) + SPACE;
            put(&mut sheet, corner, &fitting(&images.join(name))?);
        }
    }
    Ok(sheet)
}

/// A photo scaled to fit a cell.
fn fitting(path: &Path) -> Result<RgbImage> {
    let full = RgbImage::size_of(path, &Limits::DEFAULT)?;
    let ratio = (CELL.as_dvec2() / full.as_dvec2()).min_element().min(1.0);
    let size = (full.as_dvec2() * ratio).floor().as_uvec2().max(UVec2::ONE);
    Ok(RgbImage::load_reduced(path, size, &Limits::DEFAULT)?.0.over(GROUND).downscaled(size))
}

/// Centres a picture in the cell at `corner`.
fn put(sheet: &mut RgbImage, corner: UVec2, picture: &RgbImage) {
    let at = corner + (CELL - picture.size) / 2;
    for (row, y) in picture.rgb.chunks_exact(picture.size.x as usize).zip(at.y..) {
        let start = (y * sheet.size.x + at.x) as usize;
        sheet.rgb[start..start + row.len()].copy_from_slice(row);
    }
}
