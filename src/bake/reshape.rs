//! Fits opaque triangles to what the scene looked like while it was soft, or to the photos.
//!
//! A soft picture is a blend of many faint triangles; made solid, the nearest of them hide all others. This stage
//! searches for the opaque scene that looks most like the pictures, without gradients. In every round it
//!
//! 1. gives each triangle the mean colour of the pixels that show it;
//! 2. moves a corner of each triangle at random, and keeps the move if the pictures are matched better with it;
//! 3. in some rounds cuts the triangles with the largest error in two, as long as there are not more than at first;
//! 4. drops the triangles without which the pictures are matched better.
//!
//! One drawing per picture decides about all triangles at once: each is in one of four groups with a z-buffer of their
//! own, and what a sample shows without a triangle, or with it moved, is the nearest of the other groups and of the
//! moved one.
//!
//! The cost of a round is that of its drawings, so large scenes get fewer pictures in a round, and fewer rounds: see
//! [`Effort`].

mod faces;
mod round;

use super::views::Views;
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::mesh::Mesh;
use crate::report::{Outcome, StageDetails, StageProgress};
use faces::ReshapedFaces;
use round::Rounds;

/// Pictures that a round looks at, if it can; the next round looks at others.
const ROUND_VIEWS: u64 = 48;
/// Samples of a round per triangle: with more, its effect is known no better.
const ENOUGH_SAMPLES: u64 = 192;
/// With fewer pictures, triangles would be fitted to a few of them only.
const FEWEST_VIEWS: u64 = 12;
/// With fewer, nothing would be gained.
const FEWEST_ROUNDS: u32 = 4;
/// Triangles and samples that all rounds together may draw.
const MOST_DRAWN: u64 = 200_000_000;
/// Triangles are cut after every so many rounds, ...
const CUT_EVERY: u32 = 3;
/// ... so many of those there are at most, as a share, ...
const MOST_CUT: f64 = 0.2;
/// ... and not in the last rounds, as the halves want to move: at most this share of the rounds is over.
const CUT_UNTIL: f64 = 0.8;

/// When triangles are fitted to pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum ReshapeWhen {
    /// When the scene is soft
    Auto,
    /// Always, if there are photos or cameras: solid scenes lose triangles and gain little
    Always,
    /// Never
    Off,
}

/// How triangles are fitted to pictures.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct ReshapeOptions {
    /// When triangles are dropped, moved and cut so that they match the soft scene, or the photos, best
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = ReshapeOptions::DEFAULT.reshape, value_name = "WHEN"))]
    pub reshape: ReshapeWhen,
    /// Rounds of it; large scenes get fewer
    #[cfg_attr(feature = "cli", arg(long, default_value_t = ReshapeOptions::DEFAULT.reshape_rounds, value_name = "N"))]
    #[schemars(range(min = 1))]
    pub reshape_rounds: u32,
}

impl ReshapeOptions {
    /// For soft scenes, as many rounds as gain something for their time.
    pub const DEFAULT: Self = Self { reshape: ReshapeWhen::Auto, reshape_rounds: 16 };
    /// None.
    pub const OFF: Self = Self { reshape: ReshapeWhen::Off, ..Self::DEFAULT };

    fn validate(&self) -> Result<()> {
        if self.reshape_rounds == 0 {
            return Err(Error::invalid("reshape_rounds", 0, "1 or more, or `reshape` off"));
        }
        Ok(())
    }
}

impl Default for ReshapeOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// What fitting did; empty when nothing was fitted.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
pub struct ReshapeDetails {
    /// Rounds made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rounds: Option<u32>,
    /// PSNR of the triangles as they came, in the pictures of the first round with one sample per pixel, dB.
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

impl StageDetails for ReshapeDetails {
    const STAGE: &'static str = "reshape";
}

/// Fits the triangles of `mesh` to `views`; there are never more than at first. `is_soft`: the scene was soft.
///
/// Errors: an option out of range, a photo that cannot be decoded.
pub fn reshape(
    mesh: &mut Mesh,
    views: Option<&mut Views>,
    is_soft: bool,
    options: &ReshapeOptions,
    details: &mut ReshapeDetails,
    progress: &mut StageProgress<'_>,
) -> Result<Outcome<()>> {
    options.validate()?;
    if options.reshape == ReshapeWhen::Off {
        return Ok(Outcome::Unneeded("`reshape` off"));
    }
    if options.reshape == ReshapeWhen::Auto && !is_soft {
        return Ok(Outcome::Unneeded("the scene is solid already"));
    }
    let Some(views) = views.filter(|views| !views.is_empty()) else {
        return Ok(Outcome::Unneeded("there are no photos and no pictures of the soft scene"));
    };
    if !mesh.indices.is_empty() {
        return Ok(Outcome::Unneeded("a mesh with shared vertices keeps its shape"));
    }
    if mesh.face_count() == 0 {
        return Ok(Outcome::Unneeded("there are no triangles"));
    }
    let effort = Effort::new(mesh.face_count(), views.cameras(), options.reshape_rounds);
    let mut faces = ReshapedFaces::new(mesh);
    let mut rounds = Rounds::new(mesh, views);
    let (mut dropped, mut moved, mut cut) = (0, 0, 0);
    for round in 0..effort.rounds {
        progress.set(round as usize, effort.rounds as usize);
        let candidates = faces.with_moved_corners(round);
        let found = rounds.draw(round, effort.stride, &faces, &candidates)?;
        details.psnr_first = details.psnr_first.or(found.psnr());
        details.psnr_last = found.psnr();
        faces.recolor(&found);
        if round == 0 {
            // What it found was found with other colours.
            continue;
        }
        moved += faces.keep_moves(&found, candidates);
        if effort.cuts(round) {
            cut += faces.cut(&found, mesh.face_count(), MOST_CUT);
        }
        // Last, as what was found is by the places of the faces.
        dropped += faces.drop_harmful(&found);
    }
    details.rounds = Some(effort.rounds);
    (details.dropped, details.corners_moved, details.cut) = (Some(dropped), Some(moved), Some(cut));
    *mesh = faces.into_mesh();
    Ok(Outcome::Changed(()))
}

/// How many rounds there are, and which pictures each looks at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Effort {
    rounds: u32,
    /// A round looks at one picture in so many.
    stride: usize,
}

impl Effort {
    /// For so many faces: as many pictures a round as show enough of each, fewer when they are many, and then fewer rounds.
    fn new(faces: usize, cameras: &[Camera], rounds: u32) -> Self {
        let (faces, views) = (faces as u64, cameras.len() as u64);
        let pixels = |camera| round::smaller(camera).size.as_u64vec2().element_product();
        let pixels = (cameras.iter().map(pixels).sum::<u64>() / views.max(1)).max(1);
        // Every face twice, as it is and moved.
        let per_view = 2 * faces + pixels;
        let enough = (ENOUGH_SAMPLES * faces).div_ceil(pixels);
        let affordable = MOST_DRAWN / (u64::from(rounds) * per_view).max(1);
        let per_round = enough.min(affordable).clamp(FEWEST_VIEWS, ROUND_VIEWS).min(views).max(1);
        let affordable = MOST_DRAWN / (per_round * per_view).max(1);
        let affordable = u32::try_from(affordable).unwrap_or(u32::MAX).max(FEWEST_ROUNDS);
        Self { rounds: affordable.min(rounds), stride: views.div_ceil(per_round) as usize }
    }

    /// Whether triangles are cut after this round.
    fn cuts(self, round: u32) -> bool {
        round.is_multiple_of(CUT_EVERY) && f64::from(round) < CUT_UNTIL * f64::from(self.rounds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat3, UVec2, Vec2, Vec3};

    fn cameras(count: usize, side: u32) -> Vec<Camera> {
        let size = UVec2::splat(side);
        let (rotation, translation) = (Mat3::IDENTITY, Vec3::ZERO);
        vec![Camera { rotation, translation, focal: Vec2::ONE, center: size.as_vec2() / 2.0, size }; count]
    }

    #[test]
    fn large_scenes_get_fewer_pictures_and_then_fewer_rounds() {
        let effort = |faces, count, side| Effort::new(faces, &cameras(count, side), 16);
        assert_eq!(effort(40_000, 40, 300), Effort { rounds: 16, stride: 1 });
        assert_eq!(effort(10_000, 96, 360), Effort { rounds: 16, stride: 8 }, "a few pictures show enough");
        let large = effort(1_000_000, 96, 360);
        assert!(large.stride == 8 && (FEWEST_ROUNDS..16).contains(&large.rounds), "{large:?}");
        assert_eq!(effort(50_000_000, 96, 360), Effort { rounds: FEWEST_ROUNDS, stride: 8 });
        assert_eq!(effort(1, 1, 1), Effort { rounds: 16, stride: 1 });
    }

    #[test]
    fn the_last_rounds_cut_nothing() {
        let effort = Effort { rounds: 16, stride: 1 };
        let cut: Vec<u32> = (1..16).filter(|&round| effort.cuts(round)).collect();
        assert_eq!(cut, [3, 6, 9, 12]);
    }
}
