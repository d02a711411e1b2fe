//! The result of a run: the scene, its figures, and its file.

use super::budget::{BudgetControl, BudgetDetails};
use super::eval::{PhotoScore, Quality, TrainSample};
use super::options::TrainOptions;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use trisplat_dataset::exposure::ExposureDetails;
use trisplat_dataset::{Dataset, ShrunkSize};
use trisplat_formats::ply;
use trisplat_scene::atomic::AtomicFile;
use trisplat_scene::camera::Camera;
use trisplat_scene::report::{Counts, StageDetails, StageReport, generator, to_json};
use trisplat_scene::{Error, ImportedScene, Placement, Provenance, Result, Soup, process};

/// A trained scene.
#[derive(Debug, Clone)]
pub struct Trained {
    /// The scene, in the data set's world.
    pub soup: Soup,
    /// The cameras of the training photos, in the same world.
    pub cameras: Vec<Camera>,
    /// The provenance of the scene, and the place of the data set's world in that of its files.
    pub provenance: Provenance,
    /// Steps made; fewer than planned when the run was stopped.
    pub steps: u64,
    /// The options of the run; with a budget, the final steps and milestones.
    pub options: TrainOptions,
    /// The control of the budget, if the run had one.
    pub budget_control: Option<BudgetControl>,
    /// The curve.
    pub curve: Vec<TrainSample>,
    /// The held-out photos at the end.
    pub scores: Vec<PhotoScore>,
    /// Samples per pixel along each axis of the drawings for them; `None` for soft drawings.
    pub samples: Option<u32>,
    /// The size that these photos were shrunk to; `None` where they were not.
    pub photo_size: Option<ShrunkSize>,
    /// Gradients dropped because they were not finite.
    pub dropped: u64,
    /// CPU seconds of the training, evaluations excluded.
    pub cpu_secs: f64,
    /// The photos' exposures; `None` where they were not estimated.
    pub exposure: Option<ExposureDetails>,
    /// The run was stopped before its last step.
    pub stopped: bool,
    /// The checkpoint of the last step, if one was written.
    pub checkpoint: Option<PathBuf>,
    /// Checkpoints and previews that could not be written, and why. The scene does not depend on
    /// them.
    pub lost: Vec<String>,
}

/// Figures of a training, as its report holds them.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TrainDetails {
    /// Steps made.
    pub steps: u64,
    /// The run was stopped before its last step.
    pub stopped: bool,
    /// CPU seconds of the training, evaluations excluded.
    pub cpu_secs: f64,
    /// Maximum memory the process has held, bytes.
    pub peak_bytes: u64,
    /// Gradients dropped because they were not finite.
    pub dropped_gradients: u64,
    /// Mean PSNR over the held-out photos, dB; null when there are none.
    pub psnr: Option<f64>,
    /// Mean SSIM over the held-out photos; null when there are none.
    pub ssim: Option<f64>,
    /// Mean PSNR over the held-out photos after one affine colour map per photo, dB; absent if
    /// photos were not corrected.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_corrected: Option<f64>,
    /// Samples per pixel along each axis of the solid drawings for these scores; null for soft
    /// drawings.
    #[serde(default)]
    pub samples: Option<u32>,
    /// The size that the held-out photos were shrunk to for these scores, "320x213"; absent where
    /// they were not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photo_size: Option<ShrunkSize>,
    /// The use of the budget; absent without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub budget: Option<BudgetDetails>,
    /// The photos' exposures; absent where they were not estimated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure: Option<ExposureDetails>,
    /// The held-out photos one by one.
    pub held_out: Vec<PhotoScore>,
}

trisplat_scene::stage!(TrainDetails, "train");

impl From<Trained> for ImportedScene {
    /// The scene as a reader returns it after [`Trained::save`].
    fn from(trained: Trained) -> Self {
        let Trained { soup, cameras, provenance, .. } = trained;
        ImportedScene { provenance, cameras, ..ImportedScene::from(soup) }
    }
}

impl Trained {
    /// Means over the held-out photos; `None` when there are none.
    pub fn quality(&self) -> Option<Quality> {
        Quality::mean(&self.scores)
    }

    /// [`PhotoScore::mean_corrected`] of a training that corrected its photos; `None` of any other.
    pub fn psnr_corrected(&self) -> Option<f64> {
        let corrected =
            self.exposure.as_ref().is_some_and(|exposure| !exposure.exposures.gains.is_empty());
        corrected.then(|| PhotoScore::mean_corrected(&self.scores)).flatten()
    }

    /// Writes the soup with its cameras and provenance as a PLY that appears whole or not at all;
    /// "-" is standard output. Returns its size in bytes.
    ///
    /// # Errors
    ///
    /// A file that the operating system refuses.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<u64> {
        self.save_to(AtomicFile::create(path.as_ref())?)
    }

    /// [`Trained::save`] into a file that was started.
    pub fn save_to(&self, mut file: AtomicFile) -> Result<u64> {
        self.write_to(&mut file)?;
        file.commit()
    }

    /// [`Trained::save`] into a file that was started; its final name is given later.
    pub fn write_to(&self, file: &mut AtomicFile) -> Result<()> {
        ply::write_soup(file, &self.soup, &self.provenance, &self.cameras)
            .map_err(|e| Error::io(file.path(), e))
    }

    /// The figures of the run that this process knows.
    pub fn details(&self) -> TrainDetails {
        let quality = self.quality();
        TrainDetails {
            steps: self.steps,
            stopped: self.stopped,
            cpu_secs: self.cpu_secs,
            peak_bytes: process::peak_bytes(),
            dropped_gradients: self.dropped,
            psnr: quality.map(|q| q.psnr),
            ssim: quality.map(|q| q.ssim),
            samples: self.samples,
            photo_size: self.photo_size,
            budget: self.budget(),
            psnr_corrected: self.psnr_corrected(),
            exposure: self.exposure.clone(),
            held_out: self.scores.clone(),
        }
    }

    /// The use of the budget so far; `None` without one.
    pub fn budget(&self) -> Option<BudgetDetails> {
        let BudgetControl { pace, spending } = self.budget_control.as_ref()?;
        Some(pace.details(spending.seconds(), &self.options))
    }

    /// The run as the only stage of its report; it began with `triangles` and took `seconds`.
    pub fn stage(&self, triangles: usize, seconds: f64) -> StageReport {
        let counts = |count: usize| Counts { triangles: count as u64, vertices: 3 * count as u64 };
        StageReport {
            name: TrainDetails::STAGE.into(),
            seconds,
            before: counts(triangles),
            after: counts(self.soup.len()),
            skipped: None,
            details: to_json(&self.details()),
        }
    }
}

/// The provenance of a scene trained on `dataset`.
pub(super) fn provenance(dataset: &Dataset) -> Provenance {
    Provenance {
        generator: Some(generator()),
        source: dataset.path.file_name().map(|name| name.to_string_lossy().into_owned()),
        trainer: Some(generator()),
        up: Some(dataset.up_axis()),
        usual_up: None,
        placement: Placement { center: dataset.origin.to_array(), ..Placement::IDENTITY },
        // The soup stores its cameras, so viewers can choose among them.
        viewpoint: None,
        backdrop_faces: 0,
        exposure: None,
        cameras: Vec::new(),
    }
}
