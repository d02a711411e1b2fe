//! A splat broadcast to the sixteen pixels of a block, for the forward and backward passes.

use super::options::{SoftOptions, Window};
use super::splats::SplatRecord;
use super::tile_grid::{LANE_X, LANE_Y};
use crate::kernel::splat::DepthPlane;
use crate::kernel::window;
use trisplat_scene::math::lanes::Lanes;
use trisplat_scene::math::real::Mask;
use trisplat_scene::math::vec::{V2, V3};

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
    /// How triangles end at their edges.
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
}

impl<L: Lanes> PixelLimits<L> {
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
            edge: [broadcast_v2(record.edge[0]), broadcast_v2(record.edge[1]), broadcast_v2(record.edge[2])],
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
            normal: V3::new(L::splat(plane.normal.x), L::splat(plane.normal.y), L::splat(plane.normal.z)),
        }
    }

    /// 1 / z at `offset` from the origin; positive inside the triangle, and bounded away from 0 against rounding.
    #[inline(always)]
    pub(super) fn inv_depth(&self, offset: V2<L>) -> L {
        self.slope.y.mul_add(offset.y, self.slope.x.mul_add(offset.x, self.inv_depth)).max(L::splat(1e-20))
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
