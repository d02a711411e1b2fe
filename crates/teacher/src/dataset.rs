//! Soft pictures of a scene as a data set for training the solid scene.

use super::drawing::Teacher;
use super::viewpoints::{Viewpoints, between, picture_bytes};
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use trisplat_dataset::{Dataset, DatasetKind, Photo, PictureFile, View};
use trisplat_raster::soft::SoftOptions;
use trisplat_scene::math::evenly_spaced::evenly_spaced;
use trisplat_scene::{Error, ImportedScene, Result, camera::Camera, image::RgbImage, placed};

/// One picture in this many is held out, to score the solid scene.
const HELD_OUT: usize = 8;

/// Draws `scene`, read from `path`, with `options` and makes a data set of the pictures, in the frame of its
/// file. With many cameras, fewer pictures are drawn from between them. Above `max_bytes` of memory, pictures
/// are kept in a temporary file. With a colour that is `behind` an object, pictures are transparent where they
/// show it. Calls `drawn` after each picture with the numbers of finished and of all pictures.
///
/// Errors: a scene without visible triangles; a full disk.
pub fn dataset(
    path: &Path,
    scene: &ImportedScene,
    options: &SoftOptions,
    behind: Option<[f32; 3]>,
    max_bytes: u64,
    drawn: &mut dyn FnMut(usize, usize),
) -> Result<Dataset> {
    let Some(Viewpoints { cameras, .. }) = Viewpoints::of(scene, max_bytes) else {
        let wants = "photos of it: it stores no cameras and shows nothing from anywhere";
        return Err(Error::invalid("from", path.display(), wants));
    };
    let mut teacher = Teacher::new(scene.scene.to_soup(), &cameras, options);
    let picture = |camera: &Camera| match behind {
        Some(behind) => teacher.object_picture(camera, behind),
        None => teacher.picture(camera),
    };
    let mut dataset = drawn_for(path, &cameras, max_bytes, picture, drawn)?;
    for (i, view) in dataset.views.iter_mut().enumerate() {
        view.test = i % HELD_OUT == HELD_OUT / 2;
    }
    Ok(dataset)
}

/// A data set of the `picture` of each of `cameras`, none held out, for a scene that was read from `path`. `max_bytes` and `drawn` as for [`dataset`].
///
/// Errors: a full disk.
pub fn drawn_for(
    path: &Path,
    cameras: &[Camera],
    max_bytes: u64,
    picture: impl FnMut(&Camera) -> RgbImage,
    drawn: &mut dyn FnMut(usize, usize),
) -> Result<Dataset> {
    Ok(Dataset {
        path: PathBuf::from(path),
        kind: DatasetKind::Drawn,
        views: draw(cameras, max_bytes, picture, drawn)?,
        points: Vec::new(),
        origin: DVec3::ZERO,
        warnings: Vec::new(),
    })
}

/// The photos of `photos` and soft pictures from between the training cameras, up to `share`, 0 to 1, of all
/// training pictures. `options`, `max_bytes` and `drawn` as for [`dataset`].
///
/// Errors: a full disk.
pub fn beside(
    photos: &Dataset,
    scene: &ImportedScene,
    options: &SoftOptions,
    share: f64,
    max_bytes: u64,
    drawn: &mut dyn FnMut(usize, usize),
) -> Result<Dataset> {
    let cameras: Vec<Camera> = photos.train().map(|view| view.camera).collect();
    let to_file = |camera: &Camera| placed::to_file(camera, &scene.provenance.placement, photos.origin);
    let near: Vec<Camera> = cameras.iter().map(to_file).collect();
    let mut teacher = Teacher::new(scene.scene.to_soup(), &near, options);
    drawn_beside(photos, share, max_bytes, |camera| teacher.picture(&to_file(camera)), drawn)
}

/// The same with any `picture`, of a camera in the world of `photos`.
///
/// Errors: a full disk.
pub fn drawn_beside(
    photos: &Dataset,
    share: f64,
    max_bytes: u64,
    picture: impl FnMut(&Camera) -> RgbImage,
    drawn: &mut dyn FnMut(usize, usize),
) -> Result<Dataset> {
    let cameras: Vec<Camera> = photos.train().map(|view| view.camera).collect();
    let between = between(&cameras);
    let wanted = (cameras.len() as f64 * share / (1.0 - share)).round() as usize;
    let chosen: Vec<Camera> = evenly_spaced(between.len(), wanted).map(|i| between[i]).collect();
    let pictures = draw(&chosen, max_bytes, picture, drawn)?;
    Ok(Dataset { views: [photos.views.clone(), pictures].concat(), ..photos.clone() })
}

/// A view of each of `cameras` with its `picture`, none held out. A picture with an alpha shows an object without background.
fn draw(
    cameras: &[Camera],
    max_bytes: u64,
    mut picture: impl FnMut(&Camera) -> RgbImage,
    drawn: &mut dyn FnMut(usize, usize),
) -> Result<Vec<View>> {
    let held = cameras.iter().map(picture_bytes).sum::<u64>() <= max_bytes;
    let file = Arc::new(PictureFile::default());
    let mut views = Vec::with_capacity(cameras.len());
    for (i, camera) in cameras.iter().enumerate() {
        let picture = picture(camera);
        let is_cut = picture.alpha.is_some();
        let photo = if held { Photo::drawn(picture) } else { Photo::stored(&picture, &file)? };
        let photo = if is_cut { photo.cut_out() } else { photo };
        views.push(View { name: format!("teacher_{i:05}"), camera: *camera, photo, test: false });
        drawn(i + 1, cameras.len());
    }
    Ok(views)
}
