//! Figures of a data set, for `trisplat info`, and its files, which no command may overwrite.

use super::colmap::{numbered_folders, with_photos};
use super::dataset::{Dataset, DatasetKind, Reprojection, View};
use super::depth_scale::depth_error;
use super::listing::{is_json, with_extension};
use super::realityscan;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::{Path, PathBuf};
use trisplat_scene::input::{self, files_below};
use trisplat_scene::math::geometry;
use trisplat_scene::math::lists::evenly_spaced;
use trisplat_scene::{Limits, Result, parallel};

/// A data set in figures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "trisplat data set")]
pub struct Description {
    /// Format of its list of poses.
    pub kind: DatasetKind,
    /// Photos to train on.
    pub train: u64,
    /// Photos held out.
    pub test: u64,
    /// Cameras that differ in more than their pose, commonest first.
    pub cameras: Vec<CameraGroup>,
    /// Photos with a mask.
    pub masks: u64,
    /// Photos with a depth map.
    pub depths: u64,
    /// Median error of the depth maps at the points, as a share of the depth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth_error: Option<f64>,
    /// Photos that show an object without background, by their opacity or mask.
    pub cut: u64,
    /// Number of photos whose lens distortion is removed during reading.
    pub undistorted: u64,
    /// Bytes of all photos once decoded.
    pub decoded_bytes: u64,
    /// Diagonal of the box around the cameras, world units.
    pub camera_extent: f64,
    /// Points of the sparse cloud.
    pub points: u64,
    /// Bounds of the middle 98% of the points along each axis, world units.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub point_bounds: Option<[[f64; 3]; 2]>,
    /// Mean error that the file states for its points, px.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stated_error_px: Option<f64>,
    /// Measured reprojection errors.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reprojection: Option<Reprojection>,
    /// The world point that positions are relative to, when the scene is far from the world's
    /// origin.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<[f64; 3]>,
    /// Notes for the user, one sentence each.
    pub warnings: Vec<String>,
}

/// Photos taken with the same camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CameraGroup {
    /// Number of photos.
    pub photos: u64,
    /// Width and height as delivered, px.
    pub size: [u32; 2],
    /// Width and height of the files, px.
    pub stored: [u32; 2],
    /// Focal lengths, px.
    pub focal: [f64; 2],
    /// Principal point, px.
    pub center: [f64; 2],
    /// Horizontal field of view, degrees.
    pub field_of_view: f64,
}

/// The figures of a data set.
///
/// # Errors
///
/// A COLMAP model that cannot be read again with its observations.
pub fn describe(dataset: &Dataset, limits: &Limits) -> Result<Description> {
    let views = &dataset.views;
    let stated_errors: Vec<f64> =
        dataset.points.iter().filter_map(|p| p.error).map(f64::from).collect();
    let count = |keep: &dyn Fn(&View) -> bool| views.iter().filter(|v| keep(v)).count() as u64;
    let pixels = |v: &View| u64::from(v.camera.size.x) * u64::from(v.camera.size.y);
    let origin = dataset.origin;
    let is_opaque = is_opaque(views);
    let around = geometry::bounds(views.iter().map(|v| v.camera.position()));
    Ok(Description {
        kind: dataset.kind,
        train: count(&|v| !v.test),
        test: count(&|v| v.test),
        cameras: cameras(views),
        masks: count(&|v| v.photo.mask.is_some()),
        depths: count(&|v| v.photo.depth.is_some()),
        depth_error: depth_error(dataset)?,
        cut: count(&|v| v.photo.is_cut() && !(is_opaque && v.photo.mask.is_none())),
        undistorted: count(&|v| v.photo.undistort.is_some()),
        decoded_bytes: views
            .iter()
            .map(|v| pixels(v) * if v.photo.mask.is_some() { 4 } else { 3 })
            .sum(),
        camera_extent: around.map_or(0.0, |[low, high]| low.distance(high).into()),
        points: dataset.points.len() as u64,
        point_bounds: bounds(dataset),
        stated_error_px: (!stated_errors.is_empty())
            .then(|| stated_errors.iter().sum::<f64>() / stated_errors.len() as f64),
        reprojection: dataset.reprojection(limits)?,
        origin: (origin != glam::DVec3::ZERO).then(|| origin.to_array()),
        warnings: dataset.warnings.clone(),
    })
}

/// Maximum number of photos decoded to find transparent pixels.
const MAX_SAMPLES: usize = 12;

/// True where photos have opacity, all of it full: they show no object without background.
fn is_opaque(views: &[View]) -> bool {
    let with_opacity: Vec<&View> =
        views.iter().filter(|view| view.photo.is_cut() && view.photo.mask.is_none()).collect();
    let sample: Vec<&View> =
        evenly_spaced(with_opacity.len(), MAX_SAMPLES).map(|i| with_opacity[i]).collect();
    // Who reads the photos reports those that cannot be decoded.
    let is_opaque = |view: &&View| view.photo.decode().is_ok_and(|photo| photo.alpha.is_none());
    !sample.is_empty() && parallel::map(&sample, |_, view| is_opaque(view)).into_iter().all(|is| is)
}

fn cameras(views: &[View]) -> Vec<CameraGroup> {
    let mut groups: Vec<CameraGroup> = Vec::new();
    for view in views {
        let camera = &view.camera;
        let width = f64::from(camera.size.x);
        let group = CameraGroup {
            photos: 1,
            size: camera.size.to_array(),
            stored: view.photo.stored.to_array(),
            focal: camera.focal.as_dvec2().to_array(),
            center: camera.center.as_dvec2().to_array(),
            field_of_view: 2.0 * (width / 2.0 / f64::from(camera.focal.x)).atan().to_degrees(),
        };
        let same =
            |other: &&mut CameraGroup| CameraGroup { photos: 1, ..(**other).clone() } == group;
        match groups.iter_mut().find(same) {
            Some(other) => other.photos += 1,
            None => groups.push(group),
        }
    }
    groups.sort_by_key(|group| std::cmp::Reverse(group.photos));
    groups
}

/// From the 1st to the 99th percentile along each axis: a few outliers must not determine it.
fn bounds(dataset: &Dataset) -> Option<[[f64; 3]; 2]> {
    let last = dataset.points.len().checked_sub(1)?;
    let axis = |axis: usize| {
        let mut values: Vec<f64> = dataset
            .points
            .iter()
            .map(|p| f64::from(p.position[axis]) + dataset.origin[axis])
            .collect();
        values.sort_by(f64::total_cmp);
        [values[last / 100], values[last - last / 100]]
    };
    let [x, y, z] = [axis(0), axis(1), axis(2)];
    Some([[x[0], y[0], z[0]], [x[1], y[1], z[1]]])
}

/// The beginnings of the names of files with poses, points and the split.
const NAMES: [&str; 9] = [
    "transforms",
    "test.txt",
    "cameras.",
    "images.",
    "points3D.",
    "rigs.",
    "poses_bounds.npy",
    "metadata",
    "depth_params.json",
];
/// Folders of a data set that hold such files; each may have numbered ones.
const FOLDERS: [&str; 3] = ["", "sparse", "colmap/sparse"];
/// The folders of masks and depth maps.
const BESIDE_PHOTOS: [&str; 3] = ["masks", "depths", "depth"];
/// The folders of photos and poses that apps of phones export.
const APPS: [&str; 3] = ["keyframes", "rgb", "rgbd"];

impl Dataset {
    /// The files of the data set at `path`, a folder or a file, and what they name: poses, points,
    /// photos in the folder `images` and elsewhere, masks. Nothing is decoded, and what cannot be
    /// read names nothing.
    pub fn files(path: &Path, images: &Path, limits: &Limits) -> Vec<PathBuf> {
        let root = match path.is_dir() {
            true => path,
            false if json(path, limits)["frames"].as_array().is_none_or(Vec::is_empty) => {
                return vec![path.to_owned()];
            }
            false => path.parent().unwrap_or(Path::new("")),
        };
        let mut files = vec![path.to_owned()];
        // A model may be given by its own folder, below that of the photos.
        let is_model = ["images.bin", "images.txt"].iter().any(|name| root.join(name).is_file());
        let above =
            is_model.then(|| with_photos(root, images)).flatten().filter(|above| *above != root);
        let roots: Vec<&Path> = std::iter::once(root).chain(above).collect();
        for root in roots {
            files.extend(Self::pose_files(root));
            let beside = BESIDE_PHOTOS.into_iter().chain(APPS).map(Path::new);
            for folder in std::iter::once(images).chain(beside) {
                // Photos may lie beside everything else.
                let is_one =
                    |path: &PathBuf| image::ImageFormat::from_path(path).is_ok() || is_json(path);
                files.extend(files_below(&root.join(folder)).into_iter().filter(is_one));
            }
        }
        let lists = files.iter().filter(|file| is_json(file));
        let listed_files: Vec<PathBuf> =
            lists.flat_map(|file| files_of_list(&json(file, limits), root)).collect();
        files.extend(listed_files);
        files
    }

    /// The files below the folder `root` with poses, points and the split, whatever program wrote
    /// them, in order of their paths.
    pub fn pose_files(root: &Path) -> Vec<PathBuf> {
        let mut files = Vec::from_iter(realityscan::locate(root));
        for folder in FOLDERS.map(|folder| root.join(folder)) {
            numbered_folders(&folder).iter().for_each(|model| files.extend(poses(model)));
            files.extend(poses(&folder));
        }
        files.sort();
        files
    }
}

/// The files of poses in `folder` itself.
fn poses(folder: &Path) -> Vec<PathBuf> {
    let begins = |name: &str| NAMES.iter().any(|start| name.starts_with(start));
    let is_one =
        |path: &PathBuf| path.file_name().and_then(|name| name.to_str()).is_some_and(begins);
    input::entries(folder).filter(|path| is_one(path) && path.is_file()).collect()
}

/// A JSON file; null if it cannot be read.
fn json(file: &Path, limits: &Limits) -> Value {
    let text = input::read_text(file, limits).unwrap_or_default();
    serde_json::from_str(&text).unwrap_or_default()
}

/// The files that a `transforms.json` names.
fn files_of_list(list: &Value, root: &Path) -> Vec<PathBuf> {
    let path = |name: &Value| Some(root.join(name.as_str()?.replace('\\', "/")));
    let frames = list["frames"].as_array().into_iter().flatten();
    let photos = frames.flat_map(|frame| {
        let photo = path(&frame["file_path"]).map(with_extension);
        [photo, path(&frame["mask_path"]), path(&frame["depth_file_path"])]
    });
    photos.chain([path(&list["ply_file_path"])]).flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn describe_finds_poses_points_photos_and_masks_unread() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in [
            "sparse/0/images.bin",
            "sparse/1/images.bin",
            "poses_bounds.npy",
            "cameras.xml",
            "images/a/1.png",
            "masks/a/1.png",
            "other/2.jpg",
            "test.txt",
            "scene.ply",
        ] {
            std::fs::create_dir_all(at(name).parent().unwrap()).unwrap();
            std::fs::write(at(name), "").unwrap();
        }
        #[cfg(unix)]
        std::os::unix::fs::symlink(folder.path(), at("images/again")).unwrap();
        std::fs::write(at("table.csv"), "#name,x,y,alt").unwrap();
        let json = r#"{"ply_file_path": "points.ply", "frames": [{"file_path": "other\\2", "mask_path": "m.png"}]}"#;
        std::fs::write(at("transforms.json"), json).unwrap();
        let found = Dataset::files(folder.path(), Path::new("images"), &Limits::DEFAULT);
        let wanted = [
            "sparse/0/images.bin",
            "sparse/1/images.bin",
            "poses_bounds.npy",
            "cameras.xml",
            "table.csv",
            "images/a/1.png",
            "masks/a/1.png",
            "other/2.jpg",
            "m.png",
            "test.txt",
            "points.ply",
            "transforms.json",
        ];
        wanted.iter().for_each(|name| assert!(found.contains(&at(name)), "{name}: {found:?}"));
        assert!(!found.contains(&at("scene.ply")), "{found:?}");
        let same = |path: PathBuf| Dataset::files(&path, Path::new("images"), &Limits::DEFAULT);
        assert!(same(at("transforms.json")).contains(&at("other/2.jpg")));
        assert!(same(at("sparse/0")).contains(&at("images/a/1.png")), "by the folder of the model");
        std::fs::write(at("options.json"), "{}").unwrap();
        assert_eq!(same(at("options.json")), [at("options.json")]);
    }
}
