//! The forward pass: one tile after the other, each front to back.

use crate::kernel::composite;
use crate::math::lanes::{LANES, Lanes, Work, dispatch, prefetch};
use crate::math::real::Mask;
use crate::raster::hits::Hits;
use crate::raster::importance::SlotWeight;
use crate::raster::project::Splats;
use crate::raster::shade::{self, DepthMap, Limits, Shade, Wide, WideSheet};
use crate::raster::soft::{Frame, Soft, SoftOptions, Sort};
use crate::raster::tiles::{BLOCKS, Entry, TILE, Tiles};
use glam::UVec2;
use rayon::prelude::*;

/// One number for each pixel of a tile, block by block.
pub(super) type Plot = [[f32; LANES]; BLOCKS];

/// The pixels of a tile.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub(super) struct TilePixels {
    pub(super) transmittance: Plot,
    pub(super) rgb: [Plot; 3],
    pub(super) geometry: Option<Box<TileGeometry>>,
}

/// Depth, normal and distortion of a tile's pixels.
#[derive(Debug, Clone)]
pub(super) struct TileGeometry {
    pub(super) depth: Plot,
    pub(super) median: Plot,
    pub(super) normal: [Plot; 3],
    pub(super) distortion: Plot,
    /// Mapped depth of the first layer: the others are taken relative to it, which changes nothing but rounding.
    pub(super) anchor: Plot,
    /// Σ w, Σ w m, Σ w m².
    pub(super) sums: [Plot; 3],
}

const BLANK: Plot = [[0.0; LANES]; BLOCKS];

impl Default for TilePixels {
    fn default() -> Self {
        Self { transmittance: BLANK, rgb: [BLANK; 3], geometry: None }
    }
}

impl TileGeometry {
    fn blank() -> Self {
        Self {
            depth: BLANK,
            median: BLANK,
            normal: [BLANK; 3],
            distortion: BLANK,
            anchor: BLANK,
            sums: [BLANK; 3],
        }
    }
}

/// Draws all tiles into `soft.pixels`.
pub(super) fn draw(soft: &mut Soft, options: &SoftOptions) {
    let Soft { projection, tiles, pixels, weights, .. } = soft;
    pixels.resize_with(tiles.len(), TilePixels::default);
    weights.clear();
    if options.importance {
        weights.resize(tiles.entries.len(), SlotWeight::default());
    }
    let (size, across) = (tiles.size, tiles.count.x);
    let splats = &projection.splats;
    let entries = split(&mut tiles.entries, &tiles.starts);
    let weights = split(weights, if options.importance { &tiles.starts } else { &[] });
    let mut weights = weights.into_iter();
    let work: Vec<_> = entries.into_iter().map(|e| (e, weights.next().unwrap_or_default())).collect();
    pixels.par_iter_mut().zip(work).enumerate().for_each(|(tile, (pixels, (entries, weights)))| {
        let corner = UVec2::new(tile as u32 % across, tile as u32 / across) * TILE;
        dispatch(Draw { splats, entries, weights, pixels, corner, size, options });
    });
}

/// How many entries ahead of its use a record is asked for.
pub(super) const AHEAD: usize = 6;

/// Cuts `values` at `starts`.
pub(super) fn split<'a, T>(mut values: &'a mut [T], starts: &[u32]) -> Vec<&'a mut [T]> {
    starts
        .windows(2)
        .map(|w| {
            let (head, tail) = std::mem::take(&mut values).split_at_mut((w[1] - w[0]) as usize);
            values = tail;
            head
        })
        .collect()
}

/// One tile.
struct Draw<'a> {
    splats: &'a Splats,
    entries: &'a mut [Entry],
    /// Empty when not asked for.
    weights: &'a mut [SlotWeight],
    pixels: &'a mut TilePixels,
    corner: UVec2,
    size: UVec2,
    options: &'a SoftOptions,
}

impl Work for Draw<'_> {
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

impl Draw<'_> {
    /// Sets the pixels to nothing; gives the blocks that lie in the image.
    #[inline(always)]
    fn clear(&mut self) -> u32 {
        let whole = shade::is_whole(self.size, self.corner);
        let mut alive = 0;
        for block in 0..BLOCKS {
            let inside = if whole { u16::MAX } else { shade::inside(self.size, self.corner, block) };
            alive |= u32::from(inside != 0) << block;
            for lane in 0..LANES {
                self.pixels.transmittance[block][lane] = f32::from(inside >> lane & 1);
            }
        }
        self.pixels.rgb = [BLANK; 3];
        if self.options.geometry {
            let geometry = self.pixels.geometry.get_or_insert_with(|| Box::new(TileGeometry::blank()));
            **geometry = TileGeometry::blank();
        }
        alive
    }

    #[inline(always)]
    fn tile<L: Lanes, const GEOMETRY: bool, const WEIGHTS: bool>(mut self) {
        let alive = self.clear();
        match self.options.sort {
            Sort::Tile => self.by_tile::<L, GEOMETRY, WEIGHTS>(alive),
            Sort::Pixel => self.by_pixel::<L, GEOMETRY, WEIGHTS>(alive),
        }
        self.background::<L>();
    }

    #[inline(always)]
    fn by_tile<L: Lanes, const GEOMETRY: bool, const WEIGHTS: bool>(&mut self, mut alive: u32) {
        let limits = Limits::<L>::new(self.options);
        for k in 0..self.entries.len() {
            if let Some(ahead) = self.entries.get(k + AHEAD) {
                prefetch(&self.splats.records[ahead.splat as usize]);
            }
            let mut left = self.entries[k].blocks & alive;
            self.entries[k].blocks = 0;
            if left == 0 {
                continue;
            }
            let brush = self.brush::<L, GEOMETRY>(self.entries[k].splat);
            let mut stats = Stats::new();
            while left != 0 {
                let b = left.trailing_zeros() as usize & (BLOCKS - 1);
                left &= left - 1;
                let before = L::load(&self.pixels.transmittance[b]);
                let corner = shade::block_corner(self.corner, b);
                let Some(shade) = brush.wide.shade(corner, before, &limits) else { continue };
                self.entries[k].blocks |= 1 << b;
                let (weight, after) = self.pixels.blend(b, &brush, &shade, before);
                after.store(&mut self.pixels.transmittance[b]);
                if WEIGHTS {
                    stats.add(weight, shade.drawn);
                }
                if L::bits(limits.min_transmittance.le(after)) == 0 {
                    alive &= !(1 << b);
                }
            }
            if WEIGHTS {
                self.weights[k].add(&stats.finish());
            }
        }
    }

    #[inline(always)]
    fn by_pixel<L: Lanes, const GEOMETRY: bool, const WEIGHTS: bool>(&mut self, alive: u32) {
        let mut hits = Hits::default();
        for b in (0..BLOCKS).filter(|b| alive >> b & 1 == 1) {
            hits.find::<L>(self.entries, self.splats, self.corner, b, self.options);
            self.entries.iter_mut().for_each(|e| e.blocks &= !(1 << b));
            hits.replay::<L>(
                &mut self.pixels.transmittance[b],
                &mut [0.0; LANES],
                self.options.min_transmittance,
            );
            for i in 0..hits.len() {
                let (hit, shade) = hits.shade::<L>(i, self.entries, self.splats);
                if hit.drawn == 0 {
                    continue;
                }
                self.entries[hit.entry].blocks |= 1 << b;
                let brush = self.brush::<L, GEOMETRY>(self.entries[hit.entry].splat);
                let (weight, _) = self.pixels.blend(b, &brush, &shade, L::load(&hit.before));
                if WEIGHTS {
                    let mut stats = Stats::new();
                    stats.add(weight, shade.drawn);
                    self.weights[hit.entry].add(&stats.finish());
                }
            }
        }
    }

    #[inline(always)]
    fn brush<L: Lanes, const GEOMETRY: bool>(&self, splat: u32) -> Brush<L> {
        let sheet = if GEOMETRY { Some(WideSheet::new(&self.splats.sheets[splat as usize])) } else { None };
        let map = DepthMap::new(self.options.depth_range);
        Brush { wide: Wide::new(&self.splats.records[splat as usize]), sheet, map }
    }

    #[inline(always)]
    fn background<L: Lanes>(&mut self) {
        let TilePixels { transmittance, rgb, .. } = self.pixels;
        for (plot, color) in rgb.iter_mut().zip(self.options.backdrop()) {
            for (out, t) in plot.iter_mut().zip(transmittance.iter()) {
                L::load(t).mul_add(L::splat(color), L::load(out)).store(out);
            }
        }
    }
}

/// A splat in every lane, ready to be blended.
struct Brush<L> {
    wide: Wide<L>,
    sheet: Option<WideSheet<L>>,
    map: DepthMap,
}

/// Weights of a splat, lane by lane.
struct Stats<L> {
    sum: L,
    max: L,
    pixels: u32,
}

impl<L: Lanes> Stats<L> {
    #[inline(always)]
    fn new() -> Self {
        Self { sum: L::splat(0.0), max: L::splat(0.0), pixels: 0 }
    }

    #[inline(always)]
    fn add(&mut self, weight: L, drawn: L::Mask) {
        self.sum = self.sum + weight;
        self.max = self.max.max(weight);
        self.pixels += L::bits(drawn).count_ones();
    }

    #[inline(always)]
    fn finish(self) -> SlotWeight {
        SlotWeight { max: self.max.largest(), sum: self.sum.sum(), pixels: self.pixels }
    }
}

impl TilePixels {
    /// Adds a layer to all but the transmittance; gives its weight and the transmittance behind it.
    #[inline(always)]
    fn blend<L: Lanes>(&mut self, b: usize, brush: &Brush<L>, shade: &Shade<L>, before: L) -> (L, L) {
        let (weight, after) = composite::blend(before, shade.alpha);
        for (plot, color) in self.rgb.iter_mut().zip(brush.wide.rgb) {
            weight.mul_add(color, L::load(&plot[b])).store(&mut plot[b]);
        }
        if let (Some(sheet), Some(geometry)) = (&brush.sheet, &mut self.geometry) {
            let crosses = is_median(before, after).and(shade.drawn);
            geometry.add(b, brush.map, weight, crosses, sheet, shade);
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
        sheet: &WideSheet<L>,
        shade: &Shade<L>,
    ) {
        let (drawn, inv_depth) = (shade.drawn, sheet.inv_depth(shade.to));
        let z = (L::splat(1.0) / inv_depth).only(drawn);
        add(&mut self.depth[b], weight, z);
        add(&mut self.normal[0][b], weight, sheet.normal.x);
        add(&mut self.normal[1][b], weight, sheet.normal.y);
        add(&mut self.normal[2][b], weight, sheet.normal.z);
        L::select(crosses, z, L::load(&self.median[b])).store(&mut self.median[b]);
        let m = L::splat(map.a) - L::splat(map.b) * inv_depth;
        let sums = [L::load(&self.sums[0][b]), L::load(&self.sums[1][b]), L::load(&self.sums[2][b])];
        let is_first = sums[0].le(L::splat(0.0)).and(drawn);
        let anchor = L::select(is_first, m, L::load(&self.anchor[b]));
        anchor.store(&mut self.anchor[b]);
        let m = (m - anchor).only(drawn);
        let grown = L::load(&self.distortion[b]) + composite::distortion(weight, m, sums);
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

/// Whether this layer takes the transmittance from 1/2 or more to less.
#[inline(always)]
pub(super) fn is_median<L: Lanes>(before: L, after: L) -> L::Mask {
    let half = L::splat(0.5);
    half.le(before).and(after.lt(half))
}

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
    fill(&mut frame.rgb, pixels, tiles, |t, b, l| t.rgb.each_ref().map(|plot| plot[b][l]));
    fill(&mut frame.transmittance, pixels, tiles, |t, b, l| t.transmittance[b][l]);
    if options.geometry {
        let of = |t: &TilePixels, f: fn(&TileGeometry) -> &Plot, b: usize, l: usize| {
            t.geometry.as_deref().map_or(0.0, |g| f(g)[b][l])
        };
        fill(&mut frame.depth, pixels, tiles, |t, b, l| of(t, |g| &g.depth, b, l));
        fill(&mut frame.median_depth, pixels, tiles, |t, b, l| of(t, |g| &g.median, b, l));
        fill(&mut frame.distortion, pixels, tiles, |t, b, l| of(t, |g| &g.distortion, b, l));
        fill(&mut frame.normal, pixels, tiles, |t, b, l| {
            t.geometry.as_deref().map_or([0.0; 3], |g| g.normal.each_ref().map(|plot| plot[b][l]))
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
    image.par_chunks_mut(width * TILE as usize).enumerate().for_each(|(band, rows)| {
        for (y, row) in rows.chunks_mut(width).enumerate() {
            for (x, out) in row.iter_mut().enumerate() {
                let tile = &pixels[band * tiles.count.x as usize + x / TILE as usize];
                let (x, y) = (x % TILE as usize, y);
                *out = at(tile, (y / 4) * 4 + x / 4, (y % 4) * 4 + x % 4);
            }
        }
    });
}
