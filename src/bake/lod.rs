//! Levels of detail: the same scene with fewer triangles, for an engine to draw where it is small on the screen.
//!
//! Triangles are ordered once, by what would be missed of them, so that the triangles of a level are also those of
//! every finer one. In each level they are then enlarged until they cover what those that are gone had covered, and
//! take their colours from the photos anew if there are any. A level is finished like the scene itself.

use super::options::BakeOptions;
use super::unseen::{self, mean_psnr};
use super::views::Views;
use super::{Details, package, paint, thin};
use crate::asset::{Asset, Placement, Provenance};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::mesh::Mesh;
use crate::report::{Outcome, Report};
use serde_json::json;

/// Photos that a level is held against.
const JUDGES: usize = 12;
/// Most levels beside the scene itself.
const MOST_LEVELS: usize = 8;

/// Which levels are made.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct LodOptions {
    /// Write levels of detail too, each with this share of the triangles, as in 0.5,0.25,0.125: OUT.lod1.glb and so
    /// on, and OUT.tileset.json (3D Tiles 1.1) that names them all
    #[cfg_attr(feature = "cli", arg(long, value_name = "SHARES", value_delimiter = ','))]
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
                "--lod",
                value,
                "shares between 0 and 1 that fall, as in 0.5,0.25,0.125",
            ));
        }
        if self.lod.len() > MOST_LEVELS {
            return Err(Error::invalid("--lod", self.lod.len(), format!("at most {MOST_LEVELS} levels")));
        }
        Ok(())
    }
}

/// Makes the levels of `mesh`, coarser and coarser, into `levels`. `provenance` is that of the mesh, `step` where the
/// scene itself was moved.
///
/// Errors: those of the stages that a level goes through.
pub fn lod(
    levels: &mut Vec<Asset>,
    mesh: &Mesh,
    cameras: &[Camera],
    mut views: Option<&mut Views>,
    (provenance, mut step): (&Provenance, Option<Placement>),
    options: &BakeOptions,
    details: &mut Details,
) -> Result<Outcome<()>> {
    if options.lod.lod.is_empty() {
        return Ok(Outcome::Unneeded("--lod was not given"));
    }
    let count = |share: f64| ((mesh.face_count() as f64 * share) as usize).max(1);
    let fewest = options.lod.lod.last().map_or(1, |share| count(*share));
    let order = match cameras.is_empty() {
        true => thin::by_size(mesh),
        false => {
            let seen = unseen::seen_px(mesh, cameras, unseen::SAMPLES);
            let ranked: Vec<u32> = (0..mesh.face_count() as u32).collect();
            thin::order(mesh, cameras, &seen, &ranked, fewest)
        }
    };
    details.insert("ordered_by".into(), if cameras.is_empty() { "size" } else { "sight" }.into());
    let mut told = Vec::new();
    for share in &options.lod.lod {
        let level = level(mesh, &order[..count(*share)], cameras, options.unseen.enlarge);
        let mut quiet = Report::default();
        let level = paint(level, views.as_deref_mut(), options, &mut quiet, &mut ())?;
        let psnr = match views.as_deref_mut().filter(|v| !v.is_empty()) {
            Some(views) => Some(mean_psnr(&level, views, &views.spread(JUDGES))?),
            None => None,
        };
        let asset = package(level, provenance.clone(), &mut step, options, &mut quiet, &mut ())?;
        told.push(json!({
            "share": share, "triangles": asset.mesh.face_count(), "psnr": psnr, "detail": asset.mesh.detail(),
        }));
        levels.push(asset);
    }
    details.insert("levels".into(), told.into());
    Ok(Outcome::Changed(()))
}

/// `mesh` with only some of its faces, in their old order, enlarged to cover for the others.
fn level(mesh: &Mesh, faces: &[u32], cameras: &[Camera], enlarge: bool) -> Mesh {
    let mut level = mesh.clone();
    match enlarge {
        true if cameras.is_empty() => thin::cover(&mut level, faces),
        true => _ = thin::grow(&mut level, cameras, faces),
        false => {}
    }
    level.keep(faces);
    level
}
