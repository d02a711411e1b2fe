//! A surface job: from a scene, from Gaussian splats or from photos alone to one connected surface.

use super::event::{Observer, add, stages};
use super::gaussians::{self, SplatTraining, TrainingEffort};
use super::training::TrainJob;
use std::ops::ControlFlow;
use std::path::Path;
use trisplat_bake::{MeshOptions, Views, mesh};
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_formats::{self as formats, Content};
use trisplat_scene::camera::PhotoDepths;
use trisplat_scene::report::{Outcome, Report};
use trisplat_scene::{Asset, Error, ImportedScene, Result, Seconds};
use trisplat_train::{DepthsDetails, TrainOptions, measure_depths, reconstruct_points};

/// CPU time for a scene of photos alone. More gains nothing: the surface has far fewer triangles
/// than any scene (docs/benchmarks/figures.md).
const TRAINING: Seconds = Seconds(30.0);

/// A surface job. [`MeshJob::new`] has the plain values; any field can be set before the run.
#[derive(Debug, Clone)]
pub struct MeshJob {
    /// The scene; without it, one is trained on the photos first. Gaussians become triangles first.
    pub scene: Option<Content>,
    /// Photos, whose cameras decide what the surface is, and which textures show. Pictures of
    /// Gaussians replace them.
    pub photos: Option<Dataset>,
    /// Reading options of the photos. Their limits bound the memory of the distance field.
    pub dataset_options: DatasetOptions,
    /// Options of the stages.
    pub options: MeshOptions,
    /// Options of that training.
    pub train: TrainOptions,
    /// CPU time of that training; `None`: the steps of `train`, so equal jobs make equal bytes.
    pub budget: Option<Seconds>,
}

impl MeshJob {
    /// A surface with these options, on photos read with [`DatasetOptions::default`]; a scene for
    /// it trains for half a minute.
    pub fn new(scene: Option<Content>, photos: Option<Dataset>, options: MeshOptions) -> Self {
        let dataset_options = DatasetOptions::default();
        let train = TrainOptions::default();
        Self { scene, photos, dataset_options, options, train, budget: Some(TRAINING) }
    }

    /// Makes the surface and writes it as its options say; the ending of `path` chooses the format.
    /// Existing files are replaced.
    ///
    /// # Errors
    ///
    /// Errors of [`MeshJob::run`], of the format and of the operating system.
    pub fn save(self, path: impl AsRef<Path>) -> Result<Asset> {
        let output = self.options.output.clone();
        let surface = self.run(&mut Report::new("mesh"), &mut |_| ControlFlow::Continue(()))?;
        let surface = surface.expect("no observer stops it");
        formats::write(&surface, path.as_ref(), &output)?;
        Ok(surface)
    }

    /// Makes the surface; `report` gets the stages. `None` when `observer` stopped the training, if
    /// there is one.
    ///
    /// # Errors
    ///
    /// Neither scene nor photos; a texture without photos; those of [`TrainJob::run`] and
    /// [`mesh`](mesh()).
    pub fn run(mut self, report: &mut Report, observer: Observer<'_>) -> Result<Option<Asset>> {
        self.options.validate()?;
        let are_splats = matches!(self.scene, Some(Content::Splats(_)));
        self.options.check_photos(self.photos.is_some() || are_splats)?;
        let reading = &self.dataset_options;
        if let Some(photos) = &mut self.photos {
            let first_new = photos.warnings.len();
            reconstruct_points(photos, reading.photo_bytes())?;
            report.warnings.extend_from_slice(&photos.warnings[first_new..]);
        }
        let mut pictures = None;
        let scene = match (self.scene, &self.photos) {
            (Some(Content::Scene(scene)), _) => scene,
            (Some(Content::Splats(splats)), photos) => {
                let splats = (Path::new("scene"), splats);
                let effort = TrainingEffort::FAST;
                let training = SplatTraining { effort, max_triangles: None, sh_degree: 0 };
                let solid =
                    gaussians::solid(splats, photos.as_ref(), reading, training, report, observer)?;
                add(solid.stage, report, observer);
                pictures = solid.pictures;
                solid.scene
            }
            (None, Some(photos)) => {
                let mut job = TrainJob::new(photos.clone(), self.train);
                job.dataset_options = self.dataset_options.clone();
                job.limit(self.budget, 1.0);
                let done = match job.run(observer) {
                    Err(Error::Stopped { .. }) => return Ok(None),
                    done => done?,
                };
                report.stages.extend(done.report.stages);
                // Warnings about the photos are in the report already.
                let is_new = |warning: &String| !photos.warnings.contains(warning);
                report.warnings.extend(done.report.warnings.into_iter().filter(is_new));
                if done.trained.stopped {
                    return Ok(None);
                }
                done.trained.into()
            }
            (None, None) => {
                return Err(Error::invalid("scene", "missing", "a scene, or photos of one"));
            }
        };
        let mut views = match &self.photos {
            Some(photos) => {
                let depths = depths_of(photos, reading, &scene, report, observer)?;
                Some(Views::new(photos, reading).with_depths(depths))
            }
            None => pictures,
        };
        let limits = &reading.limits;
        mesh(scene, views.as_mut(), &self.options, limits, report, &mut stages(observer)).map(Some)
    }
}

/// The depths of the photos of `scene`, read with these options.
fn depths_of(
    photos: &Dataset,
    reading: &DatasetOptions,
    scene: &ImportedScene,
    report: &mut Report,
    observer: Observer<'_>,
) -> Result<Vec<PhotoDepths>> {
    let counts = |_: &Vec<PhotoDepths>| scene.counts();
    let measure = |depths: &mut Vec<PhotoDepths>, details: &mut DepthsDetails| {
        *depths = measure_depths(photos, reading.photo_bytes())?;
        if depths.is_empty() {
            return Ok(Outcome::Skipped("the photos have no tracked points"));
        }
        *details = DepthsDetails::new(depths);
        Ok(Outcome::Changed(()))
    };
    Ok(report.stage(&mut stages(observer), Vec::new(), counts, measure)?.0)
}
