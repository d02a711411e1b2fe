//! Textures of triangles: pictures, and the places of triangles on them.

use crate::error::Result;
use crate::image::RgbImage;
use crate::limits::Limits;
use crate::math::color::{linear_of_srgb8, srgb8_from_linear};
use crate::parallel;
use glam::{UVec2, Vec2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

mod excerpt;

pub use excerpt::pack_rectangles;

// ---- Where the faces of a mesh are on its pictures ----------------------------------------------

/// The pictures of a mesh, its pages, and the places of its faces on them.
#[derive(Debug, Clone, PartialEq)]
pub struct FaceTexture {
    /// Places of each face's corners on its page: (0, 0) is the upper left corner, (1, 1) the lower
    /// right one. `[F]`
    pub uvs: Vec<[Vec2; 3]>,
    /// Pictures; at least one.
    pub pages: Vec<Arc<Texture>>,
    /// Number of each face's page; empty if all are on the first. `[F]`
    pub page_of: Vec<u16>,
}

impl FaceTexture {
    /// Faces on one picture.
    pub fn new(uvs: Vec<[Vec2; 3]>, page: Arc<Texture>) -> Self {
        Self { uvs, pages: vec![page], page_of: Vec::new() }
    }

    /// Number of the page of a face.
    #[inline(always)]
    pub fn page(&self, face: usize) -> usize {
        self.page_of.get(face).copied().map_or(0, usize::from)
    }

    /// The page of a face.
    #[inline(always)]
    pub fn texture(&self, face: usize) -> &Texture {
        &self.pages[self.page(face)]
    }

    /// The texture of the faces `faces[i]`, without pages that none of them is on.
    pub fn of_faces(&self, faces: &[u32]) -> Self {
        let uvs = parallel::collect(faces.len(), 1 << 13, |at| self.uvs[faces[at] as usize]);
        if self.page_of.is_empty() {
            return Self { uvs, pages: self.pages.clone(), page_of: Vec::new() };
        }
        let page_of =
            parallel::collect(faces.len(), 1 << 13, |at| self.page_of[faces[at] as usize]);
        Self { uvs, pages: self.pages.clone(), page_of }.without_unused_pages()
    }

    /// The style of all pages; the default one where they differ.
    pub fn style(&self) -> TextureStyle {
        let first = self.pages[0].style;
        let is_common = self.pages.iter().all(|page| page.style == first);
        if is_common { first } else { TextureStyle::default() }
    }

    fn without_unused_pages(mut self) -> Self {
        let mut used = vec![false; self.pages.len()];
        for page in &self.page_of {
            used[usize::from(*page)] = true;
        }
        // One page stays, also of no face.
        used[0] |= !used.contains(&true);
        let mut numbers = Vec::with_capacity(used.len());
        let mut next = 0;
        for used in &used {
            numbers.push(next);
            next += u16::from(*used);
        }
        for page in &mut self.page_of {
            *page = numbers[usize::from(*page)];
        }
        let mut used = used.into_iter();
        self.pages.retain(|_| used.next() == Some(true));
        if self.pages.len() == 1 {
            self.page_of.clear();
        }
        self
    }

    /// Appends the faces of another texture, and its pages.
    pub fn append(&mut self, other: &FaceTexture) {
        let number = |page: &Arc<Texture>, pages: &mut Vec<Arc<Texture>>| {
            let existing = pages.iter().position(|other| Arc::ptr_eq(other, page));
            existing.unwrap_or_else(|| {
                pages.push(page.clone());
                pages.len() - 1
            }) as u16
        };
        let numbers: Vec<u16> =
            other.pages.iter().map(|page| number(page, &mut self.pages)).collect();
        let faces = self.uvs.len();
        self.uvs.extend(&other.uvs);
        if self.pages.len() > 1 {
            self.page_of.resize(faces, 0);
            self.page_of.extend((0..other.uvs.len()).map(|face| numbers[other.page(face)]));
        }
    }

    /// Places of the vertices of a mesh with these indices, if faces that share a vertex agree;
    /// `[V]`. Without indices, vertices are the corners of faces. An unused vertex is at the
    /// origin.
    pub fn of_vertices(&self, indices: &[u32], vertices: usize) -> Option<Vec<Vec2>> {
        if indices.is_empty() {
            return Some(self.uvs.as_flattened().to_vec());
        }
        let mut at = vec![Vec2::NAN; vertices];
        for (vertex, uv) in indices.iter().zip(self.uvs.as_flattened()) {
            let of_vertex = &mut at[*vertex as usize];
            if of_vertex.is_nan() {
                *of_vertex = *uv;
            } else if of_vertex != uv {
                return None;
            }
        }
        for uv in at.iter_mut().filter(|uv| uv.is_nan()) {
            *uv = Vec2::ZERO;
        }
        Some(at)
    }

    /// Mean linear colour of a face, from the level where it covers about one texel.
    pub fn mean(&self, face: usize) -> [f32; 3] {
        let [a, b, c] = self.uvs[face];
        let texture = self.texture(face);
        let size = texture.size().as_vec2();
        let texels = ((b - a) * size).perp_dot((c - a) * size).abs() / 2.0;
        texture.sample((a + b + c) / 3.0, 0.5 * libm::log2f(texels.max(1.0)))
    }
}

// ---- Several pages as one picture, for formats that name one ------------------------------------

/// Maximum side of a joined picture, texels.
const MAX_JOINED_SIDE: u32 = 8192;
/// Alignment of the rows where pages begin, texels: mip levels up to the fifth do not mix them.
const PAGE_ALIGNMENT: u32 = 32;

impl FaceTexture {
    /// The same with one page: all below each other, each with as few texels as they need to fit.
    pub fn joined(&self) -> FaceTexture {
        if self.pages.len() == 1 {
            return self.clone();
        }
        let mut halvings = 0;
        let (size, tops) = loop {
            let (size, tops) = self.stack(halvings);
            if size.max_element() <= MAX_JOINED_SIDE
                || size.y <= PAGE_ALIGNMENT * self.pages.len() as u32
            {
                break (size, tops);
            }
            halvings += 1;
        };
        let from = self.pages.iter().map(|page| page.level(halvings));
        let scaled = from.zip(&tops).map(|(from, top)| {
            (
                from,
                from.size.as_vec2() / size.as_vec2(),
                Vec2::new(0.0, *top as f32 / size.y as f32),
            )
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
        let picture = RgbImage { size, rgb, alpha: None };
        let page = Texture::new(picture).with_style(self.style());
        let moved = |(face, uvs): (usize, &[Vec2; 3])| {
            let (_, scale, top) = pages[self.page(face)];
            uvs.map(|uv| uv * scale + top)
        };
        FaceTexture::new(self.uvs.iter().enumerate().map(moved).collect(), Arc::new(page))
    }

    /// Size of a picture of all pages, and the row where each begins.
    fn stack(&self, halvings: usize) -> (UVec2, Vec<u32>) {
        let mut size = UVec2::ZERO;
        let mut tops = Vec::with_capacity(self.pages.len());
        for page in &self.pages {
            let of_page = page.level(halvings).size;
            tops.push(size.y);
            size = UVec2::new(
                size.x.max(of_page.x),
                size.y + of_page.y.next_multiple_of(PAGE_ALIGNMENT),
            );
        }
        (size, tops)
    }
}

// ---- A picture with its mip levels, and sampling as in an engine --------------------------------

/// A picture and its mip levels, each half the size of the previous one, down to one texel. sRGB
/// codes.
#[derive(Debug, Clone)]
pub struct Texture {
    levels: Vec<RgbImage>,
    stored: Option<StoredPicture>,
    /// Filter for drawing and writing.
    pub style: TextureStyle,
}

/// Filter and storage of a picture.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct TextureStyle {
    /// The filter by which it is drawn.
    pub filter: TexelFilter,
    /// True when its file is exact, and it stays so when it is written.
    pub is_exact: bool,
}

/// Filter of a picture.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum TexelFilter {
    /// Between the four nearest texels of the two nearest levels.
    #[default]
    Linear,
    /// The nearest texel of the picture, as of pixel art and palettes.
    Nearest,
    /// The nearest texel of the nearest level.
    NearestOfLevel,
}

/// Equal pixels, whatever the format in a file.
impl PartialEq for Texture {
    fn eq(&self, other: &Self) -> bool {
        self.picture() == other.picture() && self.style.filter == other.style.filter
    }
}

/// Format and size of a picture in its file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct StoredPicture {
    /// "JPEG", "PNG", ...
    pub format: String,
    /// Bytes of the encoded picture.
    pub bytes: u64,
}

impl Texture {
    /// The texture of a picture with at least one texel; its alpha is not used. Levels are means of
    /// four texels in linear light.
    pub fn new(picture: RgbImage) -> Self {
        let mut levels = vec![RgbImage { alpha: None, ..picture }];
        while let Some(finest) = levels.last().filter(|level| level.size.max_element() > 1) {
            levels.push(halved(finest));
        }
        Self { levels, stored: None, style: TextureStyle::default() }
    }

    /// The texture of a picture that a file holds as `bytes`; `place` is for messages.
    ///
    /// # Errors
    ///
    /// A picture that cannot be decoded, or not within `limits`.
    pub fn decoded(place: &Path, bytes: &[u8], limits: &Limits) -> Result<Self> {
        let format =
            image::guess_format(bytes).map_or_else(|_| "?".to_owned(), |f| format!("{f:?}"));
        let stored = StoredPicture { format: format.to_uppercase(), bytes: bytes.len() as u64 };
        let is_exact = stored.format == "PNG";
        let style = TextureStyle { is_exact, ..TextureStyle::default() };
        let picture = RgbImage::from_bytes(place, bytes, limits)?;
        Ok(Self { stored: Some(stored), style, ..Self::new(picture) })
    }

    /// The same in another style.
    pub fn with_style(self, style: TextureStyle) -> Self {
        Self { style, ..self }
    }

    /// Format and size in the file that it was read from; `None` for a new picture.
    pub fn stored(&self) -> Option<&StoredPicture> {
        self.stored.as_ref()
    }

    /// The picture itself.
    pub fn picture(&self) -> &RgbImage {
        &self.levels[0]
    }

    /// The picture, or a mip level of it: the same with half of the texels along each side,
    /// `halvings` times.
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

    /// The linear colour at `uv`, (0, 0) the upper left corner, as engines filter it: between the
    /// four nearest texels of the two levels nearest to `level`. Outside of [0, 1] the border is
    /// repeated.
    pub fn sample(&self, uv: Vec2, level: f32) -> [f32; 3] {
        let level = if level > 0.0 { level.min((self.levels.len() - 1) as f32) } else { 0.0 };
        match self.style.filter {
            TexelFilter::Linear => {}
            TexelFilter::Nearest => return self.nearest(0, uv),
            TexelFilter::NearestOfLevel => return self.nearest(level.round() as usize, uv),
        }
        let finer = level as usize;
        let part = level.fract();
        let near = self.bilinear(finer, uv);
        if part == 0.0 {
            return near;
        }
        let far = self.bilinear(finer + 1, uv);
        [0, 1, 2].map(|c| near[c] + part * (far[c] - near[c]))
    }

    fn nearest(&self, level: usize, uv: Vec2) -> [f32; 3] {
        let level = &self.levels[level];
        // A number that is not finite becomes 0.
        let at = (uv * level.size.as_vec2()).as_uvec2().min(level.size - 1);
        level.rgb[(at.y * level.size.x + at.x) as usize]
            .map(|code| linear_of_srgb8()[usize::from(code)])
    }

    fn bilinear(&self, level: usize, uv: Vec2) -> [f32; 3] {
        let level = &self.levels[level];
        let last = (level.size - 1).as_vec2();
        let at = (uv * level.size.as_vec2() - 0.5).clamp(Vec2::ZERO, last);
        let at = if at.is_finite() { at } else { Vec2::ZERO };
        let corner = at.as_uvec2();
        let part = at.fract();
        let next = (corner + 1).min(level.size - 1);
        let texel = |x: u32, y: u32| {
            level.rgb[(y * level.size.x + x) as usize]
                .map(|code| linear_of_srgb8()[usize::from(code)])
        };
        let [a, b] = [texel(corner.x, corner.y), texel(next.x, corner.y)];
        let [c, d] = [texel(corner.x, next.y), texel(next.x, next.y)];
        [0, 1, 2].map(|i| {
            let top = a[i] + part.x * (b[i] - a[i]);
            let bottom = c[i] + part.x * (d[i] - c[i]);
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
                srgb8_from_linear(
                    four.iter().map(|t| linear[usize::from(t[c])]).sum::<f32>() * 0.25,
                )
            })
        };
        (0..size.x).map(of).collect()
    };
    RgbImage { size, rgb: parallel::map(0..size.y, row).concat(), alpha: None }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::RgbImage;
    use glam::UVec2;

    fn page(code: u8) -> Arc<Texture> {
        Arc::new(Texture::new(RgbImage { size: UVec2::ONE, rgb: vec![[code; 3]], alpha: None }))
    }

    #[test]
    fn appended_faces_keep_their_pages_and_unused_pages_leave() {
        let [a, b, c] = [page(0), page(100), page(200)];
        let uvs = vec![[Vec2::splat(0.5); 3]; 2];
        let of = |page: &Arc<Texture>| FaceTexture::new(uvs.clone(), page.clone());
        let mut all = of(&a);
        all.append(&of(&a));
        assert!(all.page_of.is_empty() && all.pages.len() == 1);
        all.append(&of(&b));
        let both = all.clone();
        all.append(&of(&c));
        all.append(&both);
        assert_eq!(all.page_of, [0, 0, 0, 0, 1, 1, 2, 2, 0, 0, 0, 0, 1, 1]);
        let some = all.of_faces(&[6, 0]);
        assert_eq!((some.page_of, some.pages), (vec![1, 0], vec![a, c.clone()]));
        let one = all.of_faces(&[7]);
        assert_eq!((one.page_of, one.pages), (vec![], vec![c]));
        assert_eq!(all.of_faces(&[]).pages.len(), 1);
    }
}

#[cfg(test)]
mod joined_tests {
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
                let [wants, got] = [&both, &one]
                    .map(|texture| texture.texture(face).sample(texture.uvs[face][k], 0.0));
                assert!((0..3).all(|c| (wants[c] - got[c]).abs() < 1e-3), "{wants:?} {got:?}");
            }
        }
        // A stack that is too high is made coarser.
        both.append(&of(UVec2::new(8, 8192)));
        assert!(both.joined().pages[0].size().max_element() <= MAX_JOINED_SIDE);
    }
}

#[cfg(test)]
mod picture_tests {
    use super::*;

    fn checkered(size: UVec2) -> Texture {
        let at =
            |i: u32| if (i % size.x + i / size.x).is_multiple_of(2) { [255; 3] } else { [0; 3] };
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
    fn texture_sampling_is_exact_at_texels_and_linear_between() {
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
