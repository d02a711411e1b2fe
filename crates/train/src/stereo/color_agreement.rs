//! Agreement of photos on the colours of points, whatever the exposure of each.

use super::gray_image::GrayImage;
use glam::Vec3;

/// Largest deviation of the photos' colours at a point of one surface: an anchor that gets a
/// triangle, a place that only depth maps know.
pub(super) const MAX_COLOR_DEVIATION: f32 = 0.03;

/// A point as a photo shows it: indices of both, and the colour.
type ColorSample = (usize, usize, Vec3);

/// Deviation of each point's colour over its photos, root mean square in [0, 1], after one gain per
/// photo and channel for the exposure; `rays` are pairs of photo and point. Infinite with fewer than
/// two photos.
pub(super) fn color_deviations(
    points: &[Vec3],
    rays: &[(u32, u32)],
    images: &[GrayImage],
) -> Vec<f32> {
    let color = |&(photo, point): &(u32, u32)| {
        let color = images[photo as usize].color(points[point as usize])?;
        Some((photo as usize, point as usize, color))
    };
    let samples: Vec<ColorSample> = rays.iter().filter_map(color).collect();
    let mut gains = vec![Vec3::ONE; images.len()];
    let mut means = mean_colors(points.len(), &samples, &gains);
    for _ in 0..2 {
        // Least squares of gain · colour - mean.
        let mut sums = vec![[Vec3::ZERO; 2]; images.len()];
        for &(photo, point, color) in &samples {
            let [both, square] = &mut sums[photo];
            *both += means[point] * color;
            *square += color * color;
        }
        let gain = |[both, square]: &[Vec3; 2]| {
            Vec3::select(square.cmpgt(Vec3::splat(1e-3)), *both / *square, Vec3::ONE)
        };
        gains = sums.iter().map(gain).collect();
        means = mean_colors(points.len(), &samples, &gains);
    }
    let mut squares = vec![(0.0f32, 0u32); points.len()];
    for &(photo, point, color) in &samples {
        let (sum, count) = &mut squares[point];
        *sum += (color * gains[photo] - means[point]).length_squared() / 3.0;
        *count += 1;
    }
    let deviation = |&(sum, count): &(f32, u32)| match count {
        0 | 1 => f32::INFINITY,
        count => (sum / (count - 1) as f32).sqrt(),
    };
    squares.iter().map(deviation).collect()
}

/// Mean colour of each of `count` points.
fn mean_colors(count: usize, samples: &[ColorSample], gains: &[Vec3]) -> Vec<Vec3> {
    let mut sums = vec![(Vec3::ZERO, 0.0f32); count];
    for &(photo, point, color) in samples {
        let (sum, count) = &mut sums[point];
        *sum += color * gains[photo];
        *count += 1.0;
    }
    sums.iter().map(|(sum, count)| *sum / count.max(1.0)).collect()
}
