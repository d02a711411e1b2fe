//! Similarity of a pixel's patch and its image in another photo: normalised cross-correlation (NCC), with
//! more weight for pixels that are near the middle and similar to it, so that pixels of other surfaces hardly
//! count.

use super::picture::WorkPicture;
use super::warp::Homography;
use crate::math::lanes::{LANES, Lanes};

/// 1 - NCC of patches that cannot be compared.
pub(super) const WORST: f32 = 2.0;
/// Values of 16 samples each.
const PARTS: usize = 2;
/// Samples, the last of them without weight.
const SAMPLES: usize = PARTS * LANES;
/// Every second pixel of a square of 7x7, like the black fields of a chequerboard, and four more beyond the
/// middles of its right and lower sides.
const OFFSETS: [[f32; SAMPLES]; 2] = offsets();
/// Standard deviation of the weight by difference in grey, codes.
const GREY_DEVIATION: f32 = 18.0;
/// Standard deviation of the weight by distance, px.
const DISTANCE_DEVIATION: f32 = 3.5;
/// Added to both variances, squared codes, so that patches without texture match nothing.
const NOISE: f32 = 2.0;
/// Rounds to the nearest integer when it is added and subtracted.
const ROUND: f32 = 12_582_912.0;

const fn offsets() -> [[f32; SAMPLES]; 2] {
    let mut out = [[0.0; SAMPLES]; 2];
    let (mut at, mut y) = (0, -4i32);
    while y <= 4 {
        let mut x = -4i32;
        while x <= 4 {
            if (x + y) % 2 == 0 && x * x + y * y <= 18 {
                out[0][at] = x as f32;
                out[1][at] = y as f32;
                at += 1;
            }
            x += 1;
        }
        y += 1;
    }
    assert!(at == USED);
    out
}

/// Samples with a weight.
const USED: usize = 29;

/// The surroundings of a pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patch<L> {
    /// Weights; they sum to 1.
    weight: [L; PARTS],
    /// Weights times the difference from the mean.
    weighted: [L; PARTS],
    mean: f32,
    variance: f32,
}

impl<L: Lanes> Patch<L> {
    /// Of the pixel at (x, y).
    #[inline(always)]
    pub(super) fn new(picture: &WorkPicture, x: usize, y: usize) -> Self {
        let (mut grey, mut there) = ([0.0f32; SAMPLES], [0.0f32; SAMPLES]);
        let (width, height) = (picture.width as i32, picture.height as i32);
        let middle = f32::from(picture.grey[y * picture.width + x]);
        for k in 0..USED {
            let column = (x as i32 + OFFSETS[0][k] as i32).clamp(0, width - 1);
            let row = (y as i32 + OFFSETS[1][k] as i32).clamp(0, height - 1);
            let pixel = (row * width + column) as usize;
            grey[k] = f32::from(picture.grey[pixel]);
            there[k] = if picture.counts(pixel) { 1.0 } else { 0.0 };
        }
        let by_grey = L::splat(-std::f32::consts::LOG2_E / (2.0 * GREY_DEVIATION * GREY_DEVIATION));
        let by_distance =
            L::splat(-std::f32::consts::LOG2_E / (2.0 * DISTANCE_DEVIATION * DISTANCE_DEVIATION));
        let mut weight = [L::splat(0.0); PARTS];
        let mut sums = [L::splat(0.0); 3];
        for (part, weight) in weight.iter_mut().enumerate() {
            let (dx, dy) = (lanes::<L>(&OFFSETS[0], part), lanes::<L>(&OFFSETS[1], part));
            let difference = lanes::<L>(&grey, part) - L::splat(middle);
            let distance = dx.mul_add(dx, dy * dy);
            let exponent = (difference * difference).mul_add(by_grey, distance * by_distance);
            *weight = exponent.max(L::splat(-100.0)).exp2() * lanes::<L>(&there, part);
            sums[0] = sums[0] + *weight;
            let weighted = *weight * difference;
            sums[1] = sums[1] + weighted;
            sums[2] = weighted.mul_add(difference, sums[2]);
        }
        let total = sums[0].sum().max(1e-6);
        let (shift, square) = (sums[1].sum() / total, sums[2].sum() / total);
        let mean = middle + shift;
        let mut weighted = weight;
        for part in 0..PARTS {
            weight[part] = weight[part] * L::splat(1.0 / total);
            weighted[part] = weight[part] * (lanes::<L>(&grey, part) - L::splat(mean));
        }
        Self { weight, weighted, mean, variance: (square - shift * shift).max(0.0) }
    }

    /// 1 - NCC of the patch and its image under a homography, from 0 to 2.
    #[inline(always)]
    pub(super) fn dissimilarity(&self, other: &WorkPicture, h: &Homography) -> f32 {
        let (x, y) = (h.middle.x / h.middle.z, h.middle.y / h.middle.z);
        let (width, height) = (other.width as f32, other.height as f32);
        let is_inside = h.middle.z > 0.0 && x >= 0.0 && y >= 0.0 && x < width && y < height;
        if !(is_inside && other.counts(y as usize * other.width + x as usize)) {
            return WORST;
        }
        let (mut sum, mut square, mut product) = (L::splat(0.0), L::splat(0.0), L::splat(0.0));
        for part in 0..PARTS {
            let value = sample::<L>(other, h, part) - L::splat(self.mean);
            let weighted = value * self.weight[part];
            sum = sum + weighted;
            square = weighted.mul_add(value, square);
            product = value.mul_add(self.weighted[part], product);
        }
        let (mean, square, product) = (sum.sum(), square.sum(), product.sum());
        let variance = (square - mean * mean).max(0.0);
        // The weighted differences of the reference sum to 0, so the mean of the other cancels.
        let ncc = product / ((self.variance + NOISE) * (variance + NOISE)).sqrt();
        (1.0 - ncc).clamp(0.0, WORST)
    }
}

/// Bilinear greys of the samples of one part.
#[inline(always)]
fn sample<L: Lanes>(other: &WorkPicture, h: &Homography, part: usize) -> L {
    let (dx, dy) = (lanes::<L>(&OFFSETS[0], part), lanes::<L>(&OFFSETS[1], part));
    let z = dx.mul_add(L::splat(h.right.z), dy.mul_add(L::splat(h.down.z), L::splat(h.middle.z)));
    let x = dx.mul_add(L::splat(h.right.x), dy.mul_add(L::splat(h.down.x), L::splat(h.middle.x)));
    let y = dx.mul_add(L::splat(h.right.y), dy.mul_add(L::splat(h.down.y), L::splat(h.middle.y)));
    let share = L::splat(1.0) / z;
    let (zero, half, round) = (L::splat(0.0), L::splat(0.5), L::splat(ROUND));
    let inside = |at: L, side: usize| at.max(zero).min(L::splat(side as f32 - 2.0));
    let (u, v) = (x * share - half, y * share - half);
    // NaN becomes 0 here; places outside the picture take its edge.
    let (u, v) = (inside(u, other.width), inside(v, other.height));
    let (column, row) = ((u - half + round) - round, (v - half + round) - round);
    let (column, row) = (column.max(zero), row.max(zero));
    let mut at = [0i32; LANES];
    row.mul_add(L::splat(other.width as f32), column).store_rounded(&mut at);
    let mut quads = [0u32; LANES];
    for k in 0..LANES {
        quads[k] = other.quads[at[k] as usize];
    }
    let mut corners = [[0.0f32; LANES]; 4];
    for k in 0..LANES {
        corners[0][k] = (quads[k] & 255) as i32 as f32;
        corners[1][k] = (quads[k] >> 8 & 255) as i32 as f32;
        corners[2][k] = (quads[k] >> 16 & 255) as i32 as f32;
        corners[3][k] = (quads[k] >> 24) as i32 as f32;
    }
    let (right, down) = (u - column, v - row);
    let (a, b) = (L::load(&corners[0]), L::load(&corners[1]));
    let (c, d) = (L::load(&corners[2]), L::load(&corners[3]));
    let (top, bottom) = (right.mul_add(b - a, a), right.mul_add(d - c, c));
    down.mul_add(bottom - top, top)
}

#[inline(always)]
fn lanes<L: Lanes>(all: &[f32; SAMPLES], part: usize) -> L {
    let mut out = [0.0; LANES];
    out.copy_from_slice(&all[part * LANES..(part + 1) * LANES]);
    L::load(&out)
}
