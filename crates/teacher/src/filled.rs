//! Closes the gaps of a picture by the colours around them.

use glam::UVec2;
use trisplat_raster::soft::Frame;
use trisplat_scene::image::RgbImage;

/// The picture of `frame`, drawn over black, with its gaps closed: what is seen through a pixel is the mean of what is around it (pull-push,
/// Gortler et al. 1996).
pub(super) fn filled(frame: &Frame) -> RgbImage {
    RgbImage::from_rgb(frame.size, &closed(frame.size, &frame.rgb, &frame.transmittance))
}

/// The same of colours over black, with the open share of each pixel.
fn closed(size: UVec2, rgb: &[[f32; 3]], open: &[f32]) -> Vec<[f32; 3]> {
    if size == UVec2::ONE {
        let cover = (1.0 - open[0]).max(f32::EPSILON);
        return vec![rgb[0].map(|c| c / cover)];
    }
    let coarse = (size / 2).max(UVec2::ONE);
    let cell = |i: usize| {
        let at = (UVec2::new(i as u32 % size.x, i as u32 / size.x) / 2).min(coarse - 1);
        (at.y * coarse.x + at.x) as usize
    };
    // Red, green, blue, open share and number of pixels.
    let mut sums = vec![[0.0; 5]; coarse.element_product() as usize];
    for (i, ([r, g, b], open)) in rgb.iter().zip(open).enumerate() {
        let sum = &mut sums[cell(i)];
        sum.iter_mut().zip([*r, *g, *b, *open, 1.0]).for_each(|(sum, value)| *sum += value);
    }
    let colors: Vec<[f32; 3]> = sums.iter().map(|[r, g, b, _, n]| [r / n, g / n, b / n]).collect();
    let gaps: Vec<f32> = sums.iter().map(|[.., open, n]| open / n).collect();
    let behind = closed(coarse, &colors, &gaps);
    let over = |(i, (rgb, open)): (usize, (&[f32; 3], &f32))| {
        let behind = behind[cell(i)];
        [0, 1, 2].map(|c| rgb[c] + open * behind[c])
    };
    rgb.iter().zip(open).enumerate().map(over).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_has_the_colour_of_what_is_around_it() {
        let size = UVec2::new(13, 7);
        let open: Vec<f32> = (0..91).map(|i| if (30..34).contains(&i) { 1.0 } else { 0.25 }).collect();
        let rgb: Vec<[f32; 3]> = open.iter().map(|open| [0.8, 0.4, 0.2].map(|c| c * (1.0 - open))).collect();
        let frame = Frame { size, rgb, transmittance: open, ..Frame::default() };
        let picture = filled(&frame);
        assert!(picture.alpha.is_none() && picture.rgb.iter().all(|rgb| *rgb == [204, 102, 51]));
        let nothing = Frame { rgb: vec![[0.0; 3]; 91], transmittance: vec![1.0; 91], ..frame };
        assert!(filled(&nothing).rgb.iter().all(|rgb| *rgb == [0; 3]));
    }
}
