//! COLMAP models as data sets: their places, their photos, and the errors of cameras and points.

use super::colmap_model::{ImageRow, Model, PointRow};
use super::found::{FoundDataset, FoundPhoto, LensClaim, NamedFiles};
use super::options::DatasetOptions;
use super::points::PointFile;
use super::posed::{DatasetKind, Reprojection};
use super::{colmap_binary, colmap_text};
use glam::{DVec2, DVec3, UVec2, Vec2};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use trisplat_scene::{Error, Limits, Result};

/// The place and format of a model.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ModelFiles {
    pub(super) folder: PathBuf,
    pub(super) binary: bool,
}

/// The model of a data set: in `sparse/0`, `sparse`, `colmap/sparse/0` or the folder itself.
pub(super) fn locate(root: &Path) -> Option<ModelFiles> {
    let folders = ["sparse/0", "sparse", "colmap/sparse/0", ""].map(|f| root.join(f));
    folders.into_iter().find_map(|folder| {
        let has = |extension: &str| {
            ["cameras", "images"].iter().all(|name| folder.join(format!("{name}.{extension}")).is_file())
        };
        let binary = has("bin");
        (binary || has("txt")).then_some(ModelFiles { folder, binary })
    })
}

/// Reads the model and finds its photos.
pub(super) fn read(root: &Path, files: &ModelFiles, options: &DatasetOptions) -> Result<FoundDataset> {
    let mut warnings = Vec::new();
    let (model, points) = (files.model(&options.limits, false)?, files.points(&mut warnings));
    let list = files.folder.join(if files.binary { "images.bin" } else { "images.txt" });
    if model.images.is_empty() {
        return Err(Error::malformed(&list, "images", "the model has no image; run COLMAP's mapper again"));
    }
    let root = photo_root(root, options)?;
    let folder = root.join(&options.images);
    let mut named = NamedFiles::new(&list, &folder, options.allow_outside);
    let photos = model.images.iter().map(|image| photo(image, &model, &mut named)).collect::<Result<_>>()?;
    warnings.extend(named.warning());
    if files.folder.parent().is_some_and(|sparse| sparse.join("1").is_dir()) {
        warnings.push("the reconstruction fell into several models; only sparse/0 is used".into());
    }
    Ok(FoundDataset {
        kind: if files.binary { DatasetKind::ColmapBinary } else { DatasetKind::ColmapText },
        points,
        root,
        list,
        photos,
        warnings,
    })
}

/// The folder that holds the folder of photos: the data set's, or a parent when the model's own folder
/// was given.
fn photo_root(root: &Path, options: &DatasetOptions) -> Result<PathBuf> {
    match with_photos(root, &options.images) {
        Some(folder) => Ok(folder.to_owned()),
        None => Err(Error::unsupported(
            root.join(&options.images),
            "does not exist; put the photos of the COLMAP model into it, or name their folder with `images`",
        )),
    }
}

/// The same, if there is one; `images` is the name of the folder of photos.
pub(super) fn with_photos<'a>(root: &'a Path, images: &Path) -> Option<&'a Path> {
    let candidates = [Some(root), root.parent(), root.parent().and_then(Path::parent)];
    candidates.into_iter().flatten().find(|folder| folder.join(images).is_dir())
}

fn photo(image: &ImageRow, model: &Model, files: &mut NamedFiles) -> Result<FoundPhoto> {
    let place = format!("image `{}`", image.name);
    let lens = model.cameras.get(&image.camera).ok_or_else(|| {
        let reason = format!("its camera {} is not in the cameras file", image.camera);
        Error::malformed(files.list, &place, reason)
    })?;
    Ok(FoundPhoto {
        name: image.name.replace('\\', "/"),
        path: files.find(&place, &image.name)?,
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

impl ModelFiles {
    /// Its cameras and images, with their observations if `observations` is set.
    pub(super) fn model(&self, limits: &Limits, observations: bool) -> Result<Model> {
        let read = if self.binary { colmap_binary::read } else { colmap_text::read };
        read(&self.folder, limits, observations)
    }

    /// The file of its points, which may be missing.
    fn points(&self, warnings: &mut Vec<String>) -> PointFile {
        let path = self.folder.join(if self.binary { "points3D.bin" } else { "points3D.txt" });
        match (path.is_file(), self.binary) {
            (true, true) => PointFile::ColmapBinary(path),
            (true, false) => PointFile::ColmapText(path),
            (false, _) => {
                warnings.push(format!("{} is missing", path.display()));
                PointFile::None
            }
        }
    }

    /// The position of each point, by its number.
    pub(super) fn places(&self, limits: &Limits) -> Result<HashMap<u64, DVec3>> {
        let mut places = HashMap::new();
        let mut visit = |row: PointRow| {
            places.insert(row.id, row.position);
        };
        match self.points(&mut Vec::new()) {
            PointFile::ColmapBinary(path) => colmap_binary::each_point(&path, limits, &mut visit)?,
            PointFile::ColmapText(path) => colmap_text::each_point(&path, limits, &mut visit)?,
            _ => {}
        }
        Ok(places)
    }
}

/// Projects every point of the model at `root` into every photo that observed it; `None` without a model or
/// observations.
///
/// Errors: a broken model.
pub(super) fn reprojection(root: &Path, limits: &Limits) -> Result<Option<Reprojection>> {
    let Some(files) = locate(root) else { return Ok(None) };
    let (model, places) = (files.model(limits, true)?, files.places(limits)?);
    let (mut sum, mut observations, mut behind) = (0.0, 0u64, 0u64);
    for image in &model.images {
        let Some(lens) = model.cameras.get(&image.camera) else { continue };
        for (id, seen) in &image.observations {
            let Some(&place) = places.get(id) else { continue };
            let v = image.rotation * place + image.translation;
            let error = lens.project(DVec2::new(v.x, v.y) / v.z).distance(seen.as_dvec2());
            if v.z > 0.0 && error.is_finite() {
                sum += error;
                observations += 1;
            } else {
                behind += 1;
            }
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
/// Errors: no model; a broken model.
pub(crate) fn tracks(folder: &Path, options: &DatasetOptions) -> Result<Tracks> {
    let Some(files) = locate(folder) else {
        return Err(Error::unsupported(folder, "holds no COLMAP model; find the poses again"));
    };
    let (model, places) = (files.model(&options.limits, true)?, files.places(&options.limits)?);
    let mut ids: Vec<u64> = places.into_keys().collect();
    ids.sort_unstable();
    let index: HashMap<u64, u32> = ids.iter().copied().zip(0..).collect();
    let mut photos: Vec<TrackedPhoto> = model
        .images
        .iter()
        .map(|image| TrackedPhoto {
            name: image.name.replace('\\', "/"),
            size: model.cameras.get(&image.camera).map_or(UVec2::ONE, |lens| lens.size),
            seen: image.observations.iter().filter_map(|(id, at)| Some((*index.get(id)?, *at))).collect(),
        })
        .collect();
    photos.sort_by(|a, b| a.name.cmp(&b.name));
    let error_px = reprojection(folder, &options.limits)?.map(|measured| measured.mean_px);
    Ok(Tracks { photos, points: ids.len(), error_px })
}
