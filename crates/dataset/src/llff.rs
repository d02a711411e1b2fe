//! `poses_bounds.npy` of LLFF: poses of the photos of a folder in order of name.
//!
//! A row of 17 numbers is a matrix of 3 by 5, row by row, and the nearest and farthest depth. The
//! columns of the matrix are the directions down, right and backwards of the photo, the place of
//! the camera, and (height, width, focal length) in px.

use super::dataset::DatasetKind;
use super::listing::{DatasetListing, LensClaim, ListedPhoto};
use super::options::DatasetOptions;
use glam::{DMat3, DVec3, UVec2};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use trisplat_scene::{Error, Result, excerpt, input};

/// Numbers of a photo.
const ROW: usize = 17;
/// Maximum length of a header, bytes: NumPy itself writes 128.
const MAX_HEADER: usize = 1 << 16;

/// The file of a folder.
pub(super) fn locate(root: &Path) -> Option<PathBuf> {
    Some(root.join("poses_bounds.npy")).filter(|file| file.is_file())
}

/// Reads `file` and finds its photos: in `images`, or shrunk in `images_2`, `images_4`, ...
pub(super) fn read(file: &Path, options: &DatasetOptions) -> Result<DatasetListing> {
    let root = file.parent().unwrap_or(Path::new("")).to_owned();
    let (mut from, length) = input::open(file, &options.limits)?;
    let header = Header::read(file, &mut from, length)?;
    let name = options.images.display().to_string();
    let folders = [name.clone()].into_iter().chain([2, 4, 8, 16].map(|by| format!("{name}_{by}")));
    let pictures_by_folder =
        folders.map(|folder| (pictures(&root.join(&folder)), folder)).collect::<Vec<_>>();
    let Some((pictures, folder)) =
        pictures_by_folder.iter().find(|(pictures, _)| pictures.len() == header.rows)
    else {
        let counts: Vec<String> = pictures_by_folder
            .iter()
            .map(|(pictures, folder)| format!("{} in {folder}", pictures.len()))
            .collect();
        let reason =
            format!("has {} poses, and there are photos: {}", header.rows, counts.join(", "));
        return Err(Error::malformed(
            file,
            "photos",
            format!("{reason}; each pose needs its photo"),
        ));
    };
    // No more numbers than photos take memory.
    let rows = header.rows(file, &mut from)?;
    let below = root.join(folder);
    let mut photos = Vec::new();
    let mut broken = Vec::new();
    for (index, (path, row)) in pictures.iter().zip(&rows).enumerate() {
        let name = path.strip_prefix(&below).unwrap_or(path).to_string_lossy().replace('\\', "/");
        match photo(name.clone(), path.clone(), row) {
            Ok(photo) => photos.push(photo),
            Err(reason) => {
                broken.push((name, Error::malformed(file, format!("pose {index}"), reason)));
            }
        }
    }
    let kind = DatasetKind::Llff;
    let list = file.to_owned();
    let points = Vec::new();
    Ok(DatasetListing { kind, root, list, photos, broken, points, warnings: Vec::new() })
}

/// The pictures in a folder, in order of name.
fn pictures(folder: &Path) -> Vec<PathBuf> {
    let is_picture = |path: &PathBuf| image::ImageFormat::from_path(path).is_ok();
    let mut pictures: Vec<PathBuf> =
        input::files_below(folder).into_iter().filter(is_picture).collect();
    pictures.sort();
    pictures
}

fn photo(name: String, path: PathBuf, row: &[f64; ROW]) -> Result<ListedPhoto, String> {
    let column = |c: usize| DVec3::new(row[c], row[5 + c], row[10 + c]);
    let to_world = DMat3::from_cols(column(1), column(0), -column(2));
    let size = column(4);
    let skew = to_world.transpose() * to_world - DMat3::IDENTITY;
    let is_rotation =
        to_world.determinant() > 0.0 && skew.to_cols_array().iter().all(|x| x.abs() < 1e-3);
    if !is_rotation || !row.iter().all(|x| x.is_finite()) {
        return Err("is no rotation: expected columns down, right, backwards".into());
    }
    let [height, width, focal] = size.to_array();
    if !(height.min(width) >= 1.0 && height.max(width) <= f64::from(1 << 20)) {
        return Err(format!("says a photo of {width}x{height}"));
    }
    let rotation = to_world.transpose();
    let lens = LensClaim {
        size: Some(UVec2::new(width.round() as u32, height.round() as u32)),
        focal: [Some(focal), None],
        ..LensClaim::default()
    };
    let translation = -(rotation * column(3));
    Ok(ListedPhoto::with_pose(name, path, (rotation, translation), lens))
}

/// Header of a NumPy file.
struct Header {
    rows: usize,
    bytes_per_number: usize,
}

impl Header {
    /// Read it from the start of `from`, a file of `length` bytes: magic bytes, the length of a
    /// Python dict, the dict.
    fn read(file: &Path, from: &mut File, length: u64) -> Result<Self> {
        let wrong = |reason: String| {
            Error::malformed(
                file,
                "header",
                format!("{reason}; expected N x {ROW} numbers, little endian"),
            )
        };
        let mut next = |count: usize| {
            let mut bytes = vec![0; count];
            from.read_exact(&mut bytes)
                .map_err(|_| wrong("is not a NumPy array".into()))
                .map(|()| bytes)
        };
        let is_long = match next(8)?[..] {
            [0x93, b'N', b'U', b'M', b'P', b'Y', version, _] => version > 1,
            _ => return Err(wrong("is not a NumPy array".into())),
        };
        let size = next(if is_long { 4 } else { 2 })?;
        let start = 8 + size.len() as u64;
        let size = size.iter().rev().fold(0, |sum, byte| 256 * sum + usize::from(*byte));
        if size > MAX_HEADER {
            return Err(wrong(format!("says a header of {size} bytes")));
        }
        let text = String::from_utf8_lossy(&next(size)?).replace([' ', '"', '\''], "");
        let says = || wrong(format!("says {}", excerpt(text.trim())));
        let bytes_per_number = match () {
            () if text.contains("descr:<f8") => 8,
            () if text.contains("descr:<f4") => 4,
            () => return Err(says()),
        };
        let shape = text.split_once("shape:(").and_then(|(_, rest)| rest.split_once(')'));
        let shape = shape.map_or("", |(shape, _)| shape);
        let rows = shape.strip_suffix(&format!(",{ROW}")).and_then(|rows| rows.parse().ok());
        let Some(rows) = rows.filter(|_| !text.contains("fortran_order:True")) else {
            return Err(says());
        };
        let follow = length.saturating_sub(start + size as u64) / bytes_per_number as u64;
        if follow / ROW as u64 != rows as u64 {
            return Err(wrong(format!("says ({shape}), and {follow} numbers follow")));
        }
        Ok(Self { rows, bytes_per_number })
    }

    /// The numbers that follow it.
    fn rows(&self, file: &Path, from: &mut File) -> Result<Vec<[f64; ROW]>> {
        let mut bytes = vec![0; self.rows * ROW * self.bytes_per_number];
        from.read_exact(&mut bytes).map_err(|e| Error::io(file, e))?;
        let number = |bytes: &[u8]| match bytes.try_into() {
            Ok(eight) => f64::from_le_bytes(eight),
            Err(_) => bytes.try_into().map_or(f64::NAN, |four| f64::from(f32::from_le_bytes(four))),
        };
        let numbers: Vec<f64> = bytes.chunks(self.bytes_per_number).map(number).collect();
        Ok(numbers.as_chunks().0.to_vec())
    }
}
