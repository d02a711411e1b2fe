//! Texels from the photos: in place of one colour, each triangle shows what photos show of it.
//!
//! The size that a triangle has in photos decides how many texels it has (`footprint`). Pairs of triangles share a rectangle of one
//! picture (`atlas`). Texels begin with the colours of the mesh, and get what photos show more (`fit`).
//!
//! Some photos are held out at first. If they match the colours better, which have usually seen them, there is no texture: where
//! triangles are hardly larger than pixels, what mip levels mix is more than what texels add.

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

/// One photo in this many is held out at first, to evaluate on, and ...
const EVALUATION_EVERY: usize = 8;
/// ... at most these.
const MOST_EVALUATION_VIEWS: usize = 24;

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
    /// Mean PSNR of the scene's colours on held-out photos, dB; fitting colours may have seen them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_before: Option<f64>,
    /// The same with texels that were fitted to the other photos only, dB.
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
    let atlas = Atlas::new(mesh, &footprints(mesh, views), options)?;
    (details.size, details.texels_per_pixel) = (Some(atlas.size.to_array()), Some(atlas.texels_per_pixel));
    let mut texels = Texels::new(mesh, &atlas);
    details.texels = Some(texels.shown());
    let every = EVALUATION_EVERY.max(views.len().div_ceil(MOST_EVALUATION_VIEWS));
    let (held_out, others): (Vec<usize>, Vec<usize>) = (0..views.len()).partition(|v| v % every == every / 2);
    let (uvs, flatness) = (atlas.uvs(), options.texture_flatness as f32);
    let painted = |texels: &Texels, photos: usize| {
        let texture = Arc::new(Texture::new(texels.picture(flatness, photos)));
        Some(FaceTexture { uvs: uvs.clone(), texture })
    };
    texels.add(mesh, views, &atlas, &others, progress.part(0.1, 0.7))?;
    if !held_out.is_empty() {
        let before = views.mean_psnr(mesh, &held_out)?;
        mesh.texture = painted(&texels, others.len());
        let after = views.mean_psnr(mesh, &held_out)?;
        mesh.texture = None;
        (details.psnr_before, details.psnr_after) = (Some(before), Some(after));
        if after < before {
            return Ok(Outcome::Unneeded("held-out photos match the colours better than texels"));
        }
    }
    texels.add(mesh, views, &atlas, &held_out, progress.part(0.8, 0.95))?;
    mesh.texture = painted(&texels, views.len());
    Ok(Outcome::Changed(()))
}
