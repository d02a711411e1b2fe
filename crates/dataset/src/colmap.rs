//! COLMAP models as data sets: their places, their photos, and the errors of cameras and points.

use super::colmap_model::{ColmapModel, ImageRow, ListedPoint};
use super::dataset::{DatasetKind, Reprojection};
use super::lens::Lens;
use super::listing::{DatasetListing, LensClaim, ListedPhoto, NamedFiles};
use super::options::DatasetOptions;
use super::pose_check::{self, Mistake, Pose};
use super::{colmap_binary, colmap_text};
use glam::{DVec2, DVec3, UVec2, Vec2};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use trisplat_scene::math::lists::median;
use trisplat_scene::{Error, Limits, Result, input};

/// A pose held by fewer points is left out ...
const MIN_TIED_POINTS: usize = 10;
/// ... where half of the photos have this many.
const USUAL_TIES: usize = 50;
/// Fewer observations say nothing of the points.
const MIN_OBSERVATIONS: usize = 50;
/// A point this far from where a photo shows it, of the longer side, is not that point.
const MAX_REPROJECTION_ERROR: f64 = 0.1;

/// The place and format of a model.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ModelFiles {
    pub(super) folder: PathBuf,
    pub(super) binary: bool,
}

/// The model of a data set: in `sparse`, `colmap/sparse` or the folder itself, there in a numbered
/// folder before the folder; of several the one of the most photos.
pub(super) fn locate(root: &Path) -> Option<ModelFiles> {
    models(root).into_iter().next()
}

/// The models that a reconstruction fell into, that of the most photos first.
fn models(root: &Path) -> Vec<ModelFiles> {
    let places = ["sparse", "colmap/sparse", ""].map(|place| models_in(&root.join(place)));
    let mut models = places.into_iter().find(|found| !found.is_empty()).unwrap_or_default();
    if models.len() > 1 {
        models.sort_by_cached_key(|files| std::cmp::Reverse(files.photos()));
    }
    models
}

/// The models in the numbered folders of `folder`, else in it.
fn models_in(folder: &Path) -> Vec<ModelFiles> {
    let model = |folder: PathBuf| {
        let has = |extension: &str| {
            ["cameras", "images"]
                .iter()
                .all(|name| folder.join(format!("{name}.{extension}")).is_file())
        };
        let binary = has("bin");
        (binary || has("txt")).then_some(ModelFiles { folder, binary })
    };
    let found: Vec<_> = numbered_folders(folder).into_iter().filter_map(model).collect();
    if found.is_empty() { model(folder.to_owned()).into_iter().collect() } else { found }
}

/// Says what a model lacks whose files are only in part there.
pub(super) fn incomplete(root: &Path) -> Option<String> {
    let places = ["sparse", "colmap/sparse", ""].map(|place| root.join(place));
    let folders =
        places.iter().flat_map(|place| [numbered_folders(place), vec![place.clone()]]).flatten();
    folders.into_iter().find_map(|folder| {
        let names = |extension: &str| {
            ["cameras", "images", "points3D"].map(|name| format!("{name}.{extension}"))
        };
        let has = |name: &String| folder.join(name).is_file();
        let [binary, text] = ["bin", "txt"].map(names);
        let there: Vec<String> = binary.iter().chain(&text).filter(|n| has(n)).cloned().collect();
        // Names of the kind that is there.
        let kind = if binary.iter().any(has) { binary } else { text };
        let missing = kind[..2].iter().find(|name| !has(name)).filter(|_| !there.is_empty())?;
        Some(format!(
            "holds a COLMAP model without {missing}: {} has only {}; copy all of the model's files, or export them again with \
             `colmap model_converter`",
            folder.display(),
            there.join(", ")
        ))
    })
}

/// The paths in `folder` whose names are numbers, in the order of these.
pub(super) fn numbered_folders(folder: &Path) -> Vec<PathBuf> {
    let number = |path: PathBuf| Some((path.file_name()?.to_str()?.parse::<u32>().ok()?, path));
    let mut folders: Vec<_> = input::entries(folder).filter_map(number).collect();
    folders.sort_unstable();
    folders.into_iter().map(|(_, path)| path).collect()
}

/// Reads the model and finds its photos.
pub(super) fn read(
    data_set: &Path,
    files: &ModelFiles,
    options: &DatasetOptions,
) -> Result<DatasetListing> {
    let mut warnings = Vec::new();
    let mut model = files.model(&options.limits, true)?;
    let mut points = files.points(&options.limits)?;
    let point_file = files.point_file();
    if !point_file.is_file() {
        warnings.push(format!("{} is missing", point_file.display()));
    }
    let list = files.folder.join(if files.binary { "images.bin" } else { "images.txt" });
    let names = model.images.iter().map(|image| &image.name);
    let Some(first) = names.chain(model.broken.iter().map(|(name, _)| name)).next() else {
        return Err(Error::malformed(
            &list,
            "images",
            "the model has no image; run COLMAP's mapper again",
        ));
    };
    let (root, folder) = photo_folders(data_set, &list, first, options)?;
    if let Some(reason) = foreign_points(&model, &places(&points)) {
        warnings.push(format!("{} {reason}; its points are not used", point_file.display()));
        points.clear();
    }
    leave_out_loose(&mut model, &mut warnings);
    warnings.extend(fell_apart(data_set, files));
    let mut files_of_photos = NamedFiles::new(&list, &folder, options);
    let numbers: HashMap<u64, u32> = points.iter().map(|point| point.id).zip(0..).collect();
    let photos =
        model.images.iter().map(|image| photo(image, &model, &numbers, &mut files_of_photos));
    let photos = photos.collect::<Result<_>>()?;
    warnings.extend(files_of_photos.warnings());
    Ok(DatasetListing {
        kind: if files.binary { DatasetKind::ColmapBinary } else { DatasetKind::ColmapText },
        points,
        root,
        list,
        photos,
        broken: model.broken,
        warnings,
    })
}

/// The warning that the reconstruction of the data set at `root` is only one of several.
fn fell_apart(root: &Path, files: &ModelFiles) -> Option<String> {
    let models = models(root);
    let others: Vec<String> =
        models.iter().skip(1).map(|other| other.photos().to_string()).collect();
    let first = models.first().filter(|first| *first == files && !others.is_empty())?;
    let place = first.folder.strip_prefix(root).unwrap_or(&first.folder).display();
    let count = models.len();
    let photos = first.photos();
    Some(format!(
        "the reconstruction fell into {count} models: only {place} is used, of {photos} photos; the others have {}",
        others.join(", ")
    ))
}

/// Reason why the points do not belong to the model; `None` if they do.
fn foreign_points(model: &ColmapModel, places: &HashMap<u64, DVec3>) -> Option<String> {
    let observations: usize = model.images.iter().map(|image| image.observations.len()).sum();
    if observations == 0 || places.is_empty() {
        return None;
    }
    let other = "is of another reconstruction than the photos";
    let apart = |change| count_apart(&sightings(model, places, change));
    let (apart_as_read, count) = apart(|pose| pose);
    if count == 0 {
        return Some(format!("{other}: none of the points of {observations} observations exists"));
    }
    if count < MIN_OBSERVATIONS || 2 * apart_as_read <= count {
        return None;
    }
    let misfit = format!("{apart_as_read} of {count} points are not where the photos show them");
    let mistakes = pose_check::mistakes(DatasetKind::ColmapText);
    let is_meant = |mistake: &&Mistake| 2 * apart(mistake.2).0 <= count;
    Some(match mistakes.iter().find(is_meant) {
        Some((name, remedy, _)) => format!(
            "does not fit the photos: {misfit}, but they would be if poses are {name}: {remedy}"
        ),
        None => format!("{other}: {misfit}"),
    })
}

/// Number of points that are not where photos show them, and of all.
fn count_apart(sightings: &[Sighting<'_>]) -> (usize, usize) {
    // The photos may have been observed at another size than their cameras have.
    let scales =
        sightings.iter().filter_map(|(_, at, seen)| Some(at.as_ref()?.length() / seen.length()));
    let scale = median(scales.collect(), f64::total_cmp).unwrap_or(1.0);
    let is_apart = |(lens, at, seen): &&(&Lens, Option<DVec2>, DVec2)| {
        let most = MAX_REPROJECTION_ERROR * lens.size.as_dvec2().max_element();
        !at.is_some_and(|at| at.distance(*seen * scale) <= most)
    };
    (sightings.iter().filter(is_apart).count(), sightings.len())
}

/// Leaves out photos whose poses hang on next to nothing.
fn leave_out_loose(model: &mut ColmapModel, warnings: &mut Vec<String>) {
    let ties = |image: &ImageRow| image.observations.len();
    let usual = median(model.images.iter().map(ties).collect(), usize::cmp).unwrap_or(0);
    // A photo of none has its pose from elsewhere.
    let loose =
        |image: &ImageRow| usual >= USUAL_TIES && (1..MIN_TIED_POINTS).contains(&ties(image));
    let total = model.images.len();
    let out = model.images.iter().filter(|image| loose(image)).count();
    let Some(first) = model.images.iter().find(|image| loose(image)) else { return };
    warnings.push(format!(
        "{out} of {total} photos left out: fewer than {MIN_TIED_POINTS} points hold their poses (`{}`: {}, half of the photos have \
         {usual} or more)",
        first.name,
        ties(first)
    ));
    model.images.retain(|image| !loose(image));
}

/// The folder of masks and lists, and that of the photos: below the data set, or a parent when the
/// model's own folder was given; or the data set's own folder, where the photo `name` lies in it or
/// in another one below.
fn photo_folders(
    root: &Path,
    list: &Path,
    name: &str,
    options: &DatasetOptions,
) -> Result<(PathBuf, PathBuf)> {
    if let Some(folder) = with_photos(root, &options.images) {
        return Ok((folder.to_owned(), folder.join(&options.images)));
    }
    let elsewhere = || NamedFiles::new(list, root, options).find("photos", name);
    if root.join(name.replace('\\', "/")).is_file() || elsewhere()?.is_file() {
        return Ok((root.to_owned(), root.to_owned()));
    }
    Err(Error::unsupported(
        root.join(&options.images),
        "does not exist; put the photos of the COLMAP model into it, or name their folder with `images`",
    ))
}

/// The folder at or above `root` that has a folder of photos, `images`.
pub(super) fn with_photos<'a>(root: &'a Path, images: &Path) -> Option<&'a Path> {
    let candidates = [Some(root), root.parent(), root.parent().and_then(Path::parent)];
    candidates.into_iter().flatten().find(|folder| folder.join(images).is_dir())
}

fn photo(
    image: &ImageRow,
    model: &ColmapModel,
    points: &HashMap<u64, u32>,
    files: &mut NamedFiles,
) -> Result<ListedPhoto> {
    let place = format!("image `{}`", image.name);
    let lens = model.cameras.get(&image.camera).ok_or_else(|| {
        let reason = format!("its camera {} is not in the cameras file", image.camera);
        Error::malformed(files.list, &place, reason)
    })?;
    let name = image.name.replace('\\', "/");
    let path = files.find(&place, &image.name)?;
    let tracked = image.observations.iter().filter_map(|(id, _)| points.get(id).copied()).collect();
    let pose = (image.rotation, image.translation);
    Ok(ListedPhoto { tracked, ..ListedPhoto::with_pose(name, path, pose, LensClaim::of(lens)) })
}

impl ModelFiles {
    /// Number of its photos; 0 if it is broken, which its reader reports.
    fn photos(&self) -> usize {
        self.model(&Limits::DEFAULT, false).map_or(0, |model| model.images.len())
    }

    /// Its cameras and images, with their observations if `observations` is set.
    pub(super) fn model(&self, limits: &Limits, observations: bool) -> Result<ColmapModel> {
        let read = if self.binary { colmap_binary::read } else { colmap_text::read };
        read(&self.folder, limits, observations)
    }

    /// True if the distortion of one of its perspective lenses folds over inside the photos.
    pub(super) fn has_folded_lens(&self, limits: &Limits) -> Result<bool> {
        Ok(self.model(limits, false)?.cameras.values().any(Lens::folds))
    }

    /// The file of its points, which may be missing.
    fn point_file(&self) -> PathBuf {
        self.folder.join(if self.binary { "points3D.bin" } else { "points3D.txt" })
    }

    /// Its points; none without their file.
    fn points(&self, limits: &Limits) -> Result<Vec<ListedPoint>> {
        let path = self.point_file();
        match (path.is_file(), self.binary) {
            (true, true) => colmap_binary::points(&path, limits),
            (true, false) => colmap_text::points(&path, limits),
            (false, _) => Ok(Vec::new()),
        }
    }
}

/// The position of each point, by its number.
fn places(points: &[ListedPoint]) -> HashMap<u64, DVec3> {
    points.iter().map(|point| (point.id, point.position)).collect()
}

/// An observation of a point: the lens, the pixel of the point, `None` behind the camera, and the
/// observed pixel.
type Sighting<'a> = (&'a Lens, Option<DVec2>, DVec2);

/// Every observation of a point, by changed poses.
fn sightings<'a>(
    model: &'a ColmapModel,
    places: &HashMap<u64, DVec3>,
    change: fn(Pose) -> Pose,
) -> Vec<Sighting<'a>> {
    let mut sightings = Vec::new();
    for image in &model.images {
        let Some(lens) = model.cameras.get(&image.camera) else { continue };
        let pose = change(Pose { rotation: image.rotation, translation: image.translation });
        sightings.extend(image.observations.iter().filter_map(|(id, seen)| {
            let ray = pose.rotation * *places.get(id)? + pose.translation;
            Some((lens, lens.pixel(ray), seen.as_dvec2()))
        }));
    }
    sightings
}

/// Projects every point of the model at `root` into every photo that observed it; `None` without a
/// model or observations.
///
/// # Errors
///
/// A broken model.
pub(super) fn reprojection(root: &Path, limits: &Limits) -> Result<Option<Reprojection>> {
    let Some(files) = locate(root) else { return Ok(None) };
    let model = files.model(limits, true)?;
    let places = places(&files.points(limits)?);
    let mut sum = 0.0;
    let mut observations = 0u64;
    let mut behind = 0u64;
    for (_, at, seen) in sightings(&model, &places, |pose| pose) {
        match at.map(|at| at.distance(seen)).filter(|error| error.is_finite()) {
            Some(error) => (sum, observations) = (sum + error, observations + 1),
            None => behind += 1,
        }
    }
    let mean_px = if observations > 0 { sum / observations as f64 } else { 0.0 };
    Ok((observations + behind > 0).then_some(Reprojection { mean_px, observations, behind }))
}

/// The photos of a model, and the points of each.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Tracks {
    /// In order of name.
    pub(crate) photos: Vec<TrackedPhoto>,
    /// Number of points.
    pub(crate) points: usize,
    /// Mean reprojection error, px.
    pub(crate) error_px: Option<f64>,
}

/// A photo and its points.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct TrackedPhoto {
    /// Its path below the folder of photos.
    pub(crate) name: String,
    /// Width and height of its camera, px.
    pub(crate) size: UVec2,
    /// Indices of points, and their image positions, px.
    pub(crate) seen: Vec<(u32, Vec2)>,
}

/// The tracks of the COLMAP model in `folder`, or in the usual places of a data set.
///
/// # Errors
///
/// No model; a broken model.
pub(crate) fn tracks(folder: &Path, limits: &Limits) -> Result<Tracks> {
    let Some(files) = locate(folder) else {
        return Err(Error::unsupported(folder, "holds no COLMAP model; find the poses again"));
    };
    let model = files.model(limits, true)?;
    let places = places(&files.points(limits)?);
    let mut ids: Vec<u64> = places.into_keys().collect();
    ids.sort_unstable();
    let index: HashMap<u64, u32> = ids.iter().copied().zip(0..).collect();
    let mut photos: Vec<TrackedPhoto> = model
        .images
        .iter()
        .map(|image| TrackedPhoto {
            name: image.name.replace('\\', "/"),
            size: model.cameras.get(&image.camera).map_or(UVec2::ONE, |lens| lens.size),
            seen: image
                .observations
                .iter()
                .filter_map(|(id, at)| Some((*index.get(id)?, *at)))
                .collect(),
        })
        .collect();
    photos.sort_by(|a, b| a.name.cmp(&b.name));
    let error_px = reprojection(folder, limits)?.map(|measured| measured.mean_px);
    Ok(Tracks { photos, points: ids.len(), error_px })
}
