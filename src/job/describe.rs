//! What a file holds, how soft it is, and what a bake would keep of it.

use crate::bake::prune::{PruneDetails, PruneOptions, prune};
use crate::bake::solid::SolidOptions;
use crate::bake::teacher::softness;
use crate::error::Result;
use crate::formats::ReadOptions;
use crate::formats::info::{BakeInfo, Info, info};
use crate::report::{self, Outcome};
use crate::scene::Loaded;
use std::path::Path;

/// What is in the scene at `path`, drawn on a few small pictures if it is soft.
///
/// Errors: what reading reports.
pub fn describe(path: &Path, options: &ReadOptions) -> Result<Info> {
    let (mut info, loaded) = info(path, options)?;
    info.softness = softness(&loaded, &SolidOptions::DEFAULT).ok().flatten();
    info.bake = would_bake(loaded);
    Ok(info)
}

/// What the default bake would keep; none when its first stage fails.
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
