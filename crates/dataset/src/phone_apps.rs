//! Raw exports of Polycam and Record3D, as they lie in their folders.
//!
//! Both hold ARKit's poses: camera to world with OpenGL axes (x right, y up, z back), y up.
//!
//! * Polycam: `keyframes/cameras/*.json` has `t_00`..`t_23` of one photo of `keyframes/images`, and
//!   its lens. Where the app closed a loop, `corrected_cameras` and `corrected_images` are better.
//! * Record3D: `metadata` has `poses`, a quaternion x y z w and a place for each picture of `rgb` (or
//!   `rgbd`), and the lens: `K` by columns, or `perFrameIntrinsicCoeffs`.

use super::dataset::DatasetKind;
use super::listing::{DatasetListing, is_json};
use super::options::DatasetOptions;
use super::transforms::{FrameRow, TransformsList, quoted};
use glam::{DMat3, DQuat, DVec4};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use trisplat_scene::{Error, Limits, Result, input};

/// Folders of Polycam's cameras and of their photos, the better first.
const KEYFRAMES: [[&str; 2]; 2] =
    [["corrected_cameras", "corrected_images"], ["cameras", "images"]];
/// Names of Record3D's file.
const METADATA: [&str; 2] = ["metadata", "metadata.json"];
/// Folders of Record3D's photos.
const PICTURES: [&str; 2] = ["rgb", "rgbd"];
/// A key of Polycam's cameras, which tells them from other JSON.
const KEY: &str = "\"t_00\"";

/// Polycam's folder of cameras.
pub(super) fn locate_polycam(root: &Path) -> Option<PathBuf> {
    let folders = ["keyframes", ""].map(|place| root.join(place));
    let cameras =
        folders.iter().flat_map(|folder| KEYFRAMES.map(|[cameras, _]| folder.join(cameras)));
    cameras.into_iter().find(|folder| {
        let first = json_files(folder).into_iter().next();
        first.is_some_and(|file| {
            input::read_text(&file, &Limits::DEFAULT).is_ok_and(|text| text.contains(KEY))
        })
    })
}

/// Record3D's list of poses.
pub(super) fn locate_record3d(root: &Path) -> Option<PathBuf> {
    let has_pictures = PICTURES.iter().any(|folder| root.join(folder).is_dir());
    METADATA.map(|name| root.join(name)).into_iter().find(|file| has_pictures && file.is_file())
}

fn json_files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = input::entries(folder).filter(|path| is_json(path)).collect();
    files.sort();
    files
}

/// A JSON object that may have Python's NaN.
fn object(file: &Path, limits: &Limits) -> Result<Map<String, Value>> {
    let text = input::read_text(file, limits)?;
    serde_json::from_str(&quoted(&text)).map_err(|e| {
        let at = format!("line {} column {}", e.line(), e.column());
        Error::malformed(file, at, format!("is no JSON object: {e}; export it again"))
    })
}

/// Reads the cameras of Polycam in `cameras`, and finds their photos.
pub(super) fn read_polycam(cameras: &Path, options: &DatasetOptions) -> Result<DatasetListing> {
    let base = cameras.parent().unwrap_or(Path::new(""));
    let is_below = base.file_name().is_some_and(|name| name == "keyframes");
    let root = if is_below { base.parent().unwrap_or(Path::new("")) } else { base };
    let corrected = cameras.file_name().is_some_and(|name| name == KEYFRAMES[0][0]);
    let pictures = base.join(KEYFRAMES[usize::from(!corrected)][1]);
    let pictures = pictures.strip_prefix(root).unwrap_or(&pictures).to_owned();
    let mut frames = Vec::new();
    for file in json_files(cameras) {
        let camera = object(&file, &options.limits)?;
        let value = |key: &str| camera.get(key).cloned().unwrap_or_default();
        let row = |row: usize| (0..4).map(|column| value(&format!("t_{row}{column}"))).collect();
        let matrix: Vec<Vec<Value>> = (0..3).map(row).collect();
        let mut own = lens(["fx", "fy", "cx", "cy", "width", "height"].map(value));
        own.insert("transform_matrix".into(), json!(matrix));
        let stem = file.file_stem().unwrap_or_default().to_string_lossy();
        let file_path = format!("{}/{stem}", pictures.display());
        let depth = base.join("depth").join(format!("{stem}.png"));
        if depth.is_file() {
            let depth = depth.strip_prefix(root).unwrap_or(&depth);
            own.insert("depth_file_path".into(), json!(depth));
        }
        frames.push(FrameRow { file_path, mask_path: None, own });
    }
    let options = DatasetOptions { images: pictures, ..options.clone() };
    let list = TransformsList { kind: DatasetKind::Polycam, root, file: cameras };
    list.assemble(frames, &options)
}

/// Reads Record3D's `file`, and finds its photos.
pub(super) fn read_record3d(file: &Path, options: &DatasetOptions) -> Result<DatasetListing> {
    let root = file.parent().unwrap_or(Path::new(""));
    let metadata = object(file, &options.limits)?;
    let poses = metadata.get("poses").and_then(Value::as_array).ok_or_else(|| {
        let reason = "is missing: this is no metadata of Record3D; export the recording again";
        Error::malformed(file, "poses", reason)
    })?;
    let folder = PICTURES.into_iter().find(|folder| root.join(folder).is_dir()).unwrap_or("rgb");
    let pictures = numbered_pictures(&root.join(folder));
    let is_frame = |(number, _): &(usize, PathBuf)| *number < poses.len();
    if !pictures.iter().all(is_frame) || pictures.is_empty() {
        let reason = format!(
            "are {}, and {folder} holds {} pictures; export the recording again",
            poses.len(),
            pictures.len()
        );
        return Err(Error::malformed(file, "poses", reason));
    }
    let value = |key: &str| metadata.get(key).cloned().unwrap_or_default();
    let k = value("K");
    let lenses = value("perFrameIntrinsicCoeffs");
    let frame = |(number, path): &(usize, PathBuf)| {
        let each = &lenses[*number];
        let [fx, fy, cx, cy] = if each.is_array() {
            [0, 1, 2, 3].map(|i| each[i].clone())
        } else {
            [0, 4, 6, 7].map(|i| k[i].clone())
        };
        let mut own = lens([fx, fy, cx, cy, value("w"), value("h")]);
        own.insert("transform_matrix".into(), matrix(&poses[*number]));
        let name = path.strip_prefix(root).unwrap_or(path).to_string_lossy().into_owned();
        FrameRow { file_path: name, mask_path: None, own }
    };
    let frames = pictures.iter().map(frame).collect();
    let options = DatasetOptions { images: folder.into(), ..options.clone() };
    TransformsList { kind: DatasetKind::Record3d, root, file }.assemble(frames, &options)
}

/// The pictures of a folder and the numbers of their poses: their names where these are numbers,
/// else their places in order.
fn numbered_pictures(folder: &Path) -> Vec<(usize, PathBuf)> {
    let is_picture = |path: &PathBuf| image::ImageFormat::from_path(path).is_ok();
    let mut pictures: Vec<PathBuf> = input::entries(folder).filter(is_picture).collect();
    pictures.sort();
    let number = |path: &PathBuf| path.file_stem()?.to_str()?.parse::<usize>().ok();
    let numbers: Option<Vec<usize>> = pictures.iter().map(number).collect();
    let numbers = numbers.unwrap_or_else(|| (0..pictures.len()).collect());
    numbers.into_iter().zip(pictures).collect()
}

/// A pose as a matrix; null where it is none.
fn matrix(pose: &Value) -> Value {
    let number = |i: usize| pose[i].as_f64().unwrap_or(f64::NAN);
    let turn = DVec4::from([0, 1, 2, 3].map(number));
    let turn = DMat3::from_quat(DQuat::from_vec4(turn / turn.length()));
    let row = |row: usize| {
        let [x, y, z] = turn.row(row).to_array();
        [x, y, z, number(4 + row)]
    };
    json!([row(0), row(1), row(2)])
}

/// The keys of a lens in a `transforms.json`.
fn lens([fx, fy, cx, cy, w, h]: [Value; 6]) -> Map<String, Value> {
    let keys = ["fl_x", "fl_y", "cx", "cy", "w", "h"].map(str::to_owned);
    keys.into_iter().zip([fx, fy, cx, cy, w, h]).collect()
}

/// Says what a folder of another app is, and the way from it to a data set.
pub(super) fn other_app(root: &Path) -> Option<String> {
    let has = |name: &str| root.join(name).is_file();
    let app = match () {
        () if has("odometry.csv") => "Stray Scanner",
        () if has("info.json") && has("frame_00000.json") => "3D Scanner App",
        () => return None,
    };
    Some(format!(
        "is a recording of {app}, whose poses are not read: `trisplat capture {}` finds them from its pictures, and an export \
         for nerfstudio is read as its transforms.json",
        root.display()
    ))
}
