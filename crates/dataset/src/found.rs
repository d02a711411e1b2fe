//! The content of a data set's files, in f64, before any photo is opened. Files that it names must be in its folder.

use super::lens::{Distortion, Lens};
use super::points::PointFile;
use super::posed::DatasetKind;
use glam::{DMat3, DVec2, DVec3, UVec2};
use std::path::{Path, PathBuf};
use trisplat_scene::camera::{Camera, LENS};
use trisplat_scene::report::counted;
use trisplat_scene::{Error, Result, input};

/// A data set, from its files.
pub(super) struct FoundDataset {
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

/// Angles of a view, radians: at half a turn no focal length shows it.
const WIDEST: std::ops::RangeInclusive<f64> = 1e-5..=3.1;

impl LensClaim {
    /// The lens, with missing values from the photo: its size, square pixels, the principal point in the
    /// middle.
    pub(super) fn resolve(&self, photo: UVec2) -> std::result::Result<Lens, String> {
        let size = self.size.unwrap_or(photo);
        if size.min_element() == 0 {
            return Err(format!("its size is {}x{}", size.x, size.y));
        }
        let half = size.as_dvec2() / 2.0;
        if let Some(angle) = self.angle.iter().flatten().find(|angle| !WIDEST.contains(*angle)) {
            return Err(format!(
                "camera_angle is {angle}: expected radians above 0 and below π, as of one picture"
            ));
        }
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
        if !Camera::is_lens(focal, center, size) || numbers.iter().any(|k| !k.is_finite()) {
            return Err(format!("focal {focal}, center {center}: expected finite numbers, {LENS}"));
        }
        Ok(lens)
    }
}

/// The files of one list, relative to a folder.
#[derive(Debug)]
pub(super) struct NamedFiles<'a> {
    /// The file that names them, for messages.
    pub(super) list: &'a Path,
    /// What they are relative to.
    pub(super) folder: &'a Path,
    pub(super) allow_outside: bool,
    /// Number of absolute paths so far, and the first of them.
    absolute: (usize, Option<String>),
}

impl<'a> NamedFiles<'a> {
    /// None yet.
    pub(super) fn new(list: &'a Path, folder: &'a Path, allow_outside: bool) -> Self {
        Self { list, folder, allow_outside, absolute: (0, None) }
    }

    /// The path of the file `name`, which the list names at `place`. Errors: a file outside the folder
    /// without permission.
    pub(super) fn find(&mut self, place: &str, name: &str) -> Result<PathBuf> {
        let path = Path::new(name);
        if path.is_absolute() {
            self.absolute.0 += 1;
            self.absolute.1.get_or_insert_with(|| name.to_owned());
        } else if input::leaves_folder(path) && !self.allow_outside {
            let reason = format!(
                "names `{name}`, which is outside {}; if that is right, give `allow_outside`",
                if self.folder.as_os_str().is_empty() { Path::new(".") } else { self.folder }.display()
            );
            return Err(Error::malformed(self.list, place, reason));
        }
        Ok(self.folder.join(path))
    }

    /// The warning about absolute paths.
    pub(super) fn warning(self) -> Option<String> {
        let (count, first) = self.absolute;
        let (list, files) = (self.list.display(), counted(count as u64, "file"));
        first.map(|first| format!("{list} names {files} by an absolute path, first `{first}`"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lens_beyond_the_range_of_lenses_is_refused_with_a_reason() {
        let size = UVec2::new(640, 480);
        let resolved = |claim: LensClaim| claim.resolve(size);
        let of = |f: f64, cx: f64| LensClaim {
            focal: [Some(f); 2],
            center: [Some(cx), None],
            ..LensClaim::default()
        };
        assert!(resolved(of(500.0, 320.0)).is_ok() && resolved(of(500.0, -3000.0)).is_ok());
        for (f, cx) in [(1e30, 320.0), (500.0, 1e38), (1e-3, 320.0), (-500.0, 320.0), (f64::NAN, 320.0)] {
            let reason = resolved(of(f, cx)).unwrap_err();
            assert!(reason.contains("0.001 to 100,000 times the longer side"), "{reason}");
        }
        for angle in [7.0, std::f64::consts::PI, 0.0, -1.0, 45.0, f64::NAN] {
            let reason =
                resolved(LensClaim { angle: [Some(angle), None], ..LensClaim::default() }).unwrap_err();
            assert!(reason.contains("radians above 0 and below π"), "{reason}");
        }
        assert!(resolved(LensClaim { angle: [Some(3.0), None], ..LensClaim::default() }).is_ok());
    }

    #[test]
    fn a_path_that_leaves_the_folder_is_an_error_and_an_absolute_one_a_warning() {
        let (list, folder) = (Path::new("set/transforms.json"), Path::new("set"));
        let mut files = NamedFiles::new(list, folder, false);
        assert_eq!(files.find("frame 0", "images/../a.png").unwrap(), Path::new("set/images/../a.png"));
        let message = files.find("frame 1", "../secret.png").unwrap_err().to_string();
        assert!(message.starts_with("set/transforms.json: frame 1: names `../secret.png`"), "{message}");
        assert!(message.contains("`allow_outside`"), "{message}");
        assert_eq!(NamedFiles::new(list, folder, false).warning(), None);
        let mut allowed = NamedFiles::new(list, folder, true);
        assert_eq!(allowed.find("frame 1", "../a.png").unwrap(), Path::new("set/../a.png"));
        if cfg!(unix) {
            assert_eq!(files.find("frame 2", "/a.png").unwrap(), Path::new("/a.png"));
            assert!(files.warning().unwrap().contains("names 1 file by an absolute path, first `/a.png`"));
        }
    }
}
