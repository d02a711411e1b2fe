//! Trains the teacher of a run.

use super::budget::{Budgeted, budgeted, with_fewer_steps};
use super::event::{Event, Observer, TrainBegins, TrainPart, begin};
use super::preparation::{PreparationPart, Storing, stopped};
use super::teacher::{enough_for_teacher, teacher_budget, teacher_options};
use super::watched::TrialRun;
use std::time::Instant;
use trisplat_bake::TeacherDetails;
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_scene::{
    Budget, ImportedScene, Result,
    layered::Layered,
    report::{StageDetails, StageReport},
};
use trisplat_train::{BackendOptions, Checkpoint, OpenRun, TrainOptions, TrainRun, budget::Paced};

/// The run that needs a teacher.
pub(super) struct TaughtRun<'a> {
    /// The photos and the options that they were read with.
    pub(super) photos: &'a Dataset,
    pub(super) how: &'a DatasetOptions,
    pub(super) options: &'a Layered<TrainOptions>,
    pub(super) budget: Option<Budget>,
    pub(super) began: Instant,
    pub(super) backend: &'a BackendOptions,
    /// Where and how the teacher is stored when it is stopped.
    pub(super) storing: Storing,
    /// Result of the short trainings.
    pub(super) watched: Option<TrialRun>,
}

/// The training of a teacher.
struct Planned {
    photos: Dataset,
    /// Options that the photos were read with.
    how: DatasetOptions,
    options: TrainOptions,
    paced: Option<Paced>,
    resume: Option<Checkpoint>,
    /// The size of photos that the budget chose.
    max_size: Option<u32>,
}

impl TaughtRun<'_> {
    /// Trains the teacher, from where it was `stopped`, if it was; with the report's stage.
    ///
    /// Errors: those of a training; a stopped training; a budget that is too small.
    pub(super) fn train_teacher(
        &self,
        stopped_at: Option<(Checkpoint, Option<u32>)>,
        observer: Observer<'_>,
    ) -> Result<(ImportedScene, StageReport)> {
        let clock = Instant::now();
        let Planned { photos, how, options, paced, resume, max_size } = match stopped_at {
            Some(stopped) => self.resumed(stopped)?,
            None => self.planned()?,
        };
        let run = TrainRun::new(&photos, &options).with_dataset_options(&how);
        let run = TrainRun { paced, began: Some(self.began), ..run };
        let part = PreparationPart::Teacher { watched: self.watched.clone(), max_size };
        let run = self.storing.stored(run, part, resume)?;
        // The run reports the card, so the teacher does not.
        let OpenRun { run, .. } = run.start_at(self.backend)?;
        let triangles = run.triangles();
        let (part, steps) = (TrainPart::Teacher, run.options().steps);
        let begins = TrainBegins { part, steps, ..TrainBegins::default() };
        let trained = run.finish(&mut begin(observer, &begins)?)?;
        if trained.stopped {
            return Err(stopped("the training of a soft teacher scene", &trained));
        }
        // The next training asks whether to go on, and can be resumed.
        let _ = observer(Event::Teacher(&trained));
        let mut stage = trained.stage(triangles, clock.elapsed().as_secs_f64());
        TeacherDetails::STAGE.clone_into(&mut stage.name);
        Ok((trained.into(), stage))
    }

    /// A new teacher.
    fn planned(&self) -> Result<Planned> {
        let (mut how, photos) = (self.how.clone(), self.photos.train().count());
        let spending = self.storing.spending;
        let budget = self.budget.map(|budget| teacher_budget(budget, spending.seconds()));
        let mut options = teacher_options(self.options, budget.is_some())?;
        let mut enough = enough_for_teacher(photos);
        // Steps given for the run also hold for its teacher.
        enough.steps = enough.steps.filter(|_| !self.options.is_given("steps"));
        if budget.is_none() {
            let triangles_given = self.options.is_given("max_triangles");
            options.options = with_fewer_steps(options.options, enough.steps, triangles_given);
        }
        let Budgeted { dataset: photos, options, paced } =
            budgeted(self.photos.clone(), options, None, budget, enough, spending, &mut how)?;
        // A given size is not a chosen one.
        let max_size = how.max_size.filter(|_| how.max_size != self.how.max_size);
        Ok(Planned { photos, how, options, paced, resume: None, max_size })
    }

    /// The teacher that was stopped at `point`, on photos of the size that a budget chose then.
    fn resumed(&self, (point, max_size): (Checkpoint, Option<u32>)) -> Result<Planned> {
        let how = DatasetOptions { max_size: self.how.max_size.or(max_size), ..self.how.clone() };
        let photos = match how.max_size == self.how.max_size {
            true => self.photos.clone(),
            false => Dataset::load(&self.photos.path, &how)?,
        };
        let options = point.meta.options.clone();
        Ok(Planned { photos, how, options, paced: None, resume: Some(point), max_size })
    }
}
