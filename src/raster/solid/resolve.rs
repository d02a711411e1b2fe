//! From the faces that samples see to pixels, or to lists of faces and depths.

use super::bin::{Batch, TILE_HEIGHT, TILE_WIDTH, tile_count};
use super::eye::Eye;
use super::fill::{EMPTY, Key, Keys, STRIDE, face_of, fill, inverse_depth_of};
use super::{NO_FACE, SolidOptions, Visibility};
use crate::image::Pixels;
use crate::math::color::linear_from_srgb;
use crate::math::srgb8::srgb8_from_linear;
use crate::mesh::{Colors, Mesh};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// The rows of a picture dealt out in tiles of so many columns and rows, tile by tile. `[tiles][rows]`
fn deal<T>(values: &mut [T], width: usize, columns: usize, rows: usize) -> Vec<Vec<&mut [T]>> {
    let mut tiles: Vec<Vec<&mut [T]>> = Vec::new();
    for band in values.chunks_mut(width * rows) {
        let first = tiles.len();
        tiles.resize_with(first + width.div_ceil(columns), || Vec::with_capacity(rows));
        for row in band.chunks_mut(width) {
            for (tile, part) in tiles[first..].iter_mut().zip(row.chunks_mut(columns)) {
                tile.push(part);
            }
        }
    }
    tiles
}

/// The picture, sRGB-encoded.
pub(super) fn picture(batches: &[Batch], mesh: &Mesh, eye: &Eye, options: &SolidOptions) -> Pixels {
    let size = eye.size / eye.samples;
    let mut rgb = vec![[0u8; 3]; size.x as usize * size.y as usize];
    let across = tile_count(eye.size).x;
    let samples = eye.samples as usize;
    let tiles = deal(&mut rgb, size.x as usize, TILE_WIDTH / samples, TILE_HEIGHT / samples);
    let background = options.background.map(linear_from_srgb);
    tiles.into_par_iter().enumerate().for_each_init(
        || Box::new(EMPTY),
        |keys, (tile, mut rows)| {
            let (column, row) = (tile as u32 % across, tile as u32 / across);
            fill(keys, batches, tile, column, row);
            let corner = [column * TILE_WIDTH as u32, row * TILE_HEIGHT as u32];
            let mut shade = Shade { mesh, eye, background, corner, face: NO_FACE, seen: None };
            shade.pixels(keys, &mut rows);
        },
    );
    Pixels { size, rgb, alpha: None }
}

/// Faces and depths of all samples.
pub(super) fn export(batches: &[Batch], eye: &Eye, out: &mut Visibility) {
    let count = eye.size.x as usize * eye.size.y as usize;
    out.size = eye.size;
    out.face.resize(count, NO_FACE);
    out.depth.resize(count, f32::INFINITY);
    let (width, across) = (eye.size.x as usize, tile_count(eye.size).x);
    let faces = deal(&mut out.face, width, TILE_WIDTH, TILE_HEIGHT);
    let depths = deal(&mut out.depth, width, TILE_WIDTH, TILE_HEIGHT);
    faces.into_par_iter().zip(depths).enumerate().for_each_init(
        || Box::new(EMPTY),
        |keys, (tile, (faces, depths))| {
            fill(keys, batches, tile, tile as u32 % across, tile as u32 / across);
            for ((faces, depths), keys) in faces.into_iter().zip(depths).zip(keys.chunks(STRIDE)) {
                for ((face, depth), key) in faces.iter_mut().zip(depths).zip(keys) {
                    *face = face_of(*key);
                    *depth = 1.0 / inverse_depth_of(*key);
                }
            }
        },
    );
}

/// A face as barycentric coordinates need it.
#[derive(Debug, Clone, Copy)]
pub struct Corners {
    /// Corner i's weight is in proportion to the i-th times the ray.
    opposite: [DVec3; 3],
}

impl Corners {
    pub(super) fn new(eye: &Eye, corners: [Vec3; 3]) -> Self {
        let [a, b, c] = corners.map(|v| eye.see_exactly(v));
        Self { opposite: [b.cross(c), c.cross(a), a.cross(b)] }
    }

    /// Weights of the corners where a ray meets the face's plane; at least 0, sum 1.
    #[inline(always)]
    pub(super) fn weights(&self, ray: DVec3) -> [f32; 3] {
        let parts = self.opposite.map(|n| n.dot(ray));
        let per = 1.0 / (parts[0] + parts[1] + parts[2]);
        // A sample may lie outside by what corners were moved when they were snapped.
        let kept = parts.map(|p| (p * per).max(0.0));
        let sum = kept[0] + kept[1] + kept[2];
        if !(sum > 0.0 && sum.is_finite()) {
            return [1.0 / 3.0; 3];
        }
        kept.map(|p| (p / sum) as f32)
    }
}

/// Colours of a tile's samples; remembers the last face.
struct Shade<'a> {
    mesh: &'a Mesh,
    eye: &'a Eye,
    background: [f32; 3],
    /// First sample of the tile.
    corner: [u32; 2],
    face: u32,
    seen: Option<(Corners, [[f32; 3]; 3])>,
}

impl Shade<'_> {
    fn pixels(&mut self, keys: &Keys, rows: &mut [&mut [[u8; 3]]]) {
        let samples = self.eye.samples as usize;
        let share = 1.0 / (samples * samples) as f32;
        for (y, row) in rows.iter_mut().enumerate() {
            for (x, pixel) in row.iter_mut().enumerate() {
                let mut sum = [0.0; 3];
                for sample in 0..samples * samples {
                    let (sx, sy) = (x * samples + sample % samples, y * samples + sample / samples);
                    let linear = self.linear(keys[sy * STRIDE + sx], sx, sy);
                    for c in 0..3 {
                        sum[c] += linear[c];
                    }
                }
                *pixel = sum.map(|c| srgb8_from_linear(c * share));
            }
        }
    }

    #[inline(always)]
    fn linear(&mut self, key: Key, x: usize, y: usize) -> [f32; 3] {
        let face = face_of(key);
        if face == NO_FACE {
            return self.background;
        }
        if let Colors::Face(colors) = &self.mesh.colors {
            return colors[face as usize];
        }
        if face != self.face || self.seen.is_none() {
            let corners = Corners::new(self.eye, self.mesh.corners(face as usize));
            self.seen = Some((corners, self.mesh.corner_colors(face as usize)));
            self.face = face;
        }
        let Some((corners, colors)) = &self.seen else { return self.background };
        let weights = corners.weights(self.eye.ray(self.corner[0] + x as u32, self.corner[1] + y as u32));
        std::array::from_fn(|c| {
            weights[0] * colors[0][c] + weights[1] * colors[1][c] + weights[2] * colors[2][c]
        })
    }
}
