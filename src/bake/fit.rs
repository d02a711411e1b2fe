//! Whether photos show the scene: their cameras may lie in another frame, or belong to another place altogether.

use super::views::Views;
use crate::error::Result;
use crate::image::Pixels;
use crate::math::metric;
use crate::mesh::Mesh;

/// Photos looked at.
const VIEWS: usize = 8;

/// A warning when `mesh`, drawn by the photos' cameras, is farther from the photos than pictures of one colour are.
/// Fails when a photo cannot be decoded.
pub fn warning(mesh: &Mesh, views: &mut Views) -> Result<Option<String>> {
    if views.is_empty() {
        return Ok(None);
    }
    let chosen = views.evenly_spaced(VIEWS);
    let drawn = views.mean_psnr(mesh, &chosen)?;
    let mut plain = 0.0;
    for &view in &chosen {
        plain += psnr_of_mean_color(&*views.photo(view)?);
    }
    let plain = plain / chosen.len() as f64;
    Ok((drawn < plain).then(|| {
        format!(
            "the photos of `dataset` do not seem to show this scene: drawn by their cameras it is farther from them \
             ({drawn:.1} dB) than pictures of one colour are ({plain:.1} dB); is it the data set it was trained on, \
             in the same coordinates?"
        )
    }))
}

/// PSNR of a picture of the photo's mean colour, dB.
fn psnr_of_mean_color(photo: &Pixels) -> f64 {
    let weights = photo.alpha.as_deref();
    let weight = |pixel: usize| weights.map_or(1.0, |alpha| f64::from(alpha[pixel]));
    let (mut sum, mut total) = ([0.0; 3], 0.0);
    for (pixel, rgb) in photo.rgb.iter().enumerate() {
        let w = weight(pixel);
        total += w;
        sum = std::array::from_fn(|c| sum[c] + w * f64::from(rgb[c]));
    }
    let mean = sum.map(|s| if total > 0.0 { s / total } else { 0.0 });
    metric::psnr(&vec![mean.map(|c| c.round() as u8); photo.rgb.len()], &photo.rgb, weights)
}
