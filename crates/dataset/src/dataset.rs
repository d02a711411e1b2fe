//! A data set in memory: posed photos of one scene, those held out, and the sparse cloud of its
//! points.

use super::options::{DatasetOptions, Masks};
use super::photo::Photo;
use super::views;
use glam::{DVec3, UVec2, Vec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::{HashMap, HashSet};
use std::fmt::{self, Display};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use trisplat_scene::camera::Camera;
use trisplat_scene::{Error, Result, UpAxis, input};

/// Posed photos of one scene.
#[derive(Debug, Clone)]
pub struct Dataset {
    /// Its folder or file, as given.
    pub path: PathBuf,
    /// Format of its list of poses.
    pub kind: DatasetKind,
    /// All photos, sorted by name.
    pub views: Vec<View>,
    /// The sparse cloud; may be empty.
    pub points: Vec<Point>,
    /// The world point at (0, 0, 0) here: zero, unless the scene is too far from the origin for
    /// f32. world = origin + position.
    pub origin: DVec3,
    /// Repairs, omissions and oddities, one sentence each.
    pub warnings: Vec<String>,
}

/// A posed photo.
#[derive(Debug, Clone)]
pub struct View {
    /// Path below the folder of photos: "0001.jpg".
    pub name: String,
    /// Its pinhole camera, at the size of the decoded photo.
    pub camera: Camera,
    /// The photo, decoded on request.
    pub photo: Photo,
    /// Held out for evaluation, never trained on.
    pub test: bool,
    /// The points of its track entries: indices in [`Dataset::points`].
    pub tracked: Vec<u32>,
}

impl View {
    /// The same view with only a part of its picture: of `size` px, with its upper left corner at
    /// `corner`.
    ///
    /// # Errors
    ///
    /// A part that is empty or outside the picture.
    pub fn cropped(&self, corner: UVec2, size: UVec2) -> Result<Self> {
        let whole = self.camera.size;
        let fits = |a: usize| {
            size[a] > 0 && corner[a].checked_add(size[a]).is_some_and(|end| end <= whole[a])
        };
        if !fits(0) || !fits(1) {
            let part = format!("{}x{} px at {},{}", size.x, size.y, corner.x, corner.y);
            let wants = format!("a part of the {}x{} px of `{}`", whole.x, whole.y, self.name);
            return Err(Error::invalid("crop", part, wants));
        }
        let camera = Camera { center: self.camera.center - corner.as_vec2(), size, ..self.camera };
        Ok(Self { camera, photo: self.photo.cropped(corner, size), ..self.clone() })
    }
}

/// A point of the sparse cloud.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// World position minus the data set's origin.
    pub position: Vec3,
    /// sRGB-encoded colour.
    pub rgb: [u8; 3],
    /// Mean reprojection error that the file states, px.
    pub error: Option<f32>,
}

/// Reprojection errors, at the photos' full size.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Reprojection {
    /// Mean over all observations, px.
    pub mean_px: f64,
    /// Observations measured.
    pub observations: u64,
    /// Observations of points behind their camera; not in the mean.
    pub behind: u64,
}

impl Dataset {
    /// True when photos track points, so that the depth of these is known.
    pub fn has_tracks(&self) -> bool {
        self.views.iter().any(|view| !view.tracked.is_empty())
    }

    /// The points that a view's photo tracks, with their indices.
    pub fn tracked(&self, view: &View) -> impl Iterator<Item = (usize, &Point)> {
        let point = |i: &u32| Some((*i as usize, self.points.get(*i as usize)?));
        view.tracked.iter().filter_map(point)
    }

    /// True for the fifth of the tracked points, by index, that measures the depth error of scenes:
    /// no training uses it.
    pub fn is_validation_point(index: usize) -> bool {
        index.is_multiple_of(5)
    }

    /// The training photos alone, those of them held out whose number `is_left_out`.
    pub fn leaving_out(&self, is_left_out: impl Fn(usize) -> bool) -> Self {
        let views = self.train().enumerate();
        let views = views.map(|(i, view)| View { test: is_left_out(i), ..view.clone() }).collect();
        Self { views, ..self.clone() }
    }

    /// Number of photos, held-out ones included.
    pub fn len(&self) -> usize {
        self.views.len()
    }

    /// True without photos.
    pub fn is_empty(&self) -> bool {
        self.views.is_empty()
    }

    /// The training photos, in order of name.
    pub fn train(&self) -> impl Iterator<Item = &View> {
        self.views.iter().filter(|v| !v.test)
    }

    /// The held-out photos, in order of name.
    pub fn test(&self) -> impl Iterator<Item = &View> {
        self.views.iter().filter(|v| v.test)
    }

    /// Use of masks for a `requested` use: `auto` as the data set decided.
    pub fn masks(&self, requested: Masks) -> Masks {
        let cut = || self.views.iter().any(|view| view.photo.mask.is_some() && view.photo.is_cut());
        match requested {
            Masks::Auto if cut() => Masks::Cut,
            Masks::Auto => Masks::Ignore,
            requested => requested,
        }
    }

    /// The world axis that usually points up in this kind of data set: -Y in COLMAP's models, which
    /// begin with an upright photo, and LLFF's, made of them; +Y in those of phones; +Z in others.
    pub fn up_axis(&self) -> UpAxis {
        match self.kind {
            DatasetKind::ColmapBinary | DatasetKind::ColmapText | DatasetKind::Llff => UpAxis::NegY,
            DatasetKind::Transforms | DatasetKind::Metashape | DatasetKind::RealityScan => {
                UpAxis::Z
            }
            DatasetKind::Polycam | DatasetKind::Record3d | DatasetKind::Drawn => UpAxis::Y,
        }
    }
}

/// The kind of a data set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum DatasetKind {
    /// COLMAP's `cameras.bin`, `images.bin` and `points3D.bin`.
    #[serde(rename = "COLMAP model (binary)")]
    ColmapBinary,
    /// COLMAP's `cameras.txt`, `images.txt` and `points3D.txt`.
    #[serde(rename = "COLMAP model (text)")]
    ColmapText,
    /// `transforms.json` of nerfstudio, instant-ngp and Blender.
    #[serde(rename = "transforms.json")]
    Transforms,
    /// `poses_bounds.npy` of LLFF.
    #[serde(rename = "LLFF poses_bounds.npy")]
    Llff,
    /// Metashape's `cameras.xml`.
    #[serde(rename = "Metashape cameras")]
    Metashape,
    /// RealityScan's table of registered photos.
    #[serde(rename = "RealityScan registration")]
    RealityScan,
    /// Polycam's raw export.
    #[serde(rename = "Polycam keyframes")]
    Polycam,
    /// Record3D's raw export.
    #[serde(rename = "Record3D recording")]
    Record3d,
    /// Drawn pictures of a scene instead of photos.
    #[serde(rename = "drawn pictures")]
    Drawn,
}

impl fmt::Display for DatasetKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// The largest size of the shrunk photos: "320x213".
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(into = "String", try_from = "String")]
#[schemars(with = "String")]
pub struct ShrunkSize(UVec2);

impl ShrunkSize {
    /// Of some views; `None` if every photo is as large as its file.
    pub fn of<'a>(views: impl IntoIterator<Item = &'a View>) -> Option<Self> {
        let shrunk =
            views.into_iter().filter(|view| view.photo.is_shrunk()).map(|view| view.photo.size);
        shrunk.max_by_key(|size| u64::from(size.x) * u64::from(size.y)).map(Self)
    }

    /// The text after a score: ", photos at 320x213", or nothing.
    pub fn suffix(size: Option<Self>) -> String {
        size.map_or(String::new(), |size| format!(", photos at {size}"))
    }
}

impl Display for ShrunkSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.0.x, self.0.y)
    }
}

impl FromStr for ShrunkSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let sides = text
            .split_once('x')
            .and_then(|(w, h)| Some(UVec2::new(w.parse().ok()?, h.parse().ok()?)));
        sides.map(Self).ok_or_else(|| "is not a width and a height, as in 320x213".to_owned())
    }
}

trisplat_scene::as_text!(ShrunkSize);

/// A part of a data set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Split {
    /// The held-out photos.
    #[default]
    Test,
    /// The photos to train on.
    Train,
    /// All photos.
    All,
}

impl Split {
    /// "test", "train" or "all".
    pub fn name(self) -> &'static str {
        match self {
            Split::Test => "test",
            Split::Train => "train",
            Split::All => "all",
        }
    }

    /// The photos of this part, in order of name.
    pub fn of(self, dataset: &Dataset) -> Vec<&View> {
        let belongs = |view: &&View| match self {
            Split::Test => view.test,
            Split::Train => !view.test,
            Split::All => true,
        };
        dataset.views.iter().filter(belongs).collect()
    }

    /// The same.
    ///
    /// # Errors
    ///
    /// No photos.
    pub fn some_of(self, dataset: &Dataset) -> Result<Vec<&View>> {
        let views = self.of(dataset);
        if views.is_empty() {
            return Err(Error::invalid(
                "split",
                self.name(),
                "a part that holds photos: train or all",
            ));
        }
        Ok(views)
    }
}

/// Marks the held-out views. They are sorted by name, and those of a `transforms_test.json` are
/// marked already.
pub(super) fn hold_out(dataset: &mut Dataset, root: &Path, options: &DatasetOptions) -> Result<()> {
    let list = root.join("test.txt");
    if options.test_every == 0 {
        dataset.views.iter_mut().for_each(|view| view.test = false);
        return Ok(());
    }
    if list.is_file() {
        let text = input::read_text(&list, &options.limits)?;
        return by_list(dataset, &list, &text);
    }
    if dataset.views.iter().any(|view| view.test) {
        return Ok(());
    }
    // The views of a wide photo show the same, and are held out together.
    let mut photos = HashMap::new();
    for view in &dataset.views {
        let next = photos.len();
        photos.entry(view.photo.path.clone()).or_insert(next);
    }
    // A single photo is worth more in training than held out.
    if photos.len() > 1 {
        for view in &mut dataset.views {
            view.test = photos[&view.photo.path].is_multiple_of(options.test_every as usize);
        }
    }
    check_training_photos(dataset, root)
}

/// Holds out the photos named in `text`, one per line, with or without their file extension.
fn by_list(dataset: &mut Dataset, list: &Path, text: &str) -> Result<()> {
    let names: HashSet<&str> =
        text.lines().map(str::trim).filter(|name| !name.is_empty()).collect();
    let mut matched_names = HashSet::new();
    for view in &mut dataset.views {
        let photo = views::photo(&view.name);
        let spellings = spellings(&view.name).into_iter().chain(spellings(&photo)).flatten();
        let hit = spellings.into_iter().find_map(|name| names.get(name).copied());
        view.test = hit.is_some();
        matched_names.extend(hit);
    }
    if let Some(missing) = names.iter().filter(|name| !matched_names.contains(*name)).min() {
        let count = names.len() - matched_names.len();
        if matched_names.is_empty() {
            let reason =
                format!("none of its {count} names is a photo of the data set (`{missing}`)");
            return Err(Error::malformed(
                list,
                "names",
                format!("{reason}; correct or remove the file"),
            ));
        }
        let of = names.len();
        dataset.warnings.push(format!(
            "test.txt: {count} of {of} names are not photos of the data set (`{missing}`)"
        ));
    }
    check_training_photos(dataset, list)
}

/// The spellings of a name in a list: in full, without extension, without folders, or without both.
fn spellings(name: &str) -> [Option<&str>; 4] {
    let path = Path::new(name);
    let stem = name.rsplit_once('.').map(|(stem, _)| stem);
    let file = path.file_name().and_then(|n| n.to_str());
    let file_stem = path.file_stem().and_then(|n| n.to_str());
    [Some(name), stem, file, file_stem]
}

fn check_training_photos(dataset: &Dataset, source: &Path) -> Result<()> {
    if dataset.views.iter().all(|view| view.test) {
        let reason =
            "every photo is held out, none is left to train on; name fewer, or give `test_every` 0";
        return Err(Error::unsupported(source, reason));
    }
    Ok(())
}
