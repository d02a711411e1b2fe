//! Drops the triangles that no photo needs: those that the solid rasteriser shows in no view.
//!
//! What a triangle is worth is the area it covers in all photos together, after everything in front of it:
//! the integral of its visibility, in pixels. A triangle behind others is worth nothing to an engine.

use super::Details;
use super::thin;
use super::views::{self, Views};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::math::metric;
use crate::mesh::Mesh;
use crate::raster::solid::{NO_FACE, Solid, SolidRasterOptions};
use crate::report::Outcome;
use rayon::prelude::*;
use serde_json::json;

/// Samples a pixel along each axis when visibility is counted to choose by it.
pub const SAMPLES: u32 = 2;
/// The same when only what nobody sees goes: a plain bake of our own soup must not take long.
const SAMPLES_AT_LEAST: u32 = 1;
/// Photos that the curve of error against triangles is measured on.
const CURVE_VIEWS: usize = 12;
/// With `--max-error` at least one triangle in so many stays, about.
const FEWEST: usize = 64;
/// Halvings of the interval in which the cut lies.
const CURVE_STEPS: usize = 9;

/// Which triangles the photos need.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct UnseenOptions {
    /// Keep triangles that no photo sees: fewer holes far from where the photos were taken
    #[cfg_attr(feature = "cli", arg(long))]
    pub keep_unseen: bool,
    /// Drop triangles that show less than this in all photos together, px
    #[cfg_attr(feature = "cli", arg(long, default_value_t = UnseenOptions::DEFAULT.min_seen_px, value_name = "PX"))]
    #[schemars(range(min = 0.0))]
    pub min_seen_px: f64,
    /// Drop the triangles least seen for as long as the photos are met at most this much worse, dB
    #[cfg_attr(feature = "cli", arg(long, value_name = "DB"))]
    #[schemars(range(min = 0.0))]
    pub max_error: Option<f64>,
    /// With fewer triangles than are seen: move corners of those that stay where that hides what is missing
    #[cfg_attr(feature = "cli", arg(long, default_value_t = UnseenOptions::DEFAULT.enlarge, num_args = 0..=1, require_equals = true,
          default_missing_value = "true", action = clap::ArgAction::Set, value_name = "BOOL"))]
    pub enlarge: bool,
}

impl UnseenOptions {
    /// Half a pixel in all photos together cannot be told from noise.
    pub const DEFAULT: Self = Self { keep_unseen: false, min_seen_px: 0.5, max_error: None, enlarge: true };
}

impl Default for UnseenOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Drops what `cameras`, those of `views` if there are photos, do not see of `mesh`; at most `max_triangles` stay,
/// those seen most.
///
/// Errors: an option out of range, a photo that cannot be decoded, no triangle in any view.
pub fn unseen(
    mesh: &mut Mesh,
    cameras: &[Camera],
    views: Option<&mut Views>,
    options: &UnseenOptions,
    max_triangles: Option<u64>,
    details: &mut Details,
) -> Result<Outcome<()>> {
    check(options)?;
    if let (None, Some(db)) = (&views, options.max_error) {
        return Err(Error::invalid("--max-error", db, "--dataset: error is measured on photos"));
    }
    if cameras.is_empty() {
        return Ok(Outcome::Unneeded("it needs cameras: of photos (--dataset), or in a soup we trained"));
    }
    let most = max_triangles.map_or(usize::MAX, |most| usize::try_from(most).unwrap_or(usize::MAX).max(1));
    if options.keep_unseen && options.max_error.is_none() && mesh.face_count() <= most {
        return Ok(Outcome::Unneeded("--keep-unseen"));
    }
    let chooses = views.is_some() || mesh.face_count() > most;
    let seen = seen_px(mesh, cameras, if chooses { SAMPLES } else { SAMPLES_AT_LEAST });
    let mut ranked = rank(mesh, &seen);
    let visible = ranked.partition_point(|&f| seen[f as usize] > 0.0);
    if visible == 0 && views.is_some() {
        let wants = "photos of this scene: none of its triangles is in any view; was it moved or scaled?";
        return Err(Error::invalid("--dataset", "its cameras", wants));
    }
    let needed = match options.keep_unseen || visible == 0 {
        true => ranked.len(),
        false => ranked.partition_point(|&f| f64::from(seen[f as usize]) >= options.min_seen_px).max(1),
    };
    details.insert("seen_by_none".into(), (ranked.len() - visible).into());
    let mut keep = needed.min(most);
    let thins = keep < needed.min(visible) || options.max_error.is_some();
    if thins {
        let fewest = if options.max_error.is_some() { visible / FEWEST } else { keep };
        let seen_at_all = needed.min(visible);
        let best = thin::order(mesh, cameras, &seen, &ranked[..seen_at_all], fewest.max(1));
        ranked[..seen_at_all].copy_from_slice(&best);
    }
    if let (Some(db), Some(views)) = (options.max_error, views) {
        keep = cut(mesh, views, &ranked[..keep], db, details)?;
    }
    if keep == ranked.len() {
        return Ok(Outcome::Unneeded("every triangle is seen"));
    }
    if thins && options.enlarge {
        details.insert("corners_moved".into(), thin::grow(mesh, cameras, &ranked[..keep]).into());
    }
    mesh.keep(&ranked[..keep]);
    Ok(Outcome::Changed(()))
}

/// All faces, those seen most first; among those seen equally little the larger first. `[F]`
fn rank(mesh: &Mesh, seen: &[f32]) -> Vec<u32> {
    let area = |f: u32| mesh.area(f as usize);
    let mut ranked: Vec<u32> = (0..seen.len() as u32).collect();
    ranked.par_sort_unstable_by(|&a, &b| {
        let by_area = || area(b).total_cmp(&area(a));
        seen[b as usize].total_cmp(&seen[a as usize]).then_with(by_area).then(a.cmp(&b))
    });
    ranked
}

fn check(options: &UnseenOptions) -> Result<()> {
    for (option, value) in [("--min-seen-px", Some(options.min_seen_px)), ("--max-error", options.max_error)]
    {
        if let Some(value) = value.filter(|v| !(*v >= 0.0 && v.is_finite())) {
            return Err(Error::invalid(option, value, "0 or more"));
        }
    }
    Ok(())
}

/// The area of each face that all cameras together see, px. `[F]`
pub fn seen_px(mesh: &Mesh, cameras: &[Camera], samples_along: u32) -> Vec<f32> {
    let options = views::drawing(cameras, mesh, samples_along);
    let mut solid = Solid::new();
    let mut samples = vec![0u64; mesh.face_count()];
    for camera in cameras {
        for &face in &solid.visibility(mesh, camera, &options).face {
            if face != NO_FACE {
                samples[face as usize] += 1;
            }
        }
    }
    let per_sample = 1.0 / f64::from(samples_along * samples_along);
    samples.into_iter().map(|n| (n as f64 * per_sample) as f32).collect()
}

/// How many of `ranked` must stay so that the photos are met at most `db` worse than by all of them.
fn cut(mesh: &Mesh, views: &mut Views, ranked: &[u32], db: f64, details: &mut Details) -> Result<usize> {
    let judges = views.spread(CURVE_VIEWS);
    let mut curve = Vec::new();
    let mut psnr = |keep: usize| -> Result<f64> {
        let mut part = mesh.clone();
        part.keep(&ranked[..keep]);
        let psnr = mean_psnr(&part, views, &judges)?;
        curve.push(json!({ "triangles": keep, "psnr": psnr }));
        Ok(psnr)
    };
    let best = psnr(ranked.len())?;
    let (mut too_few, mut enough) = (0, ranked.len());
    for _ in 0..CURVE_STEPS {
        let middle = (too_few + enough) / 2;
        if middle == too_few || middle == 0 {
            break;
        }
        if psnr(middle)? >= best - db { enough = middle } else { too_few = middle }
    }
    details.insert("curve".into(), curve.into());
    Ok(enough)
}

/// How well a mesh meets some of the photos, dB.
pub(super) fn mean_psnr(mesh: &Mesh, views: &mut Views, judges: &[usize]) -> Result<f64> {
    let options: SolidRasterOptions = views.drawing(mesh, SAMPLES);
    let mut solid = Solid::new();
    let mut sum = 0.0;
    views.expect(judges);
    for &view in judges {
        let photo = views.photo(view)?;
        let drawn = solid.render(mesh, views.camera(view), &options);
        sum += metric::psnr(&photo.rgb, &drawn.rgb, photo.alpha.as_deref());
    }
    Ok(sum / judges.len().max(1) as f64)
}
