//! Trains one block: files in, files out. The result's name is a hash of its inputs, so a finished
//! task is not repeated. A task that was killed and starts again, here or elsewhere, ends with the
//! same bytes.

use super::manifest::{Block, Manifest, PlannedPhoto};
use super::plan::planned_photos;
use crate::manifest;
use glam::DVec3;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use trisplat_dataset::Dataset;
use trisplat_scene::camera::Camera;
use trisplat_scene::{Error, ImportedScene, Limits, Provenance, Result, Scene};
use trisplat_train::{Preview, TrainInputs, TrainOutputs, Trained, TrainedPart, checkpoint};

/// Default number of checkpoints that a task writes.
const CHECKPOINTS: u64 = 10;

/// A block that is to be trained.
#[derive(Debug)]
pub struct Task {
    manifest: Manifest,
    folder: PathBuf,
    index: usize,
}

impl Task {
    /// Block `index` of the plan at `path`.
    ///
    /// # Errors
    ///
    /// As of [`Manifest::read`]; a block that does not exist.
    pub fn open(path: &Path, index: usize, limits: &Limits) -> Result<Self> {
        let (manifest, folder) = Manifest::read(path, limits)?;
        let count = manifest.blocks.len();
        if index >= count {
            return Err(Error::invalid("block", index, format!("0 to {}", count - 1)));
        }
        Ok(Self { manifest, folder, index })
    }

    /// The block.
    pub fn block(&self) -> &Block {
        &self.manifest.blocks[self.index]
    }

    fn file(&self, ending: &str) -> PathBuf {
        self.folder.join(self.block().file(self.index, ending))
    }

    /// Path of its soup; the task is done once this file exists.
    pub fn output(&self) -> PathBuf {
        self.file("ply")
    }

    /// Path of its checkpoint.
    pub fn checkpoint(&self) -> PathBuf {
        self.file("checkpoint")
    }

    /// Its photos, and the cameras of the whole photos; `dataset` is where the data set is now,
    /// if not where it was planned.
    ///
    /// # Errors
    ///
    /// Photos or cameras that are not as they were planned.
    pub fn dataset(&self, dataset: Option<&Path>) -> Result<(Dataset, Vec<Camera>)> {
        let plan = &self.manifest;
        let options = &self.manifest.dataset_options;
        let path = dataset.map_or_else(|| plan.dataset_path(&self.folder), Path::to_owned);
        let photos: Vec<&PlannedPhoto> =
            self.block().photos.iter().map(|p| &plan.photos[p.photo as usize]).collect();
        let names: BTreeSet<String> = photos.iter().map(|photo| photo.name.clone()).collect();
        // A block that starts from triangles needs no points, which may be most of a data set.
        let origin = self.block().start.as_ref().map(|_| DVec3::from(plan.origin));
        let mut dataset = Dataset::load_some(&path, options, &names, origin)?;
        for (now, planned) in planned_photos(&dataset, options)?.iter().zip(&photos) {
            if now != *planned {
                let what = if now.hash == planned.hash { "its camera" } else { "its file" };
                let reason =
                    format!("{what} has changed since it was planned: restore it, or plan again");
                return Err(Error::malformed(&path, format!("photo `{}`", planned.name), reason));
            }
        }
        if dataset.origin.to_array() != plan.origin {
            let reason = "does not match the plan: its cameras or points differ; plan again";
            return Err(Error::unsupported(&path, reason));
        }
        let cameras = dataset.views.iter().map(|view| view.camera).collect();
        for (view, photo) in dataset.views.iter_mut().zip(&self.block().photos) {
            let (corner, size) = photo.corner_and_size();
            if size != view.camera.size {
                *view = view.cropped(corner, size)?;
            }
        }
        Ok((dataset, cameras))
    }

    /// Initial scene; `None` for a plain run.
    ///
    /// # Errors
    ///
    /// A file that is not as it was planned.
    fn start(&self) -> Result<Option<ImportedScene>> {
        let Some(start) = &self.block().start else { return Ok(None) };
        let mut loaded =
            manifest::read(&self.folder, start, &self.manifest.dataset_options.limits)?;
        if let Scene::Soup(soup) = &mut loaded.scene {
            let count = |n: u64| usize::try_from(n).unwrap_or(usize::MAX);
            let first = count(self.block().frozen);
            soup.set_shell(first..first.saturating_add(count(self.block().shell)));
        }
        Ok(Some(loaded))
    }

    /// The run on `dataset`, that of [`Task::dataset`]: from its checkpoint if there is one, else
    /// from the beginning. With the warning that a checkpoint cannot be read, when that is so.
    ///
    /// # Errors
    ///
    /// A plan that is not whole, photos that cannot be read, and those of the training.
    pub fn run<'a>(
        &self,
        dataset: &'a Dataset,
        outputs: TrainOutputs,
    ) -> Result<(TrainInputs<'a>, Option<String>)> {
        let options = self.manifest.options_of(self.index);
        let path = self.checkpoint();
        let (resume, warning) = match path.exists().then(|| checkpoint::read(&path)) {
            None => (None, None),
            Some(Ok(checkpoint)) => (Some(checkpoint), None),
            Some(Err(error)) => (None, Some(format!("{error}; training from the beginning"))),
        };
        let from = if resume.is_some() { None } else { self.start()? };
        let part = from.as_ref().map(|_| TrainedPart {
            space: self.manifest.space(),
            first_step: self.block().first_step,
            core: Some(self.block().training_core(&self.manifest.space())),
            frozen: usize::try_from(self.block().frozen).unwrap_or(usize::MAX),
        });
        let run = TrainInputs::new(dataset, &options)
            .with_dataset_options(&self.manifest.dataset_options);
        Ok((TrainInputs { outputs, from, part, resume, ..run }, warning))
    }

    /// Outputs of the run; 0 `checkpoint_every`: ten checkpoints on the way.
    pub fn outputs(
        &self,
        checkpoint_every: u64,
        preview: Option<Preview>,
        max_cpu_secs: f64,
    ) -> TrainOutputs {
        let steps = self.block().steps - self.block().first_step;
        let checkpoint_every =
            if checkpoint_every > 0 { checkpoint_every } else { steps.div_ceil(CHECKPOINTS) };
        TrainOutputs {
            checkpoint: Some(self.checkpoint()),
            keep: 1,
            checkpoint_every,
            preview,
            max_cpu_secs,
            ..TrainOutputs::default()
        }
    }

    /// Result as it is written: with the cameras of whole photos.
    pub fn finished(&self, trained: Trained, cameras: Vec<Camera>) -> Trained {
        Trained { cameras, ..unnamed(trained) }
    }
}

/// Result without the name of its data set: files of a plan are the same wherever the
/// photos lie.
pub fn unnamed(trained: Trained) -> Trained {
    Trained { provenance: Provenance { source: None, ..trained.provenance }, ..trained }
}

/// The state of a block of a plan in `folder`: "done" when its result exists, "begun" when a
/// checkpoint does, or "waiting".
pub fn status(folder: &Path, block: &Block, index: usize) -> &'static str {
    let is_there = |ending: &str| folder.join(block.file(index, ending)).is_file();
    if is_there("ply") {
        "done"
    } else if is_there("checkpoint") {
        "begun"
    } else {
        "waiting"
    }
}
