//! Where faces are on a texture, whatever placed them there.

use glam::{UVec2, Vec2};

/// Places of the faces of a mesh on a texture.
pub(super) trait Layout: Sync {
    /// Width and height of the texture.
    fn size(&self) -> UVec2;

    /// Number of faces.
    fn face_count(&self) -> usize;

    /// Where a point of a face with these weights of its corners is, in texels from the middle of the first texel.
    fn place(&self, face: usize, weights: &[f32; 3]) -> Vec2;

    /// 1 along the axes between whose texels a face is interpolated, else 0.
    fn interpolated(&self, face: usize) -> UVec2;

    /// Calls `visit` with every texel of a face, and with the weights of the face's corners there or at the nearest point of it. No
    /// two faces have the same texel.
    fn for_each_texel(&self, face: usize, visit: &mut dyn FnMut(UVec2, [f32; 3]));

    /// Texels and weights of a bilinear sample.
    #[inline(always)]
    fn around(&self, face: usize, place: Vec2) -> [(usize, f32); 4] {
        let size = self.size();
        // Rounding may lead a little over the border.
        let place = place.clamp(Vec2::ZERO, (size - 1).as_vec2());
        let (corner, part) = (place.as_uvec2(), place.fract());
        let next = (corner + self.interpolated(face)).min(size - 1);
        let number = |x: u32, y: u32| (y * size.x + x) as usize;
        [
            (number(corner.x, corner.y), (1.0 - part.x) * (1.0 - part.y)),
            (number(next.x, corner.y), part.x * (1.0 - part.y)),
            (number(corner.x, next.y), (1.0 - part.x) * part.y),
            (number(next.x, next.y), part.x * part.y),
        ]
    }

    /// Where the corners of every face are on the texture: (0, 0) its upper left corner, (1, 1) its lower right one. `[F]`
    fn uvs(&self) -> Vec<[Vec2; 3]> {
        let per = Vec2::ONE / self.size().as_vec2();
        let corner = |face: usize, k: usize| {
            let mut weights = [0.0; 3];
            weights[k] = 1.0;
            (self.place(face, &weights) + 0.5) * per
        };
        (0..self.face_count()).map(|face| [0, 1, 2].map(|k| corner(face, k))).collect()
    }
}
