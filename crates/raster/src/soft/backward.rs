//! The backward pass over the tiles: sums of the pixels' gradients for every (splat, tile).

use super::frame::{FrameGrad, SoftOptions, Sort, Window};
use super::layers::{
    BlockLayers, BlockShade, BroadcastPlane, BroadcastSplat, DepthMap, PixelLimits,
};
use super::projected::{PREFETCH_AHEAD, ProjectedTriangles};
use super::slots::{
    DRAWN, ERROR, GeometryGradSlot, GradSlot, GradSlots, OPACITY, RATIO, RGB, SIGMA,
};
use super::tiles::{
    self, BLOCKS, TileChannel, TileEntry, TileGeometry, TilePixels, Tiles, split_by_tile,
};
use crate::kernel::window;
use glam::UVec2;
use trisplat_scene::math::lanes::{LANES, Lanes, Work, dispatch, prefetch};
use trisplat_scene::math::real::Mask;
use trisplat_scene::parallel;

/// Fills `slots` with the gradients of every (splat, tile) pair.
pub(super) fn draw_grad(
    splats: &ProjectedTriangles,
    tiles: &Tiles,
    pixels: &[TilePixels],
    options: &SoftOptions,
    d: &FrameGrad,
    slots: &mut GradSlots,
) {
    let GradSlots { base, geometry } = slots;
    base.resize(tiles.entries.len(), GradSlot::default());
    let geometry_slots = if options.geometry { tiles.entries.len() } else { 0 };
    geometry.resize(geometry_slots, GeometryGradSlot::default());
    let base = split_by_tile(base, &tiles.starts);
    let geometry = split_by_tile(geometry, &tiles.starts);
    parallel::for_each(base.into_iter().zip(geometry), |tile, (slots, geometry_slots)| {
        let entries = tiles.entries_of(tile);
        let corner = tiles.corner(tile);
        let size = tiles.size;
        let pixels = &pixels[tile];
        dispatch(TileBackward {
            splats,
            entries,
            slots,
            geometry_slots,
            pixels,
            corner,
            size,
            options,
            d,
        });
    });
}

/// One tile.
struct TileBackward<'a> {
    splats: &'a ProjectedTriangles,
    entries: &'a [TileEntry],
    slots: &'a mut [GradSlot],
    /// Empty when there is no geometry.
    geometry_slots: &'a mut [GeometryGradSlot],
    pixels: &'a TilePixels,
    corner: UVec2,
    size: UVec2,
    options: &'a SoftOptions,
    d: &'a FrameGrad,
}

impl Work for TileBackward<'_> {
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

/// A tile's ∂L/∂(depth, median, distortion, normal), and the results of the forward pass.
struct GeometryGrad<'a> {
    depth: TileChannel,
    median: TileChannel,
    distortion: TileChannel,
    normal: [TileChannel; 3],
    forward: &'a TileGeometry,
    map: DepthMap,
}

impl<'a> GeometryGrad<'a> {
    fn new(tile: &TileBackward, forward: &'a TileGeometry) -> Self {
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
        let m = L::splat(self.map.a)
            - L::splat(self.map.b) * inv_depth
            - L::load(&self.forward.anchor[b]);
        let sums = &self.forward.sums;
        let sums = [L::load(&sums[0][b]), L::load(&sums[1][b]), L::load(&sums[2][b])];
        window::distortion_grad(weight, m, sums)
    }

    /// Adds ∂L/∂(1/z), its moments and ∂L/∂normal.
    #[inline(always)]
    fn add_plane<L: Lanes>(
        &self,
        out: &mut [L; LANES],
        b: usize,
        plane: &BroadcastPlane<L>,
        s: &BlockShade<L>,
        weight: L,
        [before, after]: [L; 2],
    ) {
        let inv_depth = plane.inv_depth(s.offset);
        let z = L::splat(1.0) / inv_depth;
        let (_, by_m) = self.distortion(b, inv_depth, weight);
        let is_median = window::is_median(before, after);
        let d_z =
            weight.mul_add(L::load(&self.depth[b]), L::load(&self.median[b]).masked(is_median));
        let by_m = L::splat(self.map.b) * L::load(&self.distortion[b]) * by_m;
        let d_inv_depth = (-(d_z * z * z) - by_m).masked(s.drawn);
        out[0] = out[0] + d_inv_depth;
        out[1] = d_inv_depth.mul_add(s.offset.x, out[1]);
        out[2] = d_inv_depth.mul_add(s.offset.y, out[2]);
        for c in 0..3 {
            out[3 + c] = weight.mul_add(L::load(&self.normal[c][b]), out[3 + c]);
        }
    }
}

impl TileBackward<'_> {
    /// One channel of the tile's part of an image, 0 outside and for an empty image.
    fn gather<T>(&self, image: &[T], value: impl Fn(&T) -> f32) -> TileChannel {
        let mut out = [[0.0; LANES]; BLOCKS];
        if image.is_empty() {
            return out;
        }
        for (b, block) in out.iter_mut().enumerate() {
            for (lane, out) in block.iter_mut().enumerate() {
                let (x, y) = tiles::pixel(self.corner, b, lane);
                if x < self.size.x && y < self.size.y {
                    *out = value(&image[(y * self.size.x + x) as usize]);
                }
            }
        }
        out
    }

    #[inline(always)]
    fn tile<L: Lanes>(self, geometry: Option<&GeometryGrad>) {
        let d_rgb = [0, 1, 2].map(|c| self.gather(&self.d.d_rgb, |v| v[c]));
        let error = self.gather(&self.d.error, |v| *v);
        let d_transmittance = self.gather(&self.d.d_transmittance, |v| *v);
        let mut transmittance = [[0.0f32; LANES]; BLOCKS];
        let mut behind = transmittance;
        let mut background = transmittance;
        let background_rgb = self.options.blended_background();
        for b in 0..BLOCKS {
            let inside = tiles::inside(self.size, self.corner, b);
            L::splat(1.0).masked(L::from_bits(inside)).store(&mut transmittance[b]);
            let mut total = L::load(&d_transmittance[b]) * L::load(&self.pixels.transmittance[b]);
            let mut back = L::load(&d_transmittance[b]);
            for (c, d_channel) in d_rgb.iter().enumerate() {
                let d = L::load(&d_channel[b]);
                total = d.mul_add(L::load(&self.pixels.rgb[c][b]), total);
                back = d.mul_add(L::splat(background_rgb[c]), back);
            }
            if let Some(grads) = geometry {
                total = total + grads.total(b);
            }
            total.store(&mut behind[b]);
            back.store(&mut background[b]);
        }
        let state = TileState { d_rgb, transmittance, behind, background, error };
        match self.options.sort {
            Sort::Tile => self.by_tile::<L>(state, geometry),
            Sort::Pixel => self.by_pixel::<L>(state, geometry),
        }
    }

    #[inline(always)]
    fn splat<'g, L: Lanes>(
        &self,
        entry: usize,
        geometry: Option<&'g GeometryGrad>,
    ) -> BackwardSplat<'g, L> {
        let splat = self.entries[entry].splat as usize;
        BackwardSplat {
            broadcast: BroadcastSplat::new(&self.splats.records[splat]),
            plane: geometry.map(|g| (g, BroadcastPlane::new(&self.splats.planes[splat]))),
            limits: PixelLimits::new(self.options),
            min_ratio: L::splat(self.options.min_ratio),
        }
    }

    #[inline(always)]
    fn by_tile<L: Lanes>(self, mut state: TileState, geometry: Option<&GeometryGrad>) {
        let limits = PixelLimits::<L>::new(self.options);
        for (k, entry) in self.entries.iter().enumerate() {
            if let Some(ahead) = self.entries.get(k + PREFETCH_AHEAD) {
                prefetch(&self.splats.records[ahead.splat as usize]);
            }
            if entry.blocks == 0 {
                self.slots[k] = GradSlot::default();
                continue;
            }
            let splat = self.splat::<L>(k, geometry);
            let mut sums = SlotSums::new();
            let mut left = entry.blocks;
            while left != 0 {
                let b = left.trailing_zeros() as usize & (BLOCKS - 1);
                left &= left - 1;
                let before = L::load(&state.transmittance[b]);
                let corner = tiles::block_corner(self.corner, b);
                let Some(shade) = splat.broadcast.shade(corner, before, &limits) else { continue };
                let (weight, after) = window::blend(before, shade.alpha);
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
    fn by_pixel<L: Lanes>(self, mut state: TileState, geometry: Option<&GeometryGrad>) {
        self.slots.fill(GradSlot::default());
        self.geometry_slots.fill(GeometryGradSlot::default());
        let mut layers = BlockLayers::default();
        layers.begin(self.entries, self.splats);
        for b in 0..BLOCKS {
            layers.find::<L>(self.entries, self.splats, self.corner, b, self.options);
            for i in 0..layers.len() {
                let (layer, shade) = layers.shade::<L>(i, self.entries, self.splats);
                let value = self.splat::<L>(layer.entry, geometry).value(b, &shade, &state);
                value.store(layers.value(i));
            }
            let before = &mut state.transmittance[b];
            let behind = &mut state.behind[b];
            layers.replay::<L>(before, behind, self.options.min_transmittance);
            for i in 0..layers.len() {
                let (layer, shade) = layers.shade::<L>(i, self.entries, self.splats);
                let splat = self.splat::<L>(layer.entry, geometry);
                let mut sums = SlotSums::new();
                let at = [L::load(&layer.before), L::load(&layer.behind), L::load(&layer.value)];
                splat.add_grad(&mut sums, b, &shade, &state, at);
                add(&mut self.slots[layer.entry].0, &sums.finish().0);
                if geometry.is_some() {
                    add(&mut self.geometry_slots[layer.entry], &sums.finish_geometry());
                }
            }
        }
    }
}

/// The pixels of a tile between two layers, front to back.
struct TileState {
    d_rgb: [TileChannel; 3],
    transmittance: TileChannel,
    /// Σ w ∂L/∂w of the layers behind, background included.
    behind: TileChannel,
    /// ∂L/∂transmittance behind the last layer.
    background: TileChannel,
    /// Error of the pixels, [`FrameGrad::error`].
    error: TileChannel,
}

/// A splat in every lane, with the values for its gradient.
struct BackwardSplat<'a, L> {
    broadcast: BroadcastSplat<L>,
    plane: Option<(&'a GeometryGrad<'a>, BroadcastPlane<L>)>,
    limits: PixelLimits<L>,
    min_ratio: L,
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
    fn finish(&self) -> GradSlot {
        let mut out = L::sums(&self.base);
        out[DRAWN] = 1.0;
        GradSlot(out)
    }

    #[inline(always)]
    fn finish_geometry(&self) -> GeometryGradSlot {
        let [a, b, c, d, e, f, ..] = L::sums(&self.geometry);
        [a, b, c, d, e, f]
    }
}

fn add(to: &mut [f32], other: &[f32]) {
    for (a, b) in to.iter_mut().zip(other) {
        *a += b;
    }
}

impl<L: Lanes> BackwardSplat<'_, L> {
    /// ∂L/∂w; independent of the order of the layers, even through the distortion.
    #[inline(always)]
    fn value(&self, b: usize, shade: &BlockShade<L>, state: &TileState) -> L {
        let r = L::load(&state.d_rgb[0][b]);
        let g = L::load(&state.d_rgb[1][b]);
        let blue = L::load(&state.d_rgb[2][b]);
        let mut value = self.broadcast.rgb[2]
            .mul_add(blue, self.broadcast.rgb[1].mul_add(g, self.broadcast.rgb[0] * r));
        if let Some((grads, plane)) = &self.plane {
            let inv_depth = plane.inv_depth(shade.offset);
            let z = (L::splat(1.0) / inv_depth).masked(shade.drawn);
            let (cost, _) = grads.distortion(b, inv_depth, L::splat(0.0));
            value =
                value + L::load(&grads.depth[b]).mul_add(z, L::load(&grads.distortion[b]) * cost);
            for (n, d) in
                [plane.normal.x, plane.normal.y, plane.normal.z].into_iter().zip(&grads.normal)
            {
                value = n.mul_add(L::load(&d[b]), value);
            }
        }
        value
    }

    /// Adds the gradient of block `b` for the transmittance in front, Σ w ∂L/∂w behind, and the
    /// layer's ∂L/∂w.
    #[inline(always)]
    fn add_grad(
        &self,
        sums: &mut SlotSums<L>,
        b: usize,
        s: &BlockShade<L>,
        state: &TileState,
        [before, behind, value]: [L; 3],
    ) {
        let (weight, after) = window::blend(before, s.alpha);
        let last = after.lt(self.limits.min_transmittance);
        let background = L::load(&state.background[b]);
        let d_alpha = window::blend_grad(before, s.alpha, value, behind, last, background);
        let d_log = (d_alpha * s.raw).masked(s.drawn.and(s.raw.le(self.limits.cap)));
        let sigma = self.broadcast.sigma;
        let min_ratio = self.min_ratio;
        let (d_sigma, d_ratio, edges) = match self.limits.window {
            Window::Soft => {
                let (d_sigma, d_ratio) =
                    window::alpha_grad(s.ratio, s.log2_ratio, sigma, min_ratio, d_log);
                (d_sigma, d_ratio, window::nearest(&s.ratios))
            }
            Window::Coverage { .. } => {
                (L::splat(0.0), d_log / s.ratio, window::coverage_edges(&s.ratios))
            }
        };
        let out = &mut sums.base;
        for c in 0..3 {
            out[RGB + c] = weight.mul_add(L::load(&state.d_rgb[c][b]), out[RGB + c]);
        }
        out[ERROR] = weight.mul_add(L::load(&state.error[b]), out[ERROR]);
        out[OPACITY] = out[OPACITY] + d_log;
        out[SIGMA] = out[SIGMA] + d_sigma.masked(s.drawn);
        let d_ratio = d_ratio.masked(s.drawn);
        for (i, edge) in edges.into_iter().enumerate() {
            let at = RATIO + 3 * i;
            out[at] = out[at] + d_ratio.masked(edge);
            out[at + 1] = out[at + 1].add_where(edge, d_ratio, s.offset.x);
            out[at + 2] = out[at + 2].add_where(edge, d_ratio, s.offset.y);
        }
        if let Some((grads, plane)) = &self.plane {
            grads.add_plane(&mut sums.geometry, b, plane, s, weight, [before, after]);
        }
    }
}
