//! What a photo shows of each block, by drawing the coarse scene as the photo's camera sees it.

use super::cells::Cells;
use super::manifest::Block;
use super::region::{Region, middle};
use glam::{UVec2, Vec3};
use std::sync::atomic::{AtomicBool, Ordering};
use trisplat_raster::soft::{Importance, SoftOptions, SoftRasterizer, SoupRef};
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::{SceneNormalization, Soup, camera::Camera, sh0_from_rgb};

/// Longer side of the drawings, px: shares of a picture need no more.
const LONGEST_PX: u32 = 192;
/// A triangle is visible when its weight reaches this at some pixel.
const LEAST_WEIGHT: f32 = 1e-3;
/// Share of a block's pixels that its crop of a photo may leave out, on each side.
const LEFT_OUT: f32 = 0.005;
/// Margin of a crop, px, so that the windows of SSIM are whole.
const MARGIN_PX: f32 = 8.0;
/// Corners of crops are multiples of this, px, so that they stay integers when photos are halved twice.
const ALIGNED_PX: u32 = 4;

/// A coarse scene that photos show.
pub(super) struct Coverage<'a> {
    cells: Cells,
    /// Middles of the triangles, in the frame of the blocks' boxes.
    middles: &'a [Vec3],
    /// The block that owns each triangle.
    owners: &'a [u32],
    space: SceneNormalization,
    options: SoftOptions,
}

/// What a thread draws with: the triangles that one camera may see.
#[derive(Default)]
pub(super) struct Brush {
    soft: SoftRasterizer,
    soup: Soup,
    /// Their numbers in the scene.
    numbers: Vec<u32>,
    importance: Importance,
    /// Triangles projected since it was made.
    #[cfg(test)]
    projected: usize,
}

/// What a photo shows of a block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SeenBlock {
    pub(super) block: usize,
    /// Share of the photo that shows the block's core.
    pub(super) cover: f32,
    /// The part of the photo that shows core and halo: upper left corner and size, px.
    pub(super) part: (UVec2, UVec2),
}

impl<'a> Coverage<'a> {
    /// Of `soup`, whose triangles have these middles and owners; `options` say how it is drawn.
    pub(super) fn new(
        soup: &Soup,
        middles: &'a [Vec3],
        owners: &'a [u32],
        space: SceneNormalization,
        options: &SoftOptions,
    ) -> Self {
        let mut cells = Cells::new(soup, middles, |soup| {
            soup.truncate_sh(0);
            space.soup_to_training(soup);
        });
        cells.soup.shell.clear();
        // A triangle may be as small as a pixel here and still count; behind everything is nothing.
        let options = SoftOptions { fade_px: 0.0, background: [0.0; 3], importance: false, ..*options };
        Self { cells, middles, owners, space, options }
    }

    /// Which blocks `camera`, that of a whole photo, sees with at least `min_cover` of its picture.
    pub(super) fn look(
        &self,
        brush: &mut Brush,
        camera: &Camera,
        blocks: &[Block],
        min_cover: f32,
    ) -> Vec<SeenBlock> {
        let small = self.draw(brush, camera);
        let pixels = small.size.element_product() as f32;
        let mut cover = vec![0.0; blocks.len()];
        for (sum, i) in brush.importance.sum_weight.iter().zip(&brush.numbers).filter(|(sum, _)| **sum > 0.0)
        {
            cover[self.owners[*i as usize] as usize] += sum / pixels;
        }
        let shows = |(_, cover): &(usize, f32)| *cover > 0.0 && *cover >= min_cover;
        let seen: Vec<(usize, f32)> = cover.into_iter().enumerate().filter(shows).collect();
        let mut seen_blocks = Vec::with_capacity(seen.len());
        for three in seen.chunks(3) {
            let halos: Vec<&Region> = three.iter().map(|(block, _)| &blocks[*block].halo).collect();
            let shown = self.shown(brush, &small, &halos);
            for (channel, &(block, cover)) in three.iter().enumerate() {
                let part = part_of(&shown, channel, small.size, camera.size);
                seen_blocks.push(SeenBlock { block, cover, part });
            }
        }
        seen_blocks
    }

    /// Marks the triangles that `camera` sees.
    pub(super) fn mark_visible(&self, brush: &mut Brush, camera: &Camera, visible: &[AtomicBool]) {
        self.draw(brush, camera);
        for (i, weight) in brush.numbers.iter().zip(&brush.importance.max_weight) {
            if *weight >= LEAST_WEIGHT {
                visible[*i as usize].store(true, Ordering::Relaxed);
            }
        }
    }

    /// Draws what the camera may see small and weighs its triangles; returns the camera of the drawing.
    fn draw(&self, brush: &mut Brush, camera: &Camera) -> Camera {
        let small = self.space.camera_to_training(camera).within(LONGEST_PX);
        brush.take(&self.cells, &small);
        let options = SoftOptions { importance: true, ..self.options };
        brush.soft.render(&SoupRef::from(&brush.soup), &small, &options);
        brush.importance.reset(brush.soup.len());
        brush.soft.accumulate_importance(&mut brush.importance);
        small
    }

    /// How much of each pixel of the last drawing, by `camera`, shows each of up to three regions. `[H * W]`
    fn shown(&self, brush: &mut Brush, camera: &Camera, regions: &[&Region]) -> Vec<[f32; 3]> {
        for (sh, i) in brush.soup.sh.iter_mut().zip(&brush.numbers) {
            let point = self.middles[*i as usize];
            *sh = [0, 1, 2].map(|c| {
                let is = regions.get(c).is_some_and(|region| region.contains(point));
                sh0_from_rgb(f32::from(u8::from(is)))
            });
        }
        brush.soft.render(&SoupRef::from(&brush.soup), camera, &self.options).rgb.clone()
    }
}

impl Brush {
    /// Takes up the triangles that `camera` may see.
    fn take(&mut self, cells: &Cells, camera: &Camera) {
        let Self { soup, numbers, .. } = self;
        let whole = &cells.soup;
        numbers.clear();
        soup.vertices.clear();
        soup.opacity.clear();
        soup.sigma.clear();
        soup.sh.clear();
        for run in cells.within(camera) {
            numbers.extend_from_slice(&cells.numbers[run.clone()]);
            soup.vertices.extend_from_slice(&whole.vertices[run.clone()]);
            soup.opacity.extend_from_slice(&whole.opacity[run.clone()]);
            soup.sigma.extend_from_slice(&whole.sigma[run.clone()]);
            soup.sh.extend_from_slice(&whole.sh[run]);
        }
        #[cfg(test)]
        {
            self.projected += numbers.len();
        }
    }
}

/// The part of a photo of `full` px that holds a channel of a small drawing, without a small share on each side.
fn part_of(shown: &[[f32; 3]], channel: usize, small: UVec2, full: UVec2) -> (UVec2, UVec2) {
    let (mut columns, mut rows) = (vec![0.0; small.x as usize], vec![0.0; small.y as usize]);
    for (row, pixels) in rows.iter_mut().zip(shown.chunks(small.x as usize)) {
        for (column, rgb) in columns.iter_mut().zip(pixels) {
            *column += rgb[channel];
            *row += rgb[channel];
        }
    }
    let along = |sums: &[f32], small: u32, full: u32| {
        let [first, last] = inner(sums);
        let scale = full as f32 / small as f32;
        let from = (first as f32 * scale - MARGIN_PX).max(0.0) as u32 / ALIGNED_PX * ALIGNED_PX;
        let to = ((last + 1) as f32 * scale + MARGIN_PX).ceil() as u32;
        [from.min(full - 1), to.next_multiple_of(ALIGNED_PX).min(full)]
    };
    let ([left, right], [top, bottom]) = (along(&columns, small.x, full.x), along(&rows, small.y, full.y));
    (UVec2::new(left, top), UVec2::new(right - left, bottom - top))
}

/// The first and last of the sums, without a small share on each side.
fn inner(sums: &[f32]) -> [usize; 2] {
    let least = LEFT_OUT * sums.iter().sum::<f32>();
    let first = reach(sums, least, 0..sums.len()).unwrap_or(0);
    let last = reach(sums, least, (0..sums.len()).rev()).unwrap_or(sums.len() - 1);
    [first, last.max(first)]
}

/// The first position at which the running sum exceeds `least`.
fn reach(sums: &[f32], least: f32, mut order: impl Iterator<Item = usize>) -> Option<usize> {
    let mut sum = 0.0;
    order.find(|i| {
        sum += sums[*i];
        sum > least
    })
}

/// The owner of each triangle: the block whose core holds its middle.
pub(super) fn owners(middles: &[Vec3], cores: &[Region]) -> Vec<u32> {
    let owner = |point: Vec3| cores.iter().position(|core| core.contains(point)).unwrap_or(0) as u32;
    parallel::collect(middles.len(), GRAIN, |i| owner(middles[i]))
}

/// The middles of a soup's triangles.
pub(super) fn middles(soup: &Soup) -> Vec<Vec3> {
    parallel::collect(soup.len(), GRAIN, |i| middle(&soup.vertices[i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_holds_what_is_shown_and_lies_within_the_photo() {
        let small = UVec2::new(8, 6);
        let mut shown = vec![[0.0; 3]; 48];
        for (x, y) in [(2, 3), (3, 3), (3, 4)] {
            shown[y * 8 + x] = [0.0, 1.0, 0.0];
        }
        let (corner, size) = part_of(&shown, 1, small, UVec2::new(800, 600));
        // Pixels 2 to 3 and 3 to 4 of a hundred each, and 8 around.
        assert_eq!((corner, size), (UVec2::new(192, 292), UVec2::new(216, 216)));
        let full = part_of(&[[1.0; 3]; 48], 0, small, UVec2::new(801, 599));
        assert_eq!(full, (UVec2::ZERO, UVec2::new(801, 599)));
    }

    /// A street 400 m long: a wall of two triangles every metre on both sides.
    fn street() -> Soup {
        let mut soup = Soup::default();
        for i in 0..1600 {
            let (side, along) = (if i % 4 < 2 { -3.0 } else { 3.0 }, (i / 4) as f32);
            let [low, high] = [Vec3::new(along, side, 0.0), Vec3::new(along + 1.0, side, 3.0)];
            let other = if i % 2 == 0 { Vec3::new(high.x, side, 0.0) } else { Vec3::new(low.x, side, 3.0) };
            soup.vertices.push([low, high, other]);
        }
        let count = soup.vertices.len();
        (soup.opacity, soup.sigma, soup.sh) = (vec![0.7; count], vec![1.0; count], vec![[0.3; 3]; count]);
        soup
    }

    fn cameras() -> Vec<Camera> {
        let lens = Camera {
            rotation: glam::Mat3::IDENTITY,
            translation: Vec3::ZERO,
            focal: glam::Vec2::splat(60.0),
            center: glam::Vec2::new(30.0, 20.0),
            size: UVec2::new(64, 48),
        };
        let at = |i: u32| Vec3::new(4.0 * i as f32, 0.0, 1.5);
        (0..100).map(|i| lens.looking(at(i), at(i) + Vec3::new(0.3, 1.0, 0.0), Vec3::Z)).collect()
    }

    #[test]
    fn cameras_see_of_the_cells_before_them_what_they_see_of_the_scene() {
        let soup = street();
        let middles = middles(&soup);
        let regions: Vec<Region> = Region::EVERYWHERE.cut(0, 200.0).into();
        let owners = owners(&middles, &regions);
        let space = SceneNormalization { center: Vec3::new(10.0, 0.0, 0.0), scale: 0.5 };
        let coverage = Coverage::new(&soup, &middles, &owners, space, &SoftOptions::default());
        let (mut brush, mut soft, mut whole) =
            (Brush::default(), SoftRasterizer::new(), Importance::default());
        for camera in cameras() {
            let small = coverage.draw(&mut brush, &camera);
            let options = SoftOptions { importance: true, ..coverage.options };
            whole.reset(soup.len());
            soft.render(&SoupRef::from(&coverage.cells.soup), &small, &options);
            soft.accumulate_importance(&mut whole);
            assert_eq!(soft.frame().rgb, brush.soft.frame().rgb);
            let mut seen = vec![0.0; soup.len()];
            brush.numbers.iter().zip(&brush.importance.max_weight).for_each(|(i, w)| seen[*i as usize] = *w);
            for (number, weight) in coverage.cells.numbers.iter().zip(&whole.max_weight) {
                assert_eq!(seen[*number as usize], *weight);
            }
            assert!(seen.iter().any(|weight| *weight > 0.1));
        }
        // Of a long street each sees the part before it.
        let all = 100 * soup.len();
        assert!(brush.projected < all / 8, "{} of {all}", brush.projected);
    }

    #[test]
    fn a_faint_rim_is_left_out() {
        let mut sums = vec![1.0; 100];
        sums[..10].fill(1e-4);
        sums[95..].fill(0.0);
        assert_eq!(inner(&sums), [10, 94]);
        assert_eq!(inner(&[0.0; 5]), [0, 4]);
    }
}
