//! `transforms.json` of nerfstudio, instant-ngp and Blender.
//!
//! Poses are camera to world with OpenGL axes (x right, y up, z back); ours are world to camera with
//! COLMAP's (x right, y down, z forward):
//!
//! ```text
//! R = (M diag(1, -1, -1))^T        t = -R c        M, c: rotation and column 3 of transform_matrix
//! ```

use super::found::{FoundDataset, FoundPhoto, LensClaim, NamedFiles};
use super::lens::Distortion;
use super::options::DatasetOptions;
use super::points::PointFile;
use super::posed::DatasetKind;
use glam::{DMat3, DVec3, UVec2};
use serde::Deserialize;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use trisplat_formats::foreign_json;
use trisplat_scene::{Error, Limits, Result, input};

/// The whole file; keys we do not know are ignored.
#[derive(Debug, Deserialize)]
struct Transforms {
    #[serde(flatten)]
    shared: Intrinsics,
    ply_file_path: Option<String>,
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
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    camera_model: Option<String>,
    is_fisheye: Option<bool>,
}

/// The file of a folder: all frames, or the training frames.
pub(super) fn locate(root: &Path) -> Option<PathBuf> {
    ["transforms.json", "transforms_train.json"].map(|f| root.join(f)).into_iter().find(|f| f.is_file())
}

/// Reads `file`, and beside it the held-out frames of `transforms_test.json`, or else of
/// `transforms_val.json`.
pub(super) fn read(file: &Path, options: &DatasetOptions) -> Result<FoundDataset> {
    let root = file.parent().unwrap_or(Path::new("")).to_owned();
    let transforms = parse(file, &options.limits)?;
    let mut files = NamedFiles::new(file, &root, options.allow_outside);
    let points = match &transforms.ply_file_path {
        Some(name) => point_file(file, files.find("ply_file_path", &name.replace('\\', "/"))?)?,
        None => PointFile::None,
    };
    let mut frames = Vec::with_capacity(transforms.frames.len());
    for (index, row) in transforms.frames.iter().enumerate() {
        frames.push(frame(&mut files, index, row, &transforms.shared, options)?);
    }
    let mut warnings: Vec<String> = files.warning().into_iter().collect();
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
    serde_json::from_str(&text).map_err(|e| {
        foreign_json(file, text.as_bytes()).unwrap_or_else(|| {
            let at = format!("line {} column {}", e.line(), e.column());
            Error::malformed(file, at, format!("is not a transforms.json: {e}"))
        })
    })
}

/// Adds the frames of another file, held out; a photo in both files is held out too. Returns warnings.
fn add_held_out(
    frames: &mut Vec<FoundPhoto>,
    file: &Path,
    root: &Path,
    options: &DatasetOptions,
) -> Result<Option<String>> {
    let transforms = parse(file, &options.limits)?;
    let mut files = NamedFiles::new(file, root, options.allow_outside);
    let mut known: HashMap<String, usize> =
        frames.iter().enumerate().map(|(i, f)| (f.name.clone(), i)).collect();
    for (index, row) in transforms.frames.iter().enumerate() {
        let held = frame(&mut files, index, row, &transforms.shared, options)?;
        match known.get(&held.name) {
            Some(&i) => frames[i].held_out = true,
            None => {
                known.insert(held.name.clone(), frames.len());
                frames.push(FoundPhoto { held_out: true, ..held });
            }
        }
    }
    Ok(files.warning())
}

fn frame(
    files: &mut NamedFiles,
    index: usize,
    row: &FrameRow,
    shared: &Intrinsics,
    options: &DatasetOptions,
) -> Result<FoundPhoto> {
    let relative = row.file_path.replace('\\', "/");
    let relative = relative.strip_prefix("./").unwrap_or(&relative);
    let (file, place) = (files.list, format!("frame {index} `{relative}`"));
    let path = with_extension(files.find(&place, relative)?);
    let mask = row.mask_path.as_ref().map(|mask| files.find(&place, &mask.replace('\\', "/"))).transpose()?;
    let bad = |reason: String| Error::malformed(file, &place, reason);
    let mut name = relative.to_owned();
    if Path::new(relative).extension() != path.extension()
        && let Some(extension) = path.extension().and_then(|e| e.to_str())
    {
        name = format!("{relative}.{extension}");
    }
    if let Ok(below) = Path::new(&name).strip_prefix(&options.images) {
        name = below.to_string_lossy().into_owned();
    }
    let (rotation, translation) = pose(&row.transform_matrix).map_err(bad)?;
    let lens = row.own.over(shared).lens().map_err(|reason| Error::unsupported(file, reason))?;
    Ok(FoundPhoto { name, path, mask, rotation, translation, lens, held_out: false })
}

/// Blender writes names without their extension.
pub(super) fn with_extension(path: PathBuf) -> PathBuf {
    if path.is_file() {
        return path;
    }
    let appended = |extension: &str| {
        let mut name = path.clone().into_os_string();
        name.push(extension);
        PathBuf::from(name)
    };
    let found = [".png", ".jpg", ".jpeg", ".webp", ".JPG"].map(appended).into_iter().find(|p| p.is_file());
    found.unwrap_or(path)
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
            camera_angle_x: angle(self.camera_angle_x, shared.camera_angle_x),
            camera_angle_y: angle(self.camera_angle_y, shared.camera_angle_y),
            camera_model: self.camera_model.clone().or(shared.camera_model.clone()),
            is_fisheye: self.is_fisheye.or(shared.is_fisheye),
        }
    }

    fn lens(&self) -> std::result::Result<LensClaim, String> {
        let remedy = "undistort the photos first, with `colmap image_undistorter` or `ns-process-data`";
        match self.camera_model.as_deref() {
            None
            | Some("OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "perspective") => {}
            Some(other) => return Err(format!("camera_model {other} is not read; {remedy}")),
        }
        if self.is_fisheye == Some(true) {
            return Err(format!("is_fisheye is not read; {remedy}"));
        }
        let zero = |k: Option<f64>| k.unwrap_or(0.0);
        let size = match (self.w, self.h) {
            (Some(w), Some(h)) if w >= 1.0 && h >= 1.0 && w.max(h) <= f64::from(1 << 20) => {
                Some(UVec2::new(w.round() as u32, h.round() as u32))
            }
            (Some(w), Some(h)) => return Err(format!("w and h are {w} and {h}")),
            _ => None,
        };
        Ok(LensClaim {
            size,
            focal: [self.fl_x, self.fl_y],
            angle: [self.camera_angle_x, self.camera_angle_y],
            center: [self.cx, self.cy],
            distortion: Distortion {
                radial: [zero(self.k1), zero(self.k2), zero(self.k3), zero(self.k4)],
                tangential: [zero(self.p1), zero(self.p2)],
            },
        })
    }
}
