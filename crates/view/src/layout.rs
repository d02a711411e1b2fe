//! The storage of vertices in GPU memory, in the smallest form that shaders can read.
//!
//! | layout | bytes per triangle | what is stored |
//! |---|---|---|
//! | corner | 48, or 16 per vertex and 12 per face with indices | f32 position and colour per corner |
//! | face | 40 | f32 position per corner, colour per face |
//! | texture | 60, and its pictures | f32 position and place on the picture per corner |
//!
//! Colours are linear light in 10 bits per channel, stored as their square root: off by at most 0.2 of an 8-bit sRGB
//! code, and decoded by one multiplication.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use trisplat_scene::parallel;
use trisplat_scene::{
    Asset, Chunk,
    mesh::{Colors, Mesh},
};

/// How vertices are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum VertexLayout {
    /// Position and colour per corner: for indexed and vertex-coloured meshes.
    Corner,
    /// Position per corner, colour per face.
    Face,
    /// Position and place on the picture per corner: for textured meshes, and only for these.
    Texture,
}

impl VertexLayout {
    /// The smallest layout that stores every position exactly.
    pub fn exact(mesh: &Mesh) -> Self {
        let kinds = [VertexLayout::Texture, VertexLayout::Face];
        kinds.into_iter().find(|layout| layout.fits(mesh)).unwrap_or(VertexLayout::Corner)
    }

    /// Whether a mesh can be stored this way.
    pub fn fits(self, mesh: &Mesh) -> bool {
        match self {
            VertexLayout::Texture => mesh.texture.is_some(),
            VertexLayout::Corner => mesh.texture.is_none(),
            VertexLayout::Face => {
                mesh.texture.is_none() && mesh.indices.is_empty() && matches!(mesh.colors, Colors::Face(_))
            }
        }
    }
}

/// A corner of the layout [`VertexLayout::Corner`].
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct CornerVertex {
    /// World position.
    pub position: [f32; 3],
    /// See [`pack_color`].
    pub color: u32,
}

/// A corner of the layout [`VertexLayout::Texture`].
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct TextureVertex {
    /// World position.
    pub position: [f32; 3],
    /// Place on the page: (0, 0) is the upper left corner.
    pub uv: [f32; 2],
}

/// Linear light to 10 bits per channel, red lowest, stored as the square root.
pub(crate) fn pack_color(linear: [f32; 3]) -> u32 {
    let [r, g, b] = linear.map(|c| (c.clamp(0.0, 1.0).sqrt() * 1023.0 + 0.5) as u32);
    r | g << 10 | b << 20
}

/// An axis-aligned bounding box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aabb {
    /// Least coordinates.
    pub min: Vec3,
    /// Largest coordinates.
    pub max: Vec3,
}

impl Aabb {
    /// The empty box.
    pub const EMPTY: Aabb = Aabb { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// The box around both.
    pub fn union(self, other: Self) -> Self {
        Aabb { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// The box around the corners of a run of faces.
    pub fn of(mesh: &Mesh, chunk: &Chunk) -> Self {
        let faces = chunk.first as usize..(chunk.first + chunk.count) as usize;
        faces.flat_map(|f| mesh.corners(f)).fold(Self::EMPTY, |b, v| b.union(Aabb { min: v, max: v }))
    }
}

/// The chunks of an asset and their boxes; one chunk of everything when it has none. `[chunks]`
pub(crate) fn bounds(asset: &Asset) -> Vec<(Chunk, Aabb)> {
    let whole = [Chunk { first: 0, count: asset.mesh.face_count() as u32 }];
    let chunks = if asset.chunks.is_empty() { &whole[..] } else { &asset.chunks };
    parallel::map(chunks, |_, chunk| (*chunk, Aabb::of(&asset.mesh, chunk)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::math::color::{linear_from_srgb, srgb_from_linear};

    #[test]
    fn ten_bits_of_square_root_keep_every_8_bit_colour() {
        for code in 0..=255u32 {
            let linear = linear_from_srgb(code as f32 / 255.0);
            let bits = pack_color([linear, 0.0, linear]);
            assert_eq!(bits & 1023, bits >> 20);
            let root = (bits & 1023) as f32 / 1023.0;
            let off = srgb_from_linear(root * root) * 255.0 - code as f32;
            assert!(off.abs() < 0.2, "code {code} moved by {off}");
        }
        assert_eq!(pack_color([2.0, -1.0, f32::NAN]), 1023);
    }
}
