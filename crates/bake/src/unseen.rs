//! Visibility culling: drops triangles that the solid rasteriser draws in no photo, or hardly.
//!
//! Triangles are ranked by the area they cover in all photos together, after everything in front of
//! them, in pixels. Triangles outside every picture are kept, because nothing hides them from other
//! views. Where triangles share edges, a part that is seen stays whole: a closed mesh stays closed.
//! With a budget of triangles, the visible ones are then ranked by importance (see `decimate`).

use crate::decimate::Decimation;
use crate::views::{self, SAMPLES, Views};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_raster::solid::{NO_FACE, SolidRasterizer};
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::ranges::{self, OptionNaming};
use trisplat_scene::report::{Outcome, StageProgress};
use trisplat_scene::{Error, Result, parallel};

/// Samples per pixel along each axis when only unseen triangles are dropped: a plain bake of our
/// own soup must be fast.
const MIN_SAMPLES: u32 = 1;
/// At least this share of a triangle's visible area must lie in unmasked pixels. Triangles at the
/// border of a mask lie in masked pixels for the most part, and without them holes open in other
/// views.
const MIN_UNMASKED_SHARE: f32 = 0.02;
/// The same for photos of an object without background: pixels beside it are empty, and
/// triangles mostly in them are shards.
const MIN_UNMASKED_SHARE_OF_OBJECT: f32 = 0.5;
/// Number of photos for the curve of error against triangles.
const CURVE_VIEWS: usize = 12;
/// Maximum reduction with `max_error`: about one triangle in this many stays.
const MAX_REDUCTION: usize = 64;
/// Progress of a decimation when visibility is known.
const DRAWING_PART: f64 = 0.1;
/// Progress of a decimation when corners begin to move.
const MOVING_PART: f64 = 0.3;
/// Halvings of the interval that contains the cut.
const CURVE_STEPS: usize = 9;

/// Options of removing triangles that photos do not show.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct UnseenOptions {
    /// Keep triangles that are hidden in every photo: fewer holes far from where the photos were
    /// taken
    pub keep_unseen: bool,
    /// Remove triangles whose visible area in all photos together is below this, px
    #[schemars(range(min = 0.0, max = 1e9))]
    pub min_seen_px: f64,
    /// Remove the least important triangles until the PSNR on the photos has fallen by this much,
    /// dB
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub max_error: Option<f64>,
    /// After visible triangles were removed, move corners of the others to cover the gaps
    pub enlarge: bool,
}

impl UnseenOptions {
    /// Half a pixel in all photos together cannot be distinguished from noise.
    pub const DEFAULT: Self =
        Self { keep_unseen: false, min_seen_px: 0.5, max_error: None, enlarge: true };
}

trisplat_scene::default!(UnseenOptions);

/// Measurements of visibility; empty without cameras.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct UnseenDetails {
    /// Triangles that no camera sees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seen_by_none: Option<u64>,
    /// Triangles among these that lie outside every picture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outside: Option<u64>,
    /// Triangles dropped because photos see them nearly only in masked pixels, or mostly beside an
    /// object without background.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub masked: Option<u64>,
    /// PSNR against the number of triangles, in the order tried; only with `max_error`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub curve: Option<Vec<CurvePoint>>,
    /// Moves of corners of triangles that stay; only when visible triangles were dropped and
    /// `enlarge` is on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub corners_moved: Option<u64>,
}

trisplat_scene::stage!(UnseenDetails, "unseen");

/// The score of the most important triangles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CurvePoint {
    /// Triangles kept, the most important ones.
    pub triangles: u64,
    /// Mean PSNR against some of the photos, dB.
    pub psnr: f64,
}

/// Limit on the faces that stay.
#[derive(Debug, Clone, Default)]
pub struct FaceLimit {
    /// Maximum number of faces, the most important ones; `None`: no limit.
    pub max_faces: Option<u64>,
    /// Faces exempt from removal, fewer than `max_faces`; empty: none. `[F]`
    pub protected: Vec<bool>,
    /// The connected part of each face: all of a part that is seen well enough is exempt too;
    /// empty: none. `[F]`
    pub parts: Vec<Option<u32>>,
}

/// Drops faces of `mesh` that `cameras` do not see (those of `views` if there are photos), and more
/// until `limit` is met.
///
/// # Errors
///
/// An option out of range, a photo that cannot be decoded, no triangle in any view.
pub fn unseen(
    mesh: &mut Mesh,
    cameras: &[Camera],
    views: Option<&mut Views>,
    options: &UnseenOptions,
    limit: &FaceLimit,
    details: &mut UnseenDetails,
    progress: &mut StageProgress<'_>,
) -> Result<Outcome<()>> {
    ranges::check(options, OptionNaming::Flag)?;
    ranges::check_finite("max_error", options.max_error)?;
    if let Some(db) = options.max_error
        && views.is_none()
    {
        return Err(Error::invalid("max_error", db, "`dataset`: error is measured on photos"));
    }
    let max_faces = limit
        .max_faces
        .map_or(usize::MAX, |count| usize::try_from(count).unwrap_or(usize::MAX).max(1));
    if let Some(why) = skip_reason(mesh, cameras, options, max_faces) {
        return Ok(Outcome::Skipped(why));
    }
    let is_limited = mesh.face_count() > max_faces;
    let samples = if views.is_some() || is_limited { SAMPLES } else { MIN_SAMPLES };
    let decimates = is_limited || options.max_error.is_some();
    let decides_at = if decimates { DRAWING_PART } else { 1.0 };
    let visible_area = visible_px(mesh, cameras, samples, progress.part(0.0, decides_at));
    let are_photos = views.as_ref().is_some_and(|views| !views.is_drawn());
    let ranking = rank(mesh, cameras, &visible_area, options, are_photos, details)?;
    let VisibilityRanking { mut ranked, visible, seen_enough, needed } = ranking;
    let protected = with_seen_parts(limit, &visible_area, options.min_seen_px);
    let [seen_enough, needed] = protected_first(&mut ranked, &protected, [seen_enough, needed]);
    let mut keep = needed.min(max_faces);
    let decimates = keep < seen_enough || options.max_error.is_some();
    let mut decimation = decimates.then(|| Decimation::new(mesh, cameras).protecting(&protected));
    if let Some(decimation) = &mut decimation {
        let fewest =
            if options.max_error.is_some() { visible / MAX_REDUCTION } else { keep }.max(1);
        let candidates = &mut ranked[..seen_enough];
        let progress = progress.part(DRAWING_PART, MOVING_PART);
        let best = decimation.rank_by_importance(&visible_area, candidates, fewest, progress);
        candidates.copy_from_slice(&best);
    }
    if let (Some(db), Some(views)) = (options.max_error, views) {
        keep = fewest_within(mesh, views, &ranked[..keep], db, details)?;
    }
    if keep == ranked.len() {
        return Ok(Outcome::Skipped("no triangle is hidden from every camera"));
    }
    let enlarging = decimation.filter(|_| options.enlarge);
    let moved =
        enlarging.map(|mut d| d.move_corners(&ranked[..keep], progress.part(MOVING_PART, 1.0)));
    if let Some(moved) = moved {
        moved.apply(mesh);
        details.corners_moved = Some(moved.moves);
    }
    mesh.keep(&ranked[..keep]);
    Ok(Outcome::Changed(()))
}

/// All faces in the order in which they stay.
struct VisibilityRanking {
    /// Faces, the most visible first. `[F]`
    ranked: Vec<u32>,
    /// Number of visible faces.
    visible: usize,
    /// Number of first faces that are seen well enough.
    seen_enough: usize,
    /// Number of first faces that stay without a limit.
    needed: usize,
}

/// Ranks the faces of `mesh` by their visible area.
///
/// # Errors
///
/// `are_photos`, and no face is in any of them.
fn rank(
    mesh: &Mesh,
    cameras: &[Camera],
    visible_area: &[f32],
    options: &UnseenOptions,
    are_photos: bool,
    details: &mut UnseenDetails,
) -> Result<VisibilityRanking> {
    let mut ranked = rank_by_visibility(mesh, visible_area);
    let visible = ranked.partition_point(|&f| visible_area[f as usize] > 0.0);
    if visible == 0 && are_photos {
        let wants =
            "photos of this scene: none of its triangles is in any view; was it moved or scaled?";
        let fault = "its cameras".to_owned();
        return Err(Error::ForeignPhotos { fault, wants: wants.to_owned() });
    }
    details.seen_by_none = Some((ranked.len() - visible) as u64);
    let outside = outside_first(mesh, cameras, &mut ranked[visible..]);
    details.outside = Some(outside as u64);
    // Faces that are seen well enough come first among the visible ones.
    let seen_enough = if options.keep_unseen {
        visible
    } else {
        ranked[..visible]
            .partition_point(|&f| f64::from(visible_area[f as usize]) >= options.min_seen_px)
            .max(1)
    };
    let needed =
        if options.keep_unseen || visible == 0 { ranked.len() } else { seen_enough + outside };
    if needed < ranked.len() {
        // Kept ones come before hardly seen ones.
        ranked[seen_enough..visible + outside].rotate_left(visible - seen_enough);
    }
    Ok(VisibilityRanking { ranked, visible, seen_enough, needed })
}

/// Drops triangles that photos see nearly only in masked pixels, where training never compared them
/// with anything, or mostly beside an object without background. Returns how many; `None` without
/// such masks, and with `keep_unseen`.
///
/// # Errors
///
/// A photo that cannot be decoded.
pub fn masked(
    mesh: &mut Mesh,
    views: Option<&mut Views>,
    options: &UnseenOptions,
    progress: &mut StageProgress<'_>,
) -> Result<Option<u64>> {
    let Some(views) = views.filter(|views| views.are_masked() && !options.keep_unseen) else {
        return Ok(None);
    };
    let shares = counted_share(mesh, views, progress)?;
    let min_share = if views.are_cut() { MIN_UNMASKED_SHARE_OF_OBJECT } else { MIN_UNMASKED_SHARE };
    let stays = |share: &Option<f32>| share.is_none_or(|share| share >= min_share);
    let kept: Vec<u32> =
        (0..).zip(&shares).filter(|(_, share)| stays(share)).map(|(face, _)| face).collect();
    // Masks that would remove everything are not masks of this scene.
    if kept.is_empty() {
        return Ok(Some(0));
    }
    let dropped = (mesh.face_count() - kept.len()) as u64;
    mesh.keep(&kept);
    Ok(Some(dropped))
}

/// The protected faces of `limit`, and every face of a part with at least `min_px` visible pixels.
/// `[F]`
fn with_seen_parts(limit: &FaceLimit, visible_area: &[f32], min_px: f64) -> Vec<bool> {
    let mut protected = limit.protected.clone();
    if limit.parts.is_empty() {
        return protected;
    }
    let mut area_of_part = vec![0.0; limit.parts.len()];
    for (part, area) in limit.parts.iter().zip(visible_area) {
        if let Some(part) = part {
            area_of_part[*part as usize] += f64::from(*area);
        }
    }
    let is_seen = |part: u32| {
        let area = area_of_part[part as usize];
        area > 0.0 && area >= min_px
    };
    protected.resize(limit.parts.len(), false);
    for (protected, part) in protected.iter_mut().zip(&limit.parts) {
        *protected |= part.is_some_and(is_seen);
    }
    protected
}

/// Puts the faces that are `protected` first, the order unchanged otherwise; returns how many faces
/// then precede each of `ends`, all protected ones among them.
fn protected_first<const N: usize>(
    ranked: &mut [u32],
    protected: &[bool],
    ends: [usize; N],
) -> [usize; N] {
    if protected.is_empty() {
        return ends;
    }
    let is_protected = |face: &u32| protected[*face as usize];
    let ends = ends.map(|end| end + ranked[end..].iter().filter(|face| is_protected(face)).count());
    ranked.sort_by_key(|face| !is_protected(face));
    ends
}

/// Puts `faces` outside every picture first, the order unchanged otherwise; returns how many.
fn outside_first(mesh: &Mesh, cameras: &[Camera], faces: &mut [u32]) -> usize {
    let is_outside = |at: usize| {
        let face = faces[at];
        let [a, b, c] = mesh.corners(face as usize);
        let points = [a, b, c, mesh.centroid(face as usize)];
        !cameras.iter().any(|camera| points.iter().any(|point| camera.is_in_frustum(*point)))
    };
    let outside: Vec<bool> = parallel::collect(faces.len(), 1, is_outside);
    let of = |which: bool| {
        faces.iter().zip(&outside).filter(move |(_, out)| **out == which).map(|(face, _)| *face)
    };
    let ordered: Vec<u32> = of(true).chain(of(false)).collect();
    faces.copy_from_slice(&ordered);
    outside.iter().filter(|out| **out).count()
}

/// Reason to skip the stage that needs no drawing. At most `max_faces` triangles may stay.
fn skip_reason(
    mesh: &Mesh,
    cameras: &[Camera],
    options: &UnseenOptions,
    max_faces: usize,
) -> Option<&'static str> {
    if cameras.is_empty() {
        return Some("it needs cameras: from photos (`dataset`), or stored in the soup");
    }
    let keeps_all =
        options.keep_unseen && options.max_error.is_none() && mesh.face_count() <= max_faces;
    keeps_all.then_some("`keep_unseen`")
}

/// All faces, sorted by visible area, largest first; ties go to the larger face. `[F]`
fn rank_by_visibility(mesh: &Mesh, visible_area: &[f32]) -> Vec<u32> {
    let area = |f: u32| mesh.area(f as usize);
    let mut ranked: Vec<u32> = (0..visible_area.len() as u32).collect();
    ranked.par_sort_unstable_by(|&a, &b| {
        let by_area = || area(b).total_cmp(&area(a));
        visible_area[b as usize]
            .total_cmp(&visible_area[a as usize])
            .then_with(by_area)
            .then(a.cmp(&b))
    });
    ranked
}

/// Number of `ranked` faces that must stay for a PSNR on the photos at most `db` below that of all.
fn fewest_within(
    mesh: &Mesh,
    views: &mut Views,
    ranked: &[u32],
    db: f64,
    details: &mut UnseenDetails,
) -> Result<usize> {
    let chosen = views.evenly_spaced(CURVE_VIEWS);
    let mut curve = Vec::new();
    let mut psnr = |keep: usize| -> Result<f64> {
        let mut part = mesh.clone();
        part.keep(&ranked[..keep]);
        let psnr = views.mean_psnr(&part, &chosen)?;
        curve.push(CurvePoint { triangles: keep as u64, psnr });
        Ok(psnr)
    };
    let best = psnr(ranked.len())?;
    let mut too_few = 0;
    let mut enough = ranked.len();
    for _ in 0..CURVE_STEPS {
        let middle = (too_few + enough) / 2;
        if middle == too_few || middle == 0 {
            break;
        }
        if psnr(middle)? >= best - db { enough = middle } else { too_few = middle }
    }
    details.curve = Some(curve);
    Ok(enough)
}

// ---- Visible area of each face ------------------------------------------------------------------

/// The visible area of each face in all cameras together, px. `[F]`
///
/// `samples_along`: samples per pixel along each axis.
pub fn visible_px(
    mesh: &Mesh,
    cameras: &[Camera],
    samples_along: u32,
    mut progress: StageProgress<'_>,
) -> Vec<f32> {
    let options = views::drawing(cameras, mesh, samples_along);
    let mut solid = SolidRasterizer::new();
    let mut samples = vec![0u64; mesh.face_count()];
    for (done, camera) in cameras.iter().enumerate() {
        progress.set(done, cameras.len());
        for &face in &solid.visibility(mesh, camera, &options).face {
            if face != NO_FACE {
                samples[face as usize] += 1;
            }
        }
    }
    let per_sample = 1.0 / f64::from(samples_along * samples_along);
    samples.into_iter().map(|n| (n as f64 * per_sample) as f32).collect()
}

/// The share of each face's visible area in unmasked pixels; `None` for faces that no photo sees.
/// `[F]`
///
/// # Errors
///
/// A photo that cannot be decoded.
fn counted_share(
    mesh: &Mesh,
    views: &mut Views,
    progress: &mut StageProgress<'_>,
) -> Result<Vec<Option<f32>>> {
    let options = views::drawing(views.cameras(), mesh, SAMPLES);
    let mut solid = SolidRasterizer::new();
    // Samples, and the weights of their pixels.
    let mut seen_of = vec![(0u64, 0u64); mesh.face_count()];
    views.prefetch(&(0..views.len()).collect::<Vec<_>>());
    for view in 0..views.len() {
        progress.set(view, views.len());
        let photo = views.photo(view)?;
        let seen = solid.visibility(mesh, views.camera(view), &options);
        for (sample, &face) in (0u32..).zip(&seen.face).filter(|(_, face)| **face != NO_FACE) {
            let x = sample % seen.size.x / SAMPLES;
            let y = sample / seen.size.x / SAMPLES;
            let pixel = (y * photo.size.x + x) as usize;
            let (samples, weights) = &mut seen_of[face as usize];
            *samples += 1;
            *weights += photo.alpha.as_ref().map_or(255, |alpha| u64::from(alpha[pixel]));
        }
    }
    let share = |(samples, weights): (u64, u64)| {
        (samples > 0).then(|| (weights as f64 / (255.0 * samples as f64)) as f32)
    };
    Ok(seen_of.into_iter().map(share).collect())
}
