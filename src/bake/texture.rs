//! Texels from the photos: in place of one colour, each triangle shows what photos show of it.
//!
//! The size that a triangle has in photos decides how many texels it has (`footprint`). Pairs of triangles share a rectangle of one
//! picture (`atlas`). Texels begin with the colours of the mesh, and get what photos show more (`fit`).

mod atlas;
mod fit;
mod footprint;
mod options;

pub use options::TextureOptions;

use super::views::Views;
use crate::error::{Error, Result};
use crate::mesh::Mesh;
use crate::report::{Outcome, StageDetails, StageProgress};
use crate::texture::{FaceTexture, Texture};
use atlas::Atlas;
use fit::Texels;
use footprint::footprints;
use std::sync::Arc;

/// Photos that the textured scene is compared with.
const COMPARED: usize = 12;

/// What the texture is; empty when there is none.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
pub struct TextureDetails {
    /// Width and height, texels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<[u32; 2]>,
    /// Texels that triangles show.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub texels: Option<u64>,
    /// Texels per pixel that the size permits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub texels_per_pixel: Option<f64>,
    /// Mean PSNR of the scene without the texture on some of the photos, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_before: Option<f64>,
    /// The same with the texture, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_after: Option<f64>,
}

impl StageDetails for TextureDetails {
    const STAGE: &'static str = "texture";
}

/// Gives `mesh` a texture of what `views` show.
///
/// Errors: an option out of range, no photos, a photo that cannot be decoded.
pub fn texture(
    mesh: &mut Mesh,
    views: Option<&mut Views>,
    options: &TextureOptions,
    details: &mut TextureDetails,
    progress: &mut StageProgress<'_>,
) -> Result<Outcome<()>> {
    options.validate()?;
    if !options.texture {
        return Ok(Outcome::Unneeded("`texture` was not asked for"));
    }
    let Some(views) = views.filter(|views| !views.is_empty()) else {
        let wants = "photos, which `dataset` names, or a soft scene, whose own pictures serve";
        return Err(Error::invalid("texture", "given without photos", wants));
    };
    *mesh = std::mem::take(mesh).unshared();
    let compared = views.evenly_spaced(COMPARED);
    details.psnr_before = Some(views.mean_psnr(mesh, &compared)?);
    let atlas = Atlas::new(mesh, &footprints(mesh, views), options)?;
    (details.size, details.texels_per_pixel) = (Some(atlas.size.to_array()), Some(atlas.texels_per_pixel));
    let mut texels = Texels::new(mesh, &atlas);
    details.texels = Some(texels.shown());
    texels.fit(mesh, views, &atlas, options.texture_flatness as f32, &mut progress.part(0.1, 0.9))?;
    let texture = Arc::new(Texture::new(texels.picture()));
    mesh.texture = Some(FaceTexture { uvs: atlas.uvs(), texture });
    details.psnr_after = Some(views.mean_psnr(mesh, &compared)?);
    Ok(Outcome::Changed(()))
}
