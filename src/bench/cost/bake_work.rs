//! Bakes a soup with every setting.

use super::child::{Child, read_report};
use super::knobs::CostInput;
use super::score::{Scorer, difference};
use super::setting::Setting;
use super::sweep::{Outcome, RunResult, Work};
use crate::bench::measure::{self, Usage};
use crate::error::Result;
use crate::image::Pixels;
use std::path::{Path, PathBuf};

/// Bakes in processes of their own.
pub(super) struct BakeWork<'a> {
    pub(super) child: &'a Child,
    pub(super) scorer: &'a Scorer<'a>,
    pub(super) soup: &'a Path,
    pub(super) folder: &'a Path,
    /// The pictures of the default.
    pub(super) default_pictures: Option<Vec<Pixels>>,
}

impl BakeWork<'_> {
    /// Where the file of the default is left.
    pub(super) fn default_file(folder: &Path) -> PathBuf {
        folder.join("default.glb")
    }
}

impl Work for BakeWork<'_> {
    fn run(&mut self, setting: &Setting, run: usize) -> Result<Outcome> {
        let kept = setting.is_default() && setting.input == CostInput::SolidSoup;
        let file = if kept { Self::default_file(self.folder) } else { self.folder.join("baked.glb") };
        let baked = bake_once(self.child, self.soup, &file, setting)?;
        // Every run leaves the same bits.
        let result = if run == 0 { Some(self.result(&file, setting, baked.skipped)?) } else { None };
        Ok(Outcome { usage: baked.usage, bytes: Some(baked.bytes), result, chain: None })
    }
}

impl BakeWork<'_> {
    fn result(&mut self, file: &Path, setting: &Setting, skipped: Vec<String>) -> Result<RunResult> {
        let scored = self.scorer.solid(file)?;
        if setting.is_default() {
            self.default_pictures = Some(scored.pictures.clone());
        }
        let exact = self.default_pictures.as_ref().filter(|_| setting.same_scene);
        let exact_rms = exact.map(|exact| difference(&scored.pictures, exact));
        let picture = scored.pictures.into_iter().next();
        Ok(RunResult { triangles: scored.triangles, scores: scored.mean, exact_rms, skipped, picture })
    }
}

/// What one bake cost and left.
pub(super) struct Baked {
    pub(super) usage: Usage,
    /// Of all files.
    pub(super) bytes: u64,
    /// Stages that had nothing to do.
    pub(super) skipped: Vec<String>,
}

/// Bakes once: a solid soup with the photos, a soft one without.
pub(super) fn bake_once(child: &Child, soup: &Path, file: &Path, setting: &Setting) -> Result<Baked> {
    let path = file.with_extension("json");
    let photos = setting.input == CostInput::SolidSoup;
    let usage = measure::measure(&child.bake(soup, file, &path, setting, photos))?;
    let report = read_report(&path)?;
    let skipped = report.stages.iter().filter(|s| s.unneeded.is_some()).map(|s| s.name.clone()).collect();
    Ok(Baked { usage, bytes: report.outputs.iter().map(|file| file.bytes).sum(), skipped })
}
