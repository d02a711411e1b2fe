//! Texels from the photos: in place of one colour, each triangle shows its detail in the photos.
//!
//! The size that a triangle has in photos decides how many texels it has (`footprint`). Of a soup,
//! pairs of triangles share a rectangle of one picture (`atlas`); a connected mesh is unwrapped
//! (`charts`). Texels begin with the colours of the mesh, and get the detail of photos (`fit`):
//! all of them on average, or also the detail of the one that shows a face best (`best`).
//!
//! Some photos are held out at first, and compared with colours and with texels: where triangles
//! are hardly larger than pixels, what mip levels mix is more than what texels add. Both begin with
//! colours that were fitted to the other photos only, so neither has seen them. `auto` keeps
//! colours that are better by PSNR and by SSIM: PSNR alone prefers blur.

use crate::refit::UnseenColors;
use crate::views::{ViewScores, Views};
use atlas::{Atlas, Layout, footprints};
use best_photos::PhotoCandidates;
use charts::Charts;
pub use options::{TextureDetail, TextureOptions, TextureWhen};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use texels::{PixelSelection, Texels};
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::srgb_from_linear;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::{Outcome, StageProgress};
use trisplat_scene::{Error, FaceTexture, ImportedScene, Result, Scene, Texture};

mod atlas;
mod best_photos;
mod charts;
mod options;
mod texels;

/// Number of photos for which λ is that of the options; half as many double it.
const USUAL_PHOTOS: f32 = 40.0;
/// λ of the detail that the best photo adds to the mean, px.
const SHARP_FLATNESS: f32 = 0.2;

/// Measurements of the texture; empty when there is none.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TextureDetails {
    /// Width and height, texels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<[u32; 2]>,
    /// Texels that triangles show.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub texels: Option<u64>,
    /// Charts that a connected mesh is unwrapped to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub charts: Option<u64>,
    /// Photos that show some face best, whose detail it has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub best_photos: Option<u64>,
    /// Texels per pixel, fewer than asked for where the texture would be too large.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub texels_per_pixel: Option<f64>,
    /// Mean PSNR of colours on held-out photos, dB. `refit` has not seen them; the colours of a
    /// connected mesh may have.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_before: Option<f64>,
    /// The same with texels that were fitted to the other photos only, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_after: Option<f64>,
    /// Mean SSIM of colours on held-out photos, which the scene's own may have seen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ssim_before: Option<f64>,
    /// The same with texels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ssim_after: Option<f64>,
}

impl TextureDetails {
    /// Scores of colours and texels on held-out photos; `None` when none were held out.
    pub fn comparison(&self) -> Option<String> {
        let before = self.psnr_before?;
        let after = self.psnr_after?;
        let ssim = match (self.ssim_before, self.ssim_after) {
            (Some(before), Some(after)) => format!(", SSIM {before:.3} → {after:.3}"),
            _ => String::new(),
        };
        Some(format!("{before:.1} → {after:.1} dB{ssim} on held-out photos"))
    }

    /// Records the scores of colours and of texels on held-out photos.
    fn record(&mut self, colors: &ViewScores, texels: &ViewScores) {
        self.psnr_before = Some(colors.psnr);
        self.psnr_after = Some(texels.psnr);
        self.ssim_before = Some(colors.ssim);
        self.ssim_after = Some(texels.ssim);
    }

    /// True if held-out photos match the colours better by every measure.
    fn colors_are_better(&self) -> bool {
        let fell =
            |before: Option<f64>, after: Option<f64>| before.zip(after).is_some_and(|(b, a)| a < b);
        fell(self.psnr_before, self.psnr_after) && fell(self.ssim_before, self.ssim_after)
    }

    /// Warning if the texture is worse than colours.
    pub fn warning(&self) -> Option<String> {
        let comparison = self.comparison().filter(|_| self.colors_are_better())?;
        Some(format!(
            "the colours were closer to the photos than the texture: {comparison}; without `texture`, or with its value `auto`, the file has colours, which only a USDZ does not show"
        ))
    }
}

trisplat_scene::stage!(TextureDetails, "texture");

/// Gives `mesh` a texture from `views`. Texels begin with the colours `unseen`, if there
/// are any, or those of the mesh.
///
/// # Errors
///
/// An option out of range, no photos, a photo that cannot be decoded.
pub fn texture(
    mesh: &mut Mesh,
    views: Option<&mut Views>,
    unseen: Option<UnseenColors>,
    options: &TextureOptions,
    details: &mut TextureDetails,
    progress: &mut StageProgress<'_>,
) -> Result<Outcome<()>> {
    options.validate()?;
    if !options.is_wanted() {
        return Ok(Outcome::Skipped("`texture` was not asked for"));
    }
    let Some(views) = views.filter(|views| !views.is_empty()) else {
        let wants = "photos, which `dataset` names, or a soft scene, whose own pictures serve";
        return Err(Error::invalid("texture", "given without photos", wants));
    };
    if mesh.indices.is_empty() {
        let atlas = Atlas::new(mesh, &footprints(mesh, views), options)?;
        details.texels_per_pixel = Some(atlas.texels_per_pixel);
        let Some(UnseenColors { colors, psnr_of_own }) = unseen else {
            return paint(mesh, views, &atlas, None, options, details, progress);
        };
        let (held_out, _) = views.held_out();
        let ssim = views.mean_scores(mesh, &held_out)?.ssim;
        let of_own = psnr_of_own.map(|psnr| ViewScores { psnr, ssim });
        let own = std::mem::replace(&mut mesh.colors, colors);
        let outcome = paint(mesh, views, &atlas, of_own, options, details, progress);
        mesh.colors = own;
        return outcome;
    }
    let mut charted = mesh.clone();
    let charts = Charts::new(&mut charted, &footprints(mesh, views), options)?;
    details.texels_per_pixel = Some(charts.texels_per_pixel);
    details.charts = Some(charts.count);
    let outcome = paint(&mut charted, views, &charts, None, options, details, progress)?;
    if charted.texture.is_some() {
        *mesh = charted;
    }
    Ok(outcome)
}

/// Gives `mesh`, whose faces are placed by `layout`, a texture from `views`. `before` are the
/// scores of colours on held-out photos, if computed.
fn paint(
    mesh: &mut Mesh,
    views: &mut Views,
    layout: &impl Layout,
    before: Option<ViewScores>,
    options: &TextureOptions,
    details: &mut TextureDetails,
    progress: &mut StageProgress<'_>,
) -> Result<Outcome<()>> {
    details.size = Some(layout.size().to_array());
    let mut texels = Texels::new(mesh, layout);
    details.texels = Some(texels.shown_texels());
    let (held_out, others) = views.held_out();
    // λ for this number of photos.
    let flatness =
        |photos: usize| options.texture_flatness as f32 * USUAL_PHOTOS / photos.max(1) as f32;
    let painted = |texels: &Texels, flatness: f32| Some(textured(layout, texels.picture(flatness)));
    let mut candidates = PhotoCandidates::new(mesh.face_count());
    let selection = PixelSelection::All(&mut candidates);
    texels.add(mesh, views, layout, &others, selection, progress.part(0.1, 0.5))?;
    if !held_out.is_empty() {
        let colors = before.map_or_else(|| views.mean_scores(mesh, &held_out), Ok)?;
        mesh.texture = painted(&texels, flatness(others.len()));
        let texel_scores = views.mean_scores(mesh, &held_out)?;
        mesh.texture = None;
        details.record(&colors, &texel_scores);
        if options.texture == TextureWhen::Auto && details.colors_are_better() {
            return Ok(Outcome::Skipped("held-out photos match the colours better than texels"));
        }
    }
    let selection = PixelSelection::All(&mut candidates);
    texels.add(mesh, views, layout, &held_out, selection, progress.part(0.6, 0.7))?;
    let is_soup = mesh.indices.is_empty();
    let detail = options.texture_detail;
    if detail == TextureDetail::Mean || detail == TextureDetail::Auto && is_soup {
        mesh.texture = painted(&texels, flatness(views.len()));
        return Ok(Outcome::Changed(()));
    }
    texels.settle(flatness(views.len()));
    let best = candidates.best(mesh);
    details.best_photos = Some(best.views().len() as u64);
    let selection = PixelSelection::Best(&best);
    texels.add(mesh, views, layout, &best.views(), selection, progress.part(0.7, 0.95))?;
    texels.sharpen(layout, &best, SHARP_FLATNESS);
    mesh.texture = painted(&texels, 0.0);
    Ok(Outcome::Changed(()))
}

/// The texture of faces that a layout has placed.
fn textured(layout: &impl Layout, picture: RgbImage) -> FaceTexture {
    FaceTexture::new(layout.uvs(), Arc::new(Texture::new(picture)))
}

// ---- A texture of a mesh's own colours, so that it can join a textured one ----------------------

/// Corners whose sRGB-encoded colours differ by less look alike.
const ALIKE: f32 = 2.0 / 255.0;

/// Gives every mesh of `inputs` a texture if one of them has one: a merge could keep neither
/// colours nor texture of both otherwise.
///
/// # Errors
///
/// More triangles than the largest texture has texels.
pub(crate) fn texture_all(inputs: &mut [ImportedScene]) -> Result<()> {
    let is_textured = |loaded: &ImportedScene| matches!(&loaded.scene, Scene::Mesh(mesh) if mesh.texture.is_some());
    if !inputs.iter().any(is_textured) {
        return Ok(());
    }
    for loaded in inputs {
        if let Scene::Mesh(mesh) = &mut loaded.scene
            && mesh.texture.is_none()
        {
            *mesh = with_texture(std::mem::take(mesh))?;
            let name = loaded.provenance.source.as_deref().unwrap_or("an input");
            let warning =
                format!("the colours of {name} became a texture, because another input has one");
            loaded.warnings.push(warning);
        }
    }
    Ok(())
}

/// A triangle of one colour has one texel, any other those of its corners.
pub(crate) fn with_texture(mesh: Mesh) -> Result<Mesh> {
    let mut mesh = mesh.unshared();
    let length = |face: usize| {
        let corners = mesh.corner_colors(face).map(|corner| corner.map(srgb_from_linear));
        let differs = |k: usize| (0..3).any(|c| (corners[k][c] - corners[0][c]).abs() > ALIKE);
        if differs(1) || differs(2) { 1.0 } else { 0.0 }
    };
    let edges: Vec<[f32; 3]> = (0..mesh.face_count()).map(|face| [length(face); 3]).collect();
    let options = TextureOptions { texels_per_pixel: 1.0, ..TextureOptions::DEFAULT };
    let atlas = Atlas::new(&mesh, &edges, &options)?;
    mesh.texture = Some(textured(&atlas, Texels::new(&mesh, &atlas).picture(0.0)));
    Ok(mesh)
}
