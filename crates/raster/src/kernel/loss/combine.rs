//! The gradient of the whole loss: the structural part's derivatives blurred back, and the L1 part.

use super::rows::{LossNumber, blur_column, lane_sum, weight_by};
use super::ssim::GRADS;
use trisplat_scene::math::lanes::{Lanes, Work, dispatch};
use trisplat_scene::math::ssim::TAPS;
use trisplat_scene::parallel;

/// Pass 3: the gradient maps blurred along y, combined with the pictures and the gradient by their
/// difference. Returns the weighted sums of |x - y| and (x - y)².
#[allow(clippy::too_many_arguments)]
pub(super) fn combine_rows<R: LossNumber>(
    taps: &[R; TAPS],
    row: usize,
    x: &[R],
    y: &[R],
    weight: Option<&[R]>,
    l1_scale: R,
    grads: &[R],
    d_x: &mut [R],
) -> (f64, f64) {
    let sums: Vec<(f64, f64)> = parallel::map_with(
        d_x.chunks_mut(row),
        || vec![R::default(); (GRADS + 3) * row],
        |memory, at, out| {
            let (x, y) = (&x[at * row..][..row], &y[at * row..][..row]);
            let weight = weight.map(|w| &w[at * (row / 3)..][..row / 3]);
            let (blurred, parts) = memory.split_at_mut(GRADS * row);
            dispatch(CombineRow { taps, grads, at, x, y, weight, l1_scale, blurred, parts, out })
        },
    );
    sums.iter().fold((0.0, 0.0), |total, s| (total.0 + s.0, total.1 + s.1))
}

/// One row of pass 3.
struct CombineRow<'a, R> {
    taps: &'a [R; TAPS],
    grads: &'a [R],
    at: usize,
    x: &'a [R],
    y: &'a [R],
    weight: Option<&'a [R]>,
    /// ∂loss/∂x of a pixel that is too bright.
    l1_scale: R,
    blurred: &'a mut [R],
    /// |x - y|, (x - y)² and the gradient by the difference.
    parts: &'a mut [R],
    out: &'a mut [R],
}

impl<R: LossNumber> Work for CombineRow<'_, R> {
    type Output = (f64, f64);

    #[inline(always)]
    fn run<L: Lanes>(self) -> (f64, f64) {
        let (x, y, zero) = (self.x, self.y, R::default());
        let row = x.len();
        blur_column::<L, R>(self.taps, self.grads, self.at, self.blurred);
        let (absolute, rest) = self.parts.split_at_mut(row);
        let (square, by_difference) = rest.split_at_mut(row);
        // Of known length, so that the loops need no check of bounds and become vector code.
        let (by_difference, out, y) = (&mut by_difference[..row], &mut self.out[..row], &y[..row]);
        for i in 0..row {
            let difference = x[i] - y[i];
            let above = if difference > zero { self.l1_scale } else { zero };
            by_difference[i] = if difference < zero { -self.l1_scale } else { above };
            absolute[i] = if difference < zero { -difference } else { difference };
            square[i] = difference * difference;
        }
        for values in [&mut *absolute, &mut *square, &mut *by_difference] {
            weight_by(values, self.weight);
        }
        let blur = |m: usize| &self.blurred[m * row..][..row];
        let (d_mean, d_square, d_cross) = (blur(0), blur(1), blur(2));
        for i in 0..row {
            out[i] = by_difference[i] + d_mean[i] + R::of(2.0) * x[i] * d_square[i] + y[i] * d_cross[i];
        }
        (lane_sum(absolute), lane_sum(square))
    }
}
