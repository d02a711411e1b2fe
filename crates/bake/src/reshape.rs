//! Fits opaque triangles to pictures of the soft scene, or to photos.
//!
//! A soft picture blends many faint triangles. When they become solid, the nearest ones hide all
//! others. This stage searches, without gradients, for the opaque scene that looks most like the
//! pictures. In every round it
//!
//! 1. gives each triangle the mean colour of the pixels that show it;
//! 2. moves a corner of each triangle at random, and keeps the move if it matches the pictures
//!    better;
//! 3. in some rounds cuts the triangles with the largest error in two, up to their original number;
//! 4. drops triangles if the pictures are matched better without them.
//!
//! One drawing per picture decides about all triangles at once: each belongs to one of four groups,
//! and each group has a z-buffer. The picture without a triangle is the nearest sample of the other
//! groups; with the triangle moved, it is the nearest of these and the moved one.
//!
//! In a scene closed by a shell no hole is opened, because the pictures do not show every
//! direction.
//!
//! The cost of a round is that of its drawings, so large scenes get fewer pictures in a round, and
//! fewer rounds.

mod reshaped;
mod round;

use super::views::Views;
use reshaped::ReshapedFaces;
use round::{RoundEffort, Rounds};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::mesh::Mesh;
use trisplat_scene::ranges::{self, OptionNaming};
use trisplat_scene::report::{Outcome, StageProgress};
use trisplat_scene::{Error, Result};

/// Pictures that decide whether the fitted triangles are better.
const EVALUATION_VIEWS: usize = 12;
/// Largest share of the triangles that one round cuts.
const MAX_CUT_SHARE: f64 = 0.2;

/// When triangles are fitted to pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ReshapeWhen {
    /// When the scene is soft
    Auto,
    /// Always, with photos or cameras: solid scenes lose triangles and gain little
    Always,
    /// Never
    Off,
}

/// Options of fitting triangles to pictures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ReshapeOptions {
    /// When triangles are removed, moved and cut to match the soft scene or the photos
    pub reshape: ReshapeWhen,
    /// Rounds of fitting; large scenes get fewer
    #[schemars(range(min = 1, max = 10_000))]
    pub reshape_rounds: u32,
}

impl ReshapeOptions {
    /// For soft scenes; more rounds gain little for their time.
    pub const DEFAULT: Self = Self { reshape: ReshapeWhen::Auto, reshape_rounds: 16 };
    /// None.
    pub const OFF: Self = Self { reshape: ReshapeWhen::Off, ..Self::DEFAULT };

    fn validate(&self) -> Result<()> {
        if self.reshape_rounds == 0 {
            return Err(Error::invalid("reshape_rounds", 0, "1 or more, or `reshape` off"));
        }
        ranges::check(self, OptionNaming::Flag)
    }
}

trisplat_scene::default!(ReshapeOptions);

/// The result of fitting; empty when nothing was fitted.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ReshapeDetails {
    /// Rounds made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rounds: Option<u32>,
    /// PSNR of the original triangles, on the pictures of the first round with one sample per
    /// pixel, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_first: Option<f64>,
    /// The same in the last round, before its changes, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_last: Option<f64>,
    /// Triangles dropped because the pictures are matched better without them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dropped: Option<u64>,
    /// Moves of corners.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub corners_moved: Option<u64>,
    /// Triangles cut in two.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cut: Option<u64>,
}

trisplat_scene::stage!(ReshapeDetails, "reshape");

/// Properties of the scene as it was trained.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SceneTraits {
    /// The scene was soft.
    pub is_soft: bool,
    /// A shell closes it: no view should show holes.
    pub is_closed: bool,
}

/// Fits the triangles of `mesh` to `views`, without increasing their number.
///
/// # Errors
///
/// An option out of range, a photo that cannot be decoded.
pub fn reshape(
    mesh: &mut Mesh,
    views: Option<&mut Views>,
    traits: SceneTraits,
    options: &ReshapeOptions,
    details: &mut ReshapeDetails,
    progress: &mut StageProgress<'_>,
) -> Result<Outcome<()>> {
    options.validate()?;
    if let Some(why) = skip_reason(mesh, traits, options) {
        return Ok(Outcome::Skipped(why));
    }
    let Some(views) = views.filter(|views| !views.is_empty()) else {
        return Ok(Outcome::Skipped("there are no photos and no pictures of the soft scene"));
    };
    let effort = RoundEffort::new(mesh.face_count(), views.cameras(), options.reshape_rounds);
    let [recolored, fitted] = fit(mesh, views, traits, effort, details, progress)?;
    let chosen = views.evenly_spaced(EVALUATION_VIEWS);
    // With few pictures per triangle, a round may spoil triangles for the other pictures.
    if views.mean_psnr(&fitted, &chosen)? < views.mean_psnr(&recolored, &chosen)? {
        *details = ReshapeDetails::default();
        return Ok(Outcome::Skipped("the input triangles match the pictures better"));
    }
    *mesh = fitted;
    Ok(Outcome::Changed(()))
}

/// Reason to skip the stage that needs no pictures.
fn skip_reason(mesh: &Mesh, traits: SceneTraits, options: &ReshapeOptions) -> Option<&'static str> {
    match options.reshape {
        ReshapeWhen::Off => Some("`reshape` off"),
        ReshapeWhen::Auto if !traits.is_soft => Some("the scene is solid already"),
        _ if !mesh.indices.is_empty() => Some("a mesh with shared vertices keeps its shape"),
        _ if mesh.face_count() == 0 => Some("there are no triangles"),
        _ => None,
    }
}

/// Makes the rounds; returns the original triangles, recoloured, and the fitted ones.
fn fit(
    mesh: &Mesh,
    views: &mut Views,
    traits: SceneTraits,
    effort: RoundEffort,
    details: &mut ReshapeDetails,
    progress: &mut StageProgress<'_>,
) -> Result<[Mesh; 2]> {
    let mut faces = ReshapedFaces::new(mesh);
    let mut rounds = Rounds::new(mesh, views, traits.is_closed);
    // Colours first, because changes are judged with them.
    let found = rounds.draw(0, effort, &faces, &[])?;
    faces.recolor(&found);
    details.psnr_first = found.psnr();
    details.psnr_last = found.psnr();
    let recolored = faces.to_mesh();
    let mut changes = RoundChanges::default();
    for round in 1..effort.rounds {
        progress.set(round as usize, effort.rounds as usize);
        details.psnr_last =
            changes.round(round, effort, mesh.face_count(), &mut faces, &mut rounds)?;
    }
    let RoundChanges { dropped, moved, cut } = changes;
    details.rounds = Some(effort.rounds);
    details.dropped = Some(dropped);
    details.corners_moved = Some(moved);
    details.cut = Some(cut);
    Ok([recolored, faces.to_mesh()])
}

/// Triangles changed by the rounds.
#[derive(Default)]
struct RoundChanges {
    dropped: u64,
    moved: u64,
    cut: u64,
}

impl RoundChanges {
    /// Makes a round with at most `most` faces; returns the PSNR before it.
    fn round(
        &mut self,
        round: u32,
        effort: RoundEffort,
        most: usize,
        faces: &mut ReshapedFaces,
        rounds: &mut Rounds<'_>,
    ) -> Result<Option<f64>> {
        let candidates = faces.with_moved_corners(round);
        let found = rounds.draw(round, effort, faces, &candidates)?;
        faces.recolor(&found);
        self.moved += faces.keep_moves(&found, candidates);
        if effort.cuts(round) {
            self.cut += faces.cut(&found, most, MAX_CUT_SHARE);
        }
        // Last, because results are stored by index of face.
        self.dropped += faces.drop_harmful(&found);
        Ok(found.psnr())
    }
}
