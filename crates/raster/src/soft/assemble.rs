//! Assembles the frame from the pixels of the tiles.

use super::frame::Frame;
use super::options::SoftOptions;
use super::tile_grid::TILE;
use super::tile_pixels::{TileChannel, TileGeometry, TilePixels};
use super::tiles::Tiles;
use trisplat_scene::parallel;

/// Copies the tiles into the frame.
pub(super) fn assemble(frame: &mut Frame, pixels: &[TilePixels], tiles: &Tiles, options: &SoftOptions) {
    let size = tiles.size;
    let count = (size.x * size.y) as usize;
    frame.size = size;
    frame.rgb.resize(count, [0.0; 3]);
    frame.transmittance.resize(count, 0.0);
    let wanted = if options.geometry { count } else { 0 };
    frame.normal.resize(wanted, [0.0; 3]);
    for values in [&mut frame.depth, &mut frame.median_depth, &mut frame.distortion] {
        values.resize(wanted, 0.0);
    }
    fill(&mut frame.rgb, pixels, tiles, |t, b, l| t.rgb.each_ref().map(|channel| channel[b][l]));
    fill(&mut frame.transmittance, pixels, tiles, |t, b, l| t.transmittance[b][l]);
    if options.geometry {
        let of = |t: &TilePixels, f: fn(&TileGeometry) -> &TileChannel, b: usize, l: usize| {
            t.geometry.as_deref().map_or(0.0, |g| f(g)[b][l])
        };
        fill(&mut frame.depth, pixels, tiles, |t, b, l| of(t, |g| &g.depth, b, l));
        fill(&mut frame.median_depth, pixels, tiles, |t, b, l| of(t, |g| &g.median, b, l));
        fill(&mut frame.distortion, pixels, tiles, |t, b, l| of(t, |g| &g.distortion, b, l));
        fill(&mut frame.normal, pixels, tiles, |t, b, l| {
            t.geometry.as_deref().map_or([0.0; 3], |g| g.normal.each_ref().map(|channel| channel[b][l]))
        });
    }
}

/// Fills an image row by row from the tiles.
fn fill<T: Send>(
    image: &mut [T],
    pixels: &[TilePixels],
    tiles: &Tiles,
    at: impl Fn(&TilePixels, usize, usize) -> T + Sync,
) {
    let width = tiles.size.x as usize;
    parallel::for_each(image.chunks_mut(width * TILE as usize), |band, rows| {
        for (y, row) in rows.chunks_mut(width).enumerate() {
            for (x, out) in row.iter_mut().enumerate() {
                let tile = &pixels[band * tiles.count.x as usize + x / TILE as usize];
                let (x, y) = (x % TILE as usize, y);
                *out = at(tile, (y / 4) * 4 + x / 4, (y % 4) * 4 + x % 4);
            }
        }
    });
}
