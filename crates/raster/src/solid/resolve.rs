//! Turns the faces of samples into pixels, or into lists of faces and depths.

use super::bins::{TILE_HEIGHT, TILE_WIDTH, tile_count};
use super::fill::fill;
use super::keys::{EMPTY, STRIDE, SampleKeys, face_of, inverse_depth_of};
use super::options::SolidRasterOptions;
use super::projector::Projector;
use super::rounds::Faces;
use super::shade::{Code, ShadeTile, shade};
use super::timing::PartTimes;
use super::visibility::{NO_FACE, Visibility};
use glam::UVec2;
use std::slice;
use std::time::Instant;
use trisplat_scene::math::color::linear_from_srgb;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel;

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

/// The size and the pixels of the picture, sRGB-encoded.
pub(super) fn picture<C: Code>(
    faces: &Faces<'_>,
    mesh: &Mesh,
    projector: &Projector,
    options: &SolidRasterOptions,
    parts: &PartTimes,
) -> (UVec2, Vec<[C; 3]>) {
    let size = projector.size / projector.samples;
    let mut rgb = vec![[C::default(); 3]; size.x as usize * size.y as usize];
    let across = tile_count(projector.size).x;
    let samples = projector.samples as usize;
    let tiles = split_tiles(&mut rgb, size.x as usize, TILE_WIDTH / samples, TILE_HEIGHT / samples);
    let background = options.background.map(linear_from_srgb);
    parallel::for_each_with(
        tiles,
        || Box::new(EMPTY),
        |keys, tile, mut rows| {
            let (column, row) = (tile as u32 % across, tile as u32 / across);
            let start = Instant::now();
            let keys = tile_keys(faces, keys, tile, projector.size);
            let filled = PartTimes::lap(&parts.fill, start);
            let corner = [column * TILE_WIDTH as u32, row * TILE_HEIGHT as u32];
            shade(ShadeTile { mesh, projector, background, corner, keys, rows: &mut rows });
            PartTimes::lap(&parts.resolve, filled);
        },
    );
    (size, rgb)
}

/// Faces and depths of all samples.
pub(super) fn export(faces: &Faces<'_>, projector: &Projector, out: &mut Visibility, parts: &PartTimes) {
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
            let start = Instant::now();
            let keys = tile_keys(faces, keys, tile, projector.size);
            let filled = PartTimes::lap(&parts.fill, start);
            for ((faces, depths), keys) in seen.into_iter().zip(depths).zip(keys.chunks(STRIDE)) {
                for ((face, depth), key) in faces.iter_mut().zip(depths).zip(keys) {
                    *face = face_of(*key);
                    *depth = 1.0 / inverse_depth_of(*key);
                }
            }
            PartTimes::lap(&parts.resolve, filled);
        },
    );
}
