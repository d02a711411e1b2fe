//! Soft pictures of a scene as a data set to train its solid twin on.

use super::drawing::Teacher;
use super::viewpoints::Viewpoints;
use crate::camera::Camera;
use crate::dataset::picture_file::PictureFile;
use crate::dataset::{Dataset, DatasetKind, Photo, View};
use crate::error::{Error, Result};
use crate::raster::soft::SoftOptions;
use crate::scene::Loaded;
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// One picture in so many is held out, to measure the twin on.
const HELD_OUT: usize = 8;

/// Draws `scene`, read from `path`, as `options` say and makes a data set of the pictures, in the frame of its file.
/// With many cameras, fewer pictures are drawn from between them. When all of them take more than `max_bytes` of memory,
/// they are kept in a temporary file. `drawn` is told after each
/// picture how many are drawn and how many there will be.
///
/// Errors: nothing in the scene that can be looked at; no room on the disk.
pub fn dataset(
    path: &Path,
    scene: &Loaded,
    options: &SoftOptions,
    max_bytes: u64,
    drawn: &mut dyn FnMut(usize, usize),
) -> Result<Dataset> {
    let Some(Viewpoints { cameras, .. }) = Viewpoints::of(scene, max_bytes) else {
        let wants = "photos of it: it stores no cameras and shows nothing from anywhere";
        return Err(Error::invalid("from", path.display(), wants));
    };
    let mut teacher = Teacher::new(scene.scene.to_soup(), &cameras, options);
    let bytes = |camera: &Camera| 3 * u64::from(camera.size.x) * u64::from(camera.size.y);
    let held = cameras.iter().map(bytes).sum::<u64>() <= max_bytes;
    let file = Arc::new(PictureFile::default());
    let mut views = Vec::with_capacity(cameras.len());
    for (i, camera) in cameras.iter().enumerate() {
        let picture = teacher.picture(camera);
        views.push(View {
            name: format!("teacher_{i:05}"),
            camera: *camera,
            photo: if held { Photo::drawn(picture) } else { Photo::stored(&picture, &file)? },
            test: i % HELD_OUT == HELD_OUT / 2,
        });
        drawn(i + 1, cameras.len());
    }
    Ok(Dataset {
        path: PathBuf::from(path),
        kind: DatasetKind::Drawn,
        views,
        points: Vec::new(),
        origin: DVec3::ZERO,
        reprojection: None,
        warnings: Vec::new(),
    })
}
