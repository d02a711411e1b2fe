//! What a photo shows of each block, by drawing the coarse scene as the photo's camera sees it.

use super::manifest::Block;
use super::region::{Region, middle};
use crate::camera::Camera;
use crate::raster::soft::{Importance, Soft, SoftOptions, SoupRef};
use crate::soup::{Soup, sh0_from_rgb};
use crate::space::Space;
use glam::{UVec2, Vec3};
use rayon::prelude::*;

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

/// A coarse scene that is drawn.
pub(super) struct Coverage<'a> {
    soup: Soup,
    /// Middles of the triangles, in the frame of the blocks' boxes.
    middles: &'a [Vec3],
    /// The block that owns each triangle.
    owners: &'a [u32],
    space: Space,
    options: SoftOptions,
    soft: Soft,
    importance: Importance,
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
        space: Space,
        options: &SoftOptions,
    ) -> Self {
        let mut soup = soup.clone();
        soup.truncate_sh(0);
        space.soup_to_training(&mut soup);
        // A triangle may be as small as a pixel here and still count; behind everything is nothing.
        let options = SoftOptions { fade_px: 0.0, background: [0.0; 3], ..*options };
        Self { soup, middles, owners, space, options, soft: Soft::new(), importance: Importance::default() }
    }

    /// Which blocks `camera`, that of a whole photo, sees with at least `min_cover` of its picture.
    pub(super) fn look(&mut self, camera: &Camera, blocks: &[Block], min_cover: f32) -> Vec<SeenBlock> {
        let small = self.draw(camera);
        let pixels = small.size.element_product() as f32;
        let mut cover = vec![0.0; blocks.len()];
        for (sum, owner) in self.importance.sum_weight.iter().zip(self.owners) {
            cover[*owner as usize] += sum / pixels;
        }
        let seen: Vec<usize> =
            (0..blocks.len()).filter(|b| cover[*b] > 0.0 && cover[*b] >= min_cover).collect();
        let mut seen_blocks = Vec::with_capacity(seen.len());
        for three in seen.chunks(3) {
            let halos: Vec<&Region> = three.iter().map(|b| &blocks[*b].halo).collect();
            let shown = self.shown(&small, &halos);
            for (channel, &block) in three.iter().enumerate() {
                let part = part_of(&shown, channel, small.size, camera.size);
                seen_blocks.push(SeenBlock { block, cover: cover[block], part });
            }
        }
        seen_blocks
    }

    /// Marks the triangles that `camera` sees.
    pub(super) fn mark_visible(&mut self, camera: &Camera, visible: &mut [bool]) {
        self.draw(camera);
        for (seen, weight) in visible.iter_mut().zip(&self.importance.max_weight) {
            *seen |= *weight >= LEAST_WEIGHT;
        }
    }

    /// Draws the scene small and weighs its triangles; returns the camera of the drawing.
    fn draw(&mut self, camera: &Camera) -> Camera {
        let small = self.space.camera_to_training(camera).within(LONGEST_PX);
        self.importance.reset(self.soup.len());
        let options = SoftOptions { importance: true, ..self.options };
        self.soft.render(&SoupRef::from(&self.soup), &small, &options);
        self.soft.accumulate_importance(&mut self.importance);
        small
    }

    /// How much of each pixel shows each of up to three regions. `[H * W]`
    fn shown(&mut self, camera: &Camera, regions: &[&Region]) -> Vec<[f32; 3]> {
        let inside = |point: &Vec3| {
            [0, 1, 2].map(|c| {
                let is = regions.get(c).is_some_and(|region| region.contains(*point));
                sh0_from_rgb(f32::from(u8::from(is)))
            })
        };
        self.middles.par_iter().map(inside).collect_into_vec(&mut self.soup.sh);
        self.soft.render(&SoupRef::from(&self.soup), camera, &self.options).rgb.clone()
    }
}

/// The part of a photo of `full` px that holds a channel of a small drawing, without a small share on each side.
fn part_of(shown: &[[f32; 3]], channel: usize, small: UVec2, full: UVec2) -> (UVec2, UVec2) {
    let (mut columns, mut rows) = (vec![0.0; small.x as usize], vec![0.0; small.y as usize]);
    for (i, rgb) in shown.iter().enumerate() {
        columns[i % small.x as usize] += rgb[channel];
        rows[i / small.x as usize] += rgb[channel];
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
    let owner = |point: &Vec3| cores.iter().position(|core| core.contains(*point)).unwrap_or(0) as u32;
    middles.par_iter().map(owner).collect()
}

/// The middles of a soup's triangles.
pub(super) fn middles(soup: &Soup) -> Vec<Vec3> {
    soup.vertices.par_iter().map(middle).collect()
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

    #[test]
    fn a_faint_rim_is_left_out() {
        let mut sums = vec![1.0; 100];
        sums[..10].fill(1e-4);
        sums[95..].fill(0.0);
        assert_eq!(inner(&sums), [10, 94]);
        assert_eq!(inner(&[0.0; 5]), [0, 4]);
    }
}
