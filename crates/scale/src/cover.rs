//! Photos of each block: all that show it in renderings of the coarse scene, each cropped
//! to the part that shows it.

use super::manifest::{Block, BlockPhoto};
use super::region::BlockRegion;
use crate::manifest::PlanOptions;
use glam::{Mat3, UVec2, Vec2, Vec3};
use std::ops::Range;
use trisplat_dataset::View;
use trisplat_raster::soft::{Importance, SoftOptions, SoftRasterizer, SoupRef};
use trisplat_scene::camera::Camera;
use trisplat_scene::math::geometry::{along_curve, centroid};
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::{Error, Result, SceneNormalization, Soup, sh0_from_rgb};

/// Longer side of the drawings, px: shares of a picture need no more.
const LONGEST_PX: u32 = 192;
/// A triangle is visible when its weight reaches this at some pixel.
const MIN_WEIGHT: f32 = 1e-3;
/// Share of a block's pixels that its crop of a photo may leave out, on each side.
const LEFT_OUT: f32 = 0.005;
/// Margin of a crop, px, so that the windows of SSIM are whole.
const MARGIN_PX: f32 = 8.0;
/// Corners of crops are multiples of this, px, so that they stay integers when photos are halved
/// twice.
const ALIGNED_PX: u32 = 4;

/// A block with fewer photos than this gets those that show most of it, however little: one photo
/// gives no depth.
const FEWEST_PHOTOS: usize = 3;
/// Triangles of a cell: the box of fewer is looked at as long as they are drawn.
const CELL: usize = 64;
/// Distance from a picture beyond which nothing affects it, as windows and filters reach less far,
/// px.
const REACH_PX: f32 = 8.0;

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

/// Rasteriser of one thread, and the triangles that one camera may see.
#[derive(Default)]
struct Brush {
    soft: SoftRasterizer,
    soup: Soup,
    /// Their numbers in the scene.
    numbers: Vec<u32>,
    importance: Importance,
}

/// Coverage of a block in a photo.
#[derive(Debug, Clone, Copy, PartialEq)]
struct SeenBlock {
    block: usize,
    /// Share of the photo that shows the block's core.
    cover: f32,
    /// The part of the photo that shows core and halo: upper left corner and size, px.
    part: (UVec2, UVec2),
}

/// Gives each of `blocks` its photos among `views`; one that no photo shows has none.
///
/// # Errors
///
/// No photo shows any.
pub(super) fn assign(
    blocks: &mut [Block],
    views: &[&View],
    coverage: &Coverage<'_>,
    options: &PlanOptions,
) -> Result<()> {
    let min_cover = options.min_cover as f32;
    // Photos that show too little of a block are listed too, for blocks that have no others.
    let mut views_of_block: Vec<Vec<(usize, SeenBlock)>> = vec![Vec::new(); blocks.len()];
    let looks: Vec<Vec<SeenBlock>> = parallel::map_with(views, Brush::default, |brush, _, view| {
        coverage.look(brush, &view.camera, blocks, 0.1 * min_cover)
    });
    for (photo, looks) in looks.into_iter().enumerate() {
        for look in looks {
            views_of_block[look.block].push((photo, look));
        }
    }
    for (block, mut views) in blocks.iter_mut().zip(views_of_block) {
        views.sort_by(|(a, x), (b, y)| y.cover.total_cmp(&x.cover).then(a.cmp(b)));
        let enough = views.partition_point(|(_, look)| look.cover >= min_cover);
        let max_photos =
            if options.block_photos == 0 { usize::MAX } else { options.block_photos as usize };
        views.truncate(enough.max(FEWEST_PHOTOS).min(max_photos.max(FEWEST_PHOTOS)));
        views.sort_by_key(|(photo, _)| *photo);
        let block_photo = |(photo, SeenBlock { cover, part: (corner, size), .. })| BlockPhoto {
            photo: photo as u32,
            part: [corner.x, corner.y, size.x, size.y],
            // Digits beyond these say nothing.
            cover: (cover * 1e4).round() / 1e4,
        };
        block.photos = views.into_iter().map(block_photo).collect();
    }
    if blocks.iter().all(|block| block.photos.is_empty()) {
        let wants = "photos that show the coarse scene: none shows any block";
        return Err(Error::invalid("data set", "its cameras", wants));
    }
    Ok(())
}

/// True for each triangle of the coarse scene that the cropped photos of a block show. `[N]`
pub(super) fn visible(
    block: &Block,
    views: &[&View],
    coverage: &Coverage<'_>,
) -> Result<Vec<bool>> {
    let look = |brush: &mut Brush, _, photo: &BlockPhoto| -> Result<Vec<u32>> {
        let (corner, size) = photo.corner_and_size();
        coverage.draw(brush, &views[photo.photo as usize].cropped(corner, size)?.camera);
        let weighed = brush.numbers.iter().zip(&brush.importance.max_weight);
        Ok(weighed
            .filter(|(_, weight)| **weight >= MIN_WEIGHT)
            .map(|(number, _)| *number)
            .collect())
    };
    let mut visible = vec![false; coverage.middles.len()];
    for numbers in parallel::map_with(&block.photos, Brush::default, look) {
        for number in numbers? {
            visible[number as usize] = true;
        }
    }
    Ok(visible)
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
        let options =
            SoftOptions { fade_px: 0.0, background: [0.0; 3], importance: false, ..*options };
        Self { cells, middles, owners, space, options }
    }

    /// Blocks that `camera`, of a whole photo, sees with at least `min_cover` of its picture.
    fn look(
        &self,
        brush: &mut Brush,
        camera: &Camera,
        blocks: &[Block],
        min_cover: f32,
    ) -> Vec<SeenBlock> {
        let small = self.draw(brush, camera);
        let pixels = small.size.element_product() as f32;
        let mut cover = vec![0.0; blocks.len()];
        for (sum, i) in
            brush.importance.sum_weight.iter().zip(&brush.numbers).filter(|(sum, _)| **sum > 0.0)
        {
            cover[self.owners[*i as usize] as usize] += sum / pixels;
        }
        let shows = |(_, cover): &(usize, f32)| *cover > 0.0 && *cover >= min_cover;
        let covers: Vec<(usize, f32)> = cover.into_iter().enumerate().filter(shows).collect();
        let mut seen_blocks = Vec::with_capacity(covers.len());
        for three in covers.chunks(3) {
            let halos: Vec<&BlockRegion> =
                three.iter().map(|(block, _)| &blocks[*block].halo).collect();
            let shares = self.region_shares(brush, &small, &halos);
            for (channel, &(block, cover)) in three.iter().enumerate() {
                let part = part_of(&shares, channel, small.size, camera.size);
                seen_blocks.push(SeenBlock { block, cover, part });
            }
        }
        seen_blocks
    }

    /// Draws what the camera may see small and weighs its triangles; returns the camera of the
    /// drawing.
    fn draw(&self, brush: &mut Brush, camera: &Camera) -> Camera {
        let small = self.space.camera_to_training(camera).fit_within(LONGEST_PX);
        brush.take(&self.cells, &small);
        let options = SoftOptions { importance: true, ..self.options };
        brush.soft.render(&SoupRef::from(&brush.soup), &small, &options);
        brush.importance = Importance::new(brush.soup.len());
        brush.soft.accumulate_importance(&mut brush.importance);
        small
    }

    /// Share of each pixel of the last rendering, by `camera`, that shows each of up to three
    /// regions. `[H * W]`
    fn region_shares(
        &self,
        brush: &mut Brush,
        camera: &Camera,
        regions: &[&BlockRegion],
    ) -> Vec<[f32; 3]> {
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
        for run in cells.visible_runs(camera) {
            numbers.extend_from_slice(&cells.numbers[run.clone()]);
            soup.vertices.extend_from_slice(&whole.vertices[run.clone()]);
            soup.opacity.extend_from_slice(&whole.opacity[run.clone()]);
            soup.sigma.extend_from_slice(&whole.sigma[run.clone()]);
            soup.sh.extend_from_slice(&whole.sh[run]);
        }
    }
}

/// The part of a photo of `full` px that holds a channel of a small drawing, without a small share
/// on each side.
fn part_of(shares: &[[f32; 3]], channel: usize, small: UVec2, full: UVec2) -> (UVec2, UVec2) {
    let mut columns = vec![0.0; small.x as usize];
    let mut rows = vec![0.0; small.y as usize];
    for (row, pixels) in rows.iter_mut().zip(shares.chunks(small.x as usize)) {
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
    let [left, right] = along(&columns, small.x, full.x);
    let [top, bottom] = along(&rows, small.y, full.y);
    (UVec2::new(left, top), UVec2::new(right - left, bottom - top))
}

/// The first and last of the sums, without a small share on each side.
fn inner(sums: &[f32]) -> [usize; 2] {
    let threshold = LEFT_OUT * sums.iter().sum::<f32>();
    let first = reach(sums, threshold, 0..sums.len()).unwrap_or(0);
    let last = reach(sums, threshold, (0..sums.len()).rev()).unwrap_or(sums.len() - 1);
    [first, last.max(first)]
}

/// The first position at which the running sum exceeds `threshold`.
fn reach(sums: &[f32], threshold: f32, mut order: impl Iterator<Item = usize>) -> Option<usize> {
    let mut sum = 0.0;
    order.find(|i| {
        sum += sums[*i];
        sum > threshold
    })
}

/// The owner of each triangle: the block whose core holds its middle.
pub(super) fn owners(middles: &[Vec3], cores: &[BlockRegion]) -> Vec<u32> {
    let owner =
        |point: Vec3| cores.iter().position(|core| core.contains(point)).unwrap_or(0) as u32;
    parallel::collect(middles.len(), GRAIN, |i| owner(middles[i]))
}

/// The middles of a soup's triangles.
pub(super) fn middles(soup: &Soup) -> Vec<Vec3> {
    parallel::collect(soup.len(), GRAIN, |i| centroid(soup.vertices[i]))
}

/// Triangles, neighbours beside each other, and the box around each run of them.
struct Cells {
    /// The triangles, in that order.
    soup: Soup,
    /// Their numbers in the scene. `[N]`
    numbers: Vec<u32>,
    /// Middle and half extent of each cell's box.
    boxes: Vec<[Vec3; 2]>,
}

impl Cells {
    /// Of a soup that is changed before it is drawn; `middles` are those of its triangles.
    fn new(soup: &Soup, middles: &[Vec3], change: impl FnOnce(&mut Soup)) -> Self {
        let numbers =
            along_curve(&middles.iter().map(|middle| middle.as_dvec3()).collect::<Vec<_>>());
        let order: Vec<usize> = numbers.iter().map(|i| *i as usize).collect();
        let mut soup = soup.subset(&order);
        change(&mut soup);
        let around = |corners: &[[Vec3; 3]]| {
            let corners = corners.as_flattened().iter();
            let low = corners.clone().fold(Vec3::INFINITY, |a, b| a.min(*b));
            let high = corners.fold(Vec3::NEG_INFINITY, |a, b| a.max(*b));
            [(low + high) / 2.0, (high - low) / 2.0]
        };
        let boxes = soup.vertices.chunks(CELL).map(around).collect();
        Self { soup, numbers, boxes }
    }

    /// The triangles of the cells that `camera` may have in its picture, as runs of neighbouring
    /// cells.
    fn visible_runs(&self, camera: &Camera) -> Vec<Range<usize>> {
        let sides = sides(camera);
        let mut runs: Vec<Range<usize>> = Vec::new();
        for (cell, [middle, half]) in self.boxes.iter().enumerate() {
            let at = camera.rotation * *middle + camera.translation;
            // A triangle that is not finite counts as visible in every picture.
            if sides.iter().any(|(side, reach)| side.dot(at) < -reach.dot(*half)) {
                continue;
            }
            let triangles = cell * CELL..((cell + 1) * CELL).min(self.numbers.len());
            match runs.last_mut() {
                Some(last) if last.end == triangles.start => last.end = triangles.end,
                _ => runs.push(triangles),
            }
        }
        runs
    }
}

/// The five sides of what a camera sees: their normals in its space, inwards, and for a box of the
/// world how far it reaches along each.
fn sides(camera: &Camera) -> [(Vec3, Vec3); 5] {
    let Vec2 { x: fx, y: fy } = camera.focal;
    let low = camera.center + REACH_PX;
    let high = camera.size.as_vec2() + REACH_PX - camera.center;
    let normals = [
        Vec3::Z,
        Vec3::new(fx, 0.0, low.x),
        Vec3::new(-fx, 0.0, high.x),
        Vec3::new(0.0, fy, low.y),
        Vec3::new(0.0, -fy, high.y),
    ];
    let to_world: Mat3 = camera.rotation.transpose();
    normals.map(|normal| (normal, (to_world * normal).abs()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_holds_what_is_shown_and_lies_within_the_photo() {
        let small = UVec2::new(8, 6);
        let mut shares = vec![[0.0; 3]; 48];
        for (x, y) in [(2, 3), (3, 3), (3, 4)] {
            shares[y * 8 + x] = [0.0, 1.0, 0.0];
        }
        let (corner, size) = part_of(&shares, 1, small, UVec2::new(800, 600));
        // Pixels 2 to 3 and 3 to 4 of a hundred each, and 8 around.
        assert_eq!((corner, size), (UVec2::new(192, 292), UVec2::new(216, 216)));
        let full = part_of(&[[1.0; 3]; 48], 0, small, UVec2::new(801, 599));
        assert_eq!(full, (UVec2::ZERO, UVec2::new(801, 599)));
    }

    /// A street 400 m long: a wall of two triangles every metre on both sides.
    fn street() -> Soup {
        let mut soup = Soup::default();
        for i in 0..1600 {
            let side = if i % 4 < 2 { -3.0 } else { 3.0 };
            let along = (i / 4) as f32;
            let [low, high] = [Vec3::new(along, side, 0.0), Vec3::new(along + 1.0, side, 3.0)];
            let other =
                if i % 2 == 0 { Vec3::new(high.x, side, 0.0) } else { Vec3::new(low.x, side, 3.0) };
            soup.vertices.push([low, high, other]);
        }
        let count = soup.vertices.len();
        soup.opacity = vec![0.7; count];
        soup.sigma = vec![1.0; count];
        soup.sh = vec![[0.3; 3]; count];
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
        (0..100)
            .map(|i| lens.with_look_at(at(i), at(i) + Vec3::new(0.3, 1.0, 0.0), Vec3::Z))
            .collect()
    }

    #[test]
    fn cells_before_a_camera_show_it_the_whole_scene() {
        let soup = street();
        let middles = middles(&soup);
        let regions: Vec<BlockRegion> = BlockRegion::EVERYWHERE.split(0, 200.0).into();
        let owners = owners(&middles, &regions);
        let space = SceneNormalization { center: Vec3::new(10.0, 0.0, 0.0), scale: 0.5 };
        let coverage = Coverage::new(&soup, &middles, &owners, space, &SoftOptions::default());
        let mut brush = Brush::default();
        let mut soft = SoftRasterizer::new();
        let mut projected = 0;
        for camera in cameras() {
            let small = coverage.draw(&mut brush, &camera);
            projected += brush.numbers.len();
            let options = SoftOptions { importance: true, ..coverage.options };
            let mut whole = Importance::new(soup.len());
            soft.render(&SoupRef::from(&coverage.cells.soup), &small, &options);
            soft.accumulate_importance(&mut whole);
            assert_eq!(soft.frame().rgb, brush.soft.frame().rgb);
            let mut weights = vec![0.0; soup.len()];
            for (number, weight) in brush.numbers.iter().zip(&brush.importance.max_weight) {
                weights[*number as usize] = *weight;
            }
            for (number, weight) in coverage.cells.numbers.iter().zip(&whole.max_weight) {
                assert_eq!(weights[*number as usize], *weight);
            }
            assert!(weights.iter().any(|weight| *weight > 0.1));
        }
        // Of a long street each sees the part before it.
        let all = 100 * soup.len();
        assert!(projected < all / 8, "{projected} of {all}");
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
