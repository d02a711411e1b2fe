//! RealityScan's table of registered photos (Export > Registration > Internal/External camera
//! parameters).
//!
//! A line per photo: its name, place (z up), heading, pitch and roll in degrees, focal length f in
//! mm of a photo whose longer side is 36 mm, principal point from the middle in longer sides, and
//! Brown's coefficients. A photo with three angles of 0 looks down, its upper edge to +y;
//! tangential coefficients are in the order opposite to OpenCV's.

use super::dataset::DatasetKind;
use super::lens::Distortion;
use super::listing::{DatasetListing, LensClaim, ListedPhoto, NamedFiles};
use super::options::DatasetOptions;
use glam::{DMat3, DVec2, DVec3};
use std::path::{Path, PathBuf};
use trisplat_scene::image::RgbImage;
use trisplat_scene::{Error, Result, input};

/// The longer side of a photo that f is for, mm.
const FILM: f64 = 36.0;

/// Columns: each by its names today and before.
const COLUMNS: [&[&str]; 15] = [
    &["x"],
    &["y"],
    &["alt", "z"],
    &["yaw", "heading"],
    &["pitch"],
    &["roll"],
    &["f_35mm", "f"],
    &["px_norm", "px"],
    &["py_norm", "py"],
    &["k1"],
    &["k2"],
    &["k3"],
    &["k4"],
    &["t1"],
    &["t2"],
];

/// The file of a folder: its only table that begins as this one does.
pub(super) fn locate(root: &Path) -> Option<PathBuf> {
    let is_table = |path: &PathBuf| {
        let is_csv = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("csv"));
        let mut start = [0; 5];
        let read =
            |mut file: std::fs::File| std::io::Read::read_exact(&mut file, &mut start).is_ok();
        is_csv && std::fs::File::open(path).is_ok_and(read) && &start == b"#name"
    };
    let mut tables: Vec<PathBuf> =
        input::entries(root).filter(|path| path.is_file() && is_table(path)).collect();
    tables.sort();
    (tables.len() == 1).then(|| tables.remove(0))
}

/// Reads `file` and finds its photos.
pub(super) fn read(file: &Path, options: &DatasetOptions) -> Result<DatasetListing> {
    let text = input::read_text(file, &options.limits)?;
    let wrong =
        |line: usize, reason: String| Error::malformed(file, format!("line {}", line + 1), reason);
    let mut lines = text
        .trim_start_matches('\u{feff}')
        .lines()
        .map(str::trim)
        .enumerate()
        .filter(|(_, l)| !l.is_empty());
    let head = lines.next().and_then(|(_, line)| line.strip_prefix('#')).unwrap_or_default();
    let head: Vec<&str> = head.split(',').map(str::trim).collect();
    let places = COLUMNS.map(|names| head.iter().position(|have| names.contains(have)));
    if head[0] != "name" || places[..7].contains(&None) {
        let reason = "expected #name,x,y,alt,yaw,pitch,roll,f_35mm, ...: export `Internal/External camera parameters`";
        return Err(wrong(0, reason.into()));
    }
    let root = file.parent().unwrap_or(Path::new("")).to_owned();
    let mut files = NamedFiles::new(file, &root, options);
    let mut photos = Vec::new();
    let mut broken = Vec::new();
    for (index, line) in lines {
        let words: Vec<&str> = line.split(',').map(str::trim).collect();
        let number = |place: Option<usize>| match place {
            None => Ok(0.0),
            Some(at) => words.get(at).and_then(|word| word.parse().ok()).ok_or_else(|| {
                wrong(index, format!("{} of `{}` is not a number", head[at], words[0]))
            }),
        };
        let mut numbers = [0.0; COLUMNS.len()];
        for (number_at, place) in numbers.iter_mut().zip(places) {
            *number_at = number(place)?;
        }
        let path = files.find(&format!("line {}", index + 1), words[0])?;
        let name = files.name_of(&path);
        if numbers.iter().all(|number: &f64| number.is_finite()) {
            photos.push(photo(name, path, &numbers, options));
        } else {
            broken.push((name, wrong(index, "a number is not finite".into())));
        }
    }
    if photos.is_empty() && broken.is_empty() {
        return Err(wrong(0, "no photo follows; align the photos before the export".into()));
    }
    check_places(file, &photos)?;
    let warnings = files.warnings().collect();
    let kind = DatasetKind::RealityScan;
    let list = file.to_owned();
    let points = Vec::new();
    Ok(DatasetListing { kind, root, list, photos, broken, points, warnings })
}

fn photo(
    name: String,
    path: PathBuf,
    numbers: &[f64; 15],
    options: &DatasetOptions,
) -> ListedPhoto {
    let &[x, y, z, heading, pitch, roll, f, px, py, k1, k2, k3, k4, t1, t2] = numbers;
    let [heading, pitch, roll] = [heading, pitch, roll].map(f64::to_radians);
    // Right, up, backwards in the world.
    let turn = DMat3::from_rotation_z(-heading)
        * DMat3::from_rotation_x(pitch)
        * DMat3::from_rotation_y(roll);
    let to_world = DMat3::from_cols(turn.x_axis, -turn.y_axis, -turn.z_axis);
    // The header is read again with the photo, which is an error then if it is broken.
    let size = RgbImage::size_of(&path, &options.limits).ok();
    let sides = size.unwrap_or_default().as_dvec2();
    let scale = sides.max_element();
    let center = sides / 2.0 + DVec2::new(px, py) * scale;
    let lens = LensClaim {
        size,
        focal: [Some(f / FILM * scale); 2],
        angle: [None; 2],
        center: center.to_array().map(Some),
        distortion: Distortion {
            radial: [k1, k2, k3, k4],
            tangential: [t2, t1],
            ..Distortion::default()
        },
    };
    let rotation = to_world.transpose();
    let translation = -(rotation * DVec3::new(x, y, z));
    ListedPhoto::with_pose(name, path, (rotation, translation), lens)
}

/// Refuses places in degrees of longitude and latitude with heights in metres.
fn check_places(file: &Path, photos: &[ListedPhoto]) -> Result<()> {
    let places = || photos.iter().map(ListedPhoto::center);
    let low = places().fold(DVec3::INFINITY, DVec3::min);
    let high = places().fold(DVec3::NEG_INFINITY, DVec3::max);
    let on_earth = low.x >= -180.0 && high.x <= 180.0 && low.y >= -90.0 && high.y <= 90.0;
    let near = (high - low).truncate().max_element() < 0.05 && low.truncate().length() > 1.0;
    if photos.len() > 1
        && on_earth
        && near
        && high.z - low.z > 20.0 * (high - low).truncate().max_element()
    {
        let reason = "x and y are degrees of longitude and latitude; export in a local or metric coordinate system";
        return Err(Error::malformed(file, "x, y", reason));
    }
    Ok(())
}
