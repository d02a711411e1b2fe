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
mod slabs;
mod slots;
pub(crate) mod splats;
mod tiles;

pub use frame::{Frame, FrameGrad, SoftOptions, Sort, SoupGrad, SoupRef, Window};
pub use slots::{CountedPixels, Importance};
pub use tiles::{MARGIN, TILE, tile_count};

use forward::Slab;
use gather::PairGrads;
use slabs::SlabTarget;
use slots::{GradSlots, WeightSlot};
use splats::Projection;
use tiles::{TileChannel, TileGeometry, TilePixels, Tiles};
use trisplat_scene::camera::Camera;
use trisplat_scene::parallel;

/// The rasteriser: scratch memory that is reused from frame to frame.
#[derive(Debug, Default)]
pub struct SoftRasterizer {
    projection: Projection,
    tiles: Tiles,
    pixels: Vec<TilePixels>,
    slots: GradSlots,
    weights: Vec<WeightSlot>,
    frame: Frame,
    /// Most pairs of splats and tiles drawn at once, where tests set fewer than usual.
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

    /// The same picture; only `counted` pixels add to the importance of triangles, all if there is none.
    pub fn render_counting(
        &mut self,
        soup: &SoupRef,
        camera: &Camera,
        options: &SoftOptions,
        counted: Option<CountedPixels<'_>>,
    ) -> &Frame {
        self.projection.project(soup, camera, options);
        self.projection.order();
        let Self { projection, tiles, pixels, weights, .. } = self;
        let (splats, size) = (&projection.splats, camera.size);
        let pairs = self.pairs_per_slab.unwrap_or(slabs::PAIRS_PER_SLAB);
        if slabs::are_needed(splats, size, options, pairs) {
            let mut target = SlabTarget { tiles, pixels, weights };
            target.draw(splats, size, options, counted, pairs);
        } else {
            tiles.bin(splats, size, options.window);
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
        let pairs = PairGrads { chunks: &self.projection.chunks, tiles: &self.tiles, slots: &self.slots };
        gather::gather(&pairs, soup, camera, options, out);
    }

    /// The last frame drawn.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Adds the last frame, drawn with `options.importance`, to `out`; `out` is first reset if its number of
    /// triangles differs.
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
