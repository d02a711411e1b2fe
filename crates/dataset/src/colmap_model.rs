//! A COLMAP model in memory, with the meaning of camera models and quaternions.

use super::lens::{Distortion, Lens, LensProjection};
use glam::{DMat3, DQuat, DVec3, UVec2, Vec2};
use std::collections::HashMap;
use std::path::Path;
use trisplat_scene::{Error, Result};

/// A model without its points, which are read one by one.
#[derive(Debug, Default)]
pub(super) struct ColmapModel {
    pub(super) cameras: HashMap<u32, Lens>,
    pub(super) images: Vec<ImageRow>,
    /// The names of images without a pose, and why.
    pub(super) broken: Vec<(String, Error)>,
}

impl ColmapModel {
    /// Adds an image with the quaternion (w, x, y, z) of its pose, which may have any length except
    /// zero; `malformed` makes the error of one that is none.
    pub(super) fn add_image(
        &mut self,
        mut image: ImageRow,
        wxyz: [f64; 4],
        malformed: impl Fn(String) -> Error,
    ) {
        let [w, x, y, z] = wxyz;
        let q = DQuat::from_xyzw(x, y, z, w);
        let length = q.length();
        if length > 1e-6 && length.is_finite() && image.translation.is_finite() {
            image.rotation = DMat3::from_quat(q * (1.0 / length));
            self.images.push(image);
        } else {
            let ImageRow { name, translation, .. } = image;
            let reason = format!("image `{name}` has no pose: {wxyz:?}, {translation}");
            self.broken.push((name, malformed(reason)));
        }
    }
}

/// A row of images.bin or images.txt.
#[derive(Debug, PartialEq)]
pub(super) struct ImageRow {
    pub(super) name: String,
    pub(super) camera: u32,
    pub(super) rotation: DMat3,
    pub(super) translation: DVec3,
    /// Observed points and their image positions, px.
    pub(super) observations: Vec<(u64, Vec2)>,
}

/// COLMAP's camera models in the order of their numbers in binary files: name, number of
/// parameters, 0 of those that are not read.
const CAMERA_MODELS: [(&str, usize); 18] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 0),
    ("FOV", 0),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 0),
    ("SIMPLE_DIVISION", 0),
    ("DIVISION", 0),
    ("SIMPLE_FISHEYE", 3),
    ("FISHEYE", 4),
    ("EUCM", 0),
    ("EQUIRECTANGULAR", 2),
];

/// The name of a camera model by its number in binary files.
pub(super) fn camera_model_name(number: i32) -> Option<&'static str> {
    usize::try_from(number).ok().and_then(|n| CAMERA_MODELS.get(n)).map(|(name, _)| *name)
}

/// Number of parameters of a camera model. Fails for models that are not read.
pub(super) fn parameter_count(path: &Path, model: &str) -> Result<usize> {
    let name = if model == "SPHERICAL" { "EQUIRECTANGULAR" } else { model };
    let read = || CAMERA_MODELS.iter().filter(|(_, count)| *count > 0);
    read().find(|(model, _)| *model == name).map(|(_, count)| *count).ok_or_else(|| {
        let ours = read().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
        let remedy = "run `colmap image_undistorter` and use its output";
        Error::unsupported(
            path,
            format!("camera model {model} is not read (only {ours}); {remedy}"),
        )
    })
}

/// A lens from the parameters in COLMAP's order.
pub(super) fn lens(path: &Path, model: &str, size: [u64; 2], params: &[f64]) -> Result<Lens> {
    let wrong = |reason: String| Error::malformed(path, format!("{model} camera"), reason);
    let want = parameter_count(path, model)?;
    if params.len() != want {
        return Err(wrong(format!("has {} parameters, expected {want}", params.len())));
    }
    let side = |pixels: u64| u32::try_from(pixels).ok().filter(|p| (1..=1 << 20).contains(p));
    let (Some(width), Some(height)) = (side(size[0]), side(size[1])) else {
        return Err(wrong(format!("its size is {}x{}", size[0], size[1])));
    };
    let size = UVec2::new(width, height);
    let two_focals =
        matches!(model, "PINHOLE" | "OPENCV" | "OPENCV_FISHEYE" | "THIN_PRISM_FISHEYE" | "FISHEYE");
    let (focal, center, rest) = match *params {
        [_, _] => return Ok(Lens::spherical(size)),
        [fx, fy, x, y, ref rest @ ..] if two_focals => ([fx, fy], [x, y], rest),
        [f, x, y, ref rest @ ..] => ([f, f], [x, y], rest),
        _ => return Err(wrong(format!("has {} parameters", params.len()))),
    };
    let order = match model {
        "OPENCV_FISHEYE" => [0, 1, 2, 3, 4, 5, 6, 7],
        _ => [0, 1, 4, 5, 2, 3, 6, 7], // k1 k2 p1 p2 k3 k4 sx1 sy1
    };
    let mut values = [0.0; 8];
    for (value, at) in rest.iter().zip(order) {
        values[at] = *value;
    }
    let [k1, k2, k3, k4, p1, p2, sx, sy] = values;
    let fisheye = model.ends_with("FISHEYE");
    let distortion = Distortion {
        radial: [k1, k2, k3, k4],
        tangential: [p1, p2],
        prism: [sx, sy],
        projection: if fisheye { LensProjection::Fisheye } else { LensProjection::Perspective },
        ..Distortion::default()
    };
    Ok(Lens { size, focal: focal.into(), center: center.into(), distortion })
}

/// A point of the cloud in f64.
#[derive(Debug, PartialEq)]
pub(super) struct ListedPoint {
    /// Its number in a COLMAP model.
    pub(super) id: u64,
    pub(super) position: DVec3,
    pub(super) rgb: [u8; 3],
    pub(super) error: Option<f32>,
}

impl ListedPoint {
    /// Of a row of points3D. COLMAP writes -1 as the error of a point that was never refined.
    pub(super) fn of(id: u64, position: DVec3, rgb: [u8; 3], error: f64) -> Self {
        let error = (error >= 0.0 && error.is_finite()).then_some(error as f32);
        Self { id, position, rgb, error }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    #[test]
    fn parameters_have_the_order_of_colmap() {
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
        let prism = [1.0, 2.0, 3.0, 4.0, 0.1, 0.2, 0.5, 0.6, 0.3, 0.4, 0.7, 0.8];
        let prism = read("THIN_PRISM_FISHEYE", &prism).distortion;
        assert_eq!(
            (prism.radial, prism.projection),
            ([0.1, 0.2, 0.3, 0.4], LensProjection::Fisheye)
        );
        assert_eq!((prism.tangential, prism.prism), ([0.5, 0.6], [0.7, 0.8]));
        let fisheye = read("OPENCV_FISHEYE", &[1.0, 2.0, 3.0, 4.0, 0.1, 0.2, 0.3, 0.4]).distortion;
        assert_eq!(fisheye.radial, [0.1, 0.2, 0.3, 0.4]);
        assert_eq!(read("SPHERICAL", &[8.0, 6.0]), Lens::spherical(UVec2::new(8, 6)));
        let error = lens(path, "FOV", [8, 6], &[0.0; 5]).unwrap_err().to_string();
        assert!(error.contains("image_undistorter"), "{error}");
        assert_eq!(camera_model_name(4), Some("OPENCV"));
        assert_eq!(camera_model_name(5), Some("OPENCV_FISHEYE"));
        assert_eq!(camera_model_name(-1), None);
    }
}
