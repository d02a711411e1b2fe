//! Describes a file: its contents, its softness, and the triangles that a bake would keep.

use crate::bake::prune::{PruneDetails, PruneOptions, prune};
use crate::bake::solid::SolidOptions;
use crate::bake::teacher::softness;
use crate::error::Result;
use crate::formats::ReadOptions;
use crate::formats::info::{BakeInfo, Info, info};
use crate::report::{self, Outcome};
use crate::scene::Loaded;
use std::path::Path;

/// Describes the scene at `path`. A soft scene is drawn on a few small pictures to measure its softness.
///
/// Errors: those of reading.
pub fn describe(path: &Path, options: &ReadOptions) -> Result<Info> {
    let (mut info, loaded) = info(path, options)?;
    info.softness = softness(&loaded, &SolidOptions::DEFAULT).ok().flatten();
    info.bake = would_bake(loaded);
    Ok(info)
}

/// Triangles that the default bake would keep; `None` when its first stage fails.
fn would_bake(loaded: Loaded) -> Option<BakeInfo> {
    let mut scene = loaded.scene;
    let mut details = PruneDetails::default();
    match prune(&mut scene, &PruneOptions::DEFAULT, &mut details) {
        Ok(Outcome::Changed(()) | Outcome::Unneeded(_)) => {
            let mut dropped = report::to_json(&details);
            dropped.retain(|_, count| count.as_u64() != Some(0));
            Some(BakeInfo { kept: scene.triangle_count() as u64, dropped })
        }
        Err(_) => None,
    }
}
