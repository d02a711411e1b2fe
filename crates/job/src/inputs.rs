//! Which files a command reads: those that were given, and those that they name. None of them may be written,
//! moved or removed.

use std::path::{Path, PathBuf};
use trisplat_dataset::Dataset;
use trisplat_dataset::capture::camera_files;
use trisplat_formats as formats;
use trisplat_scale::{Manifest, NAME};
use trisplat_scene::Limits;

/// `path` and every file that it names, whatever it is: a scene with its buffers, materials and pictures; a data set with its
/// poses, photos (those of COLMAP in the folder `images`) and masks; a plan with all its files and its data set; a folder
/// with its photos and videos. What cannot be read names nothing.
pub fn files_of(path: &Path, images: &Path, limits: &Limits) -> Vec<PathBuf> {
    let mut files = vec![path.to_owned()];
    let is_plan =
        path.join(NAME).is_file() || path.is_file() && path.file_name().is_some_and(|name| name == NAME);
    if let Some((plan, folder)) = is_plan.then(|| Manifest::read(path, limits).ok()).flatten() {
        files.extend(plan.files(&folder));
        files.extend(Dataset::files(&plan.dataset_path(&folder), &plan.dataset_options.images, limits));
    }
    if Dataset::is_posed(path) {
        files.extend(Dataset::files(path, images, limits));
    } else if path.is_dir() {
        files.extend(camera_files(path));
    }
    if path.is_file() {
        files.extend(formats::named_files(path, limits));
    }
    files
}
