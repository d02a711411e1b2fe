//! Layers of a block of sixteen pixels: a splat's shade there; and with an order per pixel, the
//! layers sorted by the depth of their planes.
//!
//! Every layer is kept, so the order is exact, intersecting triangles included. Only the
//! transmittance depends on the order. After [`BlockLayers::replay`] has computed it, everything
//! else is summed layer by layer as usual.

use super::frame::{SoftOptions, Window};
use super::projected::{ProjectedTriangles, SplatRecord};
use super::tiles::{BLOCKS, LANE_X, LANE_Y, TileEntry, block_corner};
use crate::kernel::splat::DepthPlane;
use crate::kernel::window;
use glam::UVec2;
use trisplat_scene::math::lanes::{LANES, Lanes, prefetch};
use trisplat_scene::math::real::{Mask, V2, V3};

/// A splat's record in every lane.
pub(super) struct BroadcastSplat<L> {
    origin: [f32; 2],
    edge: [V2<L>; 3],
    shift: L,
    floor: L,
    pub(super) sigma: L,
    log2_opacity: L,
    pub(super) rgb: [L; 3],
}

/// Bounds of the alpha and the transmittance of every pixel.
#[derive(Clone, Copy)]
pub(super) struct PixelLimits<L> {
    pub(super) cap: L,
    pub(super) min_transmittance: L,
    /// The window at the edges of triangles.
    pub(super) window: Window,
}

impl<L: Lanes> PixelLimits<L> {
    #[inline(always)]
    pub(super) fn new(options: &SoftOptions) -> Self {
        Self {
            cap: L::splat(options.alpha_cap),
            min_transmittance: L::splat(options.min_transmittance),
            window: options.window,
        }
    }

    #[inline(always)]
    fn ratio(&self, ratios: &[L; 3]) -> L {
        match self.window {
            Window::Coverage { .. } => window::coverage(ratios),
            Window::Soft => window::ratio(ratios),
        }
    }
}

/// A splat's contribution to the sixteen pixels of a block.
#[derive(Clone, Copy)]
pub(super) struct BlockShade<L: Lanes> {
    /// p - origin, px.
    pub(super) offset: V2<L>,
    pub(super) ratios: [L; 3],
    /// The ratio or the coverage.
    pub(super) ratio: L,
    pub(super) log2_ratio: L,
    /// Alpha before the cap; arbitrary where not drawn.
    pub(super) raw: L,
    /// Alpha, 0 where not drawn.
    pub(super) alpha: L,
    pub(super) drawn: L::Mask,
}

impl<L: Lanes> BroadcastSplat<L> {
    #[inline(always)]
    pub(super) fn new(record: &SplatRecord) -> Self {
        Self {
            origin: record.origin,
            edge: [
                broadcast_v2(record.edge[0]),
                broadcast_v2(record.edge[1]),
                broadcast_v2(record.edge[2]),
            ],
            shift: L::splat(record.shift),
            floor: L::splat(record.floor),
            sigma: L::splat(record.sigma),
            log2_opacity: L::splat(record.log2_opacity),
            rgb: [L::splat(record.rgb[0]), L::splat(record.rgb[1]), L::splat(record.rgb[2])],
        }
    }

    /// Alpha on the block whose top left pixel is `corner`; nothing when no pixel is drawn.
    #[inline(always)]
    pub(super) fn shade(
        &self,
        corner: [f32; 2],
        transmittance: L,
        limits: &PixelLimits<L>,
    ) -> Option<BlockShade<L>> {
        let offset = self.offset(corner);
        let ratios = window::ratios(&self.edge, self.shift, offset);
        let ratio = limits.ratio(&ratios);
        let drawn = self.floor.le(ratio).and(limits.min_transmittance.le(transmittance));
        if L::bits(drawn) == 0 {
            return None;
        }
        Some(self.finish(offset, ratios, ratio, drawn, limits))
    }

    /// [`Self::shade`], even when no pixel is drawn.
    #[inline(always)]
    pub(super) fn shade_all(&self, corner: [f32; 2], limits: &PixelLimits<L>) -> BlockShade<L> {
        let offset = self.offset(corner);
        let ratios = window::ratios(&self.edge, self.shift, offset);
        let ratio = limits.ratio(&ratios);
        self.finish(offset, ratios, ratio, self.floor.le(ratio), limits)
    }

    /// p - origin on the block whose top left pixel is `corner`, px.
    #[inline(always)]
    pub(super) fn offset(&self, corner: [f32; 2]) -> V2<L> {
        V2::new(
            L::load(&LANE_X) + L::splat(corner[0] + 0.5 - self.origin[0]),
            L::load(&LANE_Y) + L::splat(corner[1] + 0.5 - self.origin[1]),
        )
    }

    #[inline(always)]
    fn finish(
        &self,
        offset: V2<L>,
        ratios: [L; 3],
        ratio: L,
        drawn: L::Mask,
        limits: &PixelLimits<L>,
    ) -> BlockShade<L> {
        let (log2_ratio, raw) = match limits.window {
            Window::Soft => {
                let log2_ratio = ratio.log2();
                (log2_ratio, window::alpha(log2_ratio, self.log2_opacity, self.sigma))
            }
            Window::Coverage { .. } => (L::splat(0.0), self.log2_opacity.exp2() * ratio),
        };
        let alpha = raw.min(limits.cap).masked(drawn);
        BlockShade { offset, ratios, ratio, log2_ratio, raw, alpha, drawn }
    }
}

#[inline(always)]
fn broadcast_v2<L: Lanes>([x, y]: [f32; 2]) -> V2<L> {
    V2::new(L::splat(x), L::splat(y))
}

/// A depth plane in every lane.
pub(super) struct BroadcastPlane<L> {
    inv_depth: L,
    slope: V2<L>,
    pub(super) normal: V3<L>,
}

impl<L: Lanes> BroadcastPlane<L> {
    #[inline(always)]
    pub(super) fn new(plane: &DepthPlane<f32>) -> Self {
        Self {
            inv_depth: L::splat(plane.inv_depth),
            slope: V2::new(L::splat(plane.slope.x), L::splat(plane.slope.y)),
            normal: V3::new(
                L::splat(plane.normal.x),
                L::splat(plane.normal.y),
                L::splat(plane.normal.z),
            ),
        }
    }

    /// 1 / z at `offset` from the origin; positive inside the triangle, and bounded away from 0
    /// against rounding.
    #[inline(always)]
    pub(super) fn inv_depth(&self, offset: V2<L>) -> L {
        self.slope
            .y
            .mul_add(offset.y, self.slope.x.mul_add(offset.x, self.inv_depth))
            .max(L::splat(1e-20))
    }
}

/// Mapped depth m = a - b / z, from 0 at the near to 1 at the far end of the range.
#[derive(Clone, Copy)]
pub(super) struct DepthMap {
    pub(super) a: f32,
    pub(super) b: f32,
}

impl DepthMap {
    pub(super) fn new([near, far]: [f32; 2]) -> Self {
        let scale = 1.0 / (far - near);
        Self { a: far * scale, b: far * near * scale }
    }
}

/// A layer on the pixels of a block.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct BlockLayer {
    /// Its entry in the tile.
    pub(super) entry: usize,
    /// Pixels where it is drawn, one bit each.
    pub(super) drawn: u16,
    inv_depth: [f32; LANES],
    alpha: [f32; LANES],
    /// ∂L/∂w, for the backward pass.
    pub(super) value: [f32; LANES],
    /// Transmittance in front of it.
    pub(super) before: [f32; LANES],
    /// Σ w ∂L/∂w behind it.
    pub(super) behind: [f32; LANES],
}

/// Depth of the occluder of each pixel of a block, for early termination: one layer whose alpha
/// ends the pixel, or two that do so together. Layers behind it are never visible.
struct OccluderDepth<L> {
    /// 1 / depth of the occluder, 0 where there is none.
    inv_depth: L,
    /// 1 / depth of the nearest of the layers that end a pixel in pairs.
    nearest_half: L,
    /// Alpha above which one layer ends a pixel.
    whole_alpha: L,
    /// Alpha above which two layers end a pixel.
    half_alpha: L,
}

impl<L: Lanes> OccluderDepth<L> {
    #[inline(always)]
    fn new(min_transmittance: f32) -> Self {
        let zero = L::splat(0.0);
        let whole = 1.0 - min_transmittance;
        let half = 1.0 - min_transmittance.sqrt();
        Self {
            inv_depth: zero,
            nearest_half: zero,
            whole_alpha: L::splat(whole),
            half_alpha: L::splat(half),
        }
    }

    /// Adds a layer; its alpha is 0 where it is not drawn.
    #[inline(always)]
    fn add(&mut self, inv_depth: L, alpha: L) {
        let alone = inv_depth.masked(self.whole_alpha.lt(alpha));
        let half = inv_depth.masked(self.half_alpha.lt(alpha));
        self.inv_depth = self.inv_depth.max(alone).max(half.min(self.nearest_half));
        self.nearest_half = self.nearest_half.max(half);
    }
}

/// The nearest layer at each pixel of a block.
struct FrontLayer<L> {
    /// Pixels with a layer; at the others nothing is blended.
    lanes: u16,
    which: L,
    alpha: L,
    value: L,
}

/// Calls `of` with the number of each bit of `bits`.
#[inline(always)]
fn each_bit(mut bits: u32, mut of: impl FnMut(usize)) {
    while bits != 0 {
        of(bits.trailing_zeros() as usize & (BLOCKS - 1));
        bits &= bits - 1;
    }
}

/// The layers of one block.
#[derive(Debug, Default)]
pub(super) struct BlockLayers {
    layers: Vec<BlockLayer>,
    /// Pixels where each layer is not blended yet.
    left: Vec<u16>,
    /// The tile's entries in each block, block by block, and where each block's begin.
    entries: Vec<u32>,
    starts: [usize; BLOCKS + 1],
    corner: [f32; 2],
    cap: f32,
    window: Window,
}

impl BlockLayers {
    pub(super) fn len(&self) -> usize {
        self.layers.len()
    }

    pub(super) fn value(&mut self, i: usize) -> &mut [f32; LANES] {
        &mut self.layers[i].value
    }

    /// Begins a tile: sorts its entries by block, as most are in few of them.
    #[inline(always)]
    pub(super) fn begin(&mut self, entries: &[TileEntry], splats: &ProjectedTriangles) {
        let mut next = [0; BLOCKS];
        for e in entries {
            prefetch(&splats.records[e.splat as usize]);
            prefetch(&splats.planes[e.splat as usize]);
            each_bit(e.blocks, |b| next[b] += 1);
        }
        let mut sum = 0;
        for (b, count) in next.iter_mut().enumerate() {
            self.starts[b] = sum;
            sum += std::mem::replace(count, sum);
        }
        self.starts[BLOCKS] = sum;
        self.entries.clear();
        self.entries.resize(sum, 0);
        for (entry, e) in (0..).zip(entries) {
            each_bit(e.blocks, |b| {
                self.entries[next[b]] = entry;
                next[b] += 1;
            });
        }
    }

    /// Finds the layers of block `b` of the tile at `corner`, which has begun.
    #[inline(always)]
    pub(super) fn find<L: Lanes>(
        &mut self,
        entries: &[TileEntry],
        splats: &ProjectedTriangles,
        corner: UVec2,
        b: usize,
        options: &SoftOptions,
    ) {
        self.layers.clear();
        self.corner = block_corner(corner, b);
        self.cap = options.alpha_cap;
        self.window = options.window;
        let limits = self.limits();
        let mut occluder = OccluderDepth::<L>::new(options.min_transmittance);
        for &entry in &self.entries[self.starts[b]..self.starts[b + 1]] {
            let entry = entry as usize;
            let number = entries[entry].splat as usize;
            let splat = BroadcastSplat::<L>::new(&splats.records[number]);
            let plane = BroadcastPlane::<L>::new(&splats.planes[number]);
            let inv_depth = plane.inv_depth(splat.offset(self.corner));
            let in_front = occluder.inv_depth.le(inv_depth);
            if L::bits(in_front) == 0 {
                continue;
            }
            let Some(mut shade) = splat.shade(self.corner, L::splat(1.0), &limits) else {
                continue;
            };
            shade.drawn = shade.drawn.and(in_front);
            shade.alpha = shade.alpha.masked(shade.drawn);
            if L::bits(shade.drawn) == 0 {
                continue;
            }
            occluder.add(inv_depth, shade.alpha);
            let mut layer =
                BlockLayer { entry, drawn: L::bits(shade.drawn), ..BlockLayer::default() };
            inv_depth.store(&mut layer.inv_depth);
            shade.alpha.store(&mut layer.alpha);
            self.layers.push(layer);
        }
    }

    #[inline(always)]
    fn limits<L: Lanes>(&self) -> PixelLimits<L> {
        let cap = L::splat(self.cap);
        let min_transmittance = L::splat(0.0);
        PixelLimits { cap, min_transmittance, window: self.window }
    }

    /// Blends every pixel in its own order, ties by index. Sets the light in front of and the sum
    /// behind every layer, and omits layers behind the one that ends a pixel.
    ///
    /// Each round takes the nearest remaining layer of all sixteen pixels at once; pixels of opaque
    /// scenes have few.
    #[inline(always)]
    pub(super) fn replay<L: Lanes>(
        &mut self,
        transmittance: &mut [f32; LANES],
        behind: &mut [f32; LANES],
        min_transmittance: f32,
    ) {
        let end = L::splat(min_transmittance);
        self.left.clear();
        self.left.extend(self.layers.iter_mut().map(|layer| std::mem::take(&mut layer.drawn)));
        loop {
            let before = L::load(transmittance);
            let alive = L::bits(end.le(before));
            let Some(front) = self.front::<L>(alive) else { break };
            let (weight, after) = window::blend(before, front.alpha);
            after.store(transmittance);
            let rest = L::load(behind) - weight * front.value;
            rest.store(behind);
            let mut which = [0.0; LANES];
            front.which.store(&mut which);
            let mut fronts = [0.0; LANES];
            before.store(&mut fronts);
            let mut lanes = front.lanes;
            while lanes != 0 {
                let lane = lanes.trailing_zeros() as usize & (LANES - 1);
                lanes &= lanes - 1;
                let i = which[lane] as usize;
                let layer = &mut self.layers[i];
                layer.drawn |= 1 << lane;
                layer.before[lane] = fronts[lane];
                layer.behind[lane] = behind[lane];
                self.left[i] &= !(1 << lane);
            }
        }
    }

    /// The nearest remaining layer at each pixel of `alive`.
    #[inline(always)]
    fn front<L: Lanes>(&self, alive: u16) -> Option<FrontLayer<L>> {
        let zero = L::splat(0.0);
        let mut nearest = zero;
        let mut lanes = 0;
        let mut front = FrontLayer { lanes: 0, which: zero, alpha: zero, value: zero };
        for (i, (layer, left)) in self.layers.iter().zip(&self.left).enumerate() {
            if left & alive == 0 {
                continue;
            }
            let inv_depth = L::load(&layer.inv_depth);
            let nearer = nearest.lt(inv_depth).and(L::from_bits(left & alive));
            nearest = L::select(nearer, inv_depth, nearest);
            front.which = L::select(nearer, L::splat(i as f32), front.which);
            front.alpha = L::select(nearer, L::load(&layer.alpha), front.alpha);
            front.value = L::select(nearer, L::load(&layer.value), front.value);
            lanes |= L::bits(nearer);
        }
        front.lanes = lanes;
        (lanes != 0).then_some(front)
    }

    /// Layer `i`, and its shading on the pixels it is drawn on.
    #[inline(always)]
    pub(super) fn shade<L: Lanes>(
        &self,
        i: usize,
        entries: &[TileEntry],
        splats: &ProjectedTriangles,
    ) -> (&BlockLayer, BlockShade<L>) {
        let layer = &self.layers[i];
        let splat = BroadcastSplat::<L>::new(&splats.records[entries[layer.entry].splat as usize]);
        let mut shade = splat.shade_all(self.corner, &self.limits());
        shade.drawn = shade.drawn.and(L::from_bits(layer.drawn));
        shade.alpha = shade.alpha.masked(shade.drawn);
        (layer, shade)
    }
}
