//! Which blocks of the lattice a surface runs through.

use super::grid::Grid;
use super::picture::DepthPicture;
use rayon::prelude::*;
use trisplat_scene::parallel;

/// Samples this near to a point of the surface, in cells, are needed: a cell that the surface runs through has corners up to one cell
/// from it, and pixels lie up to one cell apart.
const REACH: f32 = 2.0;

/// The numbers of the blocks near what `pictures` see, in ascending order.
pub(super) fn blocks(pictures: &[DepthPicture], grid: &Grid) -> Vec<u64> {
    let of_picture = |picture: &DepthPicture| {
        let mut numbers = Vec::new();
        let mut last = [u64::MAX; 8];
        for pixel in 0..picture.depth.len() {
            let Some(point) = picture.point(pixel) else { continue };
            // Neighbouring pixels mostly need the same blocks.
            for (number, last) in grid.blocks_near(point, REACH).zip(&mut last) {
                if *last != number {
                    *last = number;
                    numbers.push(number);
                }
            }
        }
        numbers.sort_unstable();
        numbers.dedup();
        numbers
    };
    let mut all: Vec<u64> = parallel::map(pictures, |_, picture| of_picture(picture)).concat();
    all.par_sort_unstable();
    all.dedup();
    all
}
