//! Colours of samples, and their mean in each pixel.

use super::bin::{LANE, STRIDE, SampleKeys, TILE_HEIGHT, TILE_WIDTH, face_of};
use super::projector::Projector;
use super::visibility::{FaceBarycentrics, NO_FACE};
use trisplat_scene::FaceTexture;
use trisplat_scene::math::color::srgb8_from_linear;
use trisplat_scene::math::lanes::{LANES, Lanes, Work, prefetch};
use trisplat_scene::math::real::{Mask, Real};
use trisplat_scene::mesh::{Colors, Mesh};

/// Writes the pixels of a tile.
pub(super) struct ShadeTile<'a, 'b> {
    pub(super) mesh: &'a Mesh,
    /// Its colours, as the camera sees them.
    pub(super) colors: &'a Colors,
    pub(super) projector: &'a Projector,
    /// Linear.
    pub(super) background: [f32; 3],
    /// First sample of the tile.
    pub(super) corner: [u32; 2],
    pub(super) keys: &'a SampleKeys,
    pub(super) rows: &'a mut [&'b mut [[u8; 3]]],
}

/// Linear colours of a row of samples, channel by channel.
type SampleRow = [[f32; TILE_WIDTH]; 3];

impl Work for ShadeTile<'_, '_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(mut self) {
        let samples = self.projector.samples as usize;
        let share = 1.0 / (samples * samples) as f32;
        let mut row: SampleRow = [[0.0; TILE_WIDTH]; 3];
        for y in 0..self.rows.len() {
            let mut sums: SampleRow = [[0.0; TILE_WIDTH]; 3];
            for sample in 0..samples {
                self.shade_row::<L>(y * samples + sample, &mut row);
                for (sums, row) in sums.iter_mut().zip(&row) {
                    for (sum, part) in sums.iter_mut().zip(row.chunks_exact(samples)) {
                        for value in part {
                            *sum += *value;
                        }
                    }
                }
            }
            for (x, pixel) in self.rows[y].iter_mut().enumerate() {
                for (code, sums) in pixel.iter_mut().zip(&sums) {
                    *code = srgb8_from_linear(sums[x] * share);
                }
            }
        }
    }
}

impl ShadeTile<'_, '_> {
    /// The colours of row `y` of the tile's samples.
    #[inline(always)]
    fn shade_row<L: Lanes>(&mut self, y: usize, row: &mut SampleRow) {
        if self.keys[y * STRIDE..y * STRIDE + TILE_WIDTH].iter().fold(0, |any, key| any | key) == 0
        {
            *row = self.background.map(|channel| [channel; TILE_WIDTH]);
            return;
        }
        if let Some(texture) = &self.mesh.texture {
            return self.shade_textured(y, texture, row);
        }
        match self.colors {
            Colors::Face(colors) => self.shade_flat(y, colors, row),
            Colors::Vertex(colors) => {
                for x in (0..TILE_WIDTH).step_by(LANES) {
                    self.shade_vertices::<L>(x, y, colors, row);
                }
            }
        }
    }

    /// The faces of `N` samples from a place of the tile on.
    #[inline(always)]
    fn faces<const N: usize>(&self, x: usize, y: usize) -> [u32; N] {
        let mut faces = [NO_FACE; N];
        for (face, key) in faces.iter_mut().zip(&self.keys[y * STRIDE + x..]) {
            *face = face_of(*key);
        }
        faces
    }

    #[inline(always)]
    fn shade_flat(&self, y: usize, colors: &[[f32; 3]], row: &mut SampleRow) {
        if y + 1 < TILE_HEIGHT {
            for face in self.faces::<TILE_WIDTH>(0, y + 1) {
                if let Some(color) = colors.get(face as usize) {
                    prefetch(color);
                }
            }
        }
        for (x, face) in self.faces::<TILE_WIDTH>(0, y).into_iter().enumerate() {
            let color = colors.get(face as usize).unwrap_or(&self.background);
            for c in 0..3 {
                row[c][x] = color[c];
            }
        }
    }

    /// Shades samples as engines filter textures: trilinear, at the level where a texel is as large
    /// as a pixel.
    fn shade_textured(&self, y: usize, texture: &FaceTexture, row: &mut SampleRow) {
        let mut last_face = (NO_FACE, None);
        for (x, face) in self.faces::<TILE_WIDTH>(0, y).into_iter().enumerate() {
            let mut color = self.background;
            if face != NO_FACE {
                if face != last_face.0 {
                    last_face = (
                        face,
                        Some(FaceBarycentrics::new(
                            self.projector,
                            self.mesh.corners(face as usize),
                        )),
                    );
                }
                let Some(weights) = &last_face.1 else { continue };
                let uvs = &texture.uvs[face as usize];
                let page = texture.texture(face as usize);
                let size = page.size().as_vec2();
                let at = |x: u32, y: u32| weights.mixed(self.projector.ray(x, y), uvs);
                let x = self.corner[0] + x as u32;
                let y = self.corner[1] + y as u32;
                let here = at(x, y);
                let step = [at(x + 1, y), at(x, y + 1)].map(|next| (next - here) * size);
                let texels = step[0].length_squared().max(step[1].length_squared());
                let level = 0.5 * libm::log2f(texels) + libm::log2f(self.projector.samples as f32);
                color = page.sample(weights.inside(self.projector.ray(x, y), uvs), level);
            }
            for c in 0..3 {
                row[c][x] = color[c];
            }
        }
    }

    /// Shades sixteen samples with the interpolated colours of their faces' corners.
    #[inline(always)]
    fn shade_vertices<L: Lanes>(
        &self,
        x: usize,
        y: usize,
        colors: &[[f32; 3]],
        row: &mut SampleRow,
    ) {
        if y + 1 < TILE_HEIGHT {
            for face in self.faces::<LANES>(x, y + 1) {
                self.prefetch_face(face, colors);
            }
        }
        let mut faces_seen = SampleFaces::default();
        for (lane, face) in self.faces::<LANES>(x, y).into_iter().enumerate() {
            self.load_face(&mut faces_seen, lane, face, colors);
        }
        let weights = faces_seen.weights::<L>(self.ray::<L>(x, y));
        for (c, row) in row.iter_mut().enumerate() {
            let corner = |i: usize| L::load(&faces_seen.color[i][c]) * weights[i];
            let mut mixed = [0.0; LANES];
            (corner(0) + corner(1) + corner(2)).store(&mut mixed);
            row[x..x + LANES].copy_from_slice(&mixed);
        }
    }

    /// Prefetches what [`ShadeTile::load_face`] will read.
    #[inline(always)]
    fn prefetch_face(&self, face: u32, colors: &[[f32; 3]]) {
        if face == NO_FACE {
            return;
        }
        let vertices = self.mesh.face(face as usize);
        for v in [vertices[0] as usize, vertices[2] as usize] {
            prefetch(&self.mesh.positions[v]);
            prefetch(&colors[v]);
        }
        if !self.mesh.indices.is_empty() {
            prefetch(&self.mesh.positions[vertices[1] as usize]);
            prefetch(&colors[vertices[1] as usize]);
        }
    }

    #[inline(always)]
    fn load_face(&self, faces_seen: &mut SampleFaces, lane: usize, face: u32, colors: &[[f32; 3]]) {
        if face == NO_FACE {
            for c in 0..3 {
                for corner in 0..3 {
                    faces_seen.color[corner][c][lane] = self.background[c];
                }
            }
            return;
        }
        let vertices = self.mesh.face(face as usize);
        let a = vertices[0] as usize;
        let b = vertices[1] as usize;
        let c = vertices[2] as usize;
        let [p, q, r] = [self.mesh.positions[a], self.mesh.positions[b], self.mesh.positions[c]];
        let edge1 = q - p;
        let edge2 = r - p;
        let to_first = self.projector.offset_from_camera(p);
        for axis in 0..3 {
            faces_seen.edge1[axis][lane] = edge1[axis];
            faces_seen.edge2[axis][lane] = edge2[axis];
            faces_seen.to_first[axis][lane] = to_first[axis];
            faces_seen.color[0][axis][lane] = colors[a][axis];
            faces_seen.color[1][axis][lane] = colors[b][axis];
            faces_seen.color[2][axis][lane] = colors[c][axis];
        }
    }

    /// The rays of sixteen samples, in world axes.
    #[inline(always)]
    fn ray<L: Lanes>(&self, x: usize, y: usize) -> [L; 3] {
        let at = self.projector.ray(self.corner[0] + x as u32, self.corner[1] + y as u32);
        let (start, step) = self.projector.ray_to_world(at);
        let lane = L::load(&LANE);
        let along = |axis: usize| L::splat(start[axis]) + lane * L::splat(step[axis]);
        [along(0), along(1), along(2)]
    }
}

type LaneValues = [f32; LANES];

/// The faces of sixteen samples, as a structure of arrays. The weights of an empty sample are
/// arbitrary.
#[derive(Default)]
struct SampleFaces {
    /// From the camera to the first corner, in world axes.
    to_first: [LaneValues; 3],
    /// From the first corner to the second.
    edge1: [LaneValues; 3],
    /// From the first corner to the third.
    edge2: [LaneValues; 3],
    /// Corner by corner, channel by channel.
    color: [[LaneValues; 3]; 3],
}

impl SampleFaces {
    /// Perspective-correct weights of the corners where the rays meet the faces (Möller and
    /// Trumbore 1997).
    #[inline(always)]
    fn weights<L: Lanes>(&self, ray: [L; 3]) -> [L; 3] {
        let load = |v: &[LaneValues; 3]| [L::load(&v[0]), L::load(&v[1]), L::load(&v[2])];
        let to_first = load(&self.to_first);
        let edge1 = load(&self.edge1);
        let edge2 = load(&self.edge2);
        let p = cross(ray, edge2);
        let per = L::splat(1.0) / dot(edge1, p);
        let zero = L::splat(0.0);
        let one = L::splat(1.0);
        let second = -dot(to_first, p) * per;
        let third = -dot(ray, cross(to_first, edge1)) * per;
        let first = one - second - third;
        // Snapping moved the corners, so a sample may lie slightly outside.
        let kept = [first.max(zero), second.max(zero), third.max(zero)];
        let sum = kept[0] + kept[1] + kept[2];
        let valid = zero.lt(sum).and(sum.lt(L::splat(f32::INFINITY)));
        let third = L::splat(1.0 / 3.0);
        let per = one / sum;
        [
            L::select(valid, kept[0] * per, third),
            L::select(valid, kept[1] * per, third),
            L::select(valid, kept[2] * per, third),
        ]
    }
}

#[inline(always)]
fn dot<R: Real>(a: [R; 3], b: [R; 3]) -> R {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn cross<R: Real>(a: [R; 3], b: [R; 3]) -> [R; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::super::bin;
    use super::super::fill;
    use super::*;
    use crate::solid::bin::Batch;
    use crate::solid::bin::EMPTY;
    use glam::{Mat3, UVec2, Vec2, Vec3};
    use trisplat_scene::Rng;
    use trisplat_scene::camera::Camera;
    use trisplat_scene::math::lanes::{SimdLevel, dispatch_at};

    /// Keys and pixels of a picture of one tile, by the instructions of `level`.
    fn drawn(
        level: SimdLevel,
        mesh: &Mesh,
        projector: &Projector,
    ) -> (Box<SampleKeys>, Vec<[u8; 3]>) {
        let mut batch = Batch::default();
        batch.empty(1);
        batch.left = 0..mesh.face_count();
        dispatch_at(
            level,
            bin::BinFaces {
                mesh,
                projector,
                batch: &mut batch,
                across: 1,
                hidden: None,
                pairs: usize::MAX,
            },
        );
        let mut keys = Box::new(EMPTY);
        let batches = [batch];
        dispatch_at(
            level,
            fill::FillTile {
                keys: std::slice::from_mut(&mut *keys),
                batches: &batches,
                plane_of: None,
                tile: 0,
                size: projector.size,
            },
        );
        let mut pixels = vec![[0; 3]; TILE_WIDTH * TILE_HEIGHT];
        let mut rows: Vec<&mut [[u8; 3]]> = pixels.chunks_mut(TILE_WIDTH).collect();
        let background = [0.1, 0.2, 0.3];
        dispatch_at(
            level,
            ShadeTile {
                mesh,
                colors: &mesh.colors,
                projector,
                background,
                corner: [0, 0],
                keys: &keys,
                rows: &mut rows,
            },
        );
        (keys, pixels)
    }

    #[test]
    fn every_instruction_set_draws_the_same_bits() {
        let size = UVec2::new(TILE_WIDTH as u32, TILE_HEIGHT as u32);
        let camera = Camera {
            rotation: Mat3::from_rotation_y(0.3),
            translation: Vec3::new(0.1, -0.2, 0.3),
            focal: Vec2::new(60.0, 50.0),
            center: size.as_vec2() * 0.45,
            size,
        };
        let projector = Projector::new(&camera, 1, 0.1);
        let rng = Rng::new(5, "levels", 0);
        let mut mesh = Mesh::default();
        let mut colors = Vec::new();
        for i in 0..3 * 500 {
            let at = |k: u64| rng.uniform(8 * i + k) * 2.0 - 1.0;
            let triangle = rng.bits(1 << 32 | (i / 3));
            let reach = if triangle.is_multiple_of(9) { 3.0 } else { 0.1 };
            let near = |k: u64| (triangle >> (8 * k) & 255) as f32 / 128.0 - 1.0;
            let center = Vec3::new(2.0 * near(1), near(2), 3.0 + 2.0 * near(3));
            mesh.positions.push(center + reach * Vec3::new(at(0), at(1), at(2)));
            colors.push([at(3).abs(), at(4).abs(), at(5).abs()]);
        }
        mesh.colors = Colors::Vertex(colors);
        let portable = drawn(SimdLevel::Portable, &mesh, &projector);
        assert!(portable.0.iter().filter(|key| **key != 0).count() > 1000);
        for level in [SimdLevel::Avx2, SimdLevel::Avx512] {
            assert!(drawn(level, &mesh, &projector) == portable, "{level:?}");
        }
    }
}
