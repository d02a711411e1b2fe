//! The texture of parts of a mesh, each with a picture of its own or with none.
//!
//! In: a mesh whose colours multiply its pictures, and the faces that have one. Out: a texture of
//! all faces. A face that shows one tile of a picture in one tint keeps the picture as its page.
//! Every other face becomes a patch of one more page, the atlas: faces whose picture repeats or
//! goes beyond the border, whose corners have different tints, or that have no picture.

use crate::image::RgbImage;
use crate::math::color::{linear_of_srgb8, srgb8_from_linear};
use crate::mesh::{Colors, Mesh};
use crate::report::counted;
use crate::{FaceTexture, TexelFilter, Texture, TextureStyle, pack_rectangles, parallel};
use glam::{UVec2, Vec2};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// Maximum number of pictures that stay pages of their own: each is a draw call of an engine.
const MAX_PAGES: usize = 255;
/// Maximum number of texels of all tinted copies of pictures.
const MAX_TINTED_TEXELS: u64 = 1 << 26;
/// Maximum side of the atlas, texels.
const MAX_ATLAS_SIDE: u32 = 8192;
/// Maximum side of a patch, texels.
const MAX_PATCH_SIDE: f32 = 4096.0;
/// Tolerance of texture coordinates beyond the border, as a share of the picture.
const BORDER_TOLERANCE: f32 = 1e-3;
/// Texels around a patch that filters may touch.
const MARGIN: f32 = 2.0;
/// Patches begin at multiples of this, so that two mip levels do not mix them.
const STEP: u32 = 4;
/// Maximum number of times that patches are halved before they lose their picture.
const MAX_HALVINGS: usize = 14;

const WHITE: Tints = [[255; 3]; 3];

/// sRGB codes of a face's corners, which multiply its picture.
type Tints = [[u8; 3]; 3];

/// Wrapping mode of a picture beyond its border, along one axis.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Wrap {
    /// The picture repeats.
    #[default]
    Repeat,
    /// Every second tile is reversed.
    Mirror,
    /// The border texels are repeated.
    Clamp,
}

/// Faces of a part of a mesh, with texture coordinates.
#[derive(Debug)]
pub struct PaintedFaces {
    /// Number of the picture.
    pub image: usize,
    /// Consecutive faces of the mesh, after those of earlier parts.
    pub faces: Range<usize>,
    /// Texture coordinates of their corners; not finite where a corner has none.
    pub uvs: Vec<[Vec2; 3]>,
    /// Along u and v.
    pub wrap: [Wrap; 2],
    /// The filter of the picture.
    pub filter: TexelFilter,
}

impl Wrap {
    /// Coordinates of a face moved into [0, 1]; none if they show more than one tile.
    fn into_unit(self, at: [f32; 3]) -> Option<[f32; 3]> {
        let low = at[0].min(at[1]).min(at[2]);
        let high = at[0].max(at[1]).max(at[2]);
        let tile = match (low + BORDER_TOLERANCE).floor() {
            _ if low >= -BORDER_TOLERANCE && high <= 1.0 + BORDER_TOLERANCE => 0.0,
            _ if self == Self::Clamp && (low >= 1.0 || high <= 0.0) => 0.0,
            _ if self == Self::Clamp => return None,
            tile if high - tile <= 1.0 + BORDER_TOLERANCE => tile,
            _ => return None,
        };
        let reversed = self == Self::Mirror && tile.rem_euclid(2.0) == 1.0;
        Some(at.map(|x| if reversed { tile + 1.0 - x } else { x - tile }.clamp(0.0, 1.0)))
    }

    /// The texel of a row of `size` texels at the unwrapped place `at`.
    fn texel(self, at: i64, size: u32) -> u32 {
        let size = i64::from(size);
        let texel = match self {
            Self::Clamp => at.clamp(0, size - 1),
            Self::Mirror if at.rem_euclid(2 * size) >= size => {
                2 * size - 1 - at.rem_euclid(2 * size)
            }
            Self::Repeat | Self::Mirror => at.rem_euclid(size),
        };
        texel as u32
    }
}

/// Gives `mesh` a texture, made of the `textures` that could be read. Returns notes for the user.
pub fn paint(
    mesh: &mut Mesh,
    parts: Vec<PaintedFaces>,
    textures: &BTreeMap<usize, Option<Arc<Texture>>>,
) -> Vec<String> {
    let mut draft = AtlasDraft::default();
    let mut filtered: BTreeMap<(usize, TexelFilter), Arc<Texture>> = BTreeMap::new();
    for part in &parts {
        if let Some(Some(texture)) = textures.get(&part.image) {
            let texture = filtered.entry((part.image, part.filter)).or_insert_with(|| {
                let style = TextureStyle { filter: part.filter, ..texture.style };
                if style == texture.style {
                    return texture.clone();
                }
                Arc::new(Texture::clone(texture).with_style(style))
            });
            draft.add_plain(mesh, part.faces.start);
            draft.add(mesh, part, texture);
        }
    }
    if draft.faces.is_empty() {
        return Vec::new();
    }
    draft.add_plain(mesh, mesh.face_count());
    draft.finish(mesh)
}

/// A texture while its faces are added.
#[derive(Default)]
struct AtlasDraft {
    /// Page, or patch, and the places of every face so far.
    faces: Vec<(FaceSource, [Vec2; 3])>,
    pages: Vec<Arc<Texture>>,
    /// Page number of each picture and tint.
    page_numbers: BTreeMap<(usize, TexelFilter, [u8; 3]), u16>,
    tinted_texels: u64,
    patches: Vec<AtlasPatch>,
    patch_numbers: BTreeMap<PatchKey, u32>,
    /// Number of faces with a picture but without texture coordinates.
    faces_without_uvs: u64,
}

/// The picture and how it goes on, the tints, and the part of the picture.
type PatchKey = (Option<(usize, [Wrap; 2], TexelFilter)>, Tints, [u32; 4]);

#[derive(Clone, Copy)]
enum FaceSource {
    Page(u16),
    Patch(u32),
}

/// A part of the atlas.
struct AtlasPatch {
    /// None for colours alone.
    picture: Option<(Arc<Texture>, [Wrap; 2])>,
    tints: Tints,
    /// The corners of the face that has the tints.
    uvs: [Vec2; 3],
}

/// The texels of a patch.
struct PatchExtent {
    /// The mip level of its picture; none for colours alone.
    level: Option<usize>,
    /// The first texel, which may lie outside of the picture.
    low: Vec2,
    size: UVec2,
}

impl AtlasDraft {
    /// The faces before `end` that are not there yet: they have no picture.
    fn add_plain(&mut self, mesh: &Mesh, end: usize) {
        for face in self.faces.len()..end {
            self.add_patch(None, tints(mesh, face), [Vec2::ZERO; 3]);
        }
    }

    fn add(&mut self, mesh: &Mesh, part: &PaintedFaces, texture: &Arc<Texture>) {
        let Some(first) = part.faces.clone().next() else { return };
        let tint = tints(mesh, first)[0];
        let is_even = part.faces.clone().all(|face| tints(mesh, face) == [tint; 3]);
        for (face, uvs) in part.faces.clone().zip(&part.uvs) {
            let of_face = tints(mesh, face);
            if !uvs.iter().all(|uv| uv.is_finite()) {
                self.faces_without_uvs += 1;
                self.add_patch(None, of_face, [Vec2::ZERO; 3]);
                continue;
            }
            let along = |axis: usize| part.wrap[axis].into_unit(uvs.map(|uv| uv[axis]));
            let within = along(0).zip(along(1)).filter(|_| is_even || of_face == WHITE);
            let page = within.and_then(|_| self.page(part.image, of_face[0], texture));
            match (page, within) {
                (Some(page), Some((u, v))) => {
                    let uvs = [0, 1, 2].map(|k| Vec2::new(u[k], v[k]));
                    self.faces.push((FaceSource::Page(page), uvs));
                }
                _ => self.add_patch(Some((part, texture)), of_face, *uvs),
            }
        }
    }

    /// Number of the page of a picture in a tint; none if it would be one too many.
    fn page(&mut self, image: usize, tint: [u8; 3], texture: &Arc<Texture>) -> Option<u16> {
        let key = (image, texture.style.filter, tint);
        if let Some(number) = self.page_numbers.get(&key) {
            return Some(*number);
        }
        let texels = u64::from(texture.size().element_product());
        let is_tinted = tint != WHITE[0];
        if self.pages.len() == MAX_PAGES
            || is_tinted && self.tinted_texels + texels > MAX_TINTED_TEXELS
        {
            return None;
        }
        let mut page = texture.clone();
        if is_tinted {
            self.tinted_texels += texels;
            let picture = texture.picture();
            let tint = linear(tint);
            let rgb =
                parallel::collect(picture.rgb.len(), 1 << 13, |i| product(picture.rgb[i], tint));
            let picture = RgbImage { size: picture.size, rgb, alpha: None };
            page = Arc::new(Texture::new(picture).with_style(texture.style));
        }
        let number = self.pages.len() as u16;
        self.pages.push(page);
        self.page_numbers.insert(key, number);
        Some(number)
    }

    /// A face that the atlas shows. Faces with the same part of a picture in one tint have one
    /// patch.
    fn add_patch(
        &mut self,
        of: Option<(&PaintedFaces, &Arc<Texture>)>,
        tints: Tints,
        mut uvs: [Vec2; 3],
    ) {
        let mut picture = None;
        if let Some((part, texture)) = of {
            // The first tile is as good as any, and has the finest numbers.
            let low = uvs[0].min(uvs[1]).min(uvs[2]);
            let start = |axis: usize| match part.wrap[axis] {
                Wrap::Repeat => low[axis].floor(),
                Wrap::Mirror => 2.0 * (low[axis] / 2.0).floor(),
                Wrap::Clamp => 0.0,
            };
            let start = Vec2::new(start(0), start(1));
            uvs = uvs.map(|uv| uv - start);
            picture = Some((texture.clone(), part.wrap));
        }
        let low = uvs[0].min(uvs[1]).min(uvs[2]);
        let high = uvs[0].max(uvs[1]).max(uvs[2]);
        let key = (
            of.map(|(part, _)| (part.image, part.wrap, part.filter)),
            tints,
            [low.x, low.y, high.x, high.y].map(f32::to_bits),
        );
        let next = self.patches.len() as u32;
        let number = if of.is_none() || tints == [tints[0]; 3] {
            *self.patch_numbers.entry(key).or_insert(next)
        } else {
            next
        };
        if number == next {
            self.patches.push(AtlasPatch { picture, tints, uvs });
        }
        self.faces.push((FaceSource::Patch(number), uvs));
    }

    fn finish(mut self, mesh: &mut Mesh) -> Vec<String> {
        let mut notes = Vec::new();
        if self.faces_without_uvs > 0 {
            let faces = counted(self.faces_without_uvs, "textured triangle");
            notes.push(format!(
                "{faces} without texture coordinates have the colour of their material"
            ));
        }
        let mut patch_places = Vec::new();
        let atlas = self.pages.len() as u16;
        if !self.patches.is_empty() {
            let Some((frames, size, places)) = self.arrange() else {
                let pieces = counted(self.patches.len() as u64, "piece");
                notes.push(format!(
                    "textures are not kept: an atlas of {pieces} is too large; bake parts of the file"
                ));
                return notes;
            };
            notes.extend(self.coarseness_note(&frames));
            let page = draw_atlas(&self.patches, &frames, size, &places);
            let style = self.atlas_style();
            self.pages.push(Arc::new(Texture::new(page).with_style(style)));
            patch_places = frames.into_iter().zip(places).collect();
        }
        let size = self.pages.last().map_or(Vec2::ONE, |page| page.size().as_vec2());
        let of_face = |face: usize| match self.faces[face] {
            (FaceSource::Page(page), uvs) => (page, uvs),
            (FaceSource::Patch(number), uvs) => {
                let (frame, place) = &patch_places[number as usize];
                let within = self.patches[number as usize].places(frame, uvs);
                (atlas, within.map(|at| (at + place.as_vec2()) / size))
            }
        };
        let faces = parallel::collect(self.faces.len(), 1 << 13, of_face);
        let page_of = if self.pages.len() == 1 {
            Vec::new()
        } else {
            faces.iter().map(|face| face.0).collect()
        };
        let texture = FaceTexture {
            uvs: faces.iter().map(|face| face.1).collect(),
            pages: self.pages,
            page_of,
        };
        mesh.colors =
            Colors::Face(parallel::collect(mesh.face_count(), 1, |face| texture.mean(face)));
        mesh.texture = Some(texture);
        notes
    }

    /// The style of all pictures in the atlas; the default one where they differ.
    fn atlas_style(&self) -> TextureStyle {
        let mut styles =
            self.patches.iter().filter_map(|patch| Some(patch.picture.as_ref()?.0.style));
        let first = styles.next().unwrap_or_default();
        if styles.all(|style| style == first) { first } else { TextureStyle::default() }
    }

    /// The texels of all patches, at the finest level that fits, the size of the atlas, and the
    /// place of each.
    fn arrange(&self) -> Option<(Vec<PatchExtent>, UVec2, Vec<UVec2>)> {
        (0..=MAX_HALVINGS).find_map(|halvings| {
            let frames: Vec<PatchExtent> =
                self.patches.iter().map(|patch| patch.frame(halvings)).collect();
            let sizes: Vec<UVec2> = frames.iter().map(|frame| frame.size).collect();
            pack_rectangles(&sizes, MAX_ATLAS_SIDE).map(|(size, places)| (frames, size, places))
        })
    }

    /// Note for the user about patches that are coarser than their pictures.
    fn coarseness_note(&self, frames: &[PatchExtent]) -> Option<String> {
        let is_coarse = |face: &&(FaceSource, [Vec2; 3])| match face.0 {
            FaceSource::Patch(number) => {
                self.patches[number as usize].picture.is_some()
                    && frames[number as usize].level != Some(0)
            }
            FaceSource::Page(_) => false,
        };
        let count = self.faces.iter().filter(is_coarse).count() as u64;
        (count > 0).then(|| {
            let faces = counted(count, "triangle");
            format!("the pictures of {faces} repeat too often for an atlas of {MAX_ATLAS_SIDE} texels a side: they are coarser")
        })
    }
}

impl AtlasPatch {
    fn is_even(&self) -> bool {
        self.tints == [self.tints[0]; 3]
    }

    /// Its texels from a picture halved this often at least, or of one colour where it shows more
    /// than the largest patch holds.
    fn frame(&self, halvings: usize) -> PatchExtent {
        let [a, b, c] = self.uvs;
        let at = |(level, picture): (usize, &RgbImage)| {
            let texels = picture.size.as_vec2();
            let low = (a.min(b).min(c) * texels - 0.5).floor() - MARGIN;
            let high = (a.max(b).max(c) * texels - 0.5).ceil() + 1.0 + MARGIN;
            let size = high - low;
            (size.max_element() <= MAX_PATCH_SIDE).then(|| PatchExtent {
                level: Some(level),
                low,
                size: size.as_uvec2().map(|side| side.next_multiple_of(STEP)),
            })
        };
        let levels =
            self.picture.iter().flat_map(|(texture, _)| texture.levels().iter().enumerate());
        let side = if halvings > 0 || self.is_even() { STEP } else { 2 * STEP };
        let plain = PatchExtent { level: None, low: Vec2::ZERO, size: UVec2::splat(side) };
        levels.skip(halvings).find_map(at).unwrap_or(plain)
    }

    /// The places of a face's corners in its patch, texels.
    fn places(&self, frame: &PatchExtent, uvs: [Vec2; 3]) -> [Vec2; 3] {
        let far = frame.size.x as f32 - 1.5;
        match (&self.picture, frame.level) {
            (Some((texture, _)), Some(level)) => {
                uvs.map(|uv| uv * texture.level(level).size.as_vec2() - frame.low)
            }
            _ if self.is_even() => [Vec2::splat(2.0); 3],
            _ => [Vec2::splat(1.5), Vec2::new(far, 1.5), Vec2::new(1.5, far)],
        }
    }

    /// The texel at `at` of the patch.
    fn texel(&self, frame: &PatchExtent, at: UVec2) -> [u8; 3] {
        let corners = self.tints.map(linear);
        let Some(((texture, wrap), level)) = self.picture.as_ref().zip(frame.level) else {
            // The first and last texels continue the corners.
            let at =
                ((at.as_vec2() - 1.0) / (frame.size.x as f32 - 3.0)).clamp(Vec2::ZERO, Vec2::ONE);
            let tint = mixed(corners, [1.0 - at.x - at.y, at.x, at.y]);
            let mean = self.picture.iter().flat_map(|(texture, _)| texture.levels()).last();
            return product(mean.map_or([255; 3], |level| level.rgb[0]), tint);
        };
        let picture = texture.level(level);
        let place = frame.low + at.as_vec2();
        let texel = |axis: usize| wrap[axis].texel(place[axis] as i64, picture.size[axis]);
        let code = picture.rgb[(texel(1) * picture.size.x + texel(0)) as usize];
        match self.tints {
            WHITE => code,
            _ if self.is_even() => product(code, corners[0]),
            _ => {
                product(code, mixed(corners, self.weights((place + 0.5) / picture.size.as_vec2())))
            }
        }
    }

    /// Barycentric coordinates of a place, at the nearest point of the face along each of them.
    fn weights(&self, at: Vec2) -> [f32; 3] {
        let [a, b, c] = self.uvs;
        let area = (b - a).perp_dot(c - a);
        let of = |from: Vec2, to: Vec2| (from - at).perp_dot(to - at) / area;
        let weights = [of(b, c), of(c, a), of(a, b)].map(|weight| weight.clamp(0.0, 1.0));
        let sum: f32 = weights.iter().sum();
        if sum > 0.0 && sum.is_finite() {
            weights.map(|weight| weight / sum)
        } else {
            [1.0 / 3.0; 3]
        }
    }
}

/// The picture of all patches.
fn draw_atlas(
    patches: &[AtlasPatch],
    frames: &[PatchExtent],
    size: UVec2,
    places: &[UVec2],
) -> RgbImage {
    let mut rgb = vec![[128; 3]; size.element_product() as usize];
    for ((patch, frame), place) in patches.iter().zip(frames).zip(places) {
        for y in 0..frame.size.y {
            let first = ((place.y + y) * size.x + place.x) as usize;
            for (x, texel) in rgb[first..first + frame.size.x as usize].iter_mut().enumerate() {
                *texel = patch.texel(frame, UVec2::new(x as u32, y));
            }
        }
    }
    RgbImage { size, rgb, alpha: None }
}

fn tints(mesh: &Mesh, face: usize) -> Tints {
    mesh.corner_colors(face).map(|color| color.map(srgb8_from_linear))
}

fn linear(code: [u8; 3]) -> [f32; 3] {
    code.map(|c| linear_of_srgb8()[usize::from(c)])
}

/// The code of a code in another light.
fn product(code: [u8; 3], tint: [f32; 3]) -> [u8; 3] {
    let light = linear(code);
    [0, 1, 2].map(|c| srgb8_from_linear(light[c] * tint[c]))
}

fn mixed(corners: [[f32; 3]; 3], weights: [f32; 3]) -> [f32; 3] {
    [0, 1, 2].map(|c| (0..3).map(|k| weights[k] * corners[k][c]).sum::<f32>().clamp(0.0, 1.0))
}
