//! `trisplat info DATASET`: cameras, sizes, points, their errors, and oddities.

use super::counts::thousands;
use super::messages;
use std::io::Write;
use std::path::Path;
use trisplat_dataset::{Dataset, DatasetOptions, Description, describe};
use trisplat_scene::{Error, Result, report::counted};

/// Most cameras listed one by one; others are only counted.
const LISTED: usize = 5;

/// True for a data set: a folder or a transforms.json.
pub fn is_dataset(path: &Path) -> bool {
    path.is_dir() || path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"))
}

/// Reads the data set at `path` and writes its table, or its figures as JSON, to `out`.
pub fn run(path: &Path, options: &DatasetOptions, json: bool, out: &mut dyn Write) -> Result<()> {
    let description = describe(&Dataset::load(path, options)?, &options.limits)?;
    let text = if json {
        serde_json::to_string_pretty(&description).unwrap_or_default() + "\n"
    } else {
        table(&description)
    };
    out.write_all(text.as_bytes()).map_err(|e| Error::io("-", e))
}

/// The table, one figure per line.
pub fn table(d: &Description) -> String {
    let mut rows = vec![("kind", d.kind.to_string())];
    let photos = d.train + d.test;
    rows.push(("photos", format!("{photos}: {} to train on, {} held out", d.train, d.test)));
    for group in d.cameras.iter().take(LISTED) {
        let ([w, h], [sw, sh]) = (group.size, group.stored);
        let files = if group.size == group.stored { String::new() } else { format!(" (files {sw}x{sh})") };
        let ([fx, fy], [cx, cy]) = (group.focal, group.center);
        let lens = format!("f {fx:.1} {fy:.1}, centre {cx:.1} {cy:.1}, {:.1}° wide", group.field_of_view);
        let photos = counted(group.photos, "photo");
        rows.push(("camera", format!("{w}x{h}{files}, {lens}: {photos}")));
    }
    if d.cameras.len() > LISTED {
        rows.push(("camera", format!("and {} more", d.cameras.len() - LISTED)));
    }
    if d.masks > 0 {
        rows.push(("masks", counted(d.masks, "photo")));
    }
    if d.cut > 0 {
        rows.push(("cut out", format!("{} of an object without background", counted(d.cut, "photo"))));
    }
    if d.undistorted > 0 {
        rows.push(("lens", format!("{} undistorted while read", counted(d.undistorted, "photo"))));
    }
    rows.push(("decoded", format!("{:.1} MiB", d.decoded_bytes as f64 / f64::from(1 << 20))));
    rows.push(("cameras", format!("within {:.3} world units", d.camera_extent)));
    rows.push(("points", thousands(d.points)));
    if let Some([low, high]) = d.point_bounds {
        let span = |i: usize| format!("{:.3}..{:.3}", low[i], high[i]);
        rows.push(("bounds", format!("x {}  y {}  z {} (middle 98%)", span(0), span(1), span(2))));
    }
    if let Some(error) = d.stated_error_px {
        rows.push(("stated", format!("{error:.3} px mean error")));
    }
    if let Some(fit) = d.reprojection {
        let behind =
            if fit.behind > 0 { format!(", {} behind the camera", fit.behind) } else { String::new() };
        let seen = thousands(fit.observations);
        rows.push(("measured", format!("{:.3} px mean error over {seen} observations{behind}", fit.mean_px)));
    }
    if let Some([x, y, z]) = d.origin {
        rows.push(("origin", format!("{x} {y} {z} is subtracted from every position")));
    }
    rows.extend(d.warnings.iter().map(|warning| ("warning", warning.clone())));
    rows.iter().map(|(name, value)| format!("{name:<10}{}\n", messages::visible(value))).collect()
}
