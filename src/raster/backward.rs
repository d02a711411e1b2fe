//! The backward pass over the tiles: sums of the pixels' gradients for every (splat, tile).

use crate::kernel::composite;
use crate::kernel::window;
use crate::math::lanes::{LANES, Lanes, Work, dispatch};
use crate::math::real::Mask;
use crate::raster::forward::{self, Plot, TileGeometry, TilePixels};
use crate::raster::project::Splats;
use crate::raster::shade::{self, DepthMap, Limits, Shade, Wide, WideSheet};
use crate::raster::soft::{FrameGrad, Soft, SoftOptions};
use crate::raster::tiles::{BLOCKS, Entry};
use glam::UVec2;
use rayon::prelude::*;

/// Sums over the pixels of a tile; see the constants for what is where.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C, align(64))]
pub(super) struct Slot(pub(super) [f32; LANES], pub(super) [f32; GEOMETRY_SUMS]);

/// ∂L/∂rgb at 0, 1, 2.
pub(super) const RGB: usize = 0;
/// ∂L/∂o · o.
pub(super) const OPACITY: usize = 3;
/// ∂L/∂σ.
pub(super) const SIGMA: usize = 4;
/// ∂L/∂ratio of edge i, at 3 i; then that times p - origin.
pub(super) const RATIO: usize = 5;
/// Second part: ∂L/∂(1/z), that times p - origin (2), ∂L/∂normal (3).
pub(super) const GEOMETRY_SUMS: usize = 6;

/// Fills `soft.slots`.
pub(super) fn draw_grad(soft: &mut Soft, options: &SoftOptions, d: &FrameGrad) {
    let Soft { projection, tiles, pixels, slots, .. } = soft;
    slots.resize(tiles.entries.len(), Slot::default());
    let splats = &projection.splats;
    let work = forward::split(slots, &tiles.starts);
    let tiles = &*tiles;
    work.into_par_iter().enumerate().for_each(|(tile, slots)| {
        let entries = &tiles.entries[tiles.starts[tile] as usize..tiles.starts[tile + 1] as usize];
        let (corner, size) = (tiles.corner(tile), tiles.size);
        dispatch(DrawGrad { splats, entries, slots, pixels: &pixels[tile], corner, size, options, d });
    });
}

struct DrawGrad<'a> {
    splats: &'a Splats,
    entries: &'a [Entry],
    slots: &'a mut [Slot],
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
        let product = |a: &Plot, d: &Plot| L::load(&a[b]) * L::load(&d[b]);
        let f = self.forward;
        let distortion = product(&f.distortion, &self.distortion);
        let mut out = product(&f.depth, &self.depth) + distortion + distortion;
        for c in 0..3 {
            out = out + product(&f.normal[c], &self.normal[c]);
        }
        out
    }
}

/// ∂L/∂w and ∂L/∂(1/z) of a layer due to its geometry.
#[inline(always)]
fn geometry_value<L: Lanes>(
    grads: &GeometryGrad,
    b: usize,
    sheet: &WideSheet<L>,
    shade: &Shade<L>,
    weight: L,
    after: L,
    before: L,
) -> (L, L) {
    let f = grads.forward;
    let inv_depth = sheet.inv_depth(shade.to);
    let z = (L::splat(1.0) / inv_depth).only(shade.drawn);
    let m = L::splat(grads.map.a) - L::splat(grads.map.b) * inv_depth - L::load(&f.anchor[b]);
    let m = m.only(shade.drawn);
    let sums = [0, 1, 2].map(|i| L::load(&f.sums[i][b]));
    let (by_weight, by_m) = composite::distortion_grad(weight, m, sums);
    let (d_depth, d_distortion) = (L::load(&grads.depth[b]), L::load(&grads.distortion[b]));
    let mut value = d_depth.mul_add(z, d_distortion * by_weight);
    for (n, d) in [sheet.normal.x, sheet.normal.y, sheet.normal.z].into_iter().zip(&grads.normal) {
        value = n.mul_add(L::load(&d[b]), value);
    }
    let is_median = forward::is_median(before, after).and(shade.drawn);
    let d_z = weight.mul_add(d_depth, L::load(&grads.median[b]).only(is_median));
    (value, -(d_z * z * z) - L::splat(grads.map.b) * d_distortion * by_m)
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

    #[inline(always)]
    fn tile<L: Lanes>(self, geometry: Option<&GeometryGrad>) {
        let d_rgb = [0, 1, 2].map(|c| self.gather(&self.d.d_rgb, |v| v[c]));
        let d_transmittance = self.gather(&self.d.d_transmittance, |v| *v);
        let mut transmittance = [[0.0f32; LANES]; BLOCKS];
        let mut behind = transmittance;
        let mut backdrop = transmittance;
        for b in 0..BLOCKS {
            let inside = shade::inside(self.size, self.corner, b);
            L::splat(1.0).only(L::from_bits(inside)).store(&mut transmittance[b]);
            let mut total = L::load(&d_transmittance[b]) * L::load(&self.pixels.transmittance[b]);
            let mut back = L::load(&d_transmittance[b]);
            for c in 0..3 {
                let d = L::load(&d_rgb[c][b]);
                total = d.mul_add(L::load(&self.pixels.rgb[c][b]), total);
                back = d.mul_add(L::splat(self.options.background[c]), back);
            }
            if let Some(grads) = geometry {
                total = total + grads.total(b);
            }
            total.store(&mut behind[b]);
            back.store(&mut backdrop[b]);
        }
        let mut state = State { d_rgb, transmittance, behind, backdrop };
        for (entry, slot) in self.entries.iter().zip(self.slots) {
            if entry.blocks != 0 {
                let splat = entry.splat as usize;
                let wide = Wide::<L>::new(&self.splats.records[splat]);
                let sheet = geometry.map(|g| (g, WideSheet::<L>::new(&self.splats.sheets[splat])));
                *slot = splat_grad(entry.blocks, &wide, sheet, self.corner, self.options, &mut state);
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
}

/// Sums over the blocks of one splat in one tile.
#[inline(always)]
fn splat_grad<L: Lanes>(
    blocks: u32,
    wide: &Wide<L>,
    sheet: Option<(&GeometryGrad, WideSheet<L>)>,
    corner: UVec2,
    options: &SoftOptions,
    state: &mut State,
) -> Slot {
    let (cap, least) = (L::splat(options.alpha_cap), L::splat(options.ratio_least));
    let limits = Limits { cap, min_transmittance: L::splat(options.min_transmittance) };
    let mut sums = [L::splat(0.0); LANES];
    let mut planes = [L::splat(0.0); LANES];
    let mut left = blocks;
    while left != 0 {
        let b = left.trailing_zeros() as usize & (BLOCKS - 1);
        left &= left - 1;
        let before = L::load(&state.transmittance[b]);
        let Some(s) = wide.shade(shade::block_corner(corner, b), before, &limits) else { continue };
        let (weight, after) = composite::blend(before, s.alpha);
        after.store(&mut state.transmittance[b]);
        let d_rgb = [0, 1, 2].map(|c| L::load(&state.d_rgb[c][b]));
        let mut value = wide.rgb[2].mul_add(d_rgb[2], wide.rgb[1].mul_add(d_rgb[1], wide.rgb[0] * d_rgb[0]));
        for c in 0..3 {
            sums[RGB + c] = weight.mul_add(d_rgb[c], sums[RGB + c]);
        }
        if let Some((grads, sheet)) = &sheet {
            let (more, d_inv_depth) = geometry_value(grads, b, sheet, &s, weight, after, before);
            value = value + more;
            let d_inv_depth = d_inv_depth.only(s.drawn);
            planes[0] = planes[0] + d_inv_depth;
            planes[1] = d_inv_depth.mul_add(s.to.x, planes[1]);
            planes[2] = d_inv_depth.mul_add(s.to.y, planes[2]);
            for c in 0..3 {
                planes[3 + c] = weight.mul_add(L::load(&grads.normal[c][b]), planes[3 + c]);
            }
        }
        let behind = L::load(&state.behind[b]) - weight * value;
        behind.store(&mut state.behind[b]);
        let last = after.lt(limits.min_transmittance);
        let backdrop = L::load(&state.backdrop[b]);
        let d_alpha = composite::blend_grad(before, s.alpha, value, behind, last, backdrop);
        let d_log = (d_alpha * s.raw).only(s.drawn.and(s.raw.le(cap)));
        let (d_sigma, d_ratio) = window::alpha_grad(s.ratio, s.log2_ratio, wide.sigma, least, d_log);
        sums[OPACITY] = sums[OPACITY] + d_log;
        sums[SIGMA] = sums[SIGMA] + d_sigma.only(s.drawn);
        let d_ratio = d_ratio.only(s.drawn);
        for (i, nearest) in window::nearest(&s.ratios).into_iter().enumerate() {
            let at = RATIO + 3 * i;
            sums[at] = sums[at] + d_ratio.only(nearest);
            sums[at + 1] = sums[at + 1].add_where(nearest, d_ratio, s.to.x);
            sums[at + 2] = sums[at + 2].add_where(nearest, d_ratio, s.to.y);
        }
    }
    let mut more = [0.0; GEOMETRY_SUMS];
    if sheet.is_some() {
        more.copy_from_slice(&L::sums(&planes)[..GEOMETRY_SUMS]);
    }
    Slot(L::sums(&sums), more)
}
