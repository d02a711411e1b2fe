//! Smaller pictures: every new pixel is the mean of the area that it covers.

use glam::UVec2;

/// Box filter with fractional cover, separable; `C` channels of 8 bits.
pub(super) fn area_average<const C: usize>(
    source: &[[u8; C]],
    from: UVec2,
    to: UVec2,
) -> Vec<[u8; C]> {
    let mut average = AreaAverage::new(from, to);
    for row in source.chunks_exact(from.x as usize) {
        average.push(row);
    }
    average.finish()
}

/// [`area_average`] of rows that come one by one.
pub(super) struct AreaAverage<const C: usize> {
    columns: Vec<(usize, Vec<f32>)>,
    rows: Vec<(usize, Vec<f32>)>,
    /// Sums of the current new row.
    line: Vec<[f32; C]>,
    /// Number of new rows that are finished.
    rows_out: usize,
    /// Number of old rows that were pushed.
    rows_in: usize,
    averaged: Vec<[u8; C]>,
}

impl<const C: usize> AreaAverage<C> {
    pub(super) fn new(from: UVec2, to: UVec2) -> Self {
        Self {
            columns: cover(from.x, to.x),
            rows: cover(from.y, to.y),
            line: vec![[0.0; C]; from.x as usize],
            rows_out: 0,
            rows_in: 0,
            averaged: Vec::with_capacity(to.x as usize * to.y as usize),
        }
    }

    /// Takes the next row.
    pub(super) fn push(&mut self, row: &[[u8; C]]) {
        // A row may be the last of one new row and the first of the next ones.
        while let Some((top, weights)) =
            self.rows.get(self.rows_out).filter(|(top, _)| *top <= self.rows_in)
        {
            let weight = weights[self.rows_in - top];
            for (sum, pixel) in self.line.iter_mut().zip(row) {
                for c in 0..C {
                    sum[c] += weight * f32::from(pixel[c]);
                }
            }
            if self.rows_in - top + 1 < weights.len() {
                break;
            }
            self.end_row();
        }
        self.rows_in += 1;
    }

    fn end_row(&mut self) {
        let line = &self.line;
        self.averaged.extend(self.columns.iter().map(|(left, weights)| {
            let mut sum = [0.0f32; C];
            for (pixel, weight) in line[*left..].iter().zip(weights) {
                for c in 0..C {
                    sum[c] += weight * pixel[c];
                }
            }
            sum.map(|s| (s + 0.5) as u8)
        }));
        self.line.fill([0.0; C]);
        self.rows_out += 1;
    }

    /// The new picture, after the last row.
    pub(super) fn finish(self) -> Vec<[u8; C]> {
        self.averaged
    }
}

/// For every new pixel: the first old pixel it touches, and the share that each old pixel has in
/// it. The shares sum to 1.
fn cover(from: u32, to: u32) -> Vec<(usize, Vec<f32>)> {
    let step = f64::from(from) / f64::from(to);
    let span = |i: u32| {
        let low = f64::from(i) * step;
        let high = (f64::from(i + 1) * step).min(f64::from(from));
        let first = low as usize;
        let last = (high.ceil() as usize).clamp(first + 1, from as usize);
        let share =
            |k: usize| (high.min(k as f64 + 1.0) - low.max(k as f64)).max(0.0) / (high - low);
        (first, (first..last).map(|k| share(k) as f32).collect())
    };
    (0..to).map(span).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::tests::ramp;
    use crate::image::{RgbImage, area};

    #[test]
    fn halving_averages_two_by_two() {
        let source = ramp(UVec2::new(8, 6));
        let half = source.downscaled(UVec2::new(4, 3));
        for y in 0..3 {
            for x in 0..4 {
                for c in 0..3 {
                    let at = |dx: usize, dy: usize| {
                        u32::from(source.rgb[(2 * y + dy) * 8 + 2 * x + dx][c])
                    };
                    let sum = at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1);
                    assert_eq!(u32::from(half.rgb[y * 4 + x][c]), (sum + 2) / 4);
                }
            }
        }
    }

    #[test]
    fn one_colour_stays_that_colour_at_any_ratio() {
        for size in [UVec2::new(1, 1), UVec2::new(3, 2), UVec2::new(36, 23), UVec2::new(37, 24)] {
            let source = RgbImage {
                size: UVec2::new(37, 24),
                rgb: vec![[255, 200, 1]; 37 * 24],
                alpha: Some(vec![7; 888]),
            };
            let small = source.downscaled(size);
            assert!(small.rgb.iter().all(|p| *p == [255, 200, 1]), "{size}");
            assert!(
                small.alpha.is_some_and(|a| a.len() == area(size) && a.iter().all(|&a| a == 7)),
                "{size}"
            );
        }
    }

    #[test]
    fn fractional_cover_keeps_the_mean() {
        let source = ramp(UVec2::new(101, 67));
        let small = source.downscaled(UVec2::new(31, 29));
        let mean =
            |p: &RgbImage| p.rgb.iter().map(|c| f64::from(c[1])).sum::<f64>() / p.rgb.len() as f64;
        assert!((mean(&source) - mean(&small)).abs() < 0.1);
    }
}
