//! Several pages as one picture, for formats that name one.

use super::faces::FaceTexture;
use super::picture::Texture;
use crate::image::RgbImage;
use crate::parallel;
use glam::{UVec2, Vec2};
use std::sync::Arc;

/// Largest side of a joined picture, texels.
const LARGEST: u32 = 8192;
/// Pages begin at multiples of this, so that mip levels up to the fifth do not mix them.
const WHOLE: u32 = 32;

impl FaceTexture {
    /// The same with one page: all below each other, each with as few texels as they need to fit.
    pub fn joined(&self) -> FaceTexture {
        if self.pages.len() == 1 {
            return self.clone();
        }
        let mut halvings = 0;
        let (size, tops) = loop {
            let (size, tops) = self.stacked(halvings);
            if size.max_element() <= LARGEST || size.y <= WHOLE * self.pages.len() as u32 {
                break (size, tops);
            }
            halvings += 1;
        };
        let from = self.pages.iter().map(|page| page.level(halvings));
        let scaled = from.zip(&tops).map(|(from, top)| {
            (from, from.size.as_vec2() / size.as_vec2(), Vec2::new(0.0, *top as f32 / size.y as f32))
        });
        let pages: Vec<(&RgbImage, Vec2, Vec2)> = scaled.collect();
        let row = |_, y: u32| {
            let page = tops.partition_point(|top| *top <= y) - 1;
            let from = pages[page].0;
            let y = (y - tops[page]).min(from.size.y - 1);
            let row = &from.rgb[(y * from.size.x) as usize..][..from.size.x as usize];
            // The border of a picture continues beside and below it.
            let rest = std::iter::repeat(&row[row.len() - 1]);
            row.iter().chain(rest).take(size.x as usize).copied().collect::<Vec<_>>()
        };
        let rgb = parallel::map(0..size.y, row).concat();
        let page = Texture::new(RgbImage { size, rgb, alpha: None });
        let moved = |(face, uvs): (usize, &[Vec2; 3])| {
            let (_, scale, top) = pages[self.page(face)];
            uvs.map(|uv| uv * scale + top)
        };
        FaceTexture::new(self.uvs.iter().enumerate().map(moved).collect(), Arc::new(page))
    }

    /// Size of a picture of all pages, and the row where each begins.
    fn stacked(&self, halvings: usize) -> (UVec2, Vec<u32>) {
        let (mut size, mut tops) = (UVec2::ZERO, Vec::with_capacity(self.pages.len()));
        for page in &self.pages {
            let of_page = page.level(halvings).size;
            tops.push(size.y);
            size = UVec2::new(size.x.max(of_page.x), size.y + of_page.y.next_multiple_of(WHOLE));
        }
        (size, tops)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joined_pages_show_what_each_showed() {
        let at = |i: u32, n: u32| [(i * 37 % 251) as u8, (i % n) as u8, (i / n) as u8];
        let of = |size: UVec2| {
            let rgb = (0..size.element_product()).map(|i| at(i, size.x)).collect();
            let uvs = vec![[Vec2::splat(0.2), Vec2::new(0.9, 0.3), Vec2::new(0.4, 0.75)]];
            FaceTexture::new(uvs, Arc::new(Texture::new(RgbImage { size, rgb, alpha: None })))
        };
        let mut both = of(UVec2::new(40, 50));
        both.append(&of(UVec2::new(64, 30)));
        let one = both.joined();
        assert_eq!((one.pages[0].size(), one.pages.len()), (UVec2::new(64, 96), 1));
        for face in 0..2 {
            for k in 0..3 {
                let [wants, got] =
                    [&both, &one].map(|texture| texture.texture(face).sample(texture.uvs[face][k], 0.0));
                assert!((0..3).all(|c| (wants[c] - got[c]).abs() < 1e-3), "{wants:?} {got:?}");
            }
        }
        // What is too high is made coarser.
        both.append(&of(UVec2::new(8, 8192)));
        assert!(both.joined().pages[0].size().max_element() <= LARGEST);
    }
}
