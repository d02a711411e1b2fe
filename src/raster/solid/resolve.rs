//! Turns the faces that samples see into pixels, or into lists of faces and depths.

use super::bins::{Batch, TILE_HEIGHT, TILE_WIDTH, tile_count};
use super::fill::fill;
use super::keys::{EMPTY, STRIDE, face_of, inverse_depth_of};
use super::options::SolidRasterOptions;
use super::projector::Projector;
use super::shade::{ShadeTile, shade};
use super::timing::PartTimes;
use super::visibility::{NO_FACE, Visibility};
use crate::image::Pixels;
use crate::math::color::linear_from_srgb;
use crate::mesh::Mesh;
use rayon::prelude::*;
use std::time::Instant;

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

/// The picture, sRGB-encoded.
pub(super) fn picture(
    batches: &[Batch],
    mesh: &Mesh,
    projector: &Projector,
    options: &SolidRasterOptions,
    parts: &PartTimes,
) -> Pixels {
    let size = projector.size / projector.samples;
    let mut rgb = vec![[0u8; 3]; size.x as usize * size.y as usize];
    let across = tile_count(projector.size).x;
    let samples = projector.samples as usize;
    let tiles = split_tiles(&mut rgb, size.x as usize, TILE_WIDTH / samples, TILE_HEIGHT / samples);
    let background = options.background.map(linear_from_srgb);
    tiles.into_par_iter().enumerate().for_each_init(
        || Box::new(EMPTY),
        |keys, (tile, mut rows)| {
            let (column, row) = (tile as u32 % across, tile as u32 / across);
            let start = Instant::now();
            fill(keys, batches, tile, column, row);
            let filled = PartTimes::lap(&parts.fill, start);
            let corner = [column * TILE_WIDTH as u32, row * TILE_HEIGHT as u32];
            shade(ShadeTile { mesh, projector, background, corner, keys, rows: &mut rows });
            PartTimes::lap(&parts.resolve, filled);
        },
    );
    Pixels { size, rgb, alpha: None }
}

/// Faces and depths of all samples.
pub(super) fn export(batches: &[Batch], projector: &Projector, out: &mut Visibility, parts: &PartTimes) {
    let count = projector.size.x as usize * projector.size.y as usize;
    out.size = projector.size;
    out.face.resize(count, NO_FACE);
    out.depth.resize(count, f32::INFINITY);
    let (width, across) = (projector.size.x as usize, tile_count(projector.size).x);
    let faces = split_tiles(&mut out.face, width, TILE_WIDTH, TILE_HEIGHT);
    let depths = split_tiles(&mut out.depth, width, TILE_WIDTH, TILE_HEIGHT);
    faces.into_par_iter().zip(depths).enumerate().for_each_init(
        || Box::new(EMPTY),
        |keys, (tile, (faces, depths))| {
            let start = Instant::now();
            fill(keys, batches, tile, tile as u32 % across, tile as u32 / across);
            let filled = PartTimes::lap(&parts.fill, start);
            for ((faces, depths), keys) in faces.into_iter().zip(depths).zip(keys.chunks(STRIDE)) {
                for ((face, depth), key) in faces.iter_mut().zip(depths).zip(keys) {
                    *face = face_of(*key);
                    *depth = 1.0 / inverse_depth_of(*key);
                }
            }
            PartTimes::lap(&parts.resolve, filled);
        },
    );
}
