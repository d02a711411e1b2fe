//! The list of a data set's photos from its files, in f64, before any photo is opened. Files that it
//! names must be in its folder.

use super::colmap_model::ListedPoint;
use super::dataset::DatasetKind;
use super::depth::DepthFile;
use super::lens::{Distortion, Lens, LensProjection};
use super::options::DatasetOptions;
use glam::{DMat3, DVec2, DVec3, UVec2};
use std::cell::OnceCell;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use trisplat_scene::camera::{Camera, LENS};
use trisplat_scene::report::counted;
use trisplat_scene::{Error, Result, input};

/// A data set, from its files.
pub(super) struct DatasetListing {
    pub(super) kind: DatasetKind,
    /// Folder of `test.txt` and `masks`.
    pub(super) root: PathBuf,
    /// The file that lists the photos, for messages.
    pub(super) list: PathBuf,
    pub(super) photos: Vec<ListedPhoto>,
    /// Photos whose pose is none, as not a number, and why.
    pub(super) broken: Vec<(String, Error)>,
    pub(super) points: Vec<ListedPoint>,
    pub(super) warnings: Vec<String>,
}

/// A posed photo, from its files.
pub(super) struct ListedPhoto {
    pub(super) name: String,
    pub(super) path: PathBuf,
    pub(super) mask: Option<PathBuf>,
    pub(super) depth: Option<DepthFile>,
    /// World to camera, COLMAP axes: pixel ~ rotation * world + translation.
    pub(super) rotation: DMat3,
    pub(super) translation: DVec3,
    pub(super) lens: LensClaim,
    /// Held out by the file itself.
    pub(super) held_out: bool,
    /// Indices of the points of its track entries.
    pub(super) tracked: Vec<u32>,
}

impl ListedPhoto {
    /// A photo with this pose (rotation and translation), to train on, without mask and tracks.
    pub(super) fn with_pose(
        name: String,
        path: PathBuf,
        pose: (DMat3, DVec3),
        lens: LensClaim,
    ) -> Self {
        let (rotation, translation) = pose;
        Self {
            name,
            path,
            mask: None,
            depth: None,
            rotation,
            translation,
            lens,
            held_out: false,
            tracked: Vec::new(),
        }
    }

    /// The place of its camera.
    pub(super) fn center(&self) -> DVec3 {
        -(self.rotation.transpose() * self.translation)
    }
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
    /// Complete values of a lens.
    pub(super) fn of(lens: &Lens) -> Self {
        Self {
            size: Some(lens.size),
            focal: lens.focal.to_array().map(Some),
            angle: [None; 2],
            center: lens.center.to_array().map(Some),
            distortion: lens.distortion,
        }
    }

    /// The lens, with missing values from the photo: its size, square pixels, the principal point
    /// in the middle.
    pub(super) fn resolve(&self, photo: UVec2) -> Result<Lens, String> {
        let size = self.size.unwrap_or(photo);
        if size.min_element() == 0 {
            return Err(format!("its size is {}x{}", size.x, size.y));
        }
        if self.distortion.projection == LensProjection::Spherical {
            return Ok(Lens::spherical(size));
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
        let Distortion { radial, tangential, prism, skew, .. } = self.distortion;
        let numbers = [&radial[..], &tangential, &prism, &[skew]].concat();
        if !Camera::is_lens(focal, center, size) || numbers.iter().any(|k| !k.is_finite()) {
            // As arrays the tiniest numbers are short, too.
            let [focal, center] = [focal, center].map(|v| v.to_array());
            return Err(format!(
                "focal {focal:?}, center {center:?}: expected finite numbers, {LENS}"
            ));
        }
        Ok(lens)
    }
}

/// The files of one list, relative to a folder.
#[derive(Debug)]
pub(super) struct NamedFiles<'a> {
    /// The file that names them, for messages.
    pub(super) list: &'a Path,
    /// Folder that they are relative to.
    pub(super) folder: &'a Path,
    /// The folder of photos, where files that are not in their place are looked for.
    photos: PathBuf,
    allow_outside: bool,
    /// Number of absolute paths so far, and the first of them.
    absolute: (usize, Option<String>),
    /// The same of files found in another place.
    moved: (usize, Option<String>),
    /// The same of depth maps that are missing or no pictures.
    without_depth: (usize, Option<String>),
    /// The pictures below the folder by name and by stem, in lower case, once they are needed.
    pictures: OnceCell<HashMap<String, Vec<PathBuf>>>,
}

impl<'a> NamedFiles<'a> {
    /// None yet.
    pub(super) fn new(list: &'a Path, folder: &'a Path, options: &DatasetOptions) -> Self {
        let photos = folder.join(&options.images);
        let allow_outside = options.allow_outside;
        let pictures = OnceCell::new();
        Self {
            list,
            folder,
            photos,
            allow_outside,
            absolute: (0, None),
            moved: (0, None),
            without_depth: (0, None),
            pictures,
        }
    }

    /// The path of the file `name`, which the list names at `place`: there, or else of the same
    /// name, perhaps with another extension, in the folder or that of photos, or in any folder
    /// below.
    ///
    /// # Errors
    ///
    /// A file outside the folder without permission; a name that several files have.
    pub(super) fn find(&mut self, place: &str, name: &str) -> Result<PathBuf> {
        let slashes = name.replace('\\', "/");
        let path = Path::new(slashes.strip_prefix("./").unwrap_or(&slashes));
        let foreign =
            path.is_absolute() || slashes.get(1..3) == Some(":/") || slashes.starts_with('/');
        let there = with_extension(self.folder.join(path));
        let leads_out = !foreign && input::leaves_folder(path);
        if there.is_file() && !leads_out {
            if foreign {
                self.absolute.0 += 1;
                self.absolute.1.get_or_insert_with(|| name.to_owned());
            }
            return Ok(there);
        }
        if leads_out && !self.allow_outside {
            let reason = format!(
                "names `{name}`, which is outside {}; if that is right, give `allow_outside`",
                if self.folder.as_os_str().is_empty() { Path::new(".") } else { self.folder }
                    .display()
            );
            return Err(Error::malformed(self.list, place, reason));
        }
        let found = match self.elsewhere(path) {
            None if !leads_out => self.below(place, path)?,
            found => found.filter(|_| !leads_out),
        };
        let Some(found) = found else { return Ok(there) };
        self.moved.0 += 1;
        self.moved.1.get_or_insert_with(|| format!("`{name}`, found as {}", found.display()));
        Ok(found)
    }

    /// The depth map `name`, if it is a picture in its place: pictures of the same name elsewhere
    /// are photos.
    ///
    /// # Errors
    ///
    /// A file outside the folder without permission.
    pub(super) fn find_depth(&mut self, place: &str, name: &str) -> Result<Option<PathBuf>> {
        let path = self.folder.join(name.replace('\\', "/"));
        if is_picture(&path) && path.is_file() {
            return self.find(place, name).map(Some);
        }
        self.without_depth.0 += 1;
        self.without_depth.1.get_or_insert_with(|| name.to_owned());
        Ok(None)
    }

    /// A file whose path ends as `path` does, as far as possible, or has its stem and another
    /// extension.
    fn elsewhere(&self, path: &Path) -> Option<PathBuf> {
        let parts: Vec<_> = path.iter().filter(|part| *part != "..").collect();
        let ends =
            || (1..parts.len()).chain([0]).map(|from| parts[from..].iter().collect::<PathBuf>());
        let ends = || ends().filter(|end| !end.has_root());
        let places = || ends().flat_map(|end| [self.folder.join(&end), self.photos.join(&end)]);
        let same = places().find(|place| place.is_file());
        same.or_else(|| {
            places().find_map(|place| {
                EXTENSIONS.map(|e| place.with_extension(e)).into_iter().find(|p| p.is_file())
            })
        })
    }

    /// The only picture of this name, or else of this stem, in any folder below.
    fn below(&self, place: &str, path: &Path) -> Result<Option<PathBuf>> {
        let pictures = self.pictures.get_or_init(|| pictures_below(self.folder));
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        let stem = Path::new(&name).file_stem().map(|stem| stem.to_string_lossy().into_owned());
        let same = pictures.get(&name).or_else(|| pictures.get(&stem?));
        match same.map_or(&[][..], Vec::as_slice) {
            [first, second, ..] => {
                Err(Error::malformed(self.list, place, namesakes(path, first, second)))
            }
            found => Ok(found.first().cloned()),
        }
    }

    /// The name of the photo at `path`: below the folder of photos, else below the folder.
    pub(super) fn name_of(&self, path: &Path) -> String {
        let below = path
            .strip_prefix(&self.photos)
            .or_else(|_| path.strip_prefix(self.folder))
            .unwrap_or(path);
        below.to_string_lossy().replace('\\', "/")
    }

    /// The warnings about files that are not in the folder, or not where the list says.
    pub(super) fn warnings(self) -> impl Iterator<Item = String> {
        let list = self.list.display().to_string();
        let counted =
            |(count, first): (usize, Option<String>)| Some((counted(count as u64, "file"), first?));
        let absolute = counted(self.absolute).map(|(files, first)| {
            format!("{list} names {files} by an absolute path, first `{first}`")
        });
        let moved = counted(self.moved).map(|(files, first)| {
            format!("{files} of {list} in another place than it says, first {first}")
        });
        let without_depth = counted(self.without_depth).map(|(files, first)| {
            format!("{files} of depth that {list} names are missing or no PNG, first `{first}`")
        });
        absolute.into_iter().chain(moved).chain(without_depth)
    }
}

/// Words that begin the names of folders beside photos: of small copies of them, or of pictures of
/// another kind that belong to them.
const BESIDE_PHOTOS: [&str; 12] = [
    "mask",
    "masks",
    "depth",
    "depths",
    "depthmap",
    "depthmaps",
    "normal",
    "normals",
    "confidence",
    "thumbs",
    "thumbnails",
    "__macosx",
];

/// True for the name of a folder of pictures beside photos, and of folders of systems and network
/// drives: `masks_2`, `@eaDir`, `#recycle`, `$RECYCLE.BIN`, `.git`.
pub(super) fn is_beside_photos(folder: &str) -> bool {
    let name = folder.to_lowercase();
    let is_word = |word: &str| {
        let rest = name.strip_prefix(word);
        rest.is_some_and(|rest| !rest.starts_with(char::is_alphabetic))
    };
    name.starts_with(['.', '@', '#', '$']) || BESIDE_PHOTOS.into_iter().any(is_word)
}

/// The pictures below `folder` by name and by stem, in lower case.
fn pictures_below(folder: &Path) -> HashMap<String, Vec<PathBuf>> {
    let mut pictures: HashMap<String, Vec<PathBuf>> = HashMap::new();
    let mut files = input::files_below(folder);
    files.sort();
    for path in files {
        let below = path.strip_prefix(folder).unwrap_or(&path).to_string_lossy().to_lowercase();
        let mut parts: Vec<&str> = below.split(['/', '\\']).collect();
        let name = parts.pop().unwrap_or_default();
        if is_picture(Path::new(name)) && !parts.iter().any(|part| is_beside_photos(part)) {
            let stem = Path::new(name).file_stem().unwrap_or_default().to_string_lossy();
            for key in [name, &stem] {
                pictures.entry(key.to_owned()).or_default().push(path.clone());
            }
        }
    }
    pictures
}

/// True for a name that ends like that of a photo.
pub(super) fn is_picture(path: &Path) -> bool {
    let ending = path.extension().unwrap_or_default();
    EXTENSIONS.iter().any(|known| ending.eq_ignore_ascii_case(known))
}

/// True for a name that ends like that of a JSON file.
pub(super) fn is_json(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("json"))
}

/// The error of a label that several photos below `folder` have, one of them at `path`.
pub(super) fn shared_label(folder: &Path, path: &Path) -> Option<String> {
    let label = Path::new(path.file_stem()?);
    match &pictures_below(folder).get(&label.to_string_lossy().to_lowercase())?[..] {
        [first, second, ..] => Some(namesakes(label, first, second)),
        _ => None,
    }
}

/// The reason that refuses the photo `name`, which may be any of these two.
fn namesakes(name: &Path, first: &Path, second: &Path) -> String {
    format!(
        "`{}` is the name of several files, as {} and {}: give each photo a name of its own, in the program that found the \
         poses too, or name the folder of those that are meant with `images`",
        name.display(),
        first.display(),
        second.display()
    )
}

/// Extensions of photos.
const EXTENSIONS: [&str; 9] = ["png", "jpg", "jpeg", "webp", "tif", "tiff", "JPG", "PNG", "JPEG"];

/// Blender writes names without their extension.
pub(super) fn with_extension(path: PathBuf) -> PathBuf {
    if path.is_file() {
        return path;
    }
    let appended = |extension: &str| {
        let mut name = path.clone().into_os_string();
        name.extend([".", extension].map(std::ffi::OsStr::new));
        PathBuf::from(name)
    };
    EXTENSIONS.into_iter().map(appended).find(|p| p.is_file()).unwrap_or(path)
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
        let wrong = [1e30, 1e-3, 1e-300, -500.0, f64::NAN].map(|f| (f, 320.0));
        for (f, cx) in wrong.into_iter().chain([(500.0, 1e38)]) {
            let reason = resolved(of(f, cx)).unwrap_err();
            assert!(reason.contains("0.001 to 100,000 times the longer side"), "{reason}");
            assert!(reason.len() < 300, "{reason}");
        }
        for angle in [7.0, std::f64::consts::PI, 0.0, -1.0, 45.0, f64::NAN] {
            let reason = resolved(LensClaim { angle: [Some(angle), None], ..LensClaim::default() })
                .unwrap_err();
            assert!(reason.contains("radians above 0 and below π"), "{reason}");
        }
        assert!(resolved(LensClaim { angle: [Some(3.0), None], ..LensClaim::default() }).is_ok());
    }

    #[test]
    fn folders_beside_photos_are_told_by_whole_words() {
        for name in ["masks", "Mask_2", "depth-16", "@eaDir", "#recycle", "Thumbnails", "normals"] {
            assert!(is_beside_photos(name), "{name}");
        }
        for name in ["maskenball", "photos", "images", "depthford", "a.masks"] {
            assert!(!is_beside_photos(name), "{name}");
        }
    }

    #[test]
    fn path_out_of_the_folder_is_an_error() {
        let list = Path::new("set/transforms.json");
        let folder = Path::new("set");
        let options = DatasetOptions::default();
        let mut files = NamedFiles::new(list, folder, &options);
        assert_eq!(
            files.find("frame 0", "images/../a.png").unwrap(),
            Path::new("set/images/../a.png")
        );
        let message = files.find("frame 1", "../secret.png").unwrap_err().to_string();
        assert!(
            message.starts_with("set/transforms.json: frame 1: names `../secret.png`"),
            "{message}"
        );
        assert!(message.contains("`allow_outside`"), "{message}");
        assert_eq!(NamedFiles::new(list, folder, &options).warnings().next(), None);
        let options = DatasetOptions { allow_outside: true, ..options };
        let mut allowed = NamedFiles::new(list, folder, &options);
        assert_eq!(allowed.find("frame 1", "../a.png").unwrap(), Path::new("set/../a.png"));
    }

    #[test]
    fn files_are_found_where_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir_all(at("images/a")).unwrap();
        ["images/a/1.png", "images/2.jpg", "3.png"]
            .iter()
            .for_each(|name| std::fs::write(at(name), "").unwrap());
        let list = at("transforms.json");
        let options = DatasetOptions::default();
        let mut files = NamedFiles::new(&list, folder.path(), &options);
        for (name, found) in [
            ("images\\\\a\\\\1.png".replace("\\\\", "\\"), "images/a/1.png"),
            (r"C:\Users\me\set\images\a\1.png".into(), "images/a/1.png"),
            (r"D:\other\2.png".into(), "images/2.jpg"),
            ("/home/me/3".into(), "3.png"),
            ("/home/me/a/1.png".into(), "images/a/1.png"),
        ] {
            assert_eq!(files.find("frame 0", &name).unwrap(), at(found), "{name}");
        }
        if cfg!(unix) {
            files.find("frame 0", at("3.png").to_str().unwrap()).unwrap();
        }
        let warnings: Vec<String> = files.warnings().collect();
        assert!(
            warnings.last().unwrap().contains(r"4 files of")
                && warnings.last().unwrap().contains(r"`C:\Users"),
            "{warnings:?}"
        );
        assert!(
            !cfg!(unix) || warnings[0].contains("names 1 file by an absolute path"),
            "{warnings:?}"
        );
    }
}
