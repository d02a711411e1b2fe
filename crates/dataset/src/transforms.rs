//! `transforms.json` of nerfstudio, instant-ngp and Blender.
//!
//! Poses are camera to world with OpenGL axes (x right, y up, z back); ours are world to camera with
//! COLMAP's (x right, y down, z forward):
//!
//! ```text
//! R = (M diag(1, -1, -1))^T        t = -R c        M, c: rotation and column 3 of transform_matrix
//! ```

use super::found::{FoundDataset, FoundPhoto, LensClaim, NamedFiles};
use super::lens::{Distortion, Projection};
use super::options::DatasetOptions;
use super::points::PointFile;
use super::posed::DatasetKind;
use glam::{DMat3, DVec2, DVec3, UVec2};
use serde::Deserialize;
use serde_json::Value;
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use trisplat_formats::foreign_json;
use trisplat_scene::{Error, Limits, Result, input};

/// The whole file; keys we do not know are ignored.
#[derive(Debug, Deserialize)]
struct Transforms {
    #[serde(flatten)]
    shared: Intrinsics,
    ply_file_path: Option<String>,
    train_filenames: Option<Vec<String>>,
    val_filenames: Option<Vec<String>>,
    test_filenames: Option<Vec<String>>,
    frames: Vec<FrameRow>,
}

#[derive(Debug, Deserialize)]
struct FrameRow {
    file_path: String,
    mask_path: Option<String>,
    transform_matrix: Vec<Vec<f64>>,
    #[serde(flatten)]
    own: Intrinsics,
}

/// Numbers for all frames, at the top of the file, or for one frame.
#[derive(Debug, Clone, Default, Deserialize)]
struct Intrinsics {
    w: Option<f64>,
    h: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
    sx1: Option<f64>,
    sy1: Option<f64>,
    #[serde(rename = "K")]
    matrix: Option<[[f64; 3]; 3]>,
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    fisheye_crop_radius: Option<f64>,
    camera_model: Option<String>,
    is_fisheye: Option<bool>,
    latlong: Option<bool>,
    equirectangular: Option<bool>,
    ftheta_p0: Option<f64>,
}

/// The keys whose values are used.
const NUMBERS: [&str; 20] = [
    "w",
    "h",
    "fl_x",
    "fl_y",
    "cx",
    "cy",
    "k1",
    "k2",
    "k3",
    "k4",
    "p1",
    "p2",
    "sx1",
    "sy1",
    "K",
    "camera_angle_x",
    "camera_angle_y",
    "fisheye_crop_radius",
    "ftheta_p0",
    "transform_matrix",
];

/// The file of a folder: all frames, or the training frames.
pub(super) fn locate(root: &Path) -> Option<PathBuf> {
    ["transforms.json", "transforms_train.json"].map(|f| root.join(f)).into_iter().find(|f| f.is_file())
}

/// Reads `file`, and beside it the held-out frames of `transforms_test.json`, or else of
/// `transforms_val.json`.
pub(super) fn read(file: &Path, options: &DatasetOptions) -> Result<FoundDataset> {
    let root = file.parent().unwrap_or(Path::new("")).to_owned();
    let transforms = parse(file, &options.limits)?;
    let mut files = NamedFiles::new(file, &root, options);
    let points = match &transforms.ply_file_path {
        Some(name) => point_file(file, files.find("ply_file_path", name)?)?,
        None => PointFile::None,
    };
    let mut frames = Vec::with_capacity(transforms.frames.len());
    for (index, row) in transforms.frames.iter().enumerate() {
        frames.push(frame(&mut files, index, row, &transforms.shared)?);
    }
    let mut warnings: Vec<String> = files.warnings().collect();
    warnings.extend(split(file, &transforms, &mut frames)?);
    let held_out = ["transforms_test.json", "transforms_val.json"].map(|name| root.join(name));
    if let Some(other) = held_out.iter().find(|other| other.is_file()).filter(|other| *other != file) {
        warnings.extend(add_held_out(&mut frames, other, &root, options)?);
    }
    if frames.is_empty() {
        return Err(Error::malformed(file, "frames", "is empty; a data set needs at least one photo"));
    }
    let (kind, list, photos) = (DatasetKind::Transforms, file.to_owned(), frames);
    Ok(FoundDataset { kind, root, list, photos, points, warnings })
}

/// Holds out the photos that the file's own lists name, and leaves out those in none of them. Returns a warning.
fn split(file: &Path, transforms: &Transforms, frames: &mut Vec<FoundPhoto>) -> Result<Option<String>> {
    let Transforms { train_filenames, val_filenames, test_filenames, .. } = transforms;
    let some = |list: &&Vec<String>| !list.is_empty();
    let held_out = test_filenames.as_ref().filter(some).or(val_filenames.as_ref().filter(some));
    let set = |list: &Vec<String>| list.iter().map(|name| plain(name)).collect::<HashSet<String>>();
    let (train, held_out) = (train_filenames.as_ref().filter(some).map(set), held_out.map(set));
    let mut names = transforms.frames.iter().map(|row| plain(&row.file_path));
    let (total, mut matched) = (frames.len(), 0);
    frames.retain_mut(|photo| {
        let name = names.next().unwrap_or_default();
        photo.held_out = held_out.as_ref().is_some_and(|list| list.contains(&name));
        matched += usize::from(photo.held_out);
        photo.held_out || train.as_ref().is_none_or(|list| list.contains(&name))
    });
    if held_out.is_some() && matched == 0 {
        let reason = "names no photo of `frames`; correct or remove it";
        return Err(Error::malformed(file, "test_filenames, val_filenames", reason));
    }
    let out = total - frames.len();
    let lists = "train_filenames, nor among those held out";
    Ok((out > 0).then(|| format!("{out} of {total} photos left out: they are not in {lists}")))
}

/// A file's name as lists and frames may spell it.
fn plain(name: &str) -> String {
    let name = name.replace('\\', "/");
    name.strip_prefix("./").unwrap_or(&name).to_owned()
}

/// The cloud that `file` names.
fn point_file(file: &Path, ply: PathBuf) -> Result<PointFile> {
    if !ply.exists() {
        let reason = format!(
            "{} does not exist; restore it, or remove the key to start from random points",
            ply.display()
        );
        return Err(Error::malformed(file, "ply_file_path", reason));
    }
    Ok(PointFile::Ply(ply))
}

fn parse(file: &Path, limits: &Limits) -> Result<Transforms> {
    let text = input::read_text(file, limits)?;
    let value = if text.contains("NaN") || text.contains("Infinity") {
        serde_json::from_str(&quoted(&text)).and_then(|value: Value| {
            unusable(&value)
                .map_or_else(|| serde_json::from_value(value), |bad| Err(serde::de::Error::custom(bad)))
        })
    } else {
        serde_json::from_str(&text)
    };
    value.map_err(|e| {
        foreign_json(file, text.as_bytes()).unwrap_or_else(|| {
            let at = if e.line() > 0 {
                format!("line {} column {}", e.line(), e.column())
            } else {
                "frames".into()
            };
            Error::malformed(file, at, format!("is not a transforms.json: {e}"))
        })
    })
}

/// The text with Python's NaN and Infinity as strings, which unused keys may hold.
fn quoted(text: &str) -> String {
    let (mut out, mut rest, mut inside) = (String::with_capacity(text.len()), text, false);
    while let Some(first) = rest.chars().next() {
        let word =
            ["NaN", "-Infinity", "Infinity"].into_iter().find(|word| !inside && rest.starts_with(word));
        let taken = match word {
            Some(word) => word.len(),
            None if first == '\\' => first.len_utf8() + rest[1..].chars().next().map_or(0, char::len_utf8),
            None => first.len_utf8(),
        };
        inside ^= first == '"';
        match word {
            Some(word) => out.extend(["\"", word, "\""]),
            None => out.push_str(&rest[..taken]),
        }
        rest = &rest[taken..];
    }
    out
}

/// What is wrong with a used number that is none.
fn unusable(list: &Value) -> Option<String> {
    fn is_none(value: &Value) -> bool {
        match value {
            Value::String(text) => ["NaN", "Infinity", "-Infinity"].contains(&text.as_str()),
            Value::Array(values) => values.iter().any(is_none),
            _ => false,
        }
    }
    let bad = |object: &Value| NUMBERS.into_iter().find(|key| is_none(&object[*key]));
    let frames = list["frames"].as_array().into_iter().flatten().enumerate();
    let of_frame = |(index, frame): (usize, &Value)| {
        Some(format!("frame {index}: {} is not a finite number", bad(frame)?))
    };
    bad(list)
        .map(|key| format!("{key} is not a finite number"))
        .or_else(|| frames.into_iter().find_map(of_frame))
}

/// Adds the frames of another file, held out; a photo in both files is held out too. Returns warnings.
fn add_held_out(
    frames: &mut Vec<FoundPhoto>,
    file: &Path,
    root: &Path,
    options: &DatasetOptions,
) -> Result<Vec<String>> {
    let transforms = parse(file, &options.limits)?;
    let mut files = NamedFiles::new(file, root, options);
    let mut known: HashMap<String, usize> =
        frames.iter().enumerate().map(|(i, f)| (f.name.clone(), i)).collect();
    for (index, row) in transforms.frames.iter().enumerate() {
        let held = frame(&mut files, index, row, &transforms.shared)?;
        match known.get(&held.name) {
            Some(&i) => frames[i].held_out = true,
            None => {
                known.insert(held.name.clone(), frames.len());
                frames.push(FoundPhoto { held_out: true, ..held });
            }
        }
    }
    Ok(files.warnings().collect())
}

fn frame(files: &mut NamedFiles, index: usize, row: &FrameRow, shared: &Intrinsics) -> Result<FoundPhoto> {
    let (file, place) = (files.list, format!("frame {index} `{}`", plain(&row.file_path)));
    let path = files.find(&place, &row.file_path)?;
    let mask = row.mask_path.as_ref().map(|mask| files.find(&place, mask)).transpose()?;
    let bad = |reason: String| Error::malformed(file, &place, reason);
    let name = files.name_of(&path);
    let (rotation, translation) = pose(&row.transform_matrix).map_err(bad)?;
    let lens = row
        .own
        .clone()
        .read_matrix()
        .over(&shared.clone().read_matrix())
        .lens()
        .map_err(|reason| Error::unsupported(file, reason))?;
    Ok(FoundPhoto { name, path, mask, rotation, translation, lens, held_out: false })
}

/// World to camera from camera to world.
fn pose(matrix: &[Vec<f64>]) -> std::result::Result<(DMat3, DVec3), String> {
    let shape = "transform_matrix must have 3 or 4 rows of 4 finite numbers";
    if !(3..=4).contains(&matrix.len()) || matrix.iter().any(|row| row.len() != 4) {
        return Err(shape.into());
    }
    if matrix.iter().flatten().any(|x| !x.is_finite()) {
        return Err(shape.into());
    }
    if matrix.get(3).is_some_and(|last| last[..] != [0.0, 0.0, 0.0, 1.0]) {
        return Err("the last row of transform_matrix is not 0 0 0 1".into());
    }
    let column = |c: usize| DVec3::new(matrix[0][c], matrix[1][c], matrix[2][c]);
    let axes = DMat3::from_cols(column(0), column(1), column(2));
    // Some writers scale the scene by scaling the matrix; the camera only rotates.
    let scale = axes.determinant().cbrt();
    let proper = scale > 1e-9;
    if !proper {
        return Err("transform_matrix is mirrored or singular".into());
    }
    let rotation = axes * (1.0 / scale);
    let skew = rotation.transpose() * rotation - DMat3::IDENTITY;
    if skew.to_cols_array().iter().any(|x| x.abs() > 1e-3) {
        return Err("transform_matrix is not a rotation: its columns are not at right angles".into());
    }
    let gl = orthonormal(rotation);
    let rotation = DMat3::from_cols(gl.x_axis, -gl.y_axis, -gl.z_axis).transpose();
    Ok((rotation, -(rotation * column(3))))
}

/// The nearest rotation, for a matrix that is almost one: undoes the rounding of the file.
/// Newton's iteration for the polar decomposition (Higham 1986).
fn orthonormal(mut m: DMat3) -> DMat3 {
    for _ in 0..6 {
        m = (m + m.inverse().transpose()) * 0.5;
    }
    m
}

impl Intrinsics {
    /// These numbers with those of the 3×3 matrix in their places.
    fn read_matrix(self) -> Self {
        let Some([[fx, _, cx], [_, fy, cy], _]) = self.matrix else { return self };
        let [fx, fy, cx, cy] = [fx, fy, cx, cy].map(Some);
        Self { fl_x: fx, fl_y: fy, cx, cy, ..self }
    }

    /// These numbers, and for missing ones those of `shared`.
    fn over(&self, shared: &Self) -> Self {
        // A frame with its own focal length does not inherit the shared angle, and vice versa.
        let own_focal = self.fl_x.or(self.camera_angle_x).is_some();
        let angle = |own: Option<f64>, shared: Option<f64>| own.or(shared.filter(|_| !own_focal));
        Self {
            w: self.w.or(shared.w),
            h: self.h.or(shared.h),
            fl_x: angle(self.fl_x, shared.fl_x),
            fl_y: angle(self.fl_y, shared.fl_y),
            cx: self.cx.or(shared.cx),
            cy: self.cy.or(shared.cy),
            k1: self.k1.or(shared.k1),
            k2: self.k2.or(shared.k2),
            k3: self.k3.or(shared.k3),
            k4: self.k4.or(shared.k4),
            p1: self.p1.or(shared.p1),
            p2: self.p2.or(shared.p2),
            sx1: self.sx1.or(shared.sx1),
            sy1: self.sy1.or(shared.sy1),
            matrix: self.matrix.or(shared.matrix),
            camera_angle_x: angle(self.camera_angle_x, shared.camera_angle_x),
            camera_angle_y: angle(self.camera_angle_y, shared.camera_angle_y),
            camera_model: self.camera_model.clone().or(shared.camera_model.clone()),
            fisheye_crop_radius: self.fisheye_crop_radius.or(shared.fisheye_crop_radius),
            is_fisheye: self.is_fisheye.or(shared.is_fisheye),
            latlong: self.latlong.or(shared.latlong),
            equirectangular: self.equirectangular.or(shared.equirectangular),
            ftheta_p0: self.ftheta_p0.or(shared.ftheta_p0),
        }
    }

    fn lens(&self) -> std::result::Result<LensClaim, String> {
        let remedy = "undistort the photos first, or make pinhole views of them";
        let projection = match self.camera_model.as_deref() {
            _ if self.ftheta_p0.is_some() => {
                return Err(format!("the f-theta lens of ftheta_p0 is not read; {remedy}"));
            }
            _ if self.equirectangular == Some(true) => {
                return Err(format!("the equal-area panorama of `equirectangular` is not read; {remedy}"));
            }
            _ if self.latlong == Some(true) => Projection::Spherical,
            _ if self.is_fisheye == Some(true) => Projection::Fisheye,
            None
            | Some("OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "perspective") => {
                Projection::Perspective
            }
            Some(
                "OPENCV_FISHEYE"
                | "FISHEYE"
                | "SIMPLE_FISHEYE"
                | "SIMPLE_RADIAL_FISHEYE"
                | "RADIAL_FISHEYE"
                | "THIN_PRISM_FISHEYE"
                | "fisheye",
            ) => Projection::Fisheye,
            Some("EQUIRECTANGULAR" | "SPHERICAL" | "equirectangular") => Projection::Spherical,
            Some(other) => return Err(format!("camera_model {other} is not read; {remedy}")),
        };
        let zero = |k: Option<f64>| k.unwrap_or(0.0);
        let size = match (self.w, self.h) {
            (Some(w), Some(h)) if w >= 1.0 && h >= 1.0 && w.max(h) <= f64::from(1 << 20) => {
                Some(UVec2::new(w.round() as u32, h.round() as u32))
            }
            (Some(w), Some(h)) => return Err(format!("w and h are {w} and {h}")),
            _ => None,
        };
        let mut distortion = Distortion {
            radial: [self.k1, self.k2, self.k3, self.k4].map(zero),
            tangential: [self.p1, self.p2].map(zero),
            prism: [self.sx1, self.sy1].map(zero),
            skew: self.matrix.map_or(0.0, |[[fx, skew, _], ..]| skew / fx),
            projection,
            limit: None,
        };
        let radius =
            self.fisheye_crop_radius.zip(self.fl_x).map(|(radius, focal)| DVec2::new(radius / focal, 0.0));
        distortion.limit = radius.and_then(|at| Some(distortion.undistort(at)?.length()));
        Ok(LensClaim {
            size,
            focal: [self.fl_x, self.fl_y],
            angle: [self.camera_angle_x, self.camera_angle_y],
            center: [self.cx, self.cy],
            distortion,
        })
    }
}
