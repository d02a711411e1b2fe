//! The rows of the stage table for the steps of a capture.

use super::counts::many;
use indicatif::HumanCount;
use trisplat_dataset::capture::{
    FeaturesDetails, MatchesDetails, ModelDetails, PhotosDetails, VerdictDetails,
};
use trisplat_scene::report::{StageReport, counted};

/// The middle of the row of a step; `None` for other stages.
pub(super) fn row(stage: &StageReport) -> Option<String> {
    if let Some(details) = stage.details_as::<PhotosDetails>() {
        return Some(photos(&details));
    }
    if let Some(FeaturesDetails { program, focal_px }) = stage.details_as() {
        let focal =
            focal_px.map_or(String::new(), |f| format!(", focal length {f:.0} px by the photos' notes"));
        return Some(format!("{program}{focal}"));
    }
    if let Some(MatchesDetails { how, pairs }) = stage.details_as() {
        return Some(pairs.map_or(how.clone(), |pairs| format!("{}, {how}", many(pairs, "pair"))));
    }
    if let Some(ModelDetails { mapper, registered, photos, models }) = stage.details_as() {
        let parts = if models > 1 { format!(", in {models} parts") } else { String::new() };
        return Some(format!("{registered} of {photos} photos have a pose{parts} ({mapper})"));
    }
    stage.details_as::<VerdictDetails>().map(|details| verdict(&details))
}

fn photos(details: &PhotosDetails) -> String {
    let PhotosDetails { photos, frames, video_frames, turned, converted, cameras, .. } = *details;
    let mut text = match frames {
        0 => counted(photos, "photo"),
        _ if photos == frames => format!("{frames} of {} frames", HumanCount(video_frames)),
        _ => {
            let stills = photos - frames;
            format!("{}, {frames} of {} frames", counted(stills, "photo"), HumanCount(video_frames))
        }
    };
    for (number, what) in [(turned, "turned upright"), (converted, "converted")] {
        if number > 0 {
            text += &format!(", {number} {what}");
        }
    }
    if cameras > 1 {
        text += &format!(", {cameras} cameras");
    }
    text
}

fn verdict(details: &VerdictDetails) -> String {
    let error = details.error_px.map_or(String::new(), |error| format!(", {error:.2} px"));
    let (points, track) = (many(details.points, "point"), details.track_length);
    format!("{}: {points}, each in {track:.1} photos{error}", details.verdict.word())
}
