//! The content of a data set's files, in f64, before any photo is opened.

use super::kind::DatasetKind;
use super::lens::{Distortion, Lens};
use super::point_file::PointFile;
use glam::{DMat3, DVec2, DVec3, UVec2};
use std::path::PathBuf;

/// A data set, from its files.
pub(super) struct Found {
    pub(super) kind: DatasetKind,
    /// Folder of `test.txt` and `masks`.
    pub(super) root: PathBuf,
    /// The file that lists the photos, for messages.
    pub(super) list: PathBuf,
    pub(super) photos: Vec<FoundPhoto>,
    pub(super) points: PointFile,
    pub(super) warnings: Vec<String>,
}

/// A posed photo, from its files.
pub(super) struct FoundPhoto {
    pub(super) name: String,
    pub(super) path: PathBuf,
    pub(super) mask: Option<PathBuf>,
    /// World to camera, COLMAP axes: pixel ~ rotation * world + translation.
    pub(super) rotation: DMat3,
    pub(super) translation: DVec3,
    pub(super) lens: LensClaim,
    /// Held out by the file itself.
    pub(super) held_out: bool,
}

/// A lens with missing values, which the photo's size fills.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct LensClaim {
    pub(super) size: Option<UVec2>,
    pub(super) focal: [Option<f64>; 2],
    pub(super) angle: [Option<f64>; 2],
    pub(super) center: [Option<f64>; 2],
    pub(super) distortion: Distortion,
}

impl LensClaim {
    /// The lens, with missing values from the photo: its size, square pixels, the principal point in the
    /// middle.
    pub(super) fn resolve(&self, photo: UVec2) -> std::result::Result<Lens, String> {
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
            (None, None) => return Err("no focal length: expected fl_x or camera_angle_x".into()),
        };
        let center = DVec2::new(self.center[0].unwrap_or(half.x), self.center[1].unwrap_or(half.y));
        let lens = Lens { size, focal, center, distortion: self.distortion };
        let numbers = [self.distortion.radial.as_slice(), &self.distortion.tangential].concat();
        if !(focal.min_element() > 0.0 && focal.is_finite() && center.is_finite())
            || numbers.iter().any(|k| !k.is_finite())
        {
            return Err(format!("focal {focal}, center {center}: expected finite numbers, focal > 0"));
        }
        Ok(lens)
    }
}
