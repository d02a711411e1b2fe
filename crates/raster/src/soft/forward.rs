//! The forward pass: blends the splats of every tile front to back.

use super::frame::{SoftOptions, Sort};
use super::layers::{
    BlockLayers, BlockShade, BroadcastPlane, BroadcastSplat, DepthMap, PixelLimits,
};
use super::projected::{PREFETCH_AHEAD, ProjectedTriangles};
use super::slots::{CountedPixels, WeightSlot};
use super::tiles::{
    self, BLOCKS, TILE, TileChannel, TileEntry, TileGeometry, TilePixels, Tiles, split_by_tile,
};
use crate::kernel::window;
use glam::UVec2;
use trisplat_scene::math::lanes::{LANES, Lanes, Work, dispatch, prefetch};
use trisplat_scene::math::real::Mask;
use trisplat_scene::parallel;

/// The part of the splats that is drawn at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Slab {
    /// All splats.
    Whole,
    /// The nearest splats, onto blank pixels.
    First,
    /// The splats behind the layers drawn already.
    Next,
}

/// Draws all tiles into `pixels`. Writes the blocks where each splat was drawn into the entries
/// and, if the options require it, the weight of each entry into `weights`. Draws the background
/// only for a frame in one part; otherwise [`background`] does.
pub(super) fn draw(
    splats: &ProjectedTriangles,
    tiles: &mut Tiles,
    slab: Slab,
    pixels: &mut Vec<TilePixels>,
    weights: &mut Vec<WeightSlot>,
    options: &SoftOptions,
    counted: Option<CountedPixels<'_>>,
) {
    pixels.resize_with(tiles.len(), TilePixels::default);
    weights.clear();
    if options.importance {
        weights.resize(tiles.entries.len(), WeightSlot::default());
    }
    let size = tiles.size;
    let across = tiles.count.x;
    let entries = split_by_tile(&mut tiles.entries, &tiles.starts);
    let weights = split_by_tile(weights, &tiles.starts);
    parallel::for_each(
        pixels.iter_mut().zip(entries).zip(weights),
        |tile, ((pixels, entries), weights)| {
            let corner = UVec2::new(tile as u32 % across, tile as u32 / across) * TILE;
            dispatch(DrawTile {
                splats,
                entries,
                weights,
                pixels,
                corner,
                size,
                slab,
                options,
                counted,
            });
        },
    );
}

/// Blends the background behind all slabs.
pub(super) fn background(pixels: &mut [TilePixels], options: &SoftOptions) {
    parallel::for_each_mut(pixels, 1, |_, pixels| dispatch(DrawBackground { pixels, options }));
}

/// The background of one tile.
struct DrawBackground<'a> {
    pixels: &'a mut TilePixels,
    options: &'a SoftOptions,
}

impl Work for DrawBackground<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        self.pixels.background::<L>(self.options);
    }
}

/// Draws one tile.
struct DrawTile<'a> {
    splats: &'a ProjectedTriangles,
    entries: &'a mut [TileEntry],
    /// Empty without importance.
    weights: &'a mut [WeightSlot],
    pixels: &'a mut TilePixels,
    corner: UVec2,
    size: UVec2,
    slab: Slab,
    options: &'a SoftOptions,
    /// All pixels count without.
    counted: Option<CountedPixels<'a>>,
}

impl Work for DrawTile<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        match (self.options.geometry, self.weights.is_empty()) {
            (false, true) => self.tile::<L, false, false>(),
            (false, false) => self.tile::<L, false, true>(),
            (true, true) => self.tile::<L, true, false>(),
            (true, false) => self.tile::<L, true, true>(),
        }
    }
}

impl DrawTile<'_> {
    /// Clears the pixels; returns the blocks that lie in the image, one bit each.
    #[inline(always)]
    fn clear(&mut self) -> u32 {
        let mut alive = 0;
        for block in 0..BLOCKS {
            let inside = tiles::inside(self.size, self.corner, block);
            alive |= u32::from(inside != 0) << block;
            for lane in 0..LANES {
                self.pixels.transmittance[block][lane] = f32::from(inside >> lane & 1);
            }
            self.pixels.counted[block] =
                self.counted.map_or(u16::MAX, |counted| counted.block(self.corner, block));
        }
        self.pixels.rgb = [TileChannel::default(); 3];
        if self.options.geometry {
            let geometry = self.pixels.geometry.get_or_insert_with(Box::default);
            **geometry = TileGeometry::default();
        }
        alive
    }

    #[inline(always)]
    fn tile<L: Lanes, const GEOMETRY: bool, const WEIGHTS: bool>(mut self) {
        if self.slab != Slab::Next {
            self.pixels.alive = self.clear();
        }
        match self.options.sort {
            Sort::Tile => self.by_tile::<L, GEOMETRY, WEIGHTS>(),
            Sort::Pixel => self.by_pixel::<L, GEOMETRY, WEIGHTS>(),
        }
        if self.slab == Slab::Whole {
            self.pixels.background::<L>(self.options);
        }
    }

    #[inline(always)]
    fn by_tile<L: Lanes, const GEOMETRY: bool, const WEIGHTS: bool>(&mut self) {
        let mut alive = self.pixels.alive;
        let limits = PixelLimits::<L>::new(self.options);
        for k in 0..self.entries.len() {
            if let Some(ahead) = self.entries.get(k + PREFETCH_AHEAD) {
                prefetch(&self.splats.records[ahead.splat as usize]);
            }
            let mut left = self.entries[k].blocks & alive;
            self.entries[k].blocks = 0;
            if left == 0 {
                continue;
            }
            let splat = self.broadcast::<L, GEOMETRY>(self.entries[k].splat);
            let mut stats = WeightStats::new();
            while left != 0 {
                let b = left.trailing_zeros() as usize & (BLOCKS - 1);
                left &= left - 1;
                let before = L::load(&self.pixels.transmittance[b]);
                let corner = tiles::block_corner(self.corner, b);
                let Some(shade) = splat.broadcast.shade(corner, before, &limits) else { continue };
                self.entries[k].blocks |= 1 << b;
                let (weight, after) = self.pixels.blend(b, &splat, &shade, before);
                after.store(&mut self.pixels.transmittance[b]);
                if WEIGHTS {
                    stats.add(weight, shade.drawn, self.pixels.counted[b]);
                }
                if L::bits(limits.min_transmittance.le(after)) == 0 {
                    alive &= !(1 << b);
                }
            }
            if WEIGHTS {
                self.weights[k].add(&stats.finish());
            }
        }
        self.pixels.alive = alive;
    }

    #[inline(always)]
    fn by_pixel<L: Lanes, const GEOMETRY: bool, const WEIGHTS: bool>(&mut self) {
        let alive = self.pixels.alive;
        let mut layers = BlockLayers::default();
        layers.begin(self.entries, self.splats);
        for entry in self.entries.iter_mut() {
            entry.blocks &= !alive;
        }
        for b in (0..BLOCKS).filter(|b| alive >> b & 1 == 1) {
            layers.find::<L>(self.entries, self.splats, self.corner, b, self.options);
            layers.replay::<L>(
                &mut self.pixels.transmittance[b],
                &mut [0.0; LANES],
                self.options.min_transmittance,
            );
            for i in 0..layers.len() {
                let (layer, shade) = layers.shade::<L>(i, self.entries, self.splats);
                if layer.drawn == 0 {
                    continue;
                }
                self.entries[layer.entry].blocks |= 1 << b;
                let splat = self.broadcast::<L, GEOMETRY>(self.entries[layer.entry].splat);
                let (weight, _) = self.pixels.blend(b, &splat, &shade, L::load(&layer.before));
                if WEIGHTS {
                    let mut stats = WeightStats::new();
                    stats.add(weight, shade.drawn, self.pixels.counted[b]);
                    self.weights[layer.entry].add(&stats.finish());
                }
            }
        }
    }

    #[inline(always)]
    fn broadcast<L: Lanes, const GEOMETRY: bool>(&self, splat: u32) -> ForwardSplat<L> {
        let plane = if GEOMETRY {
            Some(BroadcastPlane::new(&self.splats.planes[splat as usize]))
        } else {
            None
        };
        let map = DepthMap::new(self.options.depth_range);
        ForwardSplat {
            broadcast: BroadcastSplat::new(&self.splats.records[splat as usize]),
            plane,
            map,
        }
    }
}

/// A splat in every lane, with the values for blending.
struct ForwardSplat<L> {
    broadcast: BroadcastSplat<L>,
    plane: Option<BroadcastPlane<L>>,
    map: DepthMap,
}

/// Weights of a splat, lane by lane.
struct WeightStats<L> {
    sum: L,
    max: L,
    pixels: u32,
}

impl<L: Lanes> WeightStats<L> {
    #[inline(always)]
    fn new() -> Self {
        Self { sum: L::splat(0.0), max: L::splat(0.0), pixels: 0 }
    }

    #[inline(always)]
    fn add(&mut self, weight: L, drawn: L::Mask, counted: u16) {
        let weight = weight.masked(L::from_bits(counted));
        self.sum = self.sum + weight;
        self.max = self.max.max(weight);
        self.pixels += (L::bits(drawn) & counted).count_ones();
    }

    #[inline(always)]
    fn finish(self) -> WeightSlot {
        WeightSlot { max: self.max.max_lane(), sum: self.sum.sum(), pixels: self.pixels }
    }
}

impl TilePixels {
    #[inline(always)]
    fn background<L: Lanes>(&mut self, options: &SoftOptions) {
        let Self { transmittance, rgb, .. } = self;
        for (channel, color) in rgb.iter_mut().zip(options.blended_background()) {
            for (out, t) in channel.iter_mut().zip(transmittance.iter()) {
                L::load(t).mul_add(L::splat(color), L::load(out)).store(out);
            }
        }
    }

    /// Adds a layer to everything except the transmittance; returns its weight and the
    /// transmittance behind it.
    #[inline(always)]
    fn blend<L: Lanes>(
        &mut self,
        b: usize,
        splat: &ForwardSplat<L>,
        shade: &BlockShade<L>,
        before: L,
    ) -> (L, L) {
        let (weight, after) = window::blend(before, shade.alpha);
        for (channel, color) in self.rgb.iter_mut().zip(splat.broadcast.rgb) {
            weight.mul_add(color, L::load(&channel[b])).store(&mut channel[b]);
        }
        if let (Some(plane), Some(geometry)) = (&splat.plane, &mut self.geometry) {
            let crosses = window::is_median(before, after).and(shade.drawn);
            geometry.add(b, splat.map, weight, crosses, plane, shade);
        }
        (weight, after)
    }
}

impl TileGeometry {
    #[inline(always)]
    fn add<L: Lanes>(
        &mut self,
        b: usize,
        map: DepthMap,
        weight: L,
        crosses: L::Mask,
        plane: &BroadcastPlane<L>,
        shade: &BlockShade<L>,
    ) {
        let drawn = shade.drawn;
        let inv_depth = plane.inv_depth(shade.offset);
        let z = (L::splat(1.0) / inv_depth).masked(drawn);
        add(&mut self.depth[b], weight, z);
        add(&mut self.normal[0][b], weight, plane.normal.x);
        add(&mut self.normal[1][b], weight, plane.normal.y);
        add(&mut self.normal[2][b], weight, plane.normal.z);
        L::select(crosses, z, L::load(&self.median[b])).store(&mut self.median[b]);
        let m = L::splat(map.a) - L::splat(map.b) * inv_depth;
        let sums =
            [L::load(&self.sums[0][b]), L::load(&self.sums[1][b]), L::load(&self.sums[2][b])];
        let is_first = sums[0].le(L::splat(0.0)).and(drawn);
        let anchor = L::select(is_first, m, L::load(&self.anchor[b]));
        anchor.store(&mut self.anchor[b]);
        let m = (m - anchor).masked(drawn);
        let grown = L::load(&self.distortion[b]) + window::distortion(weight, m, sums);
        grown.store(&mut self.distortion[b]);
        (sums[0] + weight).store(&mut self.sums[0][b]);
        add(&mut self.sums[1][b], weight, m);
        add(&mut self.sums[2][b], weight, m * m);
    }
}

/// Adds a product to sixteen pixels.
#[inline(always)]
fn add<L: Lanes>(to: &mut [f32; LANES], weight: L, value: L) {
    weight.mul_add(value, L::load(to)).store(to);
}
