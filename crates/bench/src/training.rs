//! A soup trained for a benchmark, in a file like any other.

use std::path::PathBuf;
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_scene::{Error, Provenance, Result};
use trisplat_train::{TrainObserver, TrainOptions, TrainPreset, TrainRun, Trained};

/// How much is trained.
#[derive(Debug, Clone, PartialEq, Default, clap::Args)]
pub struct TrainBudget {
    /// Steps of each training, when no soup is given [default: the preset's own].
    #[arg(long, value_name = "N")]
    pub steps: Option<u64>,
    /// Most triangles of each training, when no soup is given [default: the preset's own].
    #[arg(long, value_name = "N")]
    pub max_triangles: Option<u64>,
}

impl TrainBudget {
    /// Fails when a budget is given and nothing `trains`.
    pub fn check(&self, trains: bool) -> Result<()> {
        for (option, value) in [("steps", self.steps), ("max_triangles", self.max_triangles)] {
            if let Some(value) = value.filter(|_| !trains) {
                return Err(Error::invalid(option, value, "no `soup`: nothing is trained"));
            }
        }
        Ok(())
    }
}

/// A trained soup.
#[derive(Debug)]
pub(crate) struct TrainedSoup {
    /// Where it is, for as long as this lives.
    pub path: PathBuf,
    /// How it was trained: "solid 5000 steps".
    pub name: String,
    /// Keeps the file.
    _folder: tempfile::TempDir,
}

/// Trains a soup on the training photos of `dataset`.
///
/// Errors: a budget out of range, photos that cannot be decoded, no room for the file.
pub(crate) fn train(
    dataset: &Dataset,
    preset: TrainPreset,
    budget: &TrainBudget,
    dataset_options: &DatasetOptions,
    observer: TrainObserver<'_>,
) -> Result<TrainedSoup> {
    let mut options = TrainOptions::preset(preset);
    options.steps = budget.steps.unwrap_or(options.steps);
    options.max_triangles = budget.max_triangles.unwrap_or(options.max_triangles);
    let trained = TrainRun::new(dataset, &options).with_dataset_options(dataset_options).run(observer)?;
    let steps = trained.steps;

    let folder = tempfile::tempdir().map_err(Error::temporary)?;
    let path = folder.path().join("soup.ply");
    // Only what moves cameras: benchmarks do not depend on names and axes.
    let Provenance { placement, viewpoint, .. } = trained.provenance;
    let provenance = Provenance { placement, viewpoint, ..Provenance::default() };
    Trained { provenance, ..trained }.save(&path)?;
    let kind = serde_json::to_value(preset).unwrap_or_default();
    let name = format!("{} {steps} steps", kind.as_str().unwrap_or_default());
    Ok(TrainedSoup { path, name, _folder: folder })
}
