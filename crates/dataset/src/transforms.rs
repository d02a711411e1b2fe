//! `transforms.json` of nerfstudio, instant-ngp and Blender.
//!
//! Poses are camera to world with OpenGL axes (x right, y up, z back); ours are world to camera
//! with COLMAP's (x right, y down, z forward):
//!
//! ```text
//! R = (M diag(1, -1, -1))^T        t = -R c        M, c: rotation and column 3 of transform_matrix
//! ```

use super::colmap_model::ListedPoint;
use super::dataset::DatasetKind;
use super::depth::DepthFile;
use super::lens::{Distortion, LensProjection};
use super::listing::{DatasetListing, LensClaim, ListedPhoto, NamedFiles};
use super::options::DatasetOptions;
use super::points::read_ply;
use glam::{DMat3, DVec2, DVec3, UVec2};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use trisplat_formats::foreign_json;
use trisplat_scene::{Error, Limits, Result, input};

/// The whole file; keys we do not know are ignored.
#[derive(Debug, Deserialize)]
struct Transforms {
    ply_file_path: Option<String>,
    train_filenames: Option<Vec<String>>,
    val_filenames: Option<Vec<String>>,
    test_filenames: Option<Vec<String>>,
    frames: Vec<FrameRow>,
    #[serde(flatten)]
    shared: Map<String, Value>,
}

/// A frame; its own keys are those of [`Keys`].
#[derive(Debug, Deserialize)]
pub(super) struct FrameRow {
    pub(super) file_path: String,
    pub(super) mask_path: Option<String>,
    #[serde(flatten)]
    pub(super) own: Map<String, Value>,
}

/// Another list of the same kind of frames.
pub(super) struct TransformsList<'a> {
    pub(super) kind: DatasetKind,
    /// Folder that names of files are relative to.
    pub(super) root: &'a Path,
    /// The list, for messages.
    pub(super) file: &'a Path,
}

impl TransformsList<'_> {
    /// The data set of these frames.
    pub(super) fn assemble(
        &self,
        frames: Vec<FrameRow>,
        options: &DatasetOptions,
    ) -> Result<DatasetListing> {
        let mut files = NamedFiles::new(self.file, self.root, options);
        let mut broken = Vec::new();
        let mut transforms = Transforms {
            ply_file_path: None,
            train_filenames: None,
            val_filenames: None,
            test_filenames: None,
            frames,
            shared: Map::new(),
        };
        let photos = transforms.take_photos(&mut files, &mut broken)?;
        Ok(DatasetListing {
            kind: self.kind,
            root: self.root.to_owned(),
            list: self.file.to_owned(),
            photos,
            broken,
            points: Vec::new(),
            warnings: files.warnings().collect(),
        })
    }
}

/// The file of a folder: all frames, or the training frames.
pub(super) fn locate(root: &Path) -> Option<PathBuf> {
    ["transforms.json", "transforms_train.json"]
        .map(|f| root.join(f))
        .into_iter()
        .find(|f| f.is_file())
}

/// Reads `file`, and beside it the held-out frames of `transforms_test.json`, or else of
/// `transforms_val.json`.
pub(super) fn read(file: &Path, options: &DatasetOptions) -> Result<DatasetListing> {
    let root = file.parent().unwrap_or(Path::new("")).to_owned();
    let mut transforms = parse(file, &options.limits)?;
    let mut files = NamedFiles::new(file, &root, options);
    let points = match &transforms.ply_file_path {
        Some(name) => points(file, &files.find("ply_file_path", name)?, &options.limits)?,
        None => Vec::new(),
    };
    let mut broken = Vec::new();
    let mut frames = transforms.take_photos(&mut files, &mut broken)?;
    let mut warnings: Vec<String> = files.warnings().collect();
    warnings.extend(split(file, &transforms, &mut frames)?);
    let held_out = ["transforms_test.json", "transforms_val.json"].map(|name| root.join(name));
    if let Some(other) =
        held_out.iter().find(|other| other.is_file()).filter(|other| *other != file)
    {
        warnings.extend(add_held_out(&mut frames, &mut broken, other, options)?);
    }
    if frames.is_empty() && broken.is_empty() {
        return Err(Error::malformed(
            file,
            "frames",
            "is empty; a data set needs at least one photo",
        ));
    }
    let kind = DatasetKind::Transforms;
    let list = file.to_owned();
    let photos = frames;
    Ok(DatasetListing { kind, root, list, photos, broken, points, warnings })
}

impl Transforms {
    /// The frames with a pose; the others are removed, and added to `broken`.
    fn take_photos(
        &mut self,
        files: &mut NamedFiles,
        broken: &mut Vec<(String, Error)>,
    ) -> Result<Vec<ListedPhoto>> {
        let mut frames = Vec::with_capacity(self.frames.len());
        let rows = std::mem::take(&mut self.frames);
        for (index, row) in rows.into_iter().enumerate() {
            match frame(files, index, &row, &self.shared)? {
                Ok(photo) => {
                    frames.push(photo);
                    self.frames.push(row);
                }
                Err(fault) => broken.push(fault),
            }
        }
        Ok(frames)
    }
}

/// Holds out the photos that the file's own lists name, and leaves out those in none of them.
/// Returns a warning.
fn split(
    file: &Path,
    transforms: &Transforms,
    frames: &mut Vec<ListedPhoto>,
) -> Result<Option<String>> {
    let Transforms { train_filenames, val_filenames, test_filenames, .. } = transforms;
    let some = |list: &&Vec<String>| !list.is_empty();
    let held_out = test_filenames.as_ref().filter(some).or(val_filenames.as_ref().filter(some));
    let set = |list: &Vec<String>| list.iter().map(|name| plain(name)).collect::<HashSet<String>>();
    let train = train_filenames.as_ref().filter(some).map(set);
    let held_out = held_out.map(set);
    let mut names = transforms.frames.iter().map(|row| plain(&row.file_path));
    let total = frames.len();
    let mut matched = 0;
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
fn points(file: &Path, ply: &Path, limits: &Limits) -> Result<Vec<ListedPoint>> {
    if !ply.exists() {
        let reason = format!(
            "{} does not exist; restore it, or remove the key to have points found",
            ply.display()
        );
        return Err(Error::malformed(file, "ply_file_path", reason));
    }
    read_ply(ply, limits)
}

fn parse(file: &Path, limits: &Limits) -> Result<Transforms> {
    let mut text = input::read_text(file, limits)?;
    if text.contains("NaN") || text.contains("Infinity") {
        text = quoted(&text);
    }
    serde_json::from_str(&text).map_err(|e| {
        foreign_json(file, text.as_bytes()).unwrap_or_else(|| {
            let at = format!("line {} column {}", e.line(), e.column());
            Error::malformed(file, at, format!("is not a transforms.json: {e}"))
        })
    })
}

/// Numbers as Python writes them, which JSON has not.
const NOT_FINITE: [&str; 3] = ["NaN", "-Infinity", "Infinity"];

/// The text with Python's NaN and Infinity as strings, which are refused where a number is used.
pub(super) fn quoted(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    let mut inside = false;
    while let Some(first) = rest.chars().next() {
        let word = NOT_FINITE.into_iter().find(|word| !inside && rest.starts_with(word));
        let taken = match word {
            Some(word) => word.len(),
            None if first == '\\' => {
                first.len_utf8() + rest[1..].chars().next().map_or(0, char::len_utf8)
            }
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

/// Adds the frames of another file, held out; a photo in both files is held out too. Returns
/// warnings.
fn add_held_out(
    frames: &mut Vec<ListedPhoto>,
    broken: &mut Vec<(String, Error)>,
    file: &Path,
    options: &DatasetOptions,
) -> Result<Vec<String>> {
    let mut transforms = parse(file, &options.limits)?;
    let root = file.parent().unwrap_or(Path::new(""));
    let mut files = NamedFiles::new(file, root, options);
    let mut index_of_name: HashMap<String, usize> =
        frames.iter().enumerate().map(|(i, f)| (f.name.clone(), i)).collect();
    for photo in transforms.take_photos(&mut files, broken)? {
        match index_of_name.get(&photo.name) {
            Some(&i) => frames[i].held_out = true,
            None => {
                index_of_name.insert(photo.name.clone(), frames.len());
                frames.push(ListedPhoto { held_out: true, ..photo });
            }
        }
    }
    Ok(files.warnings().collect())
}

/// A frame; or its name and what is wrong with its pose.
fn frame(
    files: &mut NamedFiles,
    index: usize,
    row: &FrameRow,
    shared: &Map<String, Value>,
) -> Result<Result<ListedPhoto, (String, Error)>> {
    let file = files.list;
    let place = format!("frame {index} `{}`", plain(&row.file_path));
    let path = files.find(&place, &row.file_path)?;
    let mask = row.mask_path.as_ref().map(|mask| files.find(&place, mask)).transpose()?;
    let bad = |reason: String| Error::malformed(file, &place, reason);
    let name = files.name_of(&path);
    let keys = Keys { own: &row.own, shared };
    let depth = match keys.value::<String>("depth_file_path").map_err(bad)? {
        Some(depth) => files.find_depth(&place, &depth)?,
        None => None,
    };
    let unit = keys.depth_unit().map_err(bad)?;
    let depth = depth.map(|path| DepthFile::linear(path, unit));
    let lens = keys
        .lens(keys.projection().map_err(|reason| Error::unsupported(file, reason))?)
        .map_err(bad)?;
    Ok(match keys.matrix().and_then(|matrix| pose(&matrix)) {
        Ok(pose) => {
            Ok(ListedPhoto { mask, depth, ..ListedPhoto::with_pose(name, path, pose, lens) })
        }
        Err(reason) => Err((name, bad(reason))),
    })
}

/// World to camera from camera to world.
fn pose(matrix: &[Vec<f64>]) -> Result<(DMat3, DVec3), String> {
    let is_row = |row: &Vec<f64>| row.len() == 4 && row.iter().all(|x| x.is_finite());
    if !(3..=4).contains(&matrix.len()) || !matrix.iter().all(is_row) {
        return Err("transform_matrix must have 3 or 4 rows of 4 finite numbers".into());
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
        return Err(
            "transform_matrix is not a rotation: its columns are not at right angles".into()
        );
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

/// The values of a frame: its own, and for missing ones those of all frames.
struct Keys<'a> {
    own: &'a Map<String, Value>,
    shared: &'a Map<String, Value>,
}

impl Keys<'_> {
    /// A value that is not null.
    fn value<T: DeserializeOwned>(&self, key: &str) -> Result<Option<T>, String> {
        let given =
            |values: &Map<String, Value>| values.get(key).filter(|value| !value.is_null()).cloned();
        let value = given(self.own).or_else(|| given(self.shared)).map(serde_json::from_value);
        value.transpose().map_err(|e| format!("{key}: {e}"))
    }

    /// The pose of the frame. Null and Python's NaN and Infinity, by now strings, are no numbers.
    fn matrix(&self) -> Result<Vec<Vec<f64>>, String> {
        let rows: Value = self.value("transform_matrix")?.ok_or("has no transform_matrix")?;
        let lists = rows.as_array().into_iter().flatten().filter_map(Value::as_array);
        for number in lists.flatten() {
            if number.is_null() || number.as_str().is_some_and(|word| NOT_FINITE.contains(&word)) {
                return Err("transform_matrix has a value that is not a finite number".into());
            }
        }
        serde_json::from_value(rows).map_err(|e| format!("transform_matrix: {e}"))
    }

    /// A number, or its place in the 3×3 matrix K.
    fn number(&self, key: &str) -> Result<Option<f64>, String> {
        let place = [("fl_x", 0, 0), ("skew", 0, 1), ("cx", 0, 2), ("fl_y", 1, 1), ("cy", 1, 2)];
        let place = place.iter().find(|(name, ..)| *name == key);
        // A frame with its own focal length does not inherit the shared angle, and vice versa.
        let own_focal =
            ["fl_x", "camera_angle_x", "K"].iter().any(|key| self.own.contains_key(*key));
        let inherits =
            !(own_focal && ["fl_x", "fl_y", "camera_angle_x", "camera_angle_y"].contains(&key));
        for values in [Some(self.own), Some(self.shared).filter(|_| inherits)].into_iter().flatten()
        {
            let in_matrix =
                || place.and_then(|(_, row, column)| Some(&values.get("K")?[*row][*column]));
            if let Some(value) = values.get(key).filter(|value| !value.is_null()).or_else(in_matrix)
            {
                // Python's NaN and Infinity, by now strings.
                let none = value.is_string();
                let why = |e| {
                    if none {
                        format!("{key} is not a finite number")
                    } else {
                        format!("{key}: {e}")
                    }
                };
                return f64::deserialize(value).map(Some).map_err(why);
            }
        }
        Ok(None)
    }

    /// World units of a code of depth maps: millimetres, as phones and nerfstudio have them.
    fn depth_unit(&self) -> Result<f64, String> {
        let unit = self.number("depth_unit_scale_factor")?.unwrap_or(1e-3);
        let is_unit = unit > 0.0 && unit.is_finite();
        is_unit
            .then_some(unit)
            .ok_or_else(|| format!("depth_unit_scale_factor is {unit}: expected a number above 0"))
    }

    fn projection(&self) -> Result<LensProjection, String> {
        let remedy = "undistort the photos first, or make pinhole views of them";
        let is = |key| self.value::<bool>(key).map(|flag| flag == Some(true));
        let model: Option<String> = self.value("camera_model")?;
        Ok(match model.as_deref() {
            _ if self.own.contains_key("ftheta_p0") || self.shared.contains_key("ftheta_p0") => {
                return Err(format!("the f-theta lens of ftheta_p0 is not read; {remedy}"));
            }
            _ if is("equirectangular")? => {
                return Err(format!(
                    "the equal-area panorama of `equirectangular` is not read; {remedy}"
                ));
            }
            _ if is("latlong")? => LensProjection::Spherical,
            _ if is("is_fisheye")? => LensProjection::Fisheye,
            None
            | Some(
                "OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL"
                | "perspective",
            ) => LensProjection::Perspective,
            Some("EQUIRECTANGULAR" | "SPHERICAL" | "equirectangular") => LensProjection::Spherical,
            Some(name)
                if name.to_ascii_uppercase().ends_with("FISHEYE")
                    && !name.starts_with("RAD_TAN") =>
            {
                LensProjection::Fisheye
            }
            Some(other) => return Err(format!("camera_model {other} is not read; {remedy}")),
        })
    }

    fn lens(&self, projection: LensProjection) -> Result<LensClaim, String> {
        let number = |key: &str| self.number(key);
        let zero = |key: &str| Ok::<_, String>(number(key)?.unwrap_or(0.0));
        let size = match (number("w")?, number("h")?) {
            (Some(w), Some(h)) if w >= 1.0 && h >= 1.0 && w.max(h) <= f64::from(1 << 20) => {
                Some(UVec2::new(w.round() as u32, h.round() as u32))
            }
            (Some(w), Some(h)) => return Err(format!("w and h are {w} and {h}")),
            _ => None,
        };
        let focal = [number("fl_x")?, number("fl_y")?];
        let mut distortion = Distortion {
            radial: [zero("k1")?, zero("k2")?, zero("k3")?, zero("k4")?],
            tangential: [zero("p1")?, zero("p2")?],
            prism: [zero("sx1")?, zero("sy1")?],
            skew: zero("skew")? / focal[0].unwrap_or(1.0),
            projection,
            limit: None,
        };
        let radius = number("fisheye_crop_radius")?
            .zip(focal[0])
            .map(|(radius, f)| DVec2::new(radius / f, 0.0));
        distortion.limit = radius.and_then(|at| Some(distortion.undistort(at)?.length()));
        let angle = [number("camera_angle_x")?, number("camera_angle_y")?];
        Ok(LensClaim { size, focal, angle, center: [number("cx")?, number("cy")?], distortion })
    }
}
