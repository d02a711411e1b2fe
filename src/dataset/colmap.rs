//! COLMAP models: where they lie, what their cameras mean, how well they fit.

use super::Reprojection;
use super::found::{Found, FoundPoint, Frame, LensClaim};
use super::lens::{Distortion, Lens};
use super::options::DatasetOptions;
use super::{colmap_binary, colmap_text};
use crate::error::{Error, Result};
use glam::{DMat3, DQuat, DVec2, DVec3, UVec2, Vec2};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// A model as its three files hold it.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Model {
    pub(super) cameras: HashMap<u32, Lens>,
    pub(super) images: Vec<ImageRow>,
    pub(super) points: Vec<PointRow>,
}

/// A row of images.bin or images.txt.
#[derive(Debug, PartialEq)]
pub(super) struct ImageRow {
    pub(super) name: String,
    pub(super) camera: u32,
    pub(super) rotation: DMat3,
    pub(super) translation: DVec3,
    /// Which points were seen where, px.
    pub(super) sightings: Vec<(u64, Vec2)>,
}

/// A row of points3D.bin or points3D.txt.
#[derive(Debug, PartialEq)]
pub(super) struct PointRow {
    pub(super) id: u64,
    pub(super) position: DVec3,
    pub(super) rgb: [u8; 3],
    pub(super) error: f64,
}

/// Where a model lies and how it is written.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Place {
    pub(super) folder: PathBuf,
    pub(super) binary: bool,
}

/// The model of a data set: in `sparse/0`, `sparse`, `colmap/sparse/0` or the folder itself.
pub(super) fn locate(root: &Path) -> Option<Place> {
    let folders = ["sparse/0", "sparse", "colmap/sparse/0", ""].map(|f| root.join(f));
    folders.into_iter().find_map(|folder| {
        let has = |extension: &str| {
            ["cameras", "images"].iter().all(|name| folder.join(format!("{name}.{extension}")).is_file())
        };
        let binary = has("bin");
        (binary || has("txt")).then_some(Place { folder, binary })
    })
}

/// Reads the model and finds the photos it names.
pub(super) fn read(root: &Path, place: &Place, options: &DatasetOptions) -> Result<Found> {
    let read = if place.binary { colmap_binary::read } else { colmap_text::read };
    let mut warnings = Vec::new();
    let model = read(&place.folder, &mut warnings)?;
    let list = place.folder.join(if place.binary { "images.bin" } else { "images.txt" });
    if model.images.is_empty() {
        return Err(Error::malformed(&list, "images", "the model has no image; run COLMAP's mapper again"));
    }
    let root = photo_root(root, options)?;
    let photos = root.join(&options.images);
    let frames =
        model.images.iter().map(|image| frame(image, &model, &photos, &list)).collect::<Result<_>>()?;
    if place.folder.parent().is_some_and(|sparse| sparse.join("1").is_dir()) {
        warnings.push("the reconstruction fell into several models; only sparse/0 is used".into());
    }
    Ok(Found {
        kind: if place.binary { "COLMAP model (binary)" } else { "COLMAP model (text)" },
        reprojection: reprojection(&model),
        points: model.points.iter().map(found_point).collect(),
        root,
        list,
        frames,
        warnings,
    })
}

/// The folder that holds the folder of photos: the data set's, or a parent when the model's own folder
/// was given.
fn photo_root(root: &Path, options: &DatasetOptions) -> Result<PathBuf> {
    let candidates = [Some(root), root.parent(), root.parent().and_then(Path::parent)];
    match candidates.into_iter().flatten().find(|folder| folder.join(&options.images).is_dir()) {
        Some(folder) => Ok(folder.to_owned()),
        None => Err(Error::unsupported(
            root.join(&options.images),
            "is not there; put the photos of the COLMAP model into it, or name their folder with --images",
        )),
    }
}

fn frame(image: &ImageRow, model: &Model, photos: &Path, list: &Path) -> Result<Frame> {
    let lens = model.cameras.get(&image.camera).ok_or_else(|| {
        let reason = format!("its camera {} is not in the cameras file", image.camera);
        Error::malformed(list, format!("image `{}`", image.name), reason)
    })?;
    Ok(Frame {
        name: image.name.replace('\\', "/"),
        photo: photos.join(&image.name),
        mask: None,
        rotation: image.rotation,
        translation: image.translation,
        lens: LensClaim {
            size: Some(lens.size),
            focal: lens.focal.to_array().map(Some),
            angle: [None; 2],
            center: lens.center.to_array().map(Some),
            distortion: lens.distortion,
        },
        held_out: false,
    })
}

fn found_point(row: &PointRow) -> FoundPoint {
    // COLMAP writes -1 for a point that was never refined.
    let error = (row.error >= 0.0 && row.error.is_finite()).then_some(row.error as f32);
    FoundPoint { position: row.position, rgb: row.rgb, error }
}

/// Projects every point into every photo that saw it.
fn reprojection(model: &Model) -> Option<Reprojection> {
    let places: HashMap<u64, DVec3> = model.points.iter().map(|p| (p.id, p.position)).collect();
    let (mut sum, mut sightings, mut behind) = (0.0, 0u64, 0u64);
    for image in &model.images {
        let Some(lens) = model.cameras.get(&image.camera) else { continue };
        for (id, seen) in &image.sightings {
            let Some(&place) = places.get(id) else { continue };
            let v = image.rotation * place + image.translation;
            let error = lens.project(DVec2::new(v.x, v.y) / v.z).distance(seen.as_dvec2());
            if v.z > 0.0 && error.is_finite() {
                sum += error;
                sightings += 1;
            } else {
                behind += 1;
            }
        }
    }
    let mean_px = if sightings > 0 { sum / sightings as f64 } else { 0.0 };
    (sightings + behind > 0).then_some(Reprojection { mean_px, sightings, behind })
}

/// The rotation of a quaternion (w, x, y, z) of any length but zero.
pub(super) fn rotation(wxyz: [f64; 4]) -> Option<DMat3> {
    let q = DQuat::from_xyzw(wxyz[1], wxyz[2], wxyz[3], wxyz[0]);
    let length = q.length();
    (length > 1e-6 && length.is_finite()).then(|| DMat3::from_quat(q * (1.0 / length)))
}

/// COLMAP's camera models: number in binary files, name in text files, number of parameters.
const CAMERA_MODELS: [(&str, usize); 5] =
    [("SIMPLE_PINHOLE", 3), ("PINHOLE", 4), ("SIMPLE_RADIAL", 4), ("RADIAL", 5), ("OPENCV", 8)];

/// Models whose straightening is left to COLMAP.
const OTHER_MODELS: [&str; 7] = [
    "OPENCV_FISHEYE",
    "FULL_OPENCV",
    "FOV",
    "SIMPLE_RADIAL_FISHEYE",
    "RADIAL_FISHEYE",
    "THIN_PRISM_FISHEYE",
    "RAD_TAN_THIN_PRISM_FISHEYE",
];

/// The name of a camera model by its number in binary files.
pub(super) fn camera_model_name(number: i32) -> Option<&'static str> {
    let names = CAMERA_MODELS.iter().map(|(name, _)| *name).chain(OTHER_MODELS);
    usize::try_from(number).ok().and_then(|n| names.into_iter().nth(n))
}

/// How many parameters a camera model has. Fails for those we do not straighten.
pub(super) fn parameter_count(path: &Path, model: &str) -> Result<usize> {
    CAMERA_MODELS.iter().find(|(name, _)| *name == model).map(|(_, count)| *count).ok_or_else(|| {
        let ours = CAMERA_MODELS.map(|(name, _)| name).join(", ");
        let remedy = "run `colmap image_undistorter` and use its output";
        Error::unsupported(path, format!("camera model {model} is not read (only {ours}); {remedy}"))
    })
}

/// A lens from the parameters as COLMAP orders them.
pub(super) fn lens(path: &Path, model: &str, size: [u64; 2], params: &[f64]) -> Result<Lens> {
    let wrong = |reason: String| Error::malformed(path, format!("{model} camera"), reason);
    let want = parameter_count(path, model)?;
    if params.len() != want {
        return Err(wrong(format!("has {} parameters, wants {want}", params.len())));
    }
    let side = |pixels: u64| u32::try_from(pixels).ok().filter(|p| (1..=1 << 20).contains(p));
    let (Some(width), Some(height)) = (side(size[0]), side(size[1])) else {
        return Err(wrong(format!("its size is {}x{}", size[0], size[1])));
    };
    let (mut radial, mut tangential) = ([0.0; 4], [0.0; 2]);
    let (focal, center, rest) = match *params {
        [f, x, y] => ([f, f], [x, y], [].as_slice()),
        [fx, fy, x, y, ref rest @ ..] if matches!(model, "PINHOLE" | "OPENCV") => ([fx, fy], [x, y], rest),
        [f, x, y, ref rest @ ..] => ([f, f], [x, y], rest),
        _ => return Err(wrong(format!("has {} parameters", params.len()))),
    };
    for (k, value) in rest.iter().enumerate() {
        if k < 2 { radial[k] = *value } else { tangential[k - 2] = *value }
    }
    Ok(Lens {
        size: UVec2::new(width, height),
        focal: focal.into(),
        center: center.into(),
        distortion: Distortion { radial, tangential },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_land_where_colmap_means_them() {
        let path = Path::new("cameras.txt");
        let read = |model: &str, params: &[f64]| lens(path, model, [8, 6], params).unwrap();
        let pinhole = read("PINHOLE", &[1.0, 2.0, 3.0, 4.0]);
        assert_eq!((pinhole.focal, pinhole.center), (DVec2::new(1.0, 2.0), DVec2::new(3.0, 4.0)));
        assert!(pinhole.distortion.is_none());
        let simple = read("SIMPLE_RADIAL", &[1.0, 3.0, 4.0, 0.5]);
        assert_eq!((simple.focal, simple.center), (DVec2::splat(1.0), DVec2::new(3.0, 4.0)));
        assert_eq!(simple.distortion.radial, [0.5, 0.0, 0.0, 0.0]);
        let radial = read("RADIAL", &[1.0, 3.0, 4.0, 0.5, 0.25]);
        assert_eq!(radial.distortion.radial, [0.5, 0.25, 0.0, 0.0]);
        let opencv = read("OPENCV", &[1.0, 2.0, 3.0, 4.0, 0.1, 0.2, 0.3, 0.4]);
        assert_eq!(opencv.distortion.radial, [0.1, 0.2, 0.0, 0.0]);
        assert_eq!(opencv.distortion.tangential, [0.3, 0.4]);
        let error = lens(path, "OPENCV_FISHEYE", [8, 6], &[0.0; 8]).unwrap_err().to_string();
        assert!(error.contains("image_undistorter"), "{error}");
        assert_eq!(camera_model_name(4), Some("OPENCV"));
        assert_eq!(camera_model_name(5), Some("OPENCV_FISHEYE"));
        assert_eq!(camera_model_name(-1), None);
    }
}
