//! A photo's gain beside those of other photos at the same points.

use super::light::Light;
use std::collections::HashMap;

/// The gain of each photo less the mean of the `residuals` of other photos at its points; `None`
/// where no other photo shows any. Only photos for which `is_used` count as others.
pub(super) fn beside_others(
    lights: &[Vec<Light>],
    gains: &[[f32; 3]],
    residuals: &[[f32; 3]],
    is_used: &[bool],
) -> Vec<Option<[f32; 3]>> {
    // Sums by point, and the number of photos.
    let mut sums: HashMap<u32, [f32; 4]> = HashMap::new();
    for photo in (0..lights.len()).filter(|photo| is_used[*photo]) {
        let [red, green, blue] = residuals[photo];
        for light in &lights[photo] {
            let sum = sums.entry(light.point).or_default();
            *sum = [sum[0] + red, sum[1] + green, sum[2] + blue, sum[3] + 1.0];
        }
    }
    let of_photo = |photo: usize| {
        let itself = f32::from(u8::from(is_used[photo]));
        let mut mean = [0.0f32; 4];
        for sum in lights[photo].iter().filter_map(|light| sums.get(&light.point)) {
            let others = sum[3] - itself;
            if others > 0.5 {
                for (mean, (sum, residual)) in mean.iter_mut().zip(sum.iter().zip(residuals[photo]))
                {
                    *mean += (sum - itself * residual) / others;
                }
                mean[3] += 1.0;
            }
        }
        let relative = [0, 1, 2].map(|c: usize| gains[photo][c] - mean[c] / mean[3]);
        (mean[3] > 0.0).then_some(relative)
    };
    (0..lights.len()).map(of_photo).collect()
}
