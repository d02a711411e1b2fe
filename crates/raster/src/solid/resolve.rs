//! Turns the faces of samples into pixels, or into lists of faces and depths.

use super::bin::Faces;
use super::bins::{
    EMPTY, STRIDE, SampleKeys, TILE_HEIGHT, TILE_WIDTH, face_of, inverse_depth_of, tile_count,
};
use super::fill::fill;
use super::projector::Projector;
use super::shade::{ShadeTile, shade};
use super::visibility::{NO_FACE, Visibility};
use glam::UVec2;
use std::slice;
use trisplat_scene::{Error, Result, image::RgbImage, math::color::linear_from_srgb, mesh::Mesh, parallel};

/// Largest number of samples along an axis of the picture: beyond it f32 cannot resolve 1/256 of a sample.
const MAX_SAMPLES: u32 = 1 << 15;

/// How to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolidRasterOptions {
    /// Colour behind everything, sRGB-encoded.
    pub background: [f32; 3],
    /// Samples per pixel along each axis: 1, 2 or 4.
    pub samples: u32,
    /// Depth of the near plane in units of the mesh, > 0. Depth precision does not depend on it.
    pub near: f32,
}

impl Default for SolidRasterOptions {
    fn default() -> Self {
        Self { background: [0.0; 3], samples: 1, near: 0.01 }
    }
}

impl SolidRasterOptions {
    /// Checks the ranges, and that a picture of `size` has at most `MAX_SAMPLES` along each axis.
    pub fn validate(&self, size: UVec2) -> Result<()> {
        if !matches!(self.samples, 1 | 2 | 4) {
            return Err(Error::invalid("samples", self.samples, "1, 2 or 4"));
        }
        if !(self.near > 0.0 && self.near.is_finite()) {
            return Err(Error::invalid("near", self.near, "a depth above 0"));
        }
        let most = u64::from(size.max_element()) * u64::from(self.samples);
        if most > u64::from(MAX_SAMPLES) {
            let wants = format!("a picture of at most {} px a side", MAX_SAMPLES / self.samples);
            return Err(Error::invalid("samples", format!("{} on {size} px", self.samples), wants));
        }
        Ok(())
    }
}

/// The rows of a picture split into tiles of `columns` by `rows`, tile by tile. `[tiles][rows]`
fn split_tiles<T>(values: &mut [T], width: usize, columns: usize, rows: usize) -> Vec<Vec<&mut [T]>> {
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

/// The faces at the samples of a tile; `keys` is scratch memory.
fn tile_keys<'a>(faces: &'a Faces<'_>, keys: &'a mut SampleKeys, tile: usize, size: UVec2) -> &'a SampleKeys {
    &faces.keys(slice::from_mut(keys), tile, |keys, batches, tile| fill(&mut keys[0], batches, tile, size))[0]
}

/// The picture, sRGB-encoded.
pub(super) fn picture(
    faces: &Faces<'_>,
    mesh: &Mesh,
    projector: &Projector,
    options: &SolidRasterOptions,
) -> RgbImage {
    let size = projector.size / projector.samples;
    let mut rgb = vec![[0; 3]; size.x as usize * size.y as usize];
    let across = tile_count(projector.size).x;
    let samples = projector.samples as usize;
    let tiles = split_tiles(&mut rgb, size.x as usize, TILE_WIDTH / samples, TILE_HEIGHT / samples);
    let background = options.background.map(linear_from_srgb);
    parallel::for_each_with(
        tiles,
        || Box::new(EMPTY),
        |keys, tile, mut rows| {
            let (column, row) = (tile as u32 % across, tile as u32 / across);
            let keys = tile_keys(faces, keys, tile, projector.size);
            let corner = [column * TILE_WIDTH as u32, row * TILE_HEIGHT as u32];
            shade(ShadeTile { mesh, projector, background, corner, keys, rows: &mut rows });
        },
    );
    RgbImage { size, rgb, alpha: None }
}

/// Faces and depths of all samples.
pub(super) fn export(faces: &Faces<'_>, projector: &Projector, out: &mut Visibility) {
    let count = projector.size.x as usize * projector.size.y as usize;
    out.size = projector.size;
    out.face.resize(count, NO_FACE);
    out.depth.resize(count, f32::INFINITY);
    let width = projector.size.x as usize;
    let seen = split_tiles(&mut out.face, width, TILE_WIDTH, TILE_HEIGHT);
    let depths = split_tiles(&mut out.depth, width, TILE_WIDTH, TILE_HEIGHT);
    parallel::for_each_with(
        seen.into_iter().zip(depths),
        || Box::new(EMPTY),
        |keys, tile, (seen, depths)| {
            let keys = tile_keys(faces, keys, tile, projector.size);
            for ((faces, depths), keys) in seen.into_iter().zip(depths).zip(keys.chunks(STRIDE)) {
                for ((face, depth), key) in faces.iter_mut().zip(depths).zip(keys) {
                    *face = face_of(*key);
                    *depth = 1.0 / inverse_depth_of(*key);
                }
            }
        },
    );
}
