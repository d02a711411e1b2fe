//! A picture with its mip levels, and sampling as in an engine.

use crate::error::Result;
use crate::image::RgbImage;
use crate::limits::Limits;
use crate::math::color::linear_of_srgb8;
use crate::math::srgb8::srgb8_from_linear;
use crate::parallel;
use glam::{UVec2, Vec2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A picture and its mip levels, each half the size of the previous one, down to one texel. sRGB codes.
#[derive(Debug, Clone)]
pub struct Texture {
    levels: Vec<RgbImage>,
    stored: Option<StoredPicture>,
}

/// By what is seen, however a file holds it.
impl PartialEq for Texture {
    fn eq(&self, other: &Self) -> bool {
        self.picture() == other.picture()
    }
}

/// How a file holds a picture.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct StoredPicture {
    /// "JPEG", "PNG", ...
    pub format: String,
    /// Bytes of the encoded picture.
    pub bytes: u64,
}

impl Texture {
    /// The texture of a picture with at least one texel; its alpha is not used. Levels are means of four
    /// texels in linear light.
    pub fn new(picture: RgbImage) -> Self {
        let mut levels = vec![RgbImage { alpha: None, ..picture }];
        while let Some(finest) = levels.last().filter(|level| level.size.max_element() > 1) {
            levels.push(halved(finest));
        }
        Self { levels, stored: None }
    }

    /// The texture of a picture that a file holds as `bytes`; `place` is for messages.
    ///
    /// Errors: what cannot be decoded, or not within `limits`.
    pub fn decoded(place: &Path, bytes: &[u8], limits: &Limits) -> Result<Self> {
        let format = image::guess_format(bytes).map_or_else(|_| "?".to_owned(), |f| format!("{f:?}"));
        let stored = StoredPicture { format: format.to_uppercase(), bytes: bytes.len() as u64 };
        Ok(Self { stored: Some(stored), ..Self::new(RgbImage::from_bytes(place, bytes, limits)?) })
    }

    /// How the file that it was read from holds it; `None` of a new one.
    pub fn stored(&self) -> Option<&StoredPicture> {
        self.stored.as_ref()
    }

    /// The picture itself.
    pub fn picture(&self) -> &RgbImage {
        &self.levels[0]
    }

    /// The picture, or a mip level of it: the same with half of the texels along each side, `halvings` times.
    pub fn level(&self, halvings: usize) -> &RgbImage {
        &self.levels[halvings.min(self.levels.len() - 1)]
    }

    /// The picture and all its mip levels, the finest first.
    pub fn levels(&self) -> &[RgbImage] {
        &self.levels
    }

    /// Width and height, texels.
    pub fn size(&self) -> UVec2 {
        self.picture().size
    }

    /// The linear colour at `uv`, (0, 0) the upper left corner, as engines filter it: between the four nearest texels of the two
    /// levels nearest to `level`. Outside of [0, 1] the border is repeated.
    pub fn sample(&self, uv: Vec2, level: f32) -> [f32; 3] {
        let level = if level > 0.0 { level.min((self.levels.len() - 1) as f32) } else { 0.0 };
        let (finer, part) = (level as usize, level.fract());
        let near = self.bilinear(finer, uv);
        if part == 0.0 {
            return near;
        }
        let far = self.bilinear(finer + 1, uv);
        [0, 1, 2].map(|c| near[c] + part * (far[c] - near[c]))
    }

    fn bilinear(&self, level: usize, uv: Vec2) -> [f32; 3] {
        let level = &self.levels[level];
        let last = (level.size - 1).as_vec2();
        let at = (uv * level.size.as_vec2() - 0.5).clamp(Vec2::ZERO, last);
        let at = if at.is_finite() { at } else { Vec2::ZERO };
        let (corner, part) = (at.as_uvec2(), at.fract());
        let next = (corner + 1).min(level.size - 1);
        let texel = |x: u32, y: u32| {
            level.rgb[(y * level.size.x + x) as usize].map(|code| linear_of_srgb8()[usize::from(code)])
        };
        let [a, b] = [texel(corner.x, corner.y), texel(next.x, corner.y)];
        let [c, d] = [texel(corner.x, next.y), texel(next.x, next.y)];
        [0, 1, 2].map(|i| {
            let (top, bottom) = (a[i] + part.x * (b[i] - a[i]), c[i] + part.x * (d[i] - c[i]));
            top + part.y * (bottom - top)
        })
    }
}

/// A level from the next finer one; for an odd size the last row or column counts twice.
fn halved(finer: &RgbImage) -> RgbImage {
    let size = (finer.size / 2).max(UVec2::ONE);
    let linear = linear_of_srgb8();
    let texel = |x: u32, y: u32| finer.rgb[(y.min(finer.size.y - 1) * finer.size.x + x) as usize];
    let row = |_, y: u32| -> Vec<[u8; 3]> {
        let of = |x: u32| {
            let right = (2 * x + 1).min(finer.size.x - 1);
            let four = [(2 * x, 2 * y), (right, 2 * y), (2 * x, 2 * y + 1), (right, 2 * y + 1)];
            let four = four.map(|(x, y)| texel(x, y));
            [0, 1, 2].map(|c| {
                srgb8_from_linear(four.iter().map(|t| linear[usize::from(t[c])]).sum::<f32>() * 0.25)
            })
        };
        (0..size.x).map(of).collect()
    };
    RgbImage { size, rgb: parallel::map(0..size.y, row).concat(), alpha: None }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checkered(size: UVec2) -> Texture {
        let at = |i: u32| if (i % size.x + i / size.x).is_multiple_of(2) { [255; 3] } else { [0; 3] };
        Texture::new(RgbImage { size, rgb: (0..size.x * size.y).map(at).collect(), alpha: None })
    }

    #[test]
    fn levels_are_means_in_linear_light_down_to_one_texel() {
        let texture = checkered(UVec2::new(8, 2));
        let sizes: Vec<UVec2> = texture.levels.iter().map(|level| level.size).collect();
        assert_eq!(sizes, [(8, 2), (4, 1), (2, 1), (1, 1)].map(UVec2::from));
        for level in 1..4 {
            // Half of the light is code 188, not 128.
            assert!(texture.levels[level].rgb.iter().all(|t| *t == [188; 3]), "{level}");
        }
    }

    #[test]
    fn sampling_is_exact_at_texels_and_linear_between_them_and_between_levels() {
        let texture = checkered(UVec2::new(4, 4));
        let at = |x: f32, y: f32| Vec2::new(x, y) / 4.0;
        assert_eq!(texture.sample(at(0.5, 0.5), 0.0), [1.0; 3]);
        assert_eq!(texture.sample(at(1.5, 0.5), 0.0), [0.0; 3]);
        assert_eq!(texture.sample(at(0.75, 0.5), -3.0), [0.75; 3]);
        assert_eq!(texture.sample(at(1.0, 1.0), 0.0), [0.5; 3]);
        let far = texture.sample(at(0.5, 0.5), 1.0);
        assert!((far[0] - 0.5).abs() < 4e-3, "{far:?}");
        assert_eq!(texture.sample(at(0.5, 0.5), 0.5), far.map(|x| 0.5 + 0.5 * x));
        assert_eq!(texture.sample(at(0.5, 0.5), 99.0), texture.sample(at(3.0, 3.0), 2.0));
        for odd in [Vec2::splat(f32::NAN), Vec2::splat(f32::INFINITY), Vec2::splat(-9.0)] {
            assert!(texture.sample(odd, f32::NAN).iter().all(|x| x.is_finite()));
        }
    }
}
