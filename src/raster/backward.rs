//! The backward pass over the tiles: sums of the pixels' gradients for every (splat, tile).

use crate::kernel::composite;
use crate::kernel::window;
use crate::math::lanes::{LANES, Lanes, Work, dispatch, prefetch};
use crate::math::real::Mask;
use crate::raster::forward::{self, Plot, TileGeometry, TilePixels};
use crate::raster::hits::Hits;
use crate::raster::project::Splats;
use crate::raster::shade::{self, DepthMap, Limits, Shade, Wide, WideSheet};
use crate::raster::soft::{FrameGrad, Soft, SoftOptions, Sort, Window};
use crate::raster::tiles::{BLOCKS, Entry};
use glam::UVec2;
use rayon::prelude::*;

/// Sums over the pixels of a tile; see the constants for what is where.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C, align(64))]
pub(super) struct Slot(pub(super) [f32; LANES]);

/// The same for the geometry: ∂L/∂(1/z), that times p - origin (2), ∂L/∂normal (3).
pub(super) type GeometrySlot = [f32; GEOMETRY_SUMS];

/// ∂L/∂rgb at 0, 1, 2.
pub(super) const RGB: usize = 0;
/// ∂L/∂o · o.
pub(super) const OPACITY: usize = 3;
/// ∂L/∂σ.
pub(super) const SIGMA: usize = 4;
/// ∂L/∂ratio of edge i, at 3 i; then that times p - origin.
pub(super) const RATIO: usize = 5;
/// 1 when the splat was drawn in the tile, else 0.
pub(super) const DRAWN: usize = 14;
/// Σ w error.
pub(super) const ERROR: usize = 15;
/// Entries of a [`GeometrySlot`].
pub(super) const GEOMETRY_SUMS: usize = 6;

/// Fills `soft.slots`.
pub(super) fn draw_grad(soft: &mut Soft, options: &SoftOptions, d: &FrameGrad) {
    let Soft { projection, tiles, pixels, slots, geometry_slots, .. } = soft;
    slots.resize(tiles.entries.len(), Slot::default());
    let wanted = if options.geometry { tiles.entries.len() } else { 0 };
    geometry_slots.resize(wanted, GeometrySlot::default());
    let splats = &projection.splats;
    let slots = forward::split(slots, &tiles.starts);
    let mut sheets =
        forward::split(geometry_slots, if options.geometry { &tiles.starts } else { &[] }).into_iter();
    let work: Vec<_> = slots.into_iter().map(|s| (s, sheets.next().unwrap_or_default())).collect();
    let tiles = &*tiles;
    work.into_par_iter().enumerate().for_each(|(tile, (slots, geometry_slots))| {
        let entries = &tiles.entries[tiles.starts[tile] as usize..tiles.starts[tile + 1] as usize];
        let (corner, size) = (tiles.corner(tile), tiles.size);
        let pixels = &pixels[tile];
        dispatch(DrawGrad { splats, entries, slots, geometry_slots, pixels, corner, size, options, d });
    });
}

struct DrawGrad<'a> {
    splats: &'a Splats,
    entries: &'a [Entry],
    slots: &'a mut [Slot],
    /// Empty when there is no geometry.
    geometry_slots: &'a mut [GeometrySlot],
    pixels: &'a TilePixels,
    corner: UVec2,
    size: UVec2,
    options: &'a SoftOptions,
    d: &'a FrameGrad,
}

impl Work for DrawGrad<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        if self.entries.is_empty() {
            return;
        }
        match &self.pixels.geometry {
            Some(geometry) if self.options.geometry => {
                let grads = GeometryGrad::new(&self, geometry);
                self.tile::<L>(Some(&grads));
            }
            _ => self.tile::<L>(None),
        }
    }
}

/// A tile's ∂L/∂(depth, median, distortion, normal), and what the forward pass left.
struct GeometryGrad<'a> {
    depth: Plot,
    median: Plot,
    distortion: Plot,
    normal: [Plot; 3],
    forward: &'a TileGeometry,
    map: DepthMap,
}

impl<'a> GeometryGrad<'a> {
    fn new(tile: &DrawGrad, forward: &'a TileGeometry) -> Self {
        let d = tile.d;
        Self {
            depth: tile.gather(&d.d_depth, |v| *v),
            median: tile.gather(&d.d_median_depth, |v| *v),
            distortion: tile.gather(&d.d_distortion, |v| *v),
            normal: [0, 1, 2].map(|c| tile.gather(&d.d_normal, |v| v[c])),
            forward,
            map: DepthMap::new(tile.options.depth_range),
        }
    }

    /// Σ w ∂L/∂w of all layers of block `b`.
    #[inline(always)]
    fn total<L: Lanes>(&self, b: usize) -> L {
        let f = self.forward;
        let distortion = L::load(&f.distortion[b]) * L::load(&self.distortion[b]);
        let mut out = L::load(&f.depth[b]) * L::load(&self.depth[b]) + distortion + distortion;
        for c in 0..3 {
            out = out + L::load(&f.normal[c][b]) * L::load(&self.normal[c][b]);
        }
        out
    }

    /// ∂distortion/∂w and ∂distortion/∂m of a layer.
    #[inline(always)]
    fn distortion<L: Lanes>(&self, b: usize, inv_depth: L, weight: L) -> (L, L) {
        let m = L::splat(self.map.a) - L::splat(self.map.b) * inv_depth - L::load(&self.forward.anchor[b]);
        let sums = &self.forward.sums;
        composite::distortion_grad(
            weight,
            m,
            [L::load(&sums[0][b]), L::load(&sums[1][b]), L::load(&sums[2][b])],
        )
    }

    /// Adds ∂L/∂(1/z), its moments and ∂L/∂normal.
    #[inline(always)]
    fn add_plane<L: Lanes>(
        &self,
        out: &mut [L; LANES],
        b: usize,
        sheet: &WideSheet<L>,
        s: &Shade<L>,
        weight: L,
        [before, after]: [L; 2],
    ) {
        let inv_depth = sheet.inv_depth(s.to);
        let z = L::splat(1.0) / inv_depth;
        let (_, by_m) = self.distortion(b, inv_depth, weight);
        let is_median = forward::is_median(before, after);
        let d_z = weight.mul_add(L::load(&self.depth[b]), L::load(&self.median[b]).only(is_median));
        let by_m = L::splat(self.map.b) * L::load(&self.distortion[b]) * by_m;
        let d_inv_depth = (-(d_z * z * z) - by_m).only(s.drawn);
        out[0] = out[0] + d_inv_depth;
        out[1] = d_inv_depth.mul_add(s.to.x, out[1]);
        out[2] = d_inv_depth.mul_add(s.to.y, out[2]);
        for c in 0..3 {
            out[3 + c] = weight.mul_add(L::load(&self.normal[c][b]), out[3 + c]);
        }
    }
}

impl DrawGrad<'_> {
    /// A tile's part of an image, 0 outside and for an empty image.
    fn gather<T>(&self, image: &[T], value: impl Fn(&T) -> f32) -> Plot {
        let mut out = [[0.0; LANES]; BLOCKS];
        if image.is_empty() {
            return out;
        }
        for (b, block) in out.iter_mut().enumerate() {
            for (lane, out) in block.iter_mut().enumerate() {
                let (x, y) = shade::pixel(self.corner, b, lane);
                if x < self.size.x && y < self.size.y {
                    *out = value(&image[(y * self.size.x + x) as usize]);
                }
            }
        }
        out
    }

    fn gather_rgb(&self) -> [Plot; 3] {
        [0, 1, 2].map(|c| self.gather(&self.d.d_rgb, |v| v[c]))
    }

    #[inline(always)]
    fn tile<L: Lanes>(self, geometry: Option<&GeometryGrad>) {
        let d_rgb = self.gather_rgb();
        let error = self.gather(&self.d.error, |v| *v);
        let d_transmittance = self.gather(&self.d.d_transmittance, |v| *v);
        let mut transmittance = [[0.0f32; LANES]; BLOCKS];
        let mut behind = transmittance;
        let mut backdrop = transmittance;
        let backdrop_rgb = self.options.backdrop();
        for b in 0..BLOCKS {
            let inside = shade::inside(self.size, self.corner, b);
            L::splat(1.0).only(L::from_bits(inside)).store(&mut transmittance[b]);
            let mut total = L::load(&d_transmittance[b]) * L::load(&self.pixels.transmittance[b]);
            let mut back = L::load(&d_transmittance[b]);
            for (c, d_plot) in d_rgb.iter().enumerate() {
                let d = L::load(&d_plot[b]);
                total = d.mul_add(L::load(&self.pixels.rgb[c][b]), total);
                back = d.mul_add(L::splat(backdrop_rgb[c]), back);
            }
            if let Some(grads) = geometry {
                total = total + grads.total(b);
            }
            total.store(&mut behind[b]);
            back.store(&mut backdrop[b]);
        }
        let state = State { d_rgb, transmittance, behind, backdrop, error };
        match self.options.sort {
            Sort::Tile => self.by_tile::<L>(state, geometry),
            Sort::Pixel => self.by_pixel::<L>(state, geometry),
        }
    }

    #[inline(always)]
    fn by_tile<L: Lanes>(self, mut state: State, geometry: Option<&GeometryGrad>) {
        let limits = Limits::<L>::new(self.options);
        for (k, entry) in self.entries.iter().enumerate() {
            if let Some(ahead) = self.entries.get(k + forward::AHEAD) {
                prefetch(&self.splats.records[ahead.splat as usize]);
            }
            if entry.blocks == 0 {
                self.slots[k] = Slot::default();
                continue;
            }
            let splat = Layer::<L>::new(self.splats, entry.splat, geometry, self.options);
            let mut sums = SlotSums::new();
            let mut left = entry.blocks;
            while left != 0 {
                let b = left.trailing_zeros() as usize & (BLOCKS - 1);
                left &= left - 1;
                let before = L::load(&state.transmittance[b]);
                let corner = shade::block_corner(self.corner, b);
                let Some(shade) = splat.wide.shade(corner, before, &limits) else { continue };
                let (weight, after) = composite::blend(before, shade.alpha);
                let value = splat.value(b, &shade, &state);
                let behind = L::load(&state.behind[b]) - weight * value;
                after.store(&mut state.transmittance[b]);
                behind.store(&mut state.behind[b]);
                splat.add_grad(&mut sums, b, &shade, &state, [before, behind, value]);
            }
            self.slots[k] = sums.finish();
            if geometry.is_some() {
                self.geometry_slots[k] = sums.finish_geometry();
            }
        }
    }

    #[inline(always)]
    fn by_pixel<L: Lanes>(self, mut state: State, geometry: Option<&GeometryGrad>) {
        self.slots.fill(Slot::default());
        self.geometry_slots.fill(GeometrySlot::default());
        let mut hits = Hits::default();
        for b in 0..BLOCKS {
            hits.find::<L>(self.entries, self.splats, self.corner, b, self.options);
            for i in 0..hits.len() {
                let (hit, shade) = hits.shade::<L>(i, self.entries, self.splats);
                let splat = self.entries[hit.entry].splat;
                let layer = Layer::<L>::new(self.splats, splat, geometry, self.options);
                layer.value(b, &shade, &state).store(hits.value(i));
            }
            let (before, behind) = (&mut state.transmittance[b], &mut state.behind[b]);
            hits.replay::<L>(before, behind, self.options.min_transmittance);
            for i in 0..hits.len() {
                let (hit, shade) = hits.shade::<L>(i, self.entries, self.splats);
                let splat = self.entries[hit.entry].splat;
                let layer = Layer::<L>::new(self.splats, splat, geometry, self.options);
                let mut sums = SlotSums::new();
                let at = [L::load(&hit.before), L::load(&hit.behind), L::load(&hit.value)];
                layer.add_grad(&mut sums, b, &shade, &state, at);
                add(&mut self.slots[hit.entry].0, &sums.finish().0);
                if geometry.is_some() {
                    add(&mut self.geometry_slots[hit.entry], &sums.finish_geometry());
                }
            }
        }
    }
}

/// The pixels of a tile as the layers pass, front to back.
struct State {
    d_rgb: [Plot; 3],
    transmittance: Plot,
    /// Σ w ∂L/∂w of what is still to come, background included.
    behind: Plot,
    /// ∂L/∂transmittance of the last layer's far side.
    backdrop: Plot,
    /// How wrong the pixels are.
    error: Plot,
}

/// A splat in every lane, and what its gradient needs.
struct Layer<'a, L> {
    wide: Wide<L>,
    sheet: Option<(&'a GeometryGrad<'a>, WideSheet<L>)>,
    limits: Limits<L>,
    ratio_least: L,
}

/// Sums over the blocks of one splat in one tile, lane by lane.
struct SlotSums<L> {
    base: [L; LANES],
    geometry: [L; LANES],
}

impl<L: Lanes> SlotSums<L> {
    #[inline(always)]
    fn new() -> Self {
        Self { base: [L::splat(0.0); LANES], geometry: [L::splat(0.0); LANES] }
    }

    #[inline(always)]
    fn finish(&self) -> Slot {
        let mut out = L::sums(&self.base);
        out[DRAWN] = 1.0;
        Slot(out)
    }

    #[inline(always)]
    fn finish_geometry(&self) -> GeometrySlot {
        let [a, b, c, d, e, f, ..] = L::sums(&self.geometry);
        [a, b, c, d, e, f]
    }
}

fn add(to: &mut [f32], other: &[f32]) {
    to.iter_mut().zip(other).for_each(|(a, b)| *a += b);
}

impl<'a, L: Lanes> Layer<'a, L> {
    #[inline(always)]
    fn new(
        splats: &Splats,
        splat: u32,
        geometry: Option<&'a GeometryGrad<'a>>,
        options: &SoftOptions,
    ) -> Self {
        Self {
            wide: Wide::new(&splats.records[splat as usize]),
            sheet: match geometry {
                Some(g) => Some((g, WideSheet::new(&splats.sheets[splat as usize]))),
                None => None,
            },
            limits: Limits::new(options),
            ratio_least: L::splat(options.ratio_least),
        }
    }

    /// ∂L/∂w; does not depend on the order of the layers, not even through the distortion.
    #[inline(always)]
    fn value(&self, b: usize, shade: &Shade<L>, state: &State) -> L {
        let r = L::load(&state.d_rgb[0][b]);
        let g = L::load(&state.d_rgb[1][b]);
        let blue = L::load(&state.d_rgb[2][b]);
        let mut value = self.wide.rgb[2].mul_add(blue, self.wide.rgb[1].mul_add(g, self.wide.rgb[0] * r));
        if let Some((grads, sheet)) = &self.sheet {
            let inv_depth = sheet.inv_depth(shade.to);
            let z = (L::splat(1.0) / inv_depth).only(shade.drawn);
            let (cost, _) = grads.distortion(b, inv_depth, L::splat(0.0));
            value = value + L::load(&grads.depth[b]).mul_add(z, L::load(&grads.distortion[b]) * cost);
            for (n, d) in [sheet.normal.x, sheet.normal.y, sheet.normal.z].into_iter().zip(&grads.normal) {
                value = n.mul_add(L::load(&d[b]), value);
            }
        }
        value
    }

    /// Adds what block `b` gives, of which the transmittance in front, Σ w ∂L/∂w behind, and the value are known.
    #[inline(always)]
    fn add_grad(
        &self,
        sums: &mut SlotSums<L>,
        b: usize,
        s: &Shade<L>,
        state: &State,
        [before, behind, value]: [L; 3],
    ) {
        let (weight, after) = composite::blend(before, s.alpha);
        let last = after.lt(self.limits.min_transmittance);
        let backdrop = L::load(&state.backdrop[b]);
        let d_alpha = composite::blend_grad(before, s.alpha, value, behind, last, backdrop);
        let d_log = (d_alpha * s.raw).only(s.drawn.and(s.raw.le(self.limits.cap)));
        let (sigma, least) = (self.wide.sigma, self.ratio_least);
        let (d_sigma, d_ratio, edges) = match self.limits.window {
            Window::Soft => {
                let (d_sigma, d_ratio) = window::alpha_grad(s.ratio, s.log2_ratio, sigma, least, d_log);
                (d_sigma, d_ratio, window::nearest(&s.ratios))
            }
            Window::Coverage { .. } => (L::splat(0.0), d_log / s.ratio, window::coverage_edges(&s.ratios)),
            Window::Sigmoid => {
                let (d_sigma, d_ratio) = window::sigmoid_grad(s.ratio, sigma, d_log);
                (d_sigma, d_ratio, window::nearest(&s.ratios))
            }
        };
        let out = &mut sums.base;
        for c in 0..3 {
            out[RGB + c] = weight.mul_add(L::load(&state.d_rgb[c][b]), out[RGB + c]);
        }
        out[ERROR] = weight.mul_add(L::load(&state.error[b]), out[ERROR]);
        out[OPACITY] = out[OPACITY] + d_log;
        out[SIGMA] = out[SIGMA] + d_sigma.only(s.drawn);
        let d_ratio = d_ratio.only(s.drawn);
        for (i, edge) in edges.into_iter().enumerate() {
            let at = RATIO + 3 * i;
            out[at] = out[at] + d_ratio.only(edge);
            out[at + 1] = out[at + 1].add_where(edge, d_ratio, s.to.x);
            out[at + 2] = out[at + 2].add_where(edge, d_ratio, s.to.y);
        }
        if let Some((grads, sheet)) = &self.sheet {
            grads.add_plane(&mut sums.geometry, b, sheet, s, weight, [before, after]);
        }
    }
}
