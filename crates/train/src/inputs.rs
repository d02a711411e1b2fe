//! The inputs of a training, and its outputs on the way.

use super::backend::RunSize;
use super::budget::{BudgetControl, Spending};
use super::checkpoint::{Checkpoint, CheckpointMeta};
use super::options::TrainOptions;
use super::params::Core;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_raster::soft::SoftOptions;
use trisplat_scene::{ImportedScene, SceneNormalization};

/// The part of a scene that a training changes, in agreement with the trainings of other parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrainedPart {
    /// Training space of the whole scene, so that lengths and rates agree in all parts.
    pub space: SceneNormalization,
    /// Number of triangles at the front of the starting scene that are drawn but not trained;
    /// `max_triangles` does not count them. The shell follows them.
    pub frozen: usize,
    /// The box of the part that stays after merging, with its own limit of triangles.
    pub core: Option<Core>,
    /// The first step of its schedule; earlier ones trained the whole scene.
    pub first_step: u64,
}

/// Outputs during a training; none of them changes the result.
#[derive(Debug, Clone, Default)]
pub struct TrainOutputs {
    /// File of the checkpoints.
    pub checkpoint: Option<PathBuf>,
    /// Number of last checkpoints to keep, in separate files; 0 means 1.
    pub keep: u32,
    /// Steps between checkpoints; 0 writes one only when the run is stopped.
    pub checkpoint_every: u64,
    /// Steps between samples of the curve; 0 chooses 100 samples per run.
    pub sample_every: u64,
    /// Steps between evaluations on the held-out photos; 0 evaluates once, at the end.
    pub evaluate_every: u64,
    /// Pictures of the first held-out photo.
    pub preview: Option<Preview>,
    /// Stop after this many CPU seconds, as on request; 0 never.
    pub max_cpu_secs: f64,
}

/// Prefix of the file names of previews.
pub const PREVIEW_PREFIX: &str = "step-";

/// Pictures of the first held-out photo while a scene trains.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Preview {
    /// Their folder; files are called `step-000500.png`.
    pub folder: PathBuf,
    /// Time between two previews.
    pub interval: Duration,
}

/// All inputs of a training. [`TrainInputs::new`] has the plain values; any field can be set before
/// the start.
///
/// ```
/// use std::ops::ControlFlow::Continue;
/// use trisplat_synthetic::SyntheticOptions;
/// use trisplat_dataset::{Dataset, DatasetOptions};
/// use trisplat_train::{TrainOutputs, TrainOptions, TrainInputs, checkpoint};
///
/// let folder = tempfile::tempdir().unwrap();
/// trisplat_synthetic::write(folder.path(), &SyntheticOptions { views: 8, width: 24, points: 50, seed: 0, ..SyntheticOptions::default() })?;
/// let dataset = Dataset::load(folder.path(), &DatasetOptions::default())?;
/// let options = TrainOptions { steps: 20, max_triangles: 100, ..TrainOptions::default() };
///
/// // A run that writes checkpoints ...
/// let path = folder.path().join("scene.checkpoint");
/// let outputs = TrainOutputs { checkpoint: Some(path.clone()), checkpoint_every: 10, ..TrainOutputs::default() };
/// let trained = TrainInputs { outputs, ..TrainInputs::new(&dataset, &options) }.run(&mut |_| Continue(()))?;
///
/// // ... and one that goes on from the last of them: the same bits, since it was made after the last step.
/// let resumed = TrainInputs::from_checkpoint(&dataset, checkpoint::read(&path)?).run(&mut |_| Continue(()))?;
/// assert_eq!(trained.soup, resumed.soup);
/// # Ok::<(), trisplat_scene::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct TrainInputs<'a> {
    /// The photos; those held out evaluate the scene.
    pub dataset: &'a Dataset,
    /// The options of the training; a resumed run has those of its checkpoint.
    pub options: TrainOptions,
    /// The colour behind everything, sRGB-encoded in [0, 1]; the same as for reading the data set.
    pub background: [f32; 3],
    /// Memory for decoded photos, bytes; others are kept on disk.
    pub photo_bytes: u64,
    /// The outputs during the run.
    pub outputs: TrainOutputs,
    /// The scene to start from instead of the data set's points, as a reader returns it; suitable
    /// options are those of [`TrainOptions::from_scene`].
    pub from: Option<ImportedScene>,
    /// Allow that scene more triangles than `max_triangles`: a solid run removes up to a tenth of
    /// them per densification, and has some left if it ends before.
    pub shrink_initial_scene: bool,
    /// The part of that scene to train, if not all; a resumed run has the part of its checkpoint.
    pub part: Option<TrainedPart>,
    /// End after this step, without finishing the schedule. `None`: after the last step.
    pub until_step: Option<u64>,
    /// The checkpoint to resume from.
    pub resume: Option<Checkpoint>,
    /// Keeps the run to a budget; `None` makes the steps of the options. A resumed run has the pace
    /// of its checkpoint, and its spending is counted from here.
    pub budget_control: Option<BudgetControl>,
    /// Start of the process that resumes a run with a budget; `None`: now.
    pub began: Option<Instant>,
    /// Resume even if photos, cameras, points or the background differ from those of the
    /// checkpoint.
    pub force_resume: bool,
}

impl<'a> TrainInputs<'a> {
    /// A training from its beginning without outputs, with the background and the memory for photos of
    /// [`DatasetOptions::default`].
    pub fn new(dataset: &'a Dataset, options: &TrainOptions) -> Self {
        let inputs = Self {
            dataset,
            options: options.clone(),
            background: [0.0; 3],
            photo_bytes: 0,
            outputs: TrainOutputs::default(),
            from: None,
            shrink_initial_scene: false,
            part: None,
            until_step: None,
            resume: None,
            budget_control: None,
            began: None,
            force_resume: false,
        };
        inputs.with_dataset_options(&DatasetOptions::default())
    }

    /// The inputs of a training that goes on from `checkpoint`.
    pub fn from_checkpoint(dataset: &'a Dataset, checkpoint: Checkpoint) -> Self {
        let inputs = Self::new(dataset, &checkpoint.meta.options);
        Self { resume: Some(checkpoint), ..inputs }
    }

    /// Takes background and memory for photos from the options of the data set.
    pub fn with_dataset_options(self, options: &DatasetOptions) -> Self {
        let photo_bytes = options.photo_bytes();
        Self { background: options.background.to_f32(), photo_bytes, ..self }
    }

    /// Drawing options of the first step.
    pub fn drawing(&self) -> SoftOptions {
        let options = self.resumed().map_or(&self.options, |meta| &meta.options);
        options.drawing(self.background)
    }

    pub(super) fn resumed(&self) -> Option<&CheckpointMeta> {
        self.resume.as_ref().map(|checkpoint| &checkpoint.meta)
    }

    /// The clock of the budget; `None` without one.
    pub(super) fn spending(&self) -> Option<Spending> {
        if let Some(control) = &self.budget_control {
            return Some(control.spending);
        }
        let pace = self.resumed()?.pace.as_ref()?;
        let clock = pace.budget.clock;
        let spending = self
            .began
            .map_or_else(|| Spending::new(clock), |began| Spending::of_process(clock, began));
        Some(spending.after(pace.stored_secs))
    }

    /// Final size of the scene and of its photos.
    pub(super) fn size(&self) -> RunSize {
        let options = self.resumed().map_or(&self.options, |meta| &meta.options);
        let photos = || self.dataset.train().map(|view| view.photo.size);
        let frozen_part = self.part.map_or(0, |part| part.frozen);
        let frozen = self.resumed().map_or(frozen_part, |meta| meta.frozen);
        RunSize {
            triangles: options.max_triangles.saturating_add(frozen as u64),
            sh_degree: options.sh_degree,
            photo: photos().max_by_key(|size| size.element_product()).unwrap_or_default(),
            photo_pixels: photos().map(|size| u64::from(size.x) * u64::from(size.y)).sum(),
        }
    }
}
