//! The files that a command reads, which it may not write, move or remove; and a description of
//! one.

use std::path::{Path, PathBuf};
use trisplat_bake::{
    BackgroundDetails, BackgroundOptions, PruneDetails, PruneOptions, SolidOptions, background,
    prune, softness,
};
use trisplat_dataset::Dataset;
use trisplat_dataset::capture::camera_files;
use trisplat_formats as formats;
use trisplat_formats::info::{BakeInfo, Info, info_of_content};
use trisplat_formats::{Content, ReadOptions};
use trisplat_scale::{Manifest, is_plan};
use trisplat_scene::report::{self, Outcome};
use trisplat_scene::{ImportedScene, Limits, Result};

/// `path` and every file that it names, whatever it is: a scene with its buffers, materials and
/// pictures; a data set with its poses, photos (those of COLMAP in the folder `images`) and masks;
/// a plan with all its files and its data set; a folder with its photos and videos. What cannot be
/// read names nothing.
pub fn files_of(path: &Path, images: &Path, limits: &Limits) -> Vec<PathBuf> {
    let mut files = vec![path.to_owned()];
    if let Some((plan, folder)) = is_plan(path).then(|| Manifest::read(path, limits).ok()).flatten()
    {
        files.extend(plan.files(&folder));
        files.extend(Dataset::files(
            &plan.dataset_path(&folder),
            &plan.dataset_options.images,
            limits,
        ));
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

/// Describes the scene or the Gaussians at `path`. A soft scene is drawn on a few small pictures to
/// measure its softness.
///
/// # Errors
///
/// Errors of reading.
pub fn describe(path: &Path, options: &ReadOptions) -> Result<Info> {
    let (mut info, content) = info_of_content(path, options)?;
    let Content::Scene(mut loaded) = content else { return Ok(info) };
    // Measured without the background of an object, as in the bake.
    background(
        &mut loaded,
        false,
        &BackgroundOptions::default(),
        &mut BackgroundDetails::default(),
    );
    let behind = info.triangles - loaded.scene.triangle_count() as u64;
    info.softness = softness(&loaded, &SolidOptions::DEFAULT).ok().flatten();
    info.bake = would_bake(loaded);
    if let (Some(bake), 1..) = (&mut info.bake, behind) {
        bake.dropped.insert("background".to_owned(), behind.into());
    }
    Ok(info)
}

/// Triangles that the default bake would keep; `None` when its first stage fails.
fn would_bake(loaded: ImportedScene) -> Option<BakeInfo> {
    let mut scene = loaded.scene;
    let mut details = PruneDetails::default();
    match prune(&mut scene, &PruneOptions::DEFAULT, &mut details) {
        Ok(Outcome::Changed(()) | Outcome::Skipped(_)) => {
            let mut dropped = report::to_json(&details);
            dropped.retain(|_, count| count.as_u64() != Some(0));
            Some(BakeInfo { kept: scene.triangle_count() as u64, dropped })
        }
        Err(_) => None,
    }
}
