//! Pictures whose sides are multiples of a number, for formats that store blocks of texels.

use super::faces::FaceTexture;
use super::picture::Texture;
use crate::image::RgbImage;
use crate::parallel::{self, GRAIN};
use glam::UVec2;
use std::sync::Arc;

impl FaceTexture {
    /// The same with pages whose sides are multiples of `side`: the last column and row are repeated. `None` if they are already.
    pub fn padded(&self, side: u32) -> Option<FaceTexture> {
        if self.pages.iter().all(|page| page.size() % side == UVec2::ZERO) {
            return None;
        }
        let padded = |page: &Arc<Texture>| Arc::new(Texture::new(padded(page.picture(), side)));
        let pages: Vec<Arc<Texture>> = parallel::map(&self.pages, |_, page| padded(page));
        let pairs = self.pages.iter().zip(&pages);
        let scales: Vec<_> = pairs.map(|(old, new)| old.size().as_vec2() / new.size().as_vec2()).collect();
        let moved = |face: usize| self.uvs[face].map(|uv| uv * scales[self.page(face)]);
        let uvs = parallel::collect(self.uvs.len(), GRAIN, moved);
        Some(FaceTexture { uvs, pages, page_of: self.page_of.clone() })
    }
}

fn padded(picture: &RgbImage, side: u32) -> RgbImage {
    let size = UVec2::new(picture.size.x.next_multiple_of(side), picture.size.y.next_multiple_of(side));
    let last = picture.size - 1;
    let rgb = parallel::collect(size.element_product() as usize, GRAIN, |i| {
        let at = UVec2::new(i as u32 % size.x, i as u32 / size.x).min(last);
        picture.rgb[(at.y * picture.size.x + at.x) as usize]
    });
    RgbImage { size, rgb, alpha: None }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec2;

    #[test]
    fn padded_pages_show_what_they_showed() {
        let of = |size: UVec2| {
            let rgb = (0..size.element_product()).map(|i| [(i * 7) as u8, (i * 31) as u8, i as u8]).collect();
            let uvs = vec![[Vec2::splat(0.3), Vec2::new(0.9, 0.2), Vec2::new(1.0, 1.0)]];
            FaceTexture::new(uvs, Arc::new(Texture::new(RgbImage { size, rgb, alpha: None })))
        };
        assert!(of(UVec2::new(8, 4)).padded(4).is_none());
        let mut both = of(UVec2::new(7, 5));
        both.append(&of(UVec2::new(8, 12)));
        let padded = both.padded(4).unwrap();
        assert_eq!(padded.pages[0].size(), UVec2::new(8, 8));
        assert_eq!(padded.pages[1].picture(), both.pages[1].picture());
        for face in 0..2 {
            for k in 0..3 {
                let [wants, got] =
                    [&both, &padded].map(|texture| texture.texture(face).sample(texture.uvs[face][k], 0.0));
                assert!((0..3).all(|c| (wants[c] - got[c]).abs() < 1e-4), "{wants:?} {got:?}");
            }
        }
    }
}
