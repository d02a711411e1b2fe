//! Trains with every setting, and bakes what comes of it, so that the whole way to a file has its rows too.

use super::bake_work::bake_once;
use super::base::Base;
use super::child::{Child, read_report};
use super::knobs::{CostInput, CostStage};
use super::score::{Scored, Scorer};
use super::setting::Setting;
use super::sweep::{Outcome, RunResult, Work};
use crate::bench::measure;
use crate::error::Result;
use crate::train::TrainDetails;
use std::path::{Path, PathBuf};

/// Trains in processes of their own.
pub(super) struct TrainWork<'a> {
    pub(super) child: &'a Child,
    pub(super) scorer: &'a Scorer<'a>,
    pub(super) base: &'a Base,
    pub(super) folder: &'a Path,
    /// Whether what is trained is baked too.
    pub(super) chain: bool,
}

impl TrainWork<'_> {
    /// Where the soup of the default and seed 0 is left.
    pub(super) fn default_soup(folder: &Path) -> PathBuf {
        folder.join("solid.ply")
    }

    /// Trains one soup with preset outdoor, which stays soft, and leaves it at `output`.
    pub(super) fn train_soft(&self, output: &Path) -> Result<()> {
        let setting = Setting {
            changes: vec![("preset", "outdoor".into())],
            ..Setting::default_of(CostStage::Train, CostInput::Photos)
        };
        measure::measure(&self.child.train(output, &setting, &self.flags(0))).map(drop)
    }

    /// Steps, triangles and seed of a run.
    fn flags(&self, run: usize) -> [(&'static str, String); 3] {
        let (steps, triangles) = (self.base.steps.to_string(), self.base.max_triangles.to_string());
        [("steps", steps), ("max_triangles", triangles), ("seed", run.to_string())]
    }

    /// The bake of a trained soup by default, its cost added to that of the training.
    fn chain(&self, soup: &Path, trained: &measure::Usage) -> Result<Outcome> {
        let default = Setting::default_of(CostStage::Bake, CostInput::SolidSoup);
        let file = self.folder.join("chain.glb");
        let baked = bake_once(self.child, soup, &file, &default)?;
        let usage = measure::Usage {
            wall_seconds: trained.wall_seconds + baked.usage.wall_seconds,
            cpu_seconds: trained.cpu_seconds + baked.usage.cpu_seconds,
            peak_bytes: trained.peak_bytes.max(baked.usage.peak_bytes),
        };
        let result = result(self.scorer.solid(&file)?, baked.skipped);
        Ok(Outcome { usage, bytes: Some(baked.bytes), result: Some(result), chain: None })
    }
}

impl Work for TrainWork<'_> {
    fn run(&mut self, setting: &Setting, run: usize) -> Result<Outcome> {
        let kept = setting.is_default() && run == 0;
        let soup = if kept { Self::default_soup(self.folder) } else { self.folder.join("trained.ply") };
        let usage = measure::measure(&self.child.train(&soup, setting, &self.flags(run)))?;
        let skipped = read_report(&soup.with_extension("json"))?
            .details::<TrainDetails>()
            .map(|train| train.skipped.labels());
        let bytes = std::fs::metadata(&soup).ok().map(|file| file.len());
        let chain = if self.chain { Some(Box::new(self.chain(&soup, &usage)?)) } else { None };
        let result = result(self.scorer.solid(&soup)?, skipped.unwrap_or_default());
        Ok(Outcome { usage, bytes, result: Some(result), chain })
    }
}

/// What is kept of a scene's pictures.
pub(super) fn result(scored: Scored, skipped: Vec<String>) -> RunResult {
    let picture = scored.pictures.into_iter().next();
    RunResult { triangles: scored.triangles, scores: scored.mean, exact_rms: None, skipped, picture }
}
