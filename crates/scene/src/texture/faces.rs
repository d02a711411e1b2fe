//! Where the faces of a mesh are on its pictures.

use super::picture::Texture;
use crate::parallel;
use glam::Vec2;
use std::sync::Arc;

/// The pictures of a mesh, its pages, and the places of its faces on them.
#[derive(Debug, Clone, PartialEq)]
pub struct FaceTexture {
    /// Places of each face's corners on its page: (0, 0) is the upper left corner, (1, 1) the lower right one.
    /// `[F]`
    pub uvs: Vec<[Vec2; 3]>,
    /// At least one.
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
        let page_of = parallel::collect(faces.len(), 1 << 13, |at| self.page_of[faces[at] as usize]);
        Self { uvs, pages: self.pages.clone(), page_of }.without_unused_pages()
    }

    fn without_unused_pages(mut self) -> Self {
        let mut used = vec![false; self.pages.len()];
        self.page_of.iter().for_each(|page| used[usize::from(*page)] = true);
        // One page stays, also of no face.
        used[0] |= !used.contains(&true);
        let mut numbers = Vec::with_capacity(used.len());
        let mut next = 0;
        for used in &used {
            numbers.push(next);
            next += u16::from(*used);
        }
        self.page_of.iter_mut().for_each(|page| *page = numbers[usize::from(*page)]);
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
            let known = pages.iter().position(|known| Arc::ptr_eq(known, page));
            known.unwrap_or_else(|| {
                pages.push(page.clone());
                pages.len() - 1
            }) as u16
        };
        let numbers: Vec<u16> = other.pages.iter().map(|page| number(page, &mut self.pages)).collect();
        let faces = self.uvs.len();
        self.uvs.extend(&other.uvs);
        if self.pages.len() > 1 {
            self.page_of.resize(faces, 0);
            self.page_of.extend((0..other.uvs.len()).map(|face| numbers[other.page(face)]));
        }
    }

    /// Places of the vertices of a mesh with these indices, if faces that share a vertex agree; `[V]`.
    /// Without indices, vertices are the corners of faces. An unused vertex is at the origin.
    pub fn of_vertices(&self, indices: &[u32], vertices: usize) -> Option<Vec<Vec2>> {
        if indices.is_empty() {
            return Some(self.uvs.as_flattened().to_vec());
        }
        let mut at = vec![Vec2::NAN; vertices];
        for (vertex, uv) in indices.iter().zip(self.uvs.as_flattened()) {
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

    /// Mean linear colour of a face, from the level where it covers about one texel.
    pub fn mean(&self, face: usize) -> [f32; 3] {
        let [a, b, c] = self.uvs[face];
        let texture = self.texture(face);
        let size = texture.size().as_vec2();
        let texels = ((b - a) * size).perp_dot((c - a) * size).abs() / 2.0;
        texture.sample((a + b + c) / 3.0, 0.5 * libm::log2f(texels.max(1.0)))
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
        let some = all.of_faces(&[6, 0]);
        assert_eq!((some.page_of, some.pages), (vec![1, 0], vec![a, c.clone()]));
        let one = all.of_faces(&[7]);
        assert_eq!((one.page_of, one.pages), (vec![], vec![c]));
        assert_eq!(all.of_faces(&[]).pages.len(), 1);
    }
}
