//! A contact sheet: one row per photo, the photo beside drawings of it and maps of their errors.

use glam::UVec2;
use trisplat_scene::image::RgbImage;

/// Widest cell, px.
const CELL: u32 = 480;
/// Space between cells, px.
const GAP: u32 = 6;
/// Its colour.
const GAP_COLOR: [u8; 3] = [236; 3];
/// Most rows; more photos are reduced to an even selection.
const ROWS: usize = 12;

/// The sheet, row by row.
#[derive(Debug, Default)]
pub struct ContactSheet {
    rows: Vec<Vec<RgbImage>>,
}

/// The shown photos among `count`: all, or the first of each equal part, one part per row.
pub fn is_shown(photo: usize, count: usize) -> bool {
    count <= ROWS || photo == 0 || photo * ROWS / count != (photo - 1) * ROWS / count
}

impl ContactSheet {
    /// Adds a row of pictures; wide ones are shrunk.
    pub fn add<'a>(&mut self, cells: impl IntoIterator<Item = &'a RgbImage>) {
        self.rows.push(cells.into_iter().map(shrunk).collect());
    }

    /// The whole sheet.
    pub fn to_pixels(&self) -> RgbImage {
        let width = self.rows.iter().map(|row| row.iter().map(|c| c.size.x + GAP).sum::<u32>() + GAP);
        let height_of = |row: &[RgbImage]| row.iter().map(|c| c.size.y).max().unwrap_or(0);
        let height: u32 = self.rows.iter().map(|row| height_of(row) + GAP).sum::<u32>() + GAP;
        let size = UVec2::new(width.max().unwrap_or(GAP), height);
        let mut rgb = vec![GAP_COLOR; size.x as usize * size.y as usize];
        let mut top = GAP;
        for row in &self.rows {
            let mut left = GAP;
            for cell in row {
                for (y, line) in cell.rgb.chunks(cell.size.x as usize).enumerate() {
                    let at = (top as usize + y) * size.x as usize + left as usize;
                    rgb[at..at + line.len()].copy_from_slice(line);
                }
                left += cell.size.x + GAP;
            }
            top += height_of(row) + GAP;
        }
        RgbImage { size, rgb, alpha: None }
    }
}

fn shrunk(cell: &RgbImage) -> RgbImage {
    let plain = RgbImage { alpha: None, ..cell.clone() };
    if cell.size.x <= CELL {
        return plain;
    }
    plain.downscaled(UVec2::new(CELL, (cell.size.y * CELL / cell.size.x).max(1)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(width: u32, height: u32, code: u8) -> RgbImage {
        let rgb = vec![[code; 3]; (width * height) as usize];
        RgbImage { size: UVec2::new(width, height), rgb, alpha: None }
    }

    #[test]
    fn cells_are_laid_out_in_rows_with_gaps_between() {
        let mut sheet = ContactSheet::default();
        sheet.add([&flat(4, 3, 1), &flat(4, 2, 2)]);
        sheet.add([&flat(960, 100, 3)]);
        let picture = sheet.to_pixels();
        assert_eq!(picture.size.to_array(), [CELL + 2 * GAP, 3 + 50 + 3 * GAP]);
        let at = |x: u32, y: u32| picture.rgb[(y * picture.size.x + x) as usize][0];
        assert_eq!([at(0, 0), at(6, 6), at(9, 8), at(10, 6), at(16, 6), at(16, 8)], [236, 1, 1, 236, 2, 236]);
        assert_eq!([at(6, 15), at(485, 64), at(486, 64)], [3, 3, 236]);
        assert_eq!(ContactSheet::default().to_pixels().size.to_array(), [GAP, GAP]);
    }

    #[test]
    fn at_most_a_screenful_of_photos_is_shown() {
        for count in [1, 11, 12, 13, 25, 300] {
            let shown = (0..count).filter(|&i| is_shown(i, count)).count();
            assert_eq!(shown, count.min(ROWS), "of {count}");
            assert!(is_shown(0, count));
        }
    }
}
