//! The soft rasteriser (Held et al. 2025): window function, alpha blending in depth
//! order; forward and backward.
//!
//! Accuracy, edge values and policies are in `docs/numerics.md`.

mod backward;
mod forward;
mod frame;
mod gather;
mod layers;
mod project;
pub(crate) mod projected;
mod slots;
mod tiles;

pub use frame::{Frame, FrameGrad, SoftOptions, Sort, SoupGrad, SoupRef, Window};
pub use slots::{CountedPixels, Importance};
pub(crate) use tiles::grid;
pub use tiles::{MARGIN, TILE, tile_count};

use forward::Slab;
use gather::PairGrads;
use glam::UVec2;
use projected::{ProjectedScene, ProjectedTriangles, ScreenBox};
use slots::{GradSlots, WeightSlot};
use std::ops::Range;
use tiles::{KeptPairs, OpenTiles, TileGeometry, TilePixels, Tiles};
use trisplat_scene::camera::Camera;
use trisplat_scene::parallel;

/// The rasteriser: scratch memory that is reused from frame to frame.
#[derive(Debug, Default)]
pub struct SoftRasterizer {
    projection: ProjectedScene,
    tiles: Tiles,
    pixels: Vec<TilePixels>,
    slots: GradSlots,
    weights: Vec<WeightSlot>,
    frame: Frame,
    /// Maximum number of pairs of splats and tiles drawn at once, if tests set fewer.
    pairs_per_slab: Option<u64>,
}

impl SoftRasterizer {
    /// A rasteriser without scratch memory.
    pub fn new() -> Self {
        Self::default()
    }

    /// Draws the view of `camera` of `soup`, with the same bits for any number of threads.
    pub fn render(&mut self, soup: &SoupRef, camera: &Camera, options: &SoftOptions) -> &Frame {
        self.render_counting(soup, camera, options, None)
    }

    /// Draws as [`render`](Self::render); only `counted` pixels add to the importance of triangles,
    /// all pixels if it is `None`.
    pub fn render_counting(
        &mut self,
        soup: &SoupRef,
        camera: &Camera,
        options: &SoftOptions,
        counted: Option<CountedPixels<'_>>,
    ) -> &Frame {
        self.projection.project(soup, camera, options);
        self.projection.order();
        let splats = &self.projection.splats;
        let size = camera.size;
        let pairs = self.pairs_per_slab.unwrap_or(PAIRS_PER_SLAB);
        if needs_slabs(splats, size, options, pairs) {
            self.draw_slabs(size, options, counted, pairs);
        } else {
            let Self { projection: ProjectedScene { splats, .. }, tiles, pixels, weights, .. } =
                self;
            tiles.bin(splats, 0..splats.records.len(), size, options.window, None);
            forward::draw(splats, tiles, Slab::Whole, pixels, weights, options, counted);
        }
        assemble(&mut self.frame, &self.pixels, &self.tiles, options);
        &self.frame
    }

    /// Gradients of the frame just rendered; soup, camera and options must be those of the last
    /// [`render`](Self::render). Rows are overwritten, not added to.
    pub fn backward(
        &mut self,
        soup: &SoupRef,
        camera: &Camera,
        options: &SoftOptions,
        d: &FrameGrad,
        out: &mut SoupGrad,
    ) {
        let Self { projection, tiles, pixels, slots, .. } = self;
        backward::draw_grad(&projection.splats, tiles, pixels, options, d, slots);
        let pairs =
            PairGrads { chunks: &self.projection.chunks, tiles: &self.tiles, slots: &self.slots };
        gather::gather(&pairs, soup, camera, options, out);
    }

    /// The last frame drawn.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Adds the last frame, drawn with `options.importance`, to `out`; `out` starts anew if its
    /// number of triangles differs.
    pub fn accumulate_importance(&self, out: &mut Importance) {
        out.accumulate(&self.projection, &self.tiles, &self.weights);
    }
}

/// Copies the tiles into the frame.
fn assemble(frame: &mut Frame, pixels: &[TilePixels], tiles: &Tiles, options: &SoftOptions) {
    let size = tiles.size;
    let count = (size.x * size.y) as usize;
    frame.size = size;
    frame.rgb.resize(count, [0.0; 3]);
    frame.transmittance.resize(count, 0.0);
    let geometry_count = if options.geometry { count } else { 0 };
    frame.normal.resize(geometry_count, [0.0; 3]);
    for values in [&mut frame.depth, &mut frame.median_depth, &mut frame.distortion] {
        values.resize(geometry_count, 0.0);
    }
    fill(&mut frame.rgb, pixels, tiles, |t, b, l| t.rgb.each_ref().map(|channel| channel[b][l]));
    fill(&mut frame.transmittance, pixels, tiles, |t, b, l| t.transmittance[b][l]);
    if options.geometry {
        fn of(tile: &TilePixels) -> &TileGeometry {
            tile.geometry.as_deref().expect("geometry was drawn")
        }
        fill(&mut frame.depth, pixels, tiles, |t, b, l| of(t).depth[b][l]);
        fill(&mut frame.median_depth, pixels, tiles, |t, b, l| of(t).median[b][l]);
        fill(&mut frame.distortion, pixels, tiles, |t, b, l| of(t).distortion[b][l]);
        fill(&mut frame.normal, pixels, tiles, |t, b, l| of(t).normal.each_ref().map(|c| c[b][l]));
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
                let x = x % TILE as usize;
                *out = at(tile, (y / 4) * 4 + x / 4, (y % 4) * 4 + x % 4);
            }
        }
    });
}

// ---- Deep scenes are drawn slab by slab, so that memory and time grow with the visible layers only
//
// Splats are drawn front to back; once every pixel of a tile has terminated, nothing behind needs a
// place in its list. A list of all (splat, tile) pairs cannot use this: 100,000 triangles that fill
// 1280x720 px have 360 million pairs. A frame with more pairs than `PAIRS_PER_SLAB` is therefore
// drawn in several slabs of splats, and closed tiles are omitted from later ones. Pixels, weights
// and gradients are bitwise the same.

/// Maximum number of pairs of a slab; each takes 20 bytes while it is drawn.
const PAIRS_PER_SLAB: u64 = 1 << 24;

/// True for a frame that needs slabs. With an order per pixel all layers must be in one list.
fn needs_slabs(
    splats: &ProjectedTriangles,
    size: UVec2,
    options: &SoftOptions,
    pairs: u64,
) -> bool {
    let [width, height] = size.as_vec2().to_array();
    // More tiles than the box can touch; rounded down, as whole numbers are summed faster.
    let tiles =
        |lo: f32, hi: f32, most: f32| (hi.min(most) - lo.max(0.0)).max(0.0) / TILE as f32 + 2.0;
    let tiles =
        |b: &ScreenBox| (tiles(b.lo[0], b.hi[0], width) * tiles(b.lo[1], b.hi[1], height)) as u64;
    options.sort == Sort::Tile && splats.bounds.iter().map(tiles).sum::<u64>() > pairs
}

/// The next splats whose pairs with open tiles fit in a slab; at least one splat.
fn next_slab(
    splats: &ProjectedTriangles,
    from: usize,
    open: &OpenTiles,
    pairs: u64,
) -> Range<usize> {
    let mut sum = 0;
    let fit = splats.bounds[from..].iter().take_while(|bounds| {
        sum += u64::from(open.count(bounds));
        sum <= pairs
    });
    from..from + fit.count().max(1)
}

impl SoftRasterizer {
    /// Draws all splats like [`forward::draw`], at most `pairs` of splats and tiles at once,
    /// without undrawn pairs.
    fn draw_slabs(
        &mut self,
        size: UVec2,
        options: &SoftOptions,
        counted: Option<CountedPixels<'_>>,
        pairs: u64,
    ) {
        let Self { projection: ProjectedScene { splats, .. }, tiles, pixels, weights, .. } = self;
        let mut open = OpenTiles::all(size);
        let mut kept = KeptPairs::default();
        let mut kept_weights = Vec::new();
        let mut drawn = 0;
        while drawn < splats.records.len() && (drawn == 0 || open.any()) {
            let range = next_slab(splats, drawn, &open, pairs);
            let slab = if drawn == 0 { Slab::First } else { Slab::Next };
            drawn = range.end;
            tiles.bin(splats, range, size, options.window, Some(&open));
            forward::draw(splats, tiles, slab, pixels, weights, options, counted);
            open.close(pixels);
            kept.add(tiles, |entry| kept_weights.extend(weights.get(entry)));
        }
        forward::background(pixels, options);
        kept.add_undrawn(splats.records.len());
        tiles.restore(kept);
        weights.clear();
        weights.resize(kept_weights.len(), WeightSlot::default());
        for (weight, entry) in kept_weights.into_iter().zip(&tiles.entry_of_pair) {
            weights[*entry as usize] = weight;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat3, Vec2, Vec3};
    use trisplat_scene::{Rng, Soup};

    const SIZE: UVec2 = UVec2::new(150, 90);

    fn camera() -> Camera {
        let rotation = Mat3::IDENTITY;
        let translation = Vec3::ZERO;
        Camera {
            rotation,
            translation,
            focal: Vec2::splat(100.0),
            center: SIZE.as_vec2() / 2.0,
            size: SIZE,
        }
    }

    /// Triangles of all sizes; the opaque ones close tiles.
    fn soup(count: usize) -> Soup {
        let mut soup = Soup::default();
        for i in 0..count as u64 {
            let rng = Rng::new(11, "slabs", i);
            let point = |k: u64| Vec3::from([0, 1, 2].map(|c| 2.0 * rng.uniform(3 * k + c) - 1.0));
            let reach = if i.is_multiple_of(5) { 4.0 } else { 0.3 };
            let center = point(0) * 1.5 + Vec3::Z * 4.0;
            soup.vertices.push([1, 2, 3].map(|k| center + reach * point(k)));
            soup.opacity.push(if i.is_multiple_of(3) { 0.98 } else { 0.3 });
            soup.sigma.push(0.05 + rng.uniform(20));
            soup.sh.push([21, 22, 23].map(|k| rng.uniform(k)));
        }
        soup
    }

    /// Everything that a frame leaves.
    fn all(
        soup: &Soup,
        options: &SoftOptions,
        pairs: u64,
    ) -> (SoftRasterizer, SoupGrad, Importance) {
        let camera = camera();
        let soup = SoupRef::from(soup);
        let mut soft = SoftRasterizer::new();
        let mut grad = SoupGrad::default();
        soft.pairs_per_slab = Some(pairs);
        soft.render(&soup, &camera, options);
        let mut importance = Importance::new(soup.count());
        soft.accumulate_importance(&mut importance);
        let pixels = (SIZE.x * SIZE.y) as usize;
        let d = FrameGrad { d_rgb: vec![[0.3, -0.2, 0.1]; pixels], ..FrameGrad::default() };
        soft.backward(&soup, &camera, options, &d, &mut grad);
        (soft, grad, importance)
    }

    #[test]
    fn slabs_change_no_bit() {
        let options =
            SoftOptions { importance: true, background: [0.2, 0.5, 0.9], ..SoftOptions::default() };
        for (options, count) in [
            (options, 900),
            (SoftOptions { geometry: true, ..options }, 900),
            (SoftOptions { window: super::Window::Coverage { width_px: 1.0 }, ..options }, 400),
            (options, 1),
        ] {
            let soup = soup(count);
            let (whole, grad, importance) = all(&soup, &options, u64::MAX);
            for pairs in [1, 100, 3000] {
                let (slabs, slab_grad, slab_importance) = all(&soup, &options, pairs);
                assert!(slabs.frame == whole.frame, "{pairs} pairs");
                assert!(slab_grad == grad, "{pairs} pairs");
                assert!(slab_importance == importance, "{pairs} pairs");
                assert!(slabs.tiles.entries.len() <= whole.tiles.entries.len());
            }
        }
    }

    #[test]
    fn hidden_splats_take_no_memory() {
        let mut soup = soup(1);
        let flat =
            |z: f32| [Vec3::new(-9.0, -9.0, z), Vec3::new(9.0, -9.0, z), Vec3::new(0.0, 18.0, z)];
        soup.vertices = (0..5000).map(|i| flat(1.0 + 0.001 * i as f32)).collect();
        soup.opacity = vec![0.99; 5000];
        soup.sigma = vec![0.001; 5000];
        soup.sh = vec![[0.1; 3]; 5000];
        let options = SoftOptions::default();
        let (whole, ..) = all(&soup, &options, u64::MAX);
        let (slabs, ..) = all(&soup, &options, 2000);
        let tiles = 10 * 6;
        assert_eq!(whole.tiles.entries.len(), 5000 * tiles);
        assert!(slabs.tiles.entries.len() <= 4 * tiles, "{}", slabs.tiles.entries.len());
        assert!(slabs.tiles.entries.capacity() < 10_000 && slabs.frame == whole.frame);
    }
}
