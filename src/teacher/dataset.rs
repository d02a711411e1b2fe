//! Soft pictures of a scene as a data set to train its solid twin on.

use super::drawing::Teacher;
use super::viewpoints::Viewpoints;
use crate::dataset::{Dataset, DatasetKind, Photo, View};
use crate::error::{Error, Result};
use crate::raster::soft::SoftOptions;
use crate::scene::Loaded;
use glam::DVec3;
use std::path::{Path, PathBuf};

/// One picture in so many is held out, to measure the twin on.
const HELD_OUT: usize = 8;

/// Draws `scene`, read from `path`, as `options` say and makes a data set of the pictures, in the frame of its file.
/// Pictures take at most `max_bytes`: with many cameras, fewer are drawn from between them. `drawn` is told after each
/// picture how many are drawn and how many there will be.
///
/// Errors: nothing in the scene that can be looked at.
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
    let mut views = Vec::with_capacity(cameras.len());
    for (i, camera) in cameras.iter().enumerate() {
        views.push(View {
            name: format!("teacher_{i:05}"),
            camera: *camera,
            photo: Photo::drawn(teacher.picture(camera)),
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
