//! The rasteriser of Gaussian splats, forward only (Kerbl et al. 2023; Zwicker et al. 2001):
//! projected as ellipses, blended in order of depth.
//!
//! Memory per frame: 104 bytes per Gaussian in view, 8 per Gaussian and row of tiles that it
//! touches, and 4 per Gaussian and tile for the rows that are being drawn, one per thread.

mod ellipse;

pub use ellipse::GaussianOptions;

use crate::kernel::window;
use crate::soft::{Frame, TILE};
use ellipse::{ALPHA_CAP, Ellipse, LOG2_CUTOFF, MIN_TRANSMITTANCE};
use glam::{UVec2, Vec2};
use trisplat_scene::camera::Camera;
use trisplat_scene::math::lanes::{LANES, Lanes, Work, dispatch, prefetch};
use trisplat_scene::math::real::{Mask, Real};
use trisplat_scene::{Splats, parallel};

/// Lines of a tile.
const LINES: usize = TILE as usize;
/// A tile's lines are as wide as the lanes.
const _: () = assert!(LINES == LANES);
/// Entries between an ellipse and the one that is fetched into the cache.
const AHEAD: usize = 8;
/// x of the pixel centres of a line.
const CENTRES: [f32; LANES] =
    [0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5, 8.5, 9.5, 10.5, 11.5, 12.5, 13.5, 14.5, 15.5];
/// Alpha far below the cut-off, where the lanes' exponential is still defined.
const MIN_POWER: f32 = -64.0;

/// Draws Gaussians for a camera; colours sRGB-encoded, as they were trained. The same bits for any
/// number of threads.
pub fn draw(splats: &Splats, camera: &Camera, options: &GaussianOptions) -> Frame {
    draw_and_weigh(splats, camera, options, None)
}

/// Draws as [`draw`], and adds to `weights` the blending weight of each Gaussian, summed over the
/// pixels. `[N]`
pub fn draw_and_weigh(
    splats: &Splats,
    camera: &Camera,
    options: &GaussianOptions,
    weights: Option<&mut [f32]>,
) -> Frame {
    let size = camera.size;
    let ellipses = &ellipse::all(splats, camera, options)[..];
    let rows = ellipse::bin(ellipses, &ellipse::front_to_back(ellipses), size);
    let pixels = size.x as usize * size.y as usize;
    let mut frame = Frame {
        size,
        rgb: vec![options.background; pixels],
        transmittance: vec![1.0; pixels],
        ..Frame::default()
    };
    let band = size.x as usize * LINES;
    let bands = frame.rgb.chunks_mut(band).zip(frame.transmittance.chunks_mut(band));
    let weigh = weights.is_some();
    let draw_row = |row: usize, (rgb, transmittance): (&mut [[f32; 3]], &mut [f32])| {
        let of_row = rows.tiles(row);
        let height = rgb.len() / size.x as usize;
        let draw = |tile: usize, ()| {
            let corner = UVec2::new(tile as u32, row as u32) * TILE;
            let width = (size.x - corner.x).min(TILE) as usize;
            let entries = of_row.of(tile);
            dispatch(DrawGaussianTile {
                ellipses,
                entries,
                corner: corner.as_vec2(),
                width,
                height,
                weigh,
            })
        };
        let tiles: Vec<GaussianTilePixels> = parallel::map((0..rows.count.x).map(|_| ()), draw);
        for (line, (rgb, transmittance)) in rgb
            .chunks_mut(size.x as usize)
            .zip(transmittance.chunks_mut(size.x as usize))
            .enumerate()
        {
            for (x, (rgb, transmittance)) in rgb.iter_mut().zip(transmittance).enumerate() {
                let tile = &tiles[x / LANES];
                let lane = x % LANES;
                *transmittance = tile.transmittance[line][lane];
                *rgb = [0, 1, 2]
                    .map(|c| transmittance.mul_add(options.background[c], tile.rgb[c][line][lane]));
            }
        }
        let of_tile = |(i, tile): (usize, &GaussianTilePixels)| {
            let sums = of_row.of(i).iter().zip(&tile.weights);
            sums.map(|(entry, sum)| (ellipses[*entry as usize].gaussian, *sum)).collect::<Vec<_>>()
        };
        tiles.iter().enumerate().flat_map(of_tile).collect()
    };
    let sums: Vec<Vec<(u32, f32)>> = parallel::map(bands, draw_row);
    if let Some(weights) = weights {
        // In the order of tiles, for the same bits with any number of threads.
        for (gaussian, sum) in sums.into_iter().flatten() {
            weights[gaussian as usize] += sum;
        }
    }
    frame
}

/// The pixels of a tile, line by line.
struct GaussianTilePixels {
    transmittance: [[f32; LANES]; LINES],
    rgb: [[[f32; LANES]; LINES]; 3],
    /// Sums of the blending weights of the entries; empty unless asked for.
    weights: Vec<f32>,
}

/// Draws one tile.
struct DrawGaussianTile<'a> {
    ellipses: &'a [Ellipse],
    /// Front to back.
    entries: &'a [u32],
    corner: Vec2,
    /// The part of the tile that lies in the picture.
    width: usize,
    height: usize,
    /// Sum the entries' weights.
    weigh: bool,
}

impl Work for DrawGaussianTile<'_> {
    type Output = GaussianTilePixels;

    #[inline(always)]
    fn run<L: Lanes>(self) -> GaussianTilePixels {
        let mut pixels = GaussianTilePixels {
            transmittance: [[0.0; LANES]; LINES],
            rgb: [[[0.0; LANES]; LINES]; 3],
            weights: vec![0.0; if self.weigh { self.entries.len() } else { 0 }],
        };
        for line in &mut pixels.transmittance[..self.height] {
            line[..self.width].fill(1.0);
        }
        let mut alive = u32::MAX >> (32 - self.height);
        for (k, entry) in self.entries.iter().enumerate() {
            if alive == 0 {
                break;
            }
            if let Some(ahead) = self.entries.get(k + AHEAD) {
                prefetch(&self.ellipses[*ahead as usize]);
            }
            let sum = self.blend::<L>(&self.ellipses[*entry as usize], &mut pixels, &mut alive);
            if let Some(weight) = pixels.weights.get_mut(k) {
                *weight = sum;
            }
        }
        pixels
    }
}

impl DrawGaussianTile<'_> {
    /// Adds one ellipse to the lines that have not ended. Returns the sum of its weights if it is
    /// asked for.
    #[inline(always)]
    fn blend<L: Lanes>(
        &self,
        ellipse: &Ellipse,
        pixels: &mut GaussianTilePixels,
        alive: &mut u32,
    ) -> f32 {
        let offset = self.corner - ellipse.middle;
        let half = ellipse.half_height();
        // Lines whose pixel centres lie within the height; more are harmless, because each pixel is
        // tested.
        let first = (-half - offset.y - 0.5).floor().max(0.0) as usize;
        let last = (half - offset.y - 0.5).ceil().min(LINES as f32 - 1.0);
        let mut sums = L::splat(0.0);
        if last < 0.0 {
            return 0.0;
        }
        let across = (L::load(&CENTRES) + L::splat(offset.x)) * L::splat(ellipse.along);
        let rgb = [L::splat(ellipse.rgb[0]), L::splat(ellipse.rgb[1]), L::splat(ellipse.rgb[2])];
        let cutoff = L::splat(LOG2_CUTOFF);
        let end = L::splat(MIN_TRANSMITTANCE);
        for line in first..=last as usize {
            if *alive >> line & 1 == 0 {
                continue;
            }
            let dy = offset.y + line as f32 + 0.5;
            let level = ellipse.level - (ellipse.down * dy) * (ellipse.down * dy);
            let side = across + L::splat(ellipse.shear * dy);
            let power = L::splat(level) - side * side;
            let before = L::load(&pixels.transmittance[line]);
            let drawn = cutoff.le(power).and(end.le(before));
            if L::bits(drawn) == 0 {
                continue;
            }
            let alpha =
                Real::min(Real::max(power, L::splat(MIN_POWER)).exp2(), L::splat(ALPHA_CAP));
            let (weight, after) = window::blend(before, alpha.masked(drawn));
            for (channel, color) in pixels.rgb.iter_mut().zip(rgb) {
                weight.mul_add(color, L::load(&channel[line])).store(&mut channel[line]);
            }
            after.store(&mut pixels.transmittance[line]);
            sums = sums + weight;
            if L::bits(end.le(after)) == 0 {
                *alive &= !(1 << line);
            }
        }
        if !self.weigh {
            return 0.0;
        }
        let mut lanes = [0.0; LANES];
        sums.store(&mut lanes);
        lanes.iter().sum()
    }
}
