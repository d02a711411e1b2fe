//! The atlas: places of triangles on the texture.
//!
//! A triangle becomes a right-angled one, its right angle opposite to its longest edge; its corners
//! are middles of texels, so that nothing bleeds in at the finest level. Two of one size, the
//! second turned by 180 degrees, make a rectangle with free diagonals between them:
//!
//! ```text
//! A A A A . . B
//! A A A . . B B
//! A A . . B B B
//! A . . B B B B
//! ```
//!
//! Rectangles stand on shelves, high ones first, those of one size sorted by colour, so that
//! coarse mip levels mix similar colours.

use super::options::TextureOptions;
use crate::views::Views;
use glam::{UVec2, Vec2, Vec3};
use rayon::prelude::*;
use trisplat_raster::solid::{NO_FACE, SolidRasterizer};
use trisplat_scene::camera::Camera;
use trisplat_scene::math::color::srgb8_from_linear;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::{Error, Result};

/// Maximum number of texels along an edge.
const MAX_SIDE: u32 = 1024;
/// Free texels around every triangle with more than one, so that the next mip level does not bleed
/// either; an even number keeps its texels whole.
const GUTTER: u32 = 2;
/// Ratio of successive densities that are tried where the texels do not fit.
const DENSITY_STEP: f64 = 0.9;

/// The texels of a triangle: texel (i, j) is at `corner` + i, j, or of a turned one at `corner` -
/// i, j.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TexturePatch {
    /// The texel of the corner with the right angle.
    pub(super) corner: UVec2,
    /// Texels from corner to corner along both legs, corners included.
    pub(super) size: UVec2,
    /// Turned by 180 degrees.
    pub(super) turned: bool,
    /// Numbers of the face's corners: at the right angle, at the end of the first leg, at the end
    /// of the second.
    pub(super) order: [usize; 3],
}

impl TexturePatch {
    /// The patch of a triangle with these edges, px.
    fn new(edges: [f32; 3], texels_per_pixel: f64) -> Self {
        // Edge i leads from corner i to the next one; opposite to it is the one after that.
        let longest =
            (0..3).fold(0, |longest, i| if edges[i] > edges[longest] { i } else { longest });
        let right = (longest + 2) % 3;
        let first = edges[right];
        let second = edges[(longest + 1) % 3];
        let texels_of = |px: f32| match f64::from(px) * texels_per_pixel {
            ..1.0 => 1,
            texels => round_up_size(texels.ceil().min(f64::from(MAX_SIDE)) as u32 + 1),
        };
        let along = texels_of(first);
        let across = texels_of(second);
        let order = [right, (right + 1) % 3, (right + 2) % 3];
        let corner = UVec2::ZERO;
        let turned = false;
        if along >= across {
            Self { corner, size: UVec2::new(along, across), turned, order }
        } else {
            // The longer leg lies along the rows.
            Self {
                corner,
                size: UVec2::new(across, along),
                turned,
                order: [order[0], order[2], order[1]],
            }
        }
    }

    /// Free texels around it. A single texel needs none: all points of its face sample its middle,
    /// so the finest mip level is drawn.
    fn gutter(&self) -> u32 {
        if self.size == UVec2::ONE { 0 } else { GUTTER }
    }

    /// Width and height of two, with the gutter between them.
    fn pair(&self) -> UVec2 {
        match self.size.y {
            1 => UVec2::new(self.size.x, 2 + 2 * self.gutter()),
            _ => self.size + 2 + 2 * self.gutter(),
        }
    }

    /// The same with the gutter around them.
    fn rectangle(&self) -> UVec2 {
        match self.gutter() {
            0 => self.pair(),
            gutter => (self.pair() + 2 * gutter).map(|side| side.next_multiple_of(2)),
        }
    }

    /// Position of a point of the face with these weights of its corners, in texels from the middle
    /// of the first texel of the texture.
    #[inline(always)]
    pub(super) fn place(&self, weights: &[f32; 3]) -> Vec2 {
        let [_, first, second] = self.order;
        let legs = (self.size - 1).as_vec2();
        let from_corner = Vec2::new(weights[first] * legs.x, weights[second] * legs.y);
        let corner = self.corner.as_vec2();
        if self.turned { corner - from_corner } else { corner + from_corner }
    }

    /// Every texel that a sample within the face may need, with the weights of the face's corners
    /// there, or at the nearest point of the face.
    pub(super) fn texels(&self) -> impl Iterator<Item = (UVec2, [f32; 3])> + use<> {
        let Self { corner, size, turned, order } = *self;
        let legs = (size - 1).as_vec2();
        let texel_size = Vec2::new(1.0 / legs.x.max(1.0), 1.0 / legs.y.max(1.0));
        let is_line = size.y == 1;
        // Beyond the corners, where rounding may lead.
        let end = if is_line { UVec2::new(size.x - 1, 0) } else { size };
        (0..=end.y).flat_map(move |j| (0..=end.x).map(move |i| UVec2::new(i, j))).filter_map(
            move |at| {
                let previous = (at.as_vec2() - 1.0) * texel_size;
                if !is_line && previous.x + previous.y >= 1.0 - 1e-6 {
                    return None;
                }
                let nearest = (at.as_vec2() * texel_size).min(Vec2::ONE);
                let nearest =
                    (nearest - (nearest.element_sum() - 1.0).max(0.0) / 2.0).max(Vec2::ZERO);
                let mut weights = [0.0; 3];
                weights[order[1]] = nearest.x;
                weights[order[2]] = nearest.y;
                weights[order[0]] = (1.0 - nearest.element_sum()).max(0.0);
                Some((if turned { corner - at } else { corner + at }, weights))
            },
        )
    }
}

/// Rounds up to a multiple of an eighth of the next power of two: the fewer sizes there are, the
/// more rectangles share a shelf, where they are sorted by colour.
fn round_up_size(texels: u32) -> u32 {
    let step = (texels.next_power_of_two() / 8).max(1);
    texels.next_multiple_of(step)
}

/// All patches, and the texture that holds them.
#[derive(Debug, PartialEq)]
pub(super) struct Atlas {
    /// Width and height of the texture, powers of two.
    pub(super) size: UVec2,
    /// `[F]`
    pub(super) patches: Vec<TexturePatch>,
    /// The requested density, or less where the texture would be too large.
    pub(super) texels_per_pixel: f64,
}

impl Atlas {
    /// Places the faces of a mesh whose edges have these lengths in photos, px. `[F]`
    ///
    /// # Errors
    ///
    /// More triangles than a texture of the largest size has texels.
    pub(super) fn new(mesh: &Mesh, edges: &[[f32; 3]], options: &TextureOptions) -> Result<Self> {
        let colors = parallel::collect(mesh.face_count(), GRAIN, |face| color_key(mesh, face));
        let mut texels_per_pixel = options.texels_per_pixel;
        loop {
            let patches =
                edges.iter().map(|edges| TexturePatch::new(*edges, texels_per_pixel)).collect();
            let mut atlas = Self { size: UVec2::ZERO, patches, texels_per_pixel };
            if atlas.pack(&colors, options.texture_size) {
                return Ok(atlas);
            }
            if atlas.patches.iter().all(|patch| patch.size == UVec2::ONE) {
                let wants =
                    format!("a texture with a texel for each of {} triangles", atlas.patches.len());
                return Err(Error::invalid("texture_size", options.texture_size, wants));
            }
            texels_per_pixel *= DENSITY_STEP;
        }
    }

    /// Finds a place for every patch on the smallest texture that holds them; false when none with
    /// sides of at most `max_side` texels does.
    fn pack(&mut self, colors: &[u32], max_side: u32) -> bool {
        let mut faces: Vec<u32> = (0..self.patches.len() as u32).collect();
        faces.par_sort_unstable_by_key(|face| {
            let size = self.patches[*face as usize].size;
            (u32::MAX - size.y, u32::MAX - size.x, colors[*face as usize], *face)
        });
        let texels: u64 =
            self.patches.iter().map(|p| u64::from(p.size.element_product()) / 2).sum();
        let mut side = 64.max((texels as f64).sqrt() as u32 / 2).next_power_of_two();
        while side <= max_side {
            if let Some(height) = self.fill_shelves(&faces, side, side) {
                self.size = UVec2::new(side, height.next_power_of_two().max(1));
                return true;
            }
            side *= 2;
        }
        false
    }

    /// Places patches in this order on shelves `width` wide; returns their height together, unless
    /// that is above `max_height`.
    fn fill_shelves(&mut self, faces: &[u32], width: u32, max_height: u32) -> Option<u32> {
        let mut at = UVec2::ZERO;
        let mut shelf = 0;
        let mut next = 0;
        while next < faces.len() {
            let patch = self.patches[faces[next] as usize];
            let rectangle = patch.rectangle();
            if rectangle.x > width {
                return None;
            }
            if at.x + rectangle.x > width {
                at = UVec2::new(0, at.y + shelf);
                shelf = 0;
            }
            shelf = shelf.max(rectangle.y);
            if at.y + shelf > max_height {
                return None;
            }
            let first = at + patch.gutter();
            let pair = faces
                .get(next + 1)
                .is_some_and(|face| self.patches[*face as usize].size == patch.size);
            let placed = &mut self.patches[faces[next] as usize];
            placed.corner = first;
            placed.turned = false;
            if pair {
                let placed = &mut self.patches[faces[next + 1] as usize];
                placed.corner = first + patch.pair() - 1;
                placed.turned = true;
            }
            at.x += rectangle.x;
            next += if pair { 2 } else { 1 };
        }
        Some(at.y + shelf)
    }
}

impl Layout for Atlas {
    fn size(&self) -> UVec2 {
        self.size
    }

    fn face_count(&self) -> usize {
        self.patches.len()
    }

    #[inline(always)]
    fn place(&self, face: usize, weights: &[f32; 3]) -> Vec2 {
        self.patches[face].place(weights)
    }

    /// A line of texels, or one, is not interpolated across.
    #[inline(always)]
    fn interpolated(&self, face: usize) -> UVec2 {
        self.patches[face].size.map(|side| u32::from(side > 1))
    }

    fn for_each_texel(&self, face: usize, visit: &mut dyn FnMut(UVec2, [f32; 3])) {
        for (at, weights) in self.patches[face].texels() {
            visit(at, weights);
        }
    }
}

/// Faces of like colours have like keys: the bits of their channels, highest first.
fn color_key(mesh: &Mesh, face: usize) -> u32 {
    let corners = mesh.corner_colors(face);
    let codes = [1, 0, 2]
        .map(|c| u32::from(srgb8_from_linear(corners.iter().map(|k| k[c]).sum::<f32>() / 3.0)));
    (0..8)
        .rev()
        .flat_map(|bit| codes.map(|code| code >> bit & 1))
        .fold(0, |key, bit| key << 1 | bit)
}

// ---- Where faces are on a texture, whatever placed them there -----------------------------------

/// Places of the faces of a mesh on a texture.
pub(super) trait Layout: Sync {
    /// Width and height of the texture.
    fn size(&self) -> UVec2;

    /// Number of faces.
    fn face_count(&self) -> usize;

    /// Position of a point of a face with these weights of its corners, in texels from the middle
    /// of the first texel.
    fn place(&self, face: usize, weights: &[f32; 3]) -> Vec2;

    /// 1 along the axes between whose texels a face is interpolated, else 0.
    fn interpolated(&self, face: usize) -> UVec2;

    /// Calls `visit` with every texel of a face, and with the weights of the face's corners there
    /// or at the nearest point of it. No two faces have the same texel.
    fn for_each_texel(&self, face: usize, visit: &mut dyn FnMut(UVec2, [f32; 3]));

    /// Texels and weights of a bilinear sample.
    #[inline(always)]
    fn around(&self, face: usize, place: Vec2) -> [(usize, f32); 4] {
        let size = self.size();
        // Rounding may lead a little over the border.
        let place = place.clamp(Vec2::ZERO, (size - 1).as_vec2());
        let corner = place.as_uvec2();
        let part = place.fract();
        let next = (corner + self.interpolated(face)).min(size - 1);
        let number = |x: u32, y: u32| (y * size.x + x) as usize;
        [
            (number(corner.x, corner.y), (1.0 - part.x) * (1.0 - part.y)),
            (number(next.x, corner.y), part.x * (1.0 - part.y)),
            (number(corner.x, next.y), (1.0 - part.x) * part.y),
            (number(next.x, next.y), part.x * part.y),
        ]
    }

    /// Texture coordinates of the corners of every face: (0, 0) is the upper left corner, (1, 1)
    /// the lower right one. `[F]`
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

// ---- Size of triangles in the photos that see them ----------------------------------------------

/// Longer side of the pictures that decide visibility, px. Triangles with less than a pixel there
/// hardly need texels.
const LONGEST_SIDE: u32 = 1280;

/// The mean length of every face's three edges in the photos that see it, px: from corner 0 to 1, 1
/// to 2, 2 to 0. Zeros where no photo does. `[F]`
pub(super) fn footprints(mesh: &Mesh, views: &Views) -> Vec<[f32; 3]> {
    let drawing = views.drawing(mesh, 1);
    let mut solid = SolidRasterizer::new();
    // Sums of three lengths, and how many.
    let mut lengths = vec![[0.0f32; 4]; mesh.face_count()];
    let mut seen = vec![false; mesh.face_count()];
    for camera in views.cameras() {
        seen.fill(false);
        let visible = solid.visibility(mesh, &camera.fit_within(LONGEST_SIDE), &drawing);
        for face in visible.face.iter().filter(|face| **face != NO_FACE) {
            seen[*face as usize] = true;
        }
        parallel::for_each_mut(&mut lengths, GRAIN, |face, lengths| {
            if seen[face] {
                let here = edges(mesh.corners(face), camera, drawing.near);
                for edge in 0..3 {
                    lengths[edge] += here[edge];
                }
                lengths[3] += 1.0;
            }
        });
    }
    lengths.iter().map(|sums| [0, 1, 2].map(|i| sums[i] / sums[3].max(1.0))).collect()
}

/// Lengths of the edges of a triangle in a picture, px. An edge with an end behind the near plane
/// counts as if all of it had the depth of its middle.
fn edges(corners: [Vec3; 3], camera: &Camera, near: f32) -> [f32; 3] {
    let corners = corners.map(|v| camera.rotation * v + camera.translation);
    let length = |p: Vec3, q: Vec3| {
        if p.z > near && q.z > near {
            let at = |v: Vec3| v.truncate() / v.z * camera.focal;
            return at(p).distance(at(q));
        }
        p.distance(q) / ((p.z + q.z) / 2.0).max(near) * camera.focal.max_element()
    };
    let [a, b, c] = corners;
    [length(a, b), length(b, c), length(c, a)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::Rng;
    use trisplat_scene::mesh::Colors;

    /// Edges of many lengths: points, needles, triangles that are never seen, and a huge one.
    fn edges() -> Vec<[f32; 3]> {
        let rng = Rng::new(4, "atlas", 0);
        let mut edges: Vec<[f32; 3]> = (0..300)
            .map(|i| {
                let [a, b] = [0, 1].map(|k| 40.0 * rng.uniform(3 * i + k).powi(4));
                [a, b, (a - b).abs() + (a + b - (a - b).abs()) * rng.uniform(3 * i + 2)]
            })
            .collect();
        edges.extend([[0.0; 3], [900.0, 700.0, 1100.0], [500.0, 500.0, 0.1]]);
        edges
    }

    fn atlas(most: u32) -> Atlas {
        let mesh = Mesh {
            positions: vec![glam::Vec3::ZERO; 3 * edges().len()],
            colors: Colors::Face(vec![[0.5; 3]; edges().len()]),
            ..Mesh::default()
        };
        let options = TextureOptions { texture_size: most, ..TextureOptions::DEFAULT };
        Atlas::new(&mesh, &edges(), &options).unwrap()
    }

    #[test]
    fn no_two_triangles_share_a_texel_and_none_is_outside() {
        for most in [512, 4096] {
            let atlas = atlas(most);
            assert!(atlas.size.max_element() <= most);
            let mut owner = vec![None; atlas.size.element_product() as usize];
            for (face, patch) in atlas.patches.iter().enumerate() {
                for (at, weights) in patch.texels() {
                    assert!(at.cmplt(atlas.size).all(), "{at} of {patch:?}");
                    let owner = &mut owner[(at.y * atlas.size.x + at.x) as usize];
                    assert!(
                        owner.is_none_or(|other| other == face),
                        "{owner:?} and {face} at {at}"
                    );
                    *owner = Some(face);
                    assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)), "{weights:?}");
                    assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-5, "{weights:?}");
                }
            }
        }
    }

    #[test]
    fn whatever_a_sample_needs_is_the_triangles_own() {
        let atlas = atlas(4096);
        let rng = Rng::new(5, "samples", 0);
        for (face, patch) in atlas.patches.iter().enumerate() {
            let own: Vec<UVec2> = patch.texels().map(|(at, _)| at).collect();
            for i in 0..50 {
                let [u, v] = [0, 1].map(|k| rng.uniform((face * 100 + 2 * i + k) as u64));
                let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                let place = patch.place(&[1.0 - u - v, u, v]);
                for across in [UVec2::ZERO, UVec2::X, UVec2::Y, UVec2::ONE] {
                    let share = (1.0 - (place - (place.as_uvec2() + across).as_vec2()).abs())
                        .max(Vec2::ZERO);
                    let texel = place.as_uvec2() + across;
                    assert!(
                        share.element_product() < 1e-3 || own.contains(&texel),
                        "{texel} of {patch:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn the_right_angle_is_opposite_to_the_longest_edge() {
        // Corner 2 is opposite to the edge from corner 0 to corner 1.
        let patch = TexturePatch::new([50.0, 30.0, 40.0], 1.0);
        assert_eq!((patch.order, patch.size), ([2, 0, 1], UVec2::new(48, 32)));
        assert_eq!(patch.place(&[0.0, 0.0, 1.0]), Vec2::ZERO);
        assert_eq!(patch.place(&[1.0, 0.0, 0.0]), Vec2::new(47.0, 0.0));
        assert_eq!(patch.place(&[0.0, 1.0, 0.0]), Vec2::new(0.0, 31.0));
        assert_eq!(
            TexturePatch::new([9.0; 3], 0.1).size,
            UVec2::ONE,
            "too small for more than one colour"
        );
    }
}
