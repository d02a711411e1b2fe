//! The storage of vertices in GPU memory, in the smallest form that shaders can read; boxes of chunks, and their culling.
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
use glam::{DVec3, DVec4, Vec3};
use trisplat_scene::parallel;
use trisplat_scene::{
    Asset, Chunk,
    camera::Camera,
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

/// The view pyramid of a camera, cut off at the near plane.
#[derive(Debug, Clone)]
pub(crate) struct Frustum {
    /// Inside: `plane.xyz · p + plane.w >= 0`.
    planes: [DVec4; 5],
}

impl Frustum {
    /// The view of `camera` beyond `near`.
    pub(crate) fn new(camera: &Camera, near: f32) -> Self {
        let axis = |row: usize| camera.rotation.row(row).as_dvec3().extend(camera.translation[row].into());
        let (x, y, z) = (axis(0), axis(1), axis(2));
        let (focal, center, size) =
            (camera.focal.as_dvec2(), camera.center.as_dvec2(), camera.size.as_dvec2());
        // 0 <= focal x / z + center <= size, times z.
        let planes = [
            x * focal.x + z * center.x,
            z * (size.x - center.x) - x * focal.x,
            y * focal.y + z * center.y,
            z * (size.y - center.y) - y * focal.y,
            z - DVec4::W * f64::from(near),
        ];
        Self { planes }
    }

    /// False only when the box is outside the view.
    pub(crate) fn sees(&self, bounds: &Aabb) -> bool {
        let (min, max) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
        self.planes.iter().all(|plane| {
            let normal = plane.truncate();
            let farthest = DVec3::select(normal.cmpge(DVec3::ZERO), max, min);
            // A box that touches the plane is kept, despite rounding.
            let slack = 1e-6 * (normal.abs().dot(farthest.abs()) + plane.w.abs());
            normal.dot(farthest) + plane.w >= -slack
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat3, UVec2, Vec2};
    use trisplat_scene::Rng;
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

    #[test]
    fn no_box_with_a_visible_point_is_left_out() {
        let rng = Rng::new(5, "cull", 0);
        let draw = |i: u64, scale: f32| (rng.uniform_f64(i) as f32 - 0.5) * scale;
        let vec = |i: u64, scale: f32| Vec3::new(draw(i, scale), draw(i + 1, scale), draw(i + 2, scale));
        let base = Camera {
            rotation: Mat3::IDENTITY,
            translation: Vec3::ZERO,
            focal: Vec2::new(300.0, 310.0),
            center: Vec2::new(220.0, 100.0),
            size: UVec2::new(400, 260),
        };
        let (mut kept, mut dropped) = (0, 0);
        for k in 0..4000 {
            let camera = base.looking(vec(k * 100, 4.0), vec(k * 100 + 3, 4.0), Vec3::NEG_Y);
            let frustum = Frustum::new(&camera, 0.1);
            let (a, b) = (vec(k * 100 + 6, 6.0), vec(k * 100 + 9, 1.0));
            let bounds = Aabb { min: a.min(a + b), max: a.max(a + b) };
            let visible = (0..27u32).any(|i| {
                let at = Vec3::new((i % 3) as f32, (i / 3 % 3) as f32, (i / 9) as f32) / 2.0;
                let seen =
                    camera.rotation * (bounds.min + at * (bounds.max - bounds.min)) + camera.translation;
                let pixel = seen.truncate() / seen.z * camera.focal + camera.center;
                seen.z >= 0.1 && pixel.cmpge(Vec2::ZERO).all() && pixel.cmple(camera.size.as_vec2()).all()
            });
            let sees = frustum.sees(&bounds);
            assert!(sees || !visible, "{bounds:?} left out");
            kept += u32::from(sees);
            dropped += u32::from(!sees);
        }
        assert!(kept > 300 && dropped > 1500, "{kept} kept, {dropped} dropped");
        assert!(!Frustum::new(&base, 0.1).sees(&Aabb { min: Vec3::splat(-2.0), max: Vec3::splat(-1.0) }));
    }
}
