//! Turns spherical harmonics of degree 0 into linear face colours, which engines multiply and blend.

use trisplat_scene::parallel;
use trisplat_scene::{
    Result, Soup,
    math::color::linear_from_srgb,
    mesh::{Colors, Mesh},
    report::StageDetails,
    rgb_from_sh0,
};

/// What the conversion clamped.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
pub struct ColorDetails {
    /// Colour channels, three per triangle, that were clamped to [0, 1].
    pub clamped_channels: u64,
}

impl StageDetails for ColorDetails {
    const STAGE: &'static str = "color";
}

/// A non-indexed mesh with one linear colour per face. Opacity and σ are dropped, and vertices move without a
/// copy. `details` counts the channels clamped to [0, 1].
pub fn color(mut soup: Soup, details: &mut ColorDetails) -> Result<Mesh> {
    soup.truncate_sh(0);
    let Soup { vertices, mut sh, opacity, sigma, shell, .. } = soup;
    drop((opacity, sigma));
    let parts = sh.chunks_mut(1 << 14);
    let clamped = parallel::map(parts, |_, part| part.iter_mut().map(linearise).sum::<u64>());
    details.clamped_channels = clamped.into_iter().sum();
    Ok(Mesh { positions: vertices.into_flattened(), colors: Colors::Face(sh), shell, ..Mesh::default() })
}

/// Turns SH degree 0 coefficients into linear channels; returns how many had to be clamped.
fn linearise(coefficients: &mut [f32; 3]) -> u64 {
    let mut clamped = 0;
    for channel in coefficients {
        let encoded = rgb_from_sh0(*channel);
        clamped += u64::from(!(0.0..=1.0).contains(&encoded));
        *channel = linear_from_srgb(encoded.max(0.0));
    }
    clamped
}
