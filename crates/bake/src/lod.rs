//! Levels of detail: the same scene with fewer triangles, for an engine to draw where it is small
//! on the screen.
//!
//! Connected parts are simplified by edge collapses for each level. The triangles of a soup are
//! ranked once, by importance, so that those of a level are also those of every finer one. In each
//! level they are then enlarged to cover the gaps of the dropped ones. The recipe finishes a level
//! like the scene itself: colours from the photos if there are any, then the stages that make a
//! file.

use super::decimate::{self, Decimation};
use super::simplify::{Parts, faces_of_share};
use super::views::SAMPLES;
use crate::unseen::visible_px;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::{Outcome, StageProgress};
use trisplat_scene::{Asset, Error, Result};
use trisplat_surface::EdgeCollapse;

/// Maximum number of levels beside the scene itself.
const MAX_LEVELS: usize = 8;

/// Levels to make.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct LodOptions {
    /// Write levels of detail too, each with this share of the triangles, as in 0.5,0.25,0.125:
    /// OUT.lod1.glb and so on, and OUT.tileset.json (3D Tiles 1.1) that names them all; for the
    /// targets godot, unity and unreal also OUT.lod.tscn, .cs or .py, with which the engine
    /// switches levels by distance
    #[cfg_attr(feature = "cli", arg(long, value_name = "SHARES", value_delimiter = ','))]
    #[schemars(inner(range(min = 0.0, max = 1.0)))]
    pub lod: Vec<f64>,
}

impl LodOptions {
    /// No levels.
    pub const DEFAULT: Self = Self { lod: Vec::new() };

    /// Checks that shares fall and lie between 0 and 1.
    pub fn validate(&self) -> Result<()> {
        let falls = self.lod.windows(2).all(|pair| pair[0] > pair[1]);
        if !falls || self.lod.iter().any(|share| !(*share > 0.0 && *share < 1.0)) {
            let value = self.lod.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
            return Err(Error::invalid(
                "lod",
                value,
                "shares between 0 and 1 that fall, as in 0.5,0.25,0.125",
            ));
        }
        if self.lod.len() > MAX_LEVELS {
            return Err(Error::invalid(
                "lod",
                self.lod.len(),
                format!("at most {MAX_LEVELS} levels"),
            ));
        }
        Ok(())
    }
}

/// The levels, finest first.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LodDetails {
    /// Ranking of the triangles.
    pub ordered_by: LodRanking,
    /// One entry per level.
    pub levels: Vec<LevelDetails>,
}

trisplat_scene::stage!(LodDetails, "lod");

/// Ranking of the triangles of levels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum LodRanking {
    /// By opacity times area: there were no cameras, or no triangles to rank.
    #[default]
    Size,
    /// By the change of the cameras' pictures without them.
    Importance,
}

/// One level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LevelDetails {
    /// Requested share of the triangles.
    pub share: f64,
    /// Triangles, without those of a backdrop.
    pub triangles: u64,
    /// Mean PSNR against some of the photos, dB; null without photos.
    pub psnr: Option<f64>,
    /// Side of a square as large as the median triangle, in units of the output.
    pub detail: f64,
}

/// The scene that levels are made from.
#[derive(Debug, Clone, Copy)]
pub struct LevelSource<'a> {
    /// All triangles, before the finest level is coloured and placed.
    pub mesh: &'a Mesh,
    /// Cameras whose pictures decide the importance of triangles; may be empty.
    pub cameras: &'a [Camera],
    /// Enlarges the remaining triangles to cover gaps.
    pub enlarge: bool,
    /// True if triangles are those of a soup, which are never connected.
    pub is_soup: bool,
}

/// A level after the stages that follow this one.
#[derive(Debug)]
pub struct FinishedLevel {
    /// The level as it is written.
    pub asset: Asset,
    /// Mean PSNR against some of the photos, dB, if there are any.
    pub psnr: Option<f64>,
}

/// Share of the stage's time for ranking; each level then takes an equal part of the rest.
const RANKING_PART: f64 = 0.2;
/// Share of a level's time before it is finished.
const MOVING_PART: f64 = 0.5;

/// Makes the levels of `source`, coarser and coarser, into `levels`, each finished by `finish`.
///
/// # Errors
///
/// Errors of `finish`.
pub fn lod(
    levels: &mut Vec<Asset>,
    source: &LevelSource<'_>,
    options: &LodOptions,
    mut finish: impl FnMut(Mesh, StageProgress<'_>) -> Result<FinishedLevel>,
    details: &mut LodDetails,
    progress: &mut StageProgress<'_>,
) -> Result<Outcome<()>> {
    if options.lod.is_empty() {
        return Ok(Outcome::Skipped("`lod` was not given"));
    }
    if !levels.is_empty() {
        return Ok(Outcome::Skipped("the scene has levels already"));
    }
    let Parts { connected, loose } =
        if source.is_soup { Parts::of_soup(source.mesh) } else { Parts::of(source.mesh) };
    let collapse = connected.as_ref().map(EdgeCollapse::new);
    let loose = LevelSource { mesh: &loose, ..*source };
    let fewest = options.lod.last().map_or(1, |share| faces_of_share(loose.mesh, *share));
    let mut decimation = Decimation::new(loose.mesh, source.cameras);
    let ranked = rank(&loose, &mut decimation, fewest, progress.part(0.0, RANKING_PART));
    if !source.cameras.is_empty() && loose.mesh.face_count() > 0 {
        details.ordered_by = LodRanking::Importance;
    }
    let start =
        |i: usize| RANKING_PART + (1.0 - RANKING_PART) * i as f64 / options.lod.len() as f64;
    for (i, &share) in options.lod.iter().enumerate() {
        let mut progress = progress.part(start(i), start(i + 1));
        let faces = &ranked[..faces_of_share(loose.mesh, share).min(ranked.len())];
        let soup = if faces.is_empty() {
            Mesh::default()
        } else {
            level(&loose, &mut decimation, faces, progress.part(0.0, MOVING_PART))
        };
        let level = match &collapse {
            Some(collapse) => {
                let faces = faces_of_share(source.mesh, share) - soup.face_count();
                let mut level = collapse.to(faces.max(1)).mesh;
                level.append(soup)?;
                level
            }
            None => soup,
        };
        let FinishedLevel { asset, psnr } = finish(level, progress.part(MOVING_PART, 1.0))?;
        let triangles = asset.scene_faces() as u64;
        let detail = asset.detail();
        details.levels.push(LevelDetails { share, triangles, psnr, detail });
        levels.push(asset);
    }
    Ok(Outcome::Changed(()))
}

/// All faces, ordered so that a level is the first n of them, for every n from `fewest` on. `[F]`
fn rank(
    source: &LevelSource<'_>,
    decimation: &mut Decimation<'_>,
    fewest: usize,
    mut progress: StageProgress<'_>,
) -> Vec<u32> {
    let LevelSource { mesh, cameras, .. } = *source;
    if cameras.is_empty() || mesh.face_count() == 0 {
        return decimate::rank_by_size(mesh);
    }
    let visible = visible_px(mesh, cameras, SAMPLES, progress.part(0.0, 0.3));
    let all: Vec<u32> = (0..mesh.face_count() as u32).collect();
    decimation.rank_by_importance(&visible, &all, fewest, progress.part(0.3, 1.0))
}

/// The loose triangles with only some of them, in their old order, enlarged to cover the gaps.
fn level(
    source: &LevelSource<'_>,
    decimation: &mut Decimation<'_>,
    faces: &[u32],
    progress: StageProgress<'_>,
) -> Mesh {
    let mut level = source.mesh.clone();
    match source.enlarge {
        true if source.cameras.is_empty() => decimate::enlarge(&mut level, faces),
        true => decimation.move_corners(faces, progress).apply(&mut level),
        false => {}
    }
    level.keep(faces);
    level
}
