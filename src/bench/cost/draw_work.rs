//! Draws a scene with every setting.

use super::child::Child;
use super::draw::{DrawFigures, DrawSettings};
use super::knobs::CostInput;
use super::score::{Scorer, difference};
use super::setting::Setting;
use super::sweep::{Outcome, RunResult, Work};
use crate::bench::measure::{self, Usage};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::formats::{self, ReadOptions};
use crate::image::Pixels;
use crate::render::scene_renderer::SceneRenderer;
use std::path::Path;

/// How long a run draws at least.
const SECONDS: f64 = 0.4;

/// Draws in processes of their own.
pub(super) struct DrawWork<'a> {
    child: &'a Child,
    scorer: &'a Scorer<'a>,
    scene: &'a Path,
    folder: &'a Path,
    /// The pictures of the exact answer.
    exact: Vec<Pixels>,
}

impl<'a> DrawWork<'a> {
    /// Draws the exact answer of `scene` first.
    pub(super) fn new(
        child: &'a Child,
        scorer: &'a Scorer<'a>,
        scene: &'a Path,
        input: CostInput,
        folder: &'a Path,
    ) -> Result<Self> {
        let (renderer, triangles) = renderer(scorer, scene, &DrawSettings::EXACT)?;
        let exact = match input {
            CostInput::File => scorer.exact_solid(renderer)?,
            _ => scorer.renderer(renderer, triangles)?.pictures,
        };
        Ok(Self { child, scorer, scene, folder, exact })
    }

    /// What the child drew, drawn once more here.
    fn result(&self, setting: &Setting) -> Result<RunResult> {
        let (mut renderer, triangles) = renderer(self.scorer, self.scene, &settings_of(setting)?)?;
        let cameras: Vec<Camera> = self.scorer.dataset.test().map(|view| view.camera).collect();
        let skipped = renderer.skipped(&cameras);
        let scored = self.scorer.renderer(renderer, triangles)?;
        let exact_rms = Some(difference(&scored.pictures, &self.exact));
        let picture = scored.pictures.into_iter().next();
        Ok(RunResult { triangles, scores: scored.mean, exact_rms, skipped, picture })
    }
}

impl Work for DrawWork<'_> {
    fn run(&mut self, setting: &Setting, run: usize) -> Result<Outcome> {
        let path = self.folder.join("figures.json");
        let process = measure::measure(&self.child.draw(self.scene, &path, SECONDS, setting))?;
        let DrawFigures { cpu_seconds, wall_seconds } = DrawFigures::read(&path)?;
        let usage = Usage { cpu_seconds, wall_seconds, ..process };
        let result = if run == 0 { Some(self.result(setting)?) } else { None };
        Ok(Outcome { usage, bytes: None, result, chain: None })
    }
}

/// A renderer of a file, and its number of triangles.
fn renderer(scorer: &Scorer<'_>, path: &Path, settings: &DrawSettings) -> Result<(SceneRenderer, u64)> {
    let loaded = formats::read(path, &ReadOptions::with_degree(3))?;
    let triangles = loaded.scene.triangle_count() as u64;
    Ok((settings.renderer(loaded, scorer.dataset, scorer.background()), triangles))
}

/// The settings that the flags of a setting mean.
fn settings_of(setting: &Setting) -> Result<DrawSettings> {
    let mut settings = serde_json::to_value(DrawSettings::default()).unwrap_or_default();
    for (name, value) in &setting.changes {
        let wrong = || Error::invalid(*name, value, "a value of this option");
        let slot = settings.get_mut(*name).ok_or_else(wrong)?;
        *slot = serde_json::from_str(value).map_err(|_| wrong())?;
    }
    serde_json::from_value(settings).map_err(|e| Error::invalid("draw", setting.value(), e.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::cost::knobs::CostStage;

    #[test]
    fn changes_become_settings() {
        let changes = vec![("cutoff", "0.03".to_owned()), ("sort_per_pixel", "true".to_owned())];
        let setting = Setting { changes, ..Setting::default_of(CostStage::Draw, CostInput::SoftSoup) };
        let settings = settings_of(&setting).unwrap();
        let wanted = DrawSettings { cutoff: 0.03, sort_per_pixel: true, ..DrawSettings::default() };
        assert_eq!(settings, wanted);
        let wrong = Setting { changes: vec![("cutof", "1".into())], ..setting };
        assert!(settings_of(&wrong).is_err());
    }
}
