//! The steps of a capture, from photos and videos to a data set with poses. Finished steps are not
//! repeated.
//!
//! ```text
//! inputs ──► photos ──► features ──► matches ──► model ──► verdict
//!            ours       └────── another program ──────┘    ours
//! ```

use super::collect::{self, PhotosDetails, TakenPhotos};
use super::log::tell;
use super::poses::{self, FeaturesDetails, MatchesDetails, ModelDetails, Poses};
use super::program::{CaptureOptions, Program};
use super::source::CaptureSources;
use super::verdict::{VerdictDetails, judge};
use crate::colmap::tracks;
use std::path::{Path, PathBuf};
use std::time::Instant;
use trisplat_scene::atomic::lies_inside;
use trisplat_scene::report::{
    Counts, Report, StageDetails, StageEvent, StageObserver, StageReport, to_json,
};
use trisplat_scene::{Error, Limits, Result};

/// Reason for skipping a finished step.
const DONE: &str = "done before";

/// A capture job.
#[derive(Debug, Clone)]
pub struct Capture {
    /// Photos, videos and folders of them.
    pub inputs: Vec<PathBuf>,
    /// Output folder: `images`, `sparse/0`, and `capture` with the files of the pose program.
    pub folder: PathBuf,
    /// Options.
    pub options: CaptureOptions,
    /// Set a capture of other inputs in the folder aside, as `FOLDER.old`.
    pub force: bool,
    /// Leave out photos that cannot be read.
    pub skip_broken: bool,
    /// Fewer photos are refused before anything runs, unless there is a video.
    pub least_photos: usize,
}

impl Capture {
    /// A capture of `inputs` into `folder` with default options.
    pub fn new(inputs: impl IntoIterator<Item = PathBuf>, folder: PathBuf) -> Self {
        let options = CaptureOptions::default();
        let force = false;
        let skip_broken = false;
        Self {
            inputs: inputs.into_iter().collect(),
            folder,
            options,
            force,
            skip_broken,
            least_photos: 1,
        }
    }

    /// Makes the data set and adds its steps to `report`. Returns the verdict, or `None` if
    /// `observer` stopped it: the next run of the same inputs continues from there.
    ///
    /// # Errors
    ///
    /// Unreadable inputs; no pose program, or one that fails; photos that do not fit together; a
    /// folder that holds something else.
    pub fn run(
        &self,
        report: &mut Report,
        observer: StageObserver<'_>,
    ) -> Result<Option<VerdictDetails>> {
        match (CaptureRun { job: self, report, observer }).all() {
            Err(Error::Stopped { .. }) => Ok(None),
            done => done.map(Some),
        }
    }

    /// The inputs as text, for reports.
    fn names(&self) -> impl Iterator<Item = String> {
        self.inputs.iter().map(|path| path.display().to_string())
    }
}

struct CaptureRun<'a> {
    job: &'a Capture,
    report: &'a mut Report,
    observer: StageObserver<'a>,
}

impl CaptureRun<'_> {
    fn all(&mut self) -> Result<VerdictDetails> {
        let job = self.job;
        self.report.inputs.extend(job.names());
        check_apart("output", &job.folder, &job.inputs)?;
        let sources = CaptureSources::find(&job.inputs)?;
        check_apart("output", &job.folder, &sources.places(&job.inputs))?;
        sources.check_number(job.least_photos, &job.inputs[0])?;
        self.report.warnings.extend(sources.warnings.iter().cloned());
        let program = Program::find(&job.options, &job.inputs[0])?;
        let photos = self.photos(&sources)?;
        let model = self.poses(program, &photos)?;
        self.verdict(&photos, &model)
    }

    /// Times and records a step. `run` returns the reason if there was nothing to do.
    fn stage<D: StageDetails, T>(
        &mut self,
        run: impl FnOnce(&mut Self, &mut D) -> Result<(T, Option<&'static str>)>,
    ) -> Result<T> {
        tell(self.observer, StageEvent::Started(D::STAGE))?;
        let clock = Instant::now();
        let mut details = D::default();
        let (value, skipped) = run(self, &mut details)?;
        let before = Counts::default();
        let after = Counts::default();
        let name = D::STAGE.to_owned();
        let skipped = skipped.map(str::to_owned);
        let seconds = clock.elapsed().as_secs_f64();
        let details = to_json(&details);
        let stage = StageReport { name, seconds, before, after, skipped, details };
        let told = tell(self.observer, StageEvent::Finished(&stage));
        self.report.stages.push(stage);
        told.map(|()| value)
    }

    fn photos(&mut self, sources: &CaptureSources) -> Result<TakenPhotos> {
        let job = self.job;
        let inputs = collect::inputs(sources, &job.options)?;
        let before =
            collect::taken_before(&job.folder, &inputs, job.force, &mut self.report.warnings)?;
        self.stage(|run, details: &mut PhotosDetails| {
            if let Some(before) = before {
                details.photos = before.photos.len() as u64;
                details.frames = before.photos.iter().filter(|photo| photo.frame).count() as u64;
                return Ok((before, Some(DONE)));
            }
            let how = (job.folder.as_path(), &job.options, job.skip_broken);
            let (taken, warnings) = collect::collect(sources, inputs, how, details, run.observer)?;
            run.report.warnings.extend(warnings);
            Ok((taken, None))
        })
    }

    /// The pose program's steps, unless the model is there.
    fn poses(&mut self, program: Program, photos: &TakenPhotos) -> Result<ModelDetails> {
        let Capture { folder, options, .. } = self.job;
        if poses::has_model(folder) {
            let model = poses::model_before(folder, photos, options)?;
            self.stage(|_, _: &mut FeaturesDetails| Ok(((), Some(DONE))))?;
            self.stage(|_, _: &mut MatchesDetails| Ok(((), Some(DONE))))?;
            return self.stage(|_, details: &mut ModelDetails| {
                *details = model.clone();
                Ok((model, Some(DONE)))
            });
        }
        let poses = &mut Poses::begin(program, folder, photos, options)?;
        self.stage(|run, details| {
            let found = poses.features(details, run.observer)?;
            Ok(((), (!found).then_some(DONE)))
        })?;
        self.stage(|run, details| Ok((poses.matches(details, run.observer)?, None)))?;
        self.stage(|run, details: &mut ModelDetails| {
            *details = poses.model(run.observer)?;
            Ok((details.clone(), None))
        })
    }

    fn verdict(&mut self, photos: &TakenPhotos, model: &ModelDetails) -> Result<VerdictDetails> {
        let folder = &self.job.folder;
        self.stage(|run, details: &mut VerdictDetails| {
            let images = folder.join("images");
            let tracks = tracks(folder, &Limits::DEFAULT)?;
            *details = judge(&images, photos, &tracks, model, run.observer)?;
            Ok((details.clone(), None))
        })
    }
}

/// Refuses photos in the output folder, and an output folder among the photos: the next run would
/// take its photos as inputs. `option` names the folder.
pub fn check_apart(option: &str, folder: &Path, photos: &[PathBuf]) -> Result<()> {
    for photo in photos {
        if photo.is_dir() && lies_inside(folder, photo) {
            let wants = format!("a folder outside of {}", photo.display());
            return Err(Error::invalid(option, folder.display(), wants));
        }
        if lies_inside(photo, folder) {
            let reason = format!(
                "lies in the output folder {}; move the photos elsewhere, or give another folder",
                folder.display()
            );
            return Err(Error::unsupported(photo, reason));
        }
    }
    Ok(())
}
