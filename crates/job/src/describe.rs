//! Describes a file: its contents, its softness, and the triangles that a bake would keep.

use std::path::Path;
use trisplat_bake::{
    BackgroundDetails, BackgroundOptions, PruneDetails, PruneOptions, SolidOptions, background, prune,
    softness,
};
use trisplat_formats::info::{BakeInfo, Info, info_of_content};
use trisplat_formats::{Content, ReadOptions};
use trisplat_scene::report::{self, Outcome};
use trisplat_scene::{ImportedScene, Result};

/// Describes the scene or the Gaussians at `path`. A soft scene is drawn on a few small pictures to measure its softness.
///
/// Errors: those of reading.
pub fn describe(path: &Path, options: &ReadOptions) -> Result<Info> {
    let (mut info, content) = info_of_content(path, options)?;
    let Content::Scene(mut loaded) = content else { return Ok(info) };
    // Measured without the background of an object, as in the bake.
    background(&mut loaded, false, &BackgroundOptions::default(), &mut BackgroundDetails::default());
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
