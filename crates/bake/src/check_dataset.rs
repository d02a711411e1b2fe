//! Verifies that the photos belong to the scene: their cameras may lie in another frame, or show
//! another place altogether.

use super::views::Views;
use std::sync::Arc;
use trisplat_raster::solid::{NO_FACE, SolidRasterizer};
use trisplat_scene::Result;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::metric;
use trisplat_scene::mesh::Mesh;

/// Number of compared photos.
const VIEWS: usize = 8;
/// Minimum excess of a drawing's correlation with its own photo over that with other photos. A soft
/// scene just made solid may be far from its photos and still show the same shapes.
const MIN_CORRELATION_EXCESS: f64 = 0.05;

/// Describes the fault if drawings of `mesh` match the photos worse than one plain colour does, and
/// no better than other photos. If the scene `is_cropped`, pixels beside it do not count.
///
/// # Errors
///
/// A photo that cannot be decoded.
pub(super) fn check_dataset(
    mesh: &Mesh,
    is_cropped: bool,
    views: &mut Views,
) -> Result<Option<String>> {
    if views.is_empty() {
        return Ok(None);
    }
    let chosen = views.evenly_spaced(VIEWS);
    let drawing = views.drawing(mesh, 1);
    let mut solid = SolidRasterizer::new();
    let mut drawn = 0.0;
    let mut plain = 0.0;
    views.prefetch(&chosen);
    let mut pictures = Vec::new();
    let mut photos = Vec::new();
    for &view in &chosen {
        let mut photo = views.photo(view)?;
        let picture = solid.render(mesh, views.camera(view), &drawing);
        if is_cropped {
            let faces = &solid.visibility(mesh, views.camera(view), &drawing).face;
            photo = Arc::new(masked_to_faces(&photo, faces));
        }
        drawn += metric::psnr(&picture.rgb, &photo.rgb, photo.alpha.as_deref());
        plain += psnr_of_mean_color(&photo);
        pictures.push(picture);
        photos.push(photo);
    }
    let [drawn, plain] = [drawn, plain].map(|sum| sum / chosen.len() as f64);
    Ok((drawn < plain && own_resemblance(&pictures, &photos) < MIN_CORRELATION_EXCESS).then(|| {
        format!(
            "photos that do not seem to show this scene: drawn by their cameras it is farther from them ({drawn:.1} dB) \
             than pictures of one colour are ({plain:.1} dB)"
        )
    }))
}

/// The photo without the pixels that show no face.
fn masked_to_faces(photo: &RgbImage, faces: &[u32]) -> RgbImage {
    let alpha = |i: usize| photo.alpha.as_ref().map_or(u8::MAX, |alpha| alpha[i]);
    let alphas =
        faces.iter().enumerate().map(|(i, face)| if *face == NO_FACE { 0 } else { alpha(i) });
    RgbImage { alpha: Some(alphas.collect()), ..photo.clone() }
}

/// Excess of the drawings' correlation with their own photos over that with others of the same
/// size.
fn own_resemblance(pictures: &[RgbImage], photos: &[Arc<RgbImage>]) -> f64 {
    let mut own = (0.0, 0.0);
    let mut others = (0.0, 0.0);
    for (i, picture) in pictures.iter().enumerate() {
        for (j, photo) in photos.iter().enumerate().filter(|(_, photo)| photo.size == picture.size)
        {
            let sum = if i == j { &mut own } else { &mut others };
            sum.0 += correlation(&picture.rgb, &photo.rgb, photo.alpha.as_deref());
            sum.1 += 1.0;
        }
    }
    own.0 / f64::max(own.1, 1.0) - others.0 / f64::max(others.1, 1.0)
}

/// Pearson's correlation of the brightness of two pictures, -1 to 1; 0 when one has a single
/// brightness. Pixels count by `weights`.
fn correlation(a: &[[u8; 3]], b: &[[u8; 3]], weights: Option<&[u8]>) -> f64 {
    let brightness = |rgb: &[u8; 3]| rgb.iter().map(|c| f64::from(*c)).sum::<f64>();
    let mut sums = [0.0; 6];
    for (pixel, (a, b)) in a.iter().zip(b).enumerate() {
        let w = weights.map_or(1.0, |w| f64::from(w[pixel]));
        let x = brightness(a);
        let y = brightness(b);
        let terms = [w, w * x, w * y, w * x * x, w * y * y, w * x * y];
        sums = std::array::from_fn(|i| sums[i] + terms[i]);
    }
    let [w, x, y, xx, yy, xy] = sums;
    let spread = ((w * xx - x * x) * (w * yy - y * y)).max(0.0).sqrt();
    if spread > 0.0 { (w * xy - x * y) / spread } else { 0.0 }
}

/// PSNR of a picture of the photo's mean colour, dB.
pub fn psnr_of_mean_color(photo: &RgbImage) -> f64 {
    let weights = photo.alpha.as_deref();
    let weight = |pixel: usize| weights.map_or(1.0, |alpha| f64::from(alpha[pixel]));
    let mut sum = [0.0; 3];
    let mut total = 0.0;
    for (pixel, rgb) in photo.rgb.iter().enumerate() {
        let w = weight(pixel);
        total += w;
        sum = std::array::from_fn(|c| sum[c] + w * f64::from(rgb[c]));
    }
    let mean = sum.map(|s| if total > 0.0 { s / total } else { 0.0 });
    metric::psnr(&vec![mean.map(|c| c.round() as u8); photo.rgb.len()], &photo.rgb, weights)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::UVec2;

    #[test]
    fn correlation_of_equal_shapes_ignores_contrast() {
        let ramp: Vec<[u8; 3]> = (0..100).map(|i| [i, i, 2 * i]).collect();
        let faint: Vec<[u8; 3]> = ramp.iter().map(|rgb| rgb.map(|c| c / 4 + 90)).collect();
        let turned: Vec<[u8; 3]> = ramp.iter().rev().copied().collect();
        assert!(correlation(&ramp, &faint, None) > 0.99);
        assert!(correlation(&ramp, &turned, None) < -0.99);
        assert_eq!(correlation(&ramp, &[[7; 3]; 100], None), 0.0);
        let first_half: Vec<u8> = (0..100).map(|i| if i < 50 { 255 } else { 0 }).collect();
        let mixed = [&ramp[..50], &turned[50..]].concat();
        assert!(correlation(&ramp, &mixed, Some(&first_half)) > 0.99);
    }

    #[test]
    fn a_part_is_judged_where_it_is() {
        let photo = RgbImage {
            alpha: Some(vec![9, 8, 7]),
            ..RgbImage::from_rgb(UVec2::new(3, 1), &[[0.5; 3]; 3])
        };
        assert_eq!(masked_to_faces(&photo, &[4, NO_FACE, 0]).alpha, Some(vec![9, 0, 7]));
    }
}
