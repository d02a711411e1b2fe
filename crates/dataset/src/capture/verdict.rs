//! Judges a capture by poses, reprojection error, gaps, blur and exposure, with advice.

use super::collect::TakenPhotos;
use super::log::tell;
use super::poses::ModelDetails;
use super::video::{Grey, sharpness};
use crate::colmap::{TrackedPhoto, Tracks};
use crate::exposure::{Light, Strengths, compared_size, differ, solve};
use glam::{UVec2, Vec2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::{HashMap, HashSet};
use std::path::Path;
use trisplat_scene::image::RgbImage;
use trisplat_scene::report::{StageEvent, StageObserver, counted};
use trisplat_scene::{Limits, Result, parallel};

/// Longer side of analysed pictures, px.
const LOOKED_AT: u32 = 640;
/// Maximum number of names in a list of the report.
const LISTED: usize = 20;
/// A photo with at most this number of points may have a wrong pose.
const FEW_POINTS: usize = 50;
/// Consecutive frames that share at most this number of points count as a gap.
const FEW_SHARED: usize = 20;
/// A photo with less than this share of its neighbours' fine detail counts as blurred.
const BLURRED: f32 = 0.5;
/// Neighbours on each side for the sharpness comparison.
const BESIDE: usize = 3;
/// Thresholds between good, fair and poor: share of photos with poses, ...
const REGISTERED: [f64; 2] = [0.95, 0.6];
/// ... and reprojection error, px.
const ERROR_PX: [f64; 2] = [1.0, 2.0];
/// Spread of exposure beyond which a locked exposure is advised, as a logarithm: a fifth of a stop.
const MAX_SPREAD: f32 = 0.15;
/// Minimum photos for a spread.
const MIN_COMPARED: u64 = 4;
/// Fewer points for each photo tie no scene together.
const MIN_TIES: u64 = 8;
/// Verdict on a capture.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct VerdictDetails {
    /// Overall grade.
    pub verdict: CaptureVerdict,
    /// Number of photos.
    pub photos: u64,
    /// Photos with a pose.
    pub registered: u64,
    /// Number of 3D points.
    pub points: u64,
    /// Mean number of photos per point.
    pub track_length: f64,
    /// Mean reprojection error, px.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error_px: Option<f64>,
    /// Standard deviation of the photos' exposure, as a logarithm, between photos that show the
    /// same points.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure: Option<f32>,
    /// Photos that are blurred compared with their neighbours.
    pub blurred: Vec<String>,
    /// Photos whose pose rests on few points.
    pub weak: Vec<String>,
    /// Places where photos are missing.
    pub gaps: Vec<Gap>,
    /// Advice, one sentence each.
    pub advice: Vec<String>,
}

trisplat_scene::stage!(VerdictDetails, "verdict");

impl VerdictDetails {
    /// Reason why no training helps: too few points connect the photos.
    pub fn hopeless(&self) -> Option<String> {
        let ties = || {
            format!("{} tie {}", counted(self.points, "point"), counted(self.registered, "photo"))
        };
        (self.points < MIN_TIES * self.registered).then(ties)
    }
}

/// Grade of a capture.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "lowercase")]
pub enum CaptureVerdict {
    /// No problem found.
    #[default]
    Good,
    /// Usable; see the advice.
    Fair,
    /// Should be taken again.
    Poor,
}

impl CaptureVerdict {
    /// Name of the grade.
    pub fn word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Fair => "fair",
            Self::Poor => "poor",
        }
    }
}

/// A gap: photos without a pose between two with one.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Gap {
    /// Last photo with a pose before the gap.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub after: Option<String>,
    /// First photo with a pose after the gap.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub before: Option<String>,
    /// Number of photos without a pose between them.
    pub lost: u64,
    /// Name of one of them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub example: Option<String>,
}

/// Measurements of one photo.
struct Looked {
    sharpness: f32,
    lights: Vec<Light>,
}

/// Judges the photos in `images` with the tracks of their model.
pub(super) fn judge(
    images: &Path,
    stored: &TakenPhotos,
    tracks: &Tracks,
    model: &ModelDetails,
    observer: StageObserver<'_>,
) -> Result<VerdictDetails> {
    let by_name: HashMap<&str, usize> =
        tracks.photos.iter().enumerate().map(|(i, photo)| (photo.name.as_str(), i)).collect();
    let mut looked = Vec::new();
    for chunk in stored.photos.chunks(8) {
        tell(observer, StageEvent::Progressed(looked.len() as f64 / stored.photos.len() as f64))?;
        let look_at =
            |name: &str| look(&images.join(name), by_name.get(name).map(|&i| &tracks.photos[i]));
        let part = parallel::map(chunk, |_, photo| look_at(&photo.name));
        looked.extend(part.into_iter().collect::<Result<Vec<Looked>>>()?);
    }
    let names: Vec<&str> = stored.photos.iter().map(|photo| photo.name.as_str()).collect();
    let sharpness: Vec<f32> = looked.iter().map(|looked| looked.sharpness).collect();
    let lights: Vec<Vec<Light>> = looked.into_iter().map(|looked| looked.lights).collect();
    let seen: usize = tracks.photos.iter().map(|photo| photo.seen.len()).sum();
    let weak = tracks.photos.iter().filter(|photo| photo.seen.len() <= FEW_POINTS);
    let mut details = VerdictDetails {
        photos: names.len() as u64,
        registered: tracks.photos.len() as u64,
        points: tracks.points as u64,
        track_length: seen as f64 / tracks.points.max(1) as f64,
        error_px: tracks.error_px,
        exposure: spread(&lights, &names, tracks),
        blurred: listed(blurred(&sharpness).into_iter().map(|i| names[i])),
        weak: listed(weak.map(|photo| photo.name.as_str())),
        gaps: gaps(stored, tracks, &by_name),
        ..VerdictDetails::default()
    };
    details.advice = advice(&details, model);
    details.verdict = word(&details);
    Ok(details)
}

fn listed<'a>(names: impl Iterator<Item = &'a str>) -> Vec<String> {
    names.take(LISTED).map(str::to_owned).collect()
}

/// Standard deviation of the photos' exposure, as a logarithm; `None` where too few can be
/// compared.
fn spread(lights: &[Vec<Light>], names: &[&str], tracks: &Tracks) -> Option<f32> {
    let sizes: HashMap<&str, UVec2> =
        tracks.photos.iter().map(|photo| (photo.name.as_str(), photo.size)).collect();
    let sizes: Vec<UVec2> =
        names.iter().map(|name| sizes.get(name).copied().unwrap_or(UVec2::ONE)).collect();
    let verdict = solve(lights, &sizes).verdict(Strengths::NONE);
    let known = names.len() as u64 - verdict.unknown;
    (known >= MIN_COMPARED).then_some(verdict.exposure)
}

/// Measures one photo; `tracked` is its entry in the model.
fn look(path: &Path, tracked: Option<&TrackedPhoto>) -> Result<Looked> {
    let limits = &Limits::DEFAULT;
    let full = RgbImage::size_of(path, limits)?;
    let ratio = (f64::from(LOOKED_AT) / f64::from(full.max_element())).min(1.0);
    let least = (full.as_dvec2() * ratio).round().as_uvec2().max(UVec2::ONE);
    let small = RgbImage::load_reduced(path, least, limits)?.0.downscaled(least);
    let luma =
        |[r, g, b]: [u8; 3]| (u32::from(r) * 54 + u32::from(g) * 183 + u32::from(b) * 19) >> 8;
    let codes: Vec<u8> = small.rgb.iter().map(|p| luma(*p).min(255) as u8).collect();
    let grey = Grey { size: small.size, codes };
    let share =
        |photo: &TrackedPhoto, (point, at): &(u32, Vec2)| (*point, *at / photo.size.as_vec2());
    let points = |photo: &TrackedPhoto| photo.seen.iter().map(|seen| share(photo, seen)).collect();
    let points: Vec<(u32, Vec2)> = tracked.map_or(Vec::new(), points);
    let lights = Light::at_points(&small.downscaled(compared_size(full)), &points);
    Ok(Looked { sharpness: sharpness(&grey), lights })
}

/// Photos with much less fine detail than their neighbours.
fn blurred(sharpness: &[f32]) -> Vec<usize> {
    let is_blurred = |&i: &usize| {
        let from = i.saturating_sub(BESIDE);
        let to = (i + BESIDE + 1).min(sharpness.len());
        let mut beside: Vec<f32> = (from..to).filter(|&k| k != i).map(|k| sharpness[k]).collect();
        beside.sort_by(f32::total_cmp);
        beside.get(beside.len() / 2).is_some_and(|middle| sharpness[i] < BLURRED * middle)
    };
    (0..sharpness.len()).filter(is_blurred).collect()
}

/// Runs of photos without a pose, and consecutive frames that share too few points.
fn gaps(stored: &TakenPhotos, tracks: &Tracks, by_name: &HashMap<&str, usize>) -> Vec<Gap> {
    let mut gaps = Vec::new();
    let mut last: Option<usize> = None;
    let mut lost: Vec<usize> = Vec::new();
    let name = |i: usize| stored.photos[i].name.clone();
    let gap = |last: Option<usize>, next: Option<usize>, lost: &[usize]| Gap {
        after: last.map(name),
        before: next.map(name),
        lost: lost.len() as u64,
        example: lost.get(lost.len() / 2).map(|&i| name(i)),
    };
    for i in 0..stored.photos.len() {
        let Some(&here) = by_name.get(stored.photos[i].name.as_str()) else {
            lost.push(i);
            continue;
        };
        let loose = last.is_some_and(|last| {
            let before = by_name.get(stored.photos[last].name.as_str());
            let frames =
                stored.photos[i].frame && stored.photos[last].source == stored.photos[i].source;
            frames
                && before.is_some_and(|&before| {
                    shared(&tracks.photos[before], &tracks.photos[here]) < FEW_SHARED
                })
        });
        if !lost.is_empty() || loose {
            gaps.push(gap(last, Some(i), &lost));
            lost.clear();
        }
        last = Some(i);
    }
    if !lost.is_empty() {
        gaps.push(gap(last, None, &lost));
    }
    // Name only the largest.
    gaps.sort_by_key(|gap| std::cmp::Reverse(gap.lost));
    gaps.truncate(LISTED);
    gaps
}

fn shared(a: &TrackedPhoto, b: &TrackedPhoto) -> usize {
    let points: HashSet<u32> = a.seen.iter().map(|(point, _)| *point).collect();
    b.seen.iter().filter(|(point, _)| points.contains(point)).count()
}

fn word(details: &VerdictDetails) -> CaptureVerdict {
    let share = details.registered as f64 / details.photos.max(1) as f64;
    let error = details.error_px.unwrap_or(0.0);
    let many_blurred = 10 * details.blurred.len() as u64 > details.photos;
    if share < REGISTERED[1] || error > ERROR_PX[1] || details.hopeless().is_some() {
        CaptureVerdict::Poor
    } else if share < REGISTERED[0]
        || error > ERROR_PX[0]
        || many_blurred
        || !details.advice.is_empty()
    {
        CaptureVerdict::Fair
    } else {
        CaptureVerdict::Good
    }
}

fn advice(details: &VerdictDetails, model: &ModelDetails) -> Vec<String> {
    let overlap = |ties| format!("{ties}: take photos that overlap by half or more");
    let mut advice: Vec<String> = details.hopeless().map(overlap).into_iter().collect();
    for gap in details.gaps.iter().take(3) {
        let place = match (&gap.after, &gap.before) {
            (Some(after), Some(before)) => format!("between {after} and {before}"),
            (Some(after), None) => format!("after {after}"),
            (None, Some(before)) => format!("before {before}"),
            (None, None) => continue,
        };
        let is_blurred =
            |example: &String| details.blurred.iter().any(|blurred| blurred == example);
        let blurred = gap.example.as_ref().filter(|example| is_blurred(example));
        let why = blurred.map_or(String::new(), |name| format!(" ({name} is blurred)"));
        advice.push(match gap.lost {
            0 => format!("take more photos {place}: they hardly overlap"),
            1 => format!("take more photos {place}: one there has no pose{why}"),
            lost => format!("take more photos {place}: {lost} there have no pose{why}"),
        });
    }
    if model.models > 1 {
        let counts: Vec<String> = model.parts.iter().map(u64::to_string).collect();
        let sizes = match &counts[..] {
            [] => String::new(),
            [only] => format!(" ({only} photos)"),
            [others @ .., last] => format!(" ({} and {last} photos)", others.join(", ")),
        };
        advice.push(format!(
            "the photos show {} places that share nothing{sizes}, and only the largest is used: take photos that connect them, or make a \
             scene of each",
            model.models
        ));
    }
    if model.straight {
        advice.push(
            "the distortion of the lens that was found first folds over inside the photos: the poses are those of one focal length \
             without distortion; photos from other distances, with more around the subject, show the lens"
                .into(),
        );
    }
    let mut of_photos = |names: &[String], [one, several]: [&str; 2], what: &str, remedy: &str| {
        let named = names.iter().take(3).cloned().collect::<Vec<_>>().join(", ");
        match names.len() {
            0 => {}
            1 => advice.push(format!("1 photo {one} {what} ({named}): {remedy}")),
            count => advice.push(format!("{count} photos {several} {what} ({named}): {remedy}")),
        }
    };
    of_photos(
        &details.weak,
        ["holds", "hold"],
        "few points",
        "more overlap there, or more texture",
    );
    let remedy = "more light, slower steps, or leave them out";
    of_photos(&details.blurred, ["is", "are"], "blurred beside the others", remedy);
    if let Some(spread) = details.exposure.filter(|spread| *spread > MAX_SPREAD) {
        advice.push(format!("{}: lock the exposure of the camera", differ(spread)));
    }
    if let Some(error) = details.error_px.filter(|error| *error > ERROR_PX[0]) {
        advice.push(format!(
            "points are {error:.2} px from where they were seen: a lens that zooms or focuses, video stabilisation, or something that moved"
        ));
    }
    advice
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::collect::TakenPhoto;

    fn stored(count: usize) -> TakenPhotos {
        let photo = |i: usize| TakenPhoto {
            name: format!("{i}.jpg"),
            frame: true,
            ..TakenPhoto::default()
        };
        TakenPhotos { photos: (0..count).map(photo).collect(), ..TakenPhotos::default() }
    }

    /// Tracks in which photo `i` shows the points `points(i)`.
    fn model(photos: &[usize], points: impl Fn(usize) -> std::ops::Range<u32>) -> Tracks {
        let photo = |&i: &usize| TrackedPhoto {
            name: format!("{i}.jpg"),
            size: UVec2::splat(100),
            seen: points(i).map(|p| (p, Vec2::ZERO)).collect(),
        };
        Tracks { photos: photos.iter().map(photo).collect(), points: 1000, error_px: Some(0.5) }
    }

    #[test]
    fn photos_without_poses_are_gaps_between_those_that_have_some() {
        let tracks = model(&[1, 2, 6, 7], |_| 0..100);
        let by_name = tracks.photos.iter().enumerate().map(|(i, p)| (p.name.as_str(), i)).collect();
        let gaps = gaps(&stored(9), &tracks, &by_name);
        let said: Vec<_> =
            gaps.iter().map(|g| (g.after.as_deref(), g.before.as_deref(), g.lost)).collect();
        assert_eq!(
            said,
            [(Some("2.jpg"), Some("6.jpg"), 3), (None, Some("1.jpg"), 1), (Some("7.jpg"), None, 1)]
        );
        assert_eq!(gaps[0].example.as_deref(), Some("4.jpg"));
        let details = VerdictDetails {
            gaps,
            photos: 9,
            registered: 4,
            points: 1000,
            ..VerdictDetails::default()
        };
        let advice = advice(&details, &ModelDetails::default());
        assert!(advice[0].contains("between 2.jpg and 6.jpg: 3 there"), "{advice:?}");
        assert_eq!(word(&details), CaptureVerdict::Poor);
    }

    #[test]
    fn photos_of_two_places_and_a_blurred_one_are_named() {
        let gap = Gap { lost: 1, example: Some("2.jpg".into()), ..Gap::default() };
        let details = VerdictDetails {
            gaps: vec![Gap { after: Some("1.jpg".into()), before: Some("3.jpg".into()), ..gap }],
            blurred: vec!["2.jpg".into()],
            points: 1000,
            ..VerdictDetails::default()
        };
        let model = ModelDetails { models: 3, parts: vec![12, 8, 4], ..ModelDetails::default() };
        let advice = advice(&details, &model).join("; ");
        let places = "the photos show 3 places that share nothing (12, 8 and 4 photos)";
        assert!(advice.contains(places), "{advice}");
        assert!(advice.contains("one there has no pose (2.jpg is blurred)"), "{advice}");
    }

    #[test]
    fn frames_that_hardly_overlap_are_a_gap() {
        let all: Vec<usize> = (0..6).collect();
        let tracks = model(&all, |i| if i < 3 { 0..100 } else { 90..200 });
        let by_name = tracks.photos.iter().enumerate().map(|(i, p)| (p.name.as_str(), i)).collect();
        let gaps = gaps(&stored(6), &tracks, &by_name);
        assert_eq!(gaps.len(), 1);
        assert_eq!((gaps[0].after.as_deref(), gaps[0].lost), (Some("2.jpg"), 0));
    }

    #[test]
    fn a_capture_that_few_points_tie_is_poor() {
        let of = |points| VerdictDetails {
            points,
            photos: 5,
            registered: 5,
            ..VerdictDetails::default()
        };
        assert_eq!(of(25).hopeless().as_deref(), Some("25 points tie 5 photos"));
        let advice = advice(&of(25), &ModelDetails::default());
        assert_eq!(advice, ["25 points tie 5 photos: take photos that overlap by half or more"]);
        assert_eq!((word(&of(25)), word(&of(400))), (CaptureVerdict::Poor, CaptureVerdict::Good));
        assert_eq!(of(40).hopeless(), None);
    }

    #[test]
    fn one_weak_photo_holds_and_two_hold() {
        let said = |weak: usize| {
            let weak = (0..weak).map(|i| format!("{i}.jpg")).collect();
            let details = VerdictDetails { weak, ..VerdictDetails::default() };
            advice(&details, &ModelDetails::default()).concat()
        };
        assert!(said(1).starts_with("1 photo holds few points (0.jpg): "), "{}", said(1));
        assert!(said(2).starts_with("2 photos hold few points (0.jpg, 1.jpg): "), "{}", said(2));
        assert_eq!(said(0), "");
    }

    #[test]
    fn one_blurred_photo_is_and_two_are() {
        let said = |blurred: usize| {
            let blurred = (0..blurred).map(|i| format!("{i}.jpg")).collect();
            let details = VerdictDetails { blurred, ..VerdictDetails::default() };
            advice(&details, &ModelDetails::default()).concat()
        };
        assert!(said(1).starts_with("1 photo is blurred"), "{}", said(1));
        assert!(said(2).starts_with("2 photos are blurred"), "{}", said(2));
    }

    #[test]
    fn blur_is_less_detail_than_the_neighbours_have() {
        assert_eq!(blurred(&[1.0, 1.1, 0.3, 0.9, 1.0]), [2]);
        assert!(
            blurred(&[1.0, 0.8, 0.7, 0.6, 0.5]).is_empty(),
            "what falls slowly is another subject"
        );
        assert!(blurred(&[1.0]).is_empty() && blurred(&[]).is_empty());
    }
}
