//! Where the faces of a mesh are on its pictures.

use super::picture::Texture;
use glam::Vec2;
use rayon::prelude::*;
use std::sync::Arc;

/// The page of faces that show the colours of their mesh.
pub const NO_PAGE: u16 = u16::MAX;

/// The pictures of a mesh, its pages, and the places of its faces on them.
#[derive(Debug, Clone, PartialEq)]
pub struct FaceTexture {
    /// Places of each face's corners on its page: (0, 0) is the upper left corner, (1, 1) the lower right one.
    /// `[F]`
    pub uvs: Vec<[Vec2; 3]>,
    /// At least one.
    pub pages: Vec<Arc<Texture>>,
    /// Number of each face's page, or [`NO_PAGE`]; empty if all are on the first. `[F]`
    pub page_of: Vec<u16>,
}

impl FaceTexture {
    /// Faces on one picture.
    pub fn new(uvs: Vec<[Vec2; 3]>, page: Arc<Texture>) -> Self {
        Self { uvs, pages: vec![page], page_of: Vec::new() }
    }

    /// Number of the page of a face; `None` if it shows the colours of the mesh.
    #[inline(always)]
    pub fn page(&self, face: usize) -> Option<usize> {
        match self.page_of.get(face) {
            None => Some(0),
            Some(&NO_PAGE) => None,
            Some(page) => Some(usize::from(*page)),
        }
    }

    /// The page of a face; `None` if it shows the colours of the mesh.
    #[inline(always)]
    pub fn texture(&self, face: usize) -> Option<&Texture> {
        Some(&self.pages[self.page(face)?])
    }

    /// Whether every face is on a page.
    pub fn is_whole(&self) -> bool {
        !self.page_of.contains(&NO_PAGE)
    }

    /// The texture of the faces `faces[i]`, without pages that none of them is on; `None` if all of them show colours.
    pub fn of_faces(&self, faces: &[u32]) -> Option<Self> {
        let chosen = faces.par_iter().with_min_len(1 << 13);
        let uvs = chosen.clone().map(|face| self.uvs[*face as usize]).collect();
        if self.page_of.is_empty() {
            return Some(Self { uvs, pages: self.pages.clone(), page_of: Vec::new() });
        }
        let page_of: Vec<u16> = chosen.map(|face| self.page_of[*face as usize]).collect();
        let none = !page_of.is_empty() && page_of.iter().all(|page| *page == NO_PAGE);
        (!none).then(|| Self { uvs, pages: self.pages.clone(), page_of }.without_unused_pages())
    }

    fn without_unused_pages(mut self) -> Self {
        let mut used = vec![false; self.pages.len()];
        let pages = self.page_of.iter().filter(|page| **page != NO_PAGE);
        pages.for_each(|page| used[usize::from(*page)] = true);
        // One page stays, also of no face.
        used[0] |= !used.contains(&true);
        let mut numbers = Vec::with_capacity(used.len());
        let mut next = 0;
        for used in &used {
            numbers.push(next);
            next += u16::from(*used);
        }
        let pages = self.page_of.iter_mut().filter(|page| **page != NO_PAGE);
        pages.for_each(|page| *page = numbers[usize::from(*page)]);
        let mut used = used.into_iter();
        self.pages.retain(|_| used.next() == Some(true));
        if self.pages.len() == 1 && self.is_whole() {
            self.page_of.clear();
        }
        self
    }

    /// The same behind `faces` faces that show colours.
    pub fn behind(mut self, faces: usize) -> Self {
        if faces > 0 {
            self.page_of.resize(self.uvs.len(), 0);
            self.page_of.splice(0..0, std::iter::repeat_n(NO_PAGE, faces));
            self.uvs.splice(0..0, std::iter::repeat_n([Vec2::ZERO; 3], faces));
        }
        self
    }

    /// The same, but faces that are on a page of `other` stay there. Both have the same faces.
    pub fn under(mut self, other: &FaceTexture) -> Self {
        let first = self.pages.len() as u16;
        self.page_of.resize(self.uvs.len(), 0);
        for face in 0..self.uvs.len() {
            if let Some(page) = other.page(face) {
                (self.uvs[face], self.page_of[face]) = (other.uvs[face], first + page as u16);
            }
        }
        self.pages.extend(other.pages.iter().cloned());
        self.without_unused_pages()
    }

    /// Appends faces that show colours.
    pub fn append_colored(&mut self, faces: usize) {
        if faces > 0 {
            self.page_of.resize(self.uvs.len(), 0);
            self.uvs.resize(self.uvs.len() + faces, [Vec2::ZERO; 3]);
            self.page_of.resize(self.uvs.len(), NO_PAGE);
        }
    }

    /// Appends the faces of another texture, and its pages.
    pub fn append(&mut self, other: &FaceTexture) {
        let number = |page: &Arc<Texture>, pages: &mut Vec<Arc<Texture>>| {
            let known = pages.iter().position(|known| Arc::ptr_eq(known, page));
            known.unwrap_or_else(|| {
                pages.push(page.clone());
                pages.len() - 1
            }) as u16
        };
        let numbers: Vec<u16> = other.pages.iter().map(|page| number(page, &mut self.pages)).collect();
        let faces = self.uvs.len();
        self.uvs.extend(&other.uvs);
        if self.pages.len() > 1 || !self.page_of.is_empty() || !other.page_of.is_empty() {
            self.page_of.resize(faces, 0);
            let number = |face| other.page(face).map_or(NO_PAGE, |page| numbers[page]);
            self.page_of.extend((0..other.uvs.len()).map(number));
        }
    }

    /// Places of the vertices of a mesh with these indices, if faces that share a vertex agree; `[V]`.
    /// Without indices, vertices are the corners of faces. A vertex of no face on a page is at the origin.
    pub fn of_vertices(&self, indices: &[u32], vertices: usize) -> Option<Vec<Vec2>> {
        if indices.is_empty() {
            return Some(self.uvs.as_flattened().to_vec());
        }
        let mut at = vec![Vec2::NAN; vertices];
        let corners = indices.iter().zip(self.uvs.as_flattened()).enumerate();
        for (_, (vertex, uv)) in corners.filter(|(corner, _)| self.page(corner / 3).is_some()) {
            let known = &mut at[*vertex as usize];
            if known.is_nan() {
                *known = *uv;
            } else if known != uv {
                return None;
            }
        }
        at.iter_mut().filter(|uv| uv.is_nan()).for_each(|uv| *uv = Vec2::ZERO);
        Some(at)
    }

    /// Mean linear colour of a face, from the level where it covers about one texel; `None` if it shows the colours of the mesh.
    pub fn mean(&self, face: usize) -> Option<[f32; 3]> {
        let [a, b, c] = self.uvs[face];
        Some(self.texture(face)?.sample((a + b + c) / 3.0, self.level(face)?))
    }

    /// Linear colours of the corners of a face, each the mean of about as many texels as the face has; `None` if it shows the colours of the mesh.
    pub fn corner_means(&self, face: usize) -> Option<[[f32; 3]; 3]> {
        let (texture, level) = (self.texture(face)?, self.level(face)?);
        Some(self.uvs[face].map(|uv| texture.sample(uv, level)))
    }

    /// The mip level where a face covers about one texel.
    fn level(&self, face: usize) -> Option<f32> {
        let [a, b, c] = self.uvs[face];
        let size = self.texture(face)?.size().as_vec2();
        let texels = ((b - a) * size).perp_dot((c - a) * size).abs() / 2.0;
        Some(0.5 * libm::log2f(texels.max(1.0)))
    }
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
        let some = all.of_faces(&[6, 0]).unwrap();
        assert_eq!((some.page_of, some.pages), (vec![1, 0], vec![a, c.clone()]));
        let one = all.of_faces(&[7]).unwrap();
        assert_eq!((one.page_of, one.pages), (vec![], vec![c]));
        assert_eq!(all.of_faces(&[]).unwrap().pages.len(), 1);
    }

    #[test]
    fn faces_with_colours_stand_beside_faces_on_pages() {
        let [a, b] = [page(0), page(100)];
        let uvs = vec![[Vec2::splat(0.5); 3]; 2];
        let mut all = FaceTexture::new(uvs.clone(), a.clone()).behind(3);
        assert_eq!((all.page_of.as_slice(), all.is_whole()), (&[NO_PAGE, NO_PAGE, NO_PAGE, 0, 0][..], false));
        assert_eq!((all.page(0), all.mean(0), all.mean(4)), (None, None, Some([0.0; 3])));
        all.append(&FaceTexture::new(uvs.clone(), b.clone()));
        all.append_colored(1);
        assert_eq!(all.page_of[3..], [0, 0, 1, 1, NO_PAGE]);
        assert_eq!(all.of_faces(&[0, 2, 7]), None);
        let behind = all.of_faces(&[5, 6]).unwrap();
        assert_eq!(behind, FaceTexture::new(uvs, b));
        let mixed = all.of_faces(&[0, 6]).unwrap();
        assert_eq!((mixed.page_of.as_slice(), mixed.pages.len()), (&[NO_PAGE, 0][..], 1));
    }
}
