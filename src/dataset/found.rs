//! What the readers find, and the steps that are the same for all of them: check the photos, straighten
//! the lenses, shrink, split.

use super::lens::{Distortion, Lens};
use super::options::{DatasetOptions, Masks};
use super::undistort::Undistort;
use super::{Dataset, Photo, Point, Reprojection, View, colmap, split, transforms};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::image::Pixels;
use glam::{DMat3, DVec2, DVec3, UVec2};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// A data set as its files describe it, in f64.
pub(super) struct Found {
    pub(super) kind: &'static str,
    /// Folder that `test.txt` and `masks` are looked for in.
    pub(super) root: PathBuf,
    /// The file that lists the photos, for messages.
    pub(super) list: PathBuf,
    pub(super) frames: Vec<Frame>,
    pub(super) points: Vec<FoundPoint>,
    pub(super) reprojection: Option<Reprojection>,
    pub(super) warnings: Vec<String>,
}

/// A posed photo as its files describe it.
pub(super) struct Frame {
    pub(super) name: String,
    pub(super) photo: PathBuf,
    pub(super) mask: Option<PathBuf>,
    /// World to camera, COLMAP axes: pixel ~ rotation * world + translation.
    pub(super) rotation: DMat3,
    pub(super) translation: DVec3,
    pub(super) lens: LensClaim,
    /// Named as held out by the file itself.
    pub(super) held_out: bool,
}

/// A lens whose gaps are filled from the photo's size.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct LensClaim {
    pub(super) size: Option<UVec2>,
    pub(super) focal: [Option<f64>; 2],
    pub(super) angle: [Option<f64>; 2],
    pub(super) center: [Option<f64>; 2],
    pub(super) distortion: Distortion,
}

/// A point of the cloud in f64.
pub(super) struct FoundPoint {
    pub(super) position: DVec3,
    pub(super) rgb: [u8; 3],
    pub(super) error: Option<f32>,
}

/// Reads the files at `path`, whichever kind they are.
pub(super) fn find(path: &Path, options: &DatasetOptions) -> Result<Found> {
    let meta = std::fs::metadata(path).map_err(|e| Error::io(path, e))?;
    if meta.is_file() {
        if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json")) {
            return transforms::read(path, options);
        }
        return Err(Error::unsupported(path, "is not a data set; give its folder or its transforms.json"));
    }
    if let Some(model) = colmap::locate(path) {
        return colmap::read(path, &model, options);
    }
    if let Some(file) = transforms::locate(path) {
        return transforms::read(&file, options);
    }
    Err(Error::unsupported(
        path,
        "holds no posed photos: wants a COLMAP model (sparse/0 with cameras, images and points3D as .bin or \
         .txt) or a transforms.json; run COLMAP on the photos first",
    ))
}

/// Makes a data set of what was found.
pub(super) fn finish(path: &Path, mut found: Found, options: &DatasetOptions) -> Result<Dataset> {
    found.frames.sort_by(|a, b| a.name.cmp(&b.name));
    if let Some(pair) = found.frames.windows(2).find(|pair| pair[0].name == pair[1].name) {
        let reason = "is listed twice; remove one of the two";
        return Err(Error::malformed(&found.list, format!("photo `{}`", pair[0].name), reason));
    }
    find_masks(&mut found, options);
    let origin = far_origin(&found);
    let views = open_views(&mut found, origin, options)?;
    let mut dataset = Dataset {
        path: path.to_owned(),
        kind: found.kind,
        views,
        points: Vec::new(),
        origin,
        reprojection: found.reprojection,
        warnings: found.warnings,
    };
    dataset.points = keep_points(&found.points, origin, &mut dataset.warnings);
    split::apply(&mut dataset, &found.root, options)?;
    Ok(dataset)
}

/// Opens every photo as far as its header and makes it a view.
fn open_views(found: &mut Found, origin: DVec3, options: &DatasetOptions) -> Result<Vec<View>> {
    let opened: Vec<Result<(View, Option<String>)>> =
        found.frames.par_iter().map(|frame| open_view(frame, origin, options)).collect();
    let total = opened.len();
    let mut views = Vec::with_capacity(total);
    let mut resized = Vec::new();
    let mut broken = Vec::new();
    for (frame, result) in found.frames.iter().zip(opened) {
        match result {
            Ok((view, warning)) => {
                views.push(view);
                resized.extend(warning);
            }
            Err(error @ (Error::Io { .. } | Error::Malformed { .. } | Error::Unsupported { .. })) => {
                broken.push((frame, error));
            }
            Err(error) => return Err(error),
        }
    }
    let count = |n: usize| format!("{n} of {total} photos {}", if n == 1 { "is" } else { "are" });
    let also = |n: usize| if n > 1 { format!(" (and {} more)", n - 1) } else { String::new() };
    if let Some(first) = resized.first() {
        found.warnings.push(format!("{first}{}", also(resized.len())));
    }
    if let Some((frame, error)) = broken.first() {
        let broken = format!("{} missing or broken", count(broken.len()));
        if !options.skip_broken {
            let reason = format!("{error}; {broken}: mend them, or go on without with --skip-broken");
            return Err(Error::malformed(&found.list, format!("photo `{}`", frame.name), reason));
        }
        found.warnings.push(format!("{broken} and left out, first {error}"));
    }
    if views.is_empty() {
        return Err(Error::unsupported(&found.list, "no photo is left; a data set wants at least one"));
    }
    Ok(views)
}

/// One view, and a warning when its photo has another size than its camera.
fn open_view(frame: &Frame, origin: DVec3, options: &DatasetOptions) -> Result<(View, Option<String>)> {
    let stored = Pixels::size_of(&frame.photo)?;
    let at_fault = |reason: String| Error::malformed(&frame.photo, "camera", reason);
    let claimed = frame.lens.resolve(stored).map_err(at_fault)?;
    let warning = check_shape(&claimed, stored).map_err(at_fault)?;
    let lens = claimed.resized(stored);
    let undistort =
        if lens.distortion.is_none() { None } else { Some(Undistort::new(&lens).map_err(at_fault)?) };
    let pinhole = undistort.map_or(lens, |plan| plan.pinhole());
    let size = shrunk(pinhole.size, options.max_size);
    let pinhole = pinhole.resized(size);
    let camera = Camera {
        rotation: frame.rotation.as_mat3(),
        translation: (frame.translation + frame.rotation * origin).as_vec3(),
        focal: pinhole.focal.as_vec2(),
        center: pinhole.center.as_vec2(),
        size,
    };
    camera.validate().map_err(|e| at_fault(e.to_string()))?;
    let photo = Photo {
        path: frame.photo.clone(),
        mask: frame.mask.clone(),
        size,
        stored,
        undistort,
        background: options.background,
        masks: options.masks,
    };
    if options.skip_broken {
        photo.decode()?;
    }
    let view = View { name: frame.name.clone(), camera, photo, test: frame.held_out };
    Ok((view, warning.map(|w| format!("photo `{}`: {w}", frame.name))))
}

/// A camera may have been calibrated on the same photos at another size, but not at another shape.
fn check_shape(lens: &Lens, stored: UVec2) -> std::result::Result<Option<String>, String> {
    if lens.size == stored {
        return Ok(None);
    }
    let sizes = format!("the photo is {}x{}, its camera {}x{}", stored.x, stored.y, lens.size.x, lens.size.y);
    let ratio = stored.as_dvec2() / lens.size.as_dvec2();
    // Shrinking rounds each side to whole pixels.
    let rounding = 1.0 / f64::from(stored.min_element()) + 0.005;
    if (ratio.x / ratio.y - 1.0).abs() > rounding {
        return Err(format!("{sizes}: give the photos the poses were made from, not rotated or cropped"));
    }
    Ok(Some(format!("{sizes}; the camera was scaled")))
}

/// The size of a photo whose longer side may be at most `max_size`.
fn shrunk(size: UVec2, max_size: Option<u32>) -> UVec2 {
    let longest = size.max_element();
    match max_size {
        Some(limit) if limit < longest => {
            let ratio = f64::from(limit) / f64::from(longest);
            (size.as_dvec2() * ratio).round().as_uvec2().max(UVec2::ONE)
        }
        _ => size,
    }
}

/// Looks for `masks/NAME.png` and `masks/NAME.jpg.png` (COLMAP's habit) where no mask is named.
fn find_masks(found: &mut Found, options: &DatasetOptions) {
    if options.masks == Masks::Off {
        found.frames.iter_mut().for_each(|frame| frame.mask = None);
        return;
    }
    let folder = found.root.join("masks");
    if !folder.is_dir() {
        return;
    }
    let mut without = 0;
    for frame in found.frames.iter_mut().filter(|frame| frame.mask.is_none()) {
        let beside = folder.join(&frame.name);
        let appended = folder.join(format!("{}.png", frame.name));
        frame.mask = [beside.with_extension("png"), appended].into_iter().find(|path| path.is_file());
        without += usize::from(frame.mask.is_none());
    }
    if without > 0 {
        let total = found.frames.len();
        found.warnings.push(format!("{without} of {total} photos have no picture in {}", folder.display()));
    }
}

/// Zero, or the middle of the cameras when the scene is so far from the world's origin that f32 could
/// not tell its detail apart: beyond 100 times its extent a millionth of the extent is lost.
fn far_origin(found: &Found) -> DVec3 {
    let centers: Vec<DVec3> =
        found.frames.iter().map(|f| -(f.rotation.transpose() * f.translation)).collect();
    let count = centers.len().max(1) as f64;
    let middle = centers.iter().sum::<DVec3>() / count;
    let mut extent = (centers.iter().map(|c| c.distance_squared(middle)).sum::<f64>() / count).sqrt();
    if !found.points.is_empty() {
        let mut distances: Vec<f64> = found.points.iter().map(|p| p.position.distance(middle)).collect();
        distances.sort_by(f64::total_cmp);
        extent = extent.max(distances[distances.len() / 2]);
    }
    // Whole numbers, so that adding the origin back is exact in a file that stores it.
    if middle.is_finite() && middle.length() > 100.0 * extent { middle.round() } else { DVec3::ZERO }
}

/// Points with finite positions, relative to the origin.
fn keep_points(points: &[FoundPoint], origin: DVec3, warnings: &mut Vec<String>) -> Vec<Point> {
    let kept: Vec<Point> = points
        .iter()
        .map(|p| Point { position: (p.position - origin).as_vec3(), rgb: p.rgb, error: p.error })
        .filter(|p| p.position.is_finite())
        .collect();
    if kept.len() < points.len() {
        warnings.push(format!("dropped {} points that are not finite", points.len() - kept.len()));
    }
    if kept.is_empty() {
        warnings.push("no points: training starts from a random cloud in front of the cameras".into());
    }
    kept
}

impl LensClaim {
    /// The lens, with what the file left out taken from the photo: its size, square pixels, the
    /// principal point in the middle.
    fn resolve(&self, photo: UVec2) -> std::result::Result<Lens, String> {
        let size = self.size.unwrap_or(photo);
        if size.min_element() == 0 {
            return Err(format!("its size is {}x{}", size.x, size.y));
        }
        let half = size.as_dvec2() / 2.0;
        let side = |i: usize| {
            let from_angle = self.angle[i].map(|angle| half[i] / (angle / 2.0).tan());
            self.focal[i].or(from_angle)
        };
        let focal = match (side(0), side(1)) {
            (Some(x), Some(y)) => DVec2::new(x, y),
            (Some(f), None) | (None, Some(f)) => DVec2::splat(f),
            (None, None) => return Err("no focal length: wants fl_x or camera_angle_x".into()),
        };
        let center = DVec2::new(self.center[0].unwrap_or(half.x), self.center[1].unwrap_or(half.y));
        let lens = Lens { size, focal, center, distortion: self.distortion };
        let numbers = [self.distortion.radial.as_slice(), &self.distortion.tangential].concat();
        if !(focal.min_element() > 0.0 && focal.is_finite() && center.is_finite())
            || numbers.iter().any(|k| !k.is_finite())
        {
            return Err(format!("focal {focal}, center {center}: wants finite numbers, focal > 0"));
        }
        Ok(lens)
    }
}
