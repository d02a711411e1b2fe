//! Trains the teachers of a run.

use super::budget::{Budgeted, budgeted, with_fewer_steps};
use super::event::{Event, Observer, TrainBegins, TrainPart, begin};
use super::preparation::{PreparationPart, Storing, TeacherPlace, stopped};
use super::teacher::{
    ALL_TEACHERS_SHARE, BUDGET_SHARE, MOST_TEACHERS, enough_for_teacher, soft_scene, teacher_budget,
    teacher_files, teacher_options,
};
use super::watched::TrialRun;
use std::path::Path;
use std::time::Instant;
use trisplat_bake::TeacherDetails;
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_scene::{
    Budget, ImportedScene, Result,
    layered::Layered,
    report::{StageDetails, StageReport},
};
use trisplat_train::{BackendOptions, Checkpoint, OpenRun, TrainOptions, TrainRun, Trained, budget::Paced};

/// The trained teachers of a run.
pub(super) struct Teachers {
    /// Their scenes.
    pub(super) scenes: Vec<ImportedScene>,
    /// Report stage of their training.
    pub(super) stage: StageReport,
}

/// The run that needs teachers.
pub(super) struct TaughtRun<'a> {
    /// The photos and the options that they were read with.
    pub(super) photos: &'a Dataset,
    pub(super) how: &'a DatasetOptions,
    pub(super) options: &'a Layered<TrainOptions>,
    pub(super) budget: Option<Budget>,
    pub(super) began: Instant,
    pub(super) backend: &'a BackendOptions,
    /// Where and how teachers are stored when they are stopped.
    pub(super) storing: Storing,
    /// Result of the short trainings.
    pub(super) watched: Option<TrialRun>,
    /// The file that keeps the first finished teacher.
    pub(super) file: Option<&'a Path>,
    /// Weight of the teacher, 0 to 1.
    pub(super) weight: f64,
}

/// The teachers of a run that are still to be trained.
struct Remaining {
    photos: Dataset,
    /// Options that the photos were read with.
    how: DatasetOptions,
    /// Options of the next teacher, and its pace and checkpoint, if it has any.
    options: TrainOptions,
    paced: Option<Paced>,
    resume: Option<Checkpoint>,
    /// The next teacher.
    place: TeacherPlace,
    /// Those before it.
    scenes: Vec<ImportedScene>,
}

impl TaughtRun<'_> {
    /// Trains one teacher, and more of them if the first leaves time; from where the `stopped` one is, if one was stopped.
    ///
    /// Errors: those of a training; a stopped training; a budget that is too small.
    pub(super) fn train_teachers(
        &self,
        stopped: Option<(Checkpoint, TeacherPlace)>,
        observer: Observer<'_>,
    ) -> Result<Teachers> {
        let clock = Instant::now();
        let resumed = stopped.map(|stopped| self.resumed(stopped)).transpose()?.flatten();
        let mut left = match resumed {
            Some(left) => left,
            None => self.planned()?,
        };
        let mut first_stage = None;
        loop {
            let (trained, stage) = self.train_teacher(&mut left, observer)?;
            let stage = first_stage.get_or_insert(stage);
            if left.place.which == 0 {
                left.place.count = self.count(&trained, left.place.began_secs);
            }
            let seed = trained.options.seed.wrapping_add(1);
            left.options = TrainOptions { seed, ..trained.options.clone() };
            left.scenes.push(trained.into());
            left.place.which += 1;
            if left.place.which >= left.place.count {
                let stage = StageReport { seconds: clock.elapsed().as_secs_f64(), ..stage.clone() };
                return Ok(Teachers { scenes: left.scenes, stage });
            }
        }
    }

    /// All teachers, with the options of the first.
    fn planned(&self) -> Result<Remaining> {
        let (mut how, photos, weight) = (self.how.clone(), self.photos.train().count(), self.weight);
        let spending = self.storing.spending;
        let budget = self.budget.map(|budget| teacher_budget(budget, weight, spending.seconds()));
        let mut options = teacher_options(self.options, budget.is_some(), weight)?;
        let mut enough = enough_for_teacher(photos, weight);
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
        let place = TeacherPlace { which: 0, count: 0, began_secs: spending.seconds(), max_size };
        Ok(Remaining { photos, how, options, paced, resume: None, place, scenes: Vec::new() })
    }

    /// Those from a stopped one on; `None` if earlier ones are not in their files, so that all are trained again.
    fn resumed(&self, (point, place): (Checkpoint, TeacherPlace)) -> Result<Option<Remaining>> {
        let files = self.file.map(teacher_files).unwrap_or_default();
        let earlier = files.get(..place.which).filter(|files| files.iter().all(|file| file.is_file()));
        let Some(earlier) = earlier.or((place.which == 0).then_some(&[])) else { return Ok(None) };
        let scenes = earlier.iter().map(|file| soft_scene(file, self.how)).collect::<Result<_>>()?;
        let how = DatasetOptions { max_size: self.how.max_size.or(place.max_size), ..self.how.clone() };
        let photos = match how.max_size == self.how.max_size {
            true => self.photos.clone(),
            false => Dataset::load(&self.photos.path, &how)?,
        };
        let options = point.meta.options.clone();
        Ok(Some(Remaining { photos, how, options, paced: None, resume: Some(point), place, scenes }))
    }

    /// How many teachers the run has time for after the `first`, which began after `began_secs` of the budget.
    fn count(&self, first: &Trained, began_secs: f64) -> usize {
        let Some(Paced { pace, spending }) = &first.paced else { return 1 };
        let share = ALL_TEACHERS_SHARE / BUDGET_SHARE;
        let fit = share * (pace.budget.seconds.0 - began_secs) / (spending.seconds() - began_secs);
        (fit as usize).clamp(1, MOST_TEACHERS)
    }

    /// Trains the next teacher.
    fn train_teacher(&self, left: &mut Remaining, observer: Observer<'_>) -> Result<(Trained, StageReport)> {
        let clock = Instant::now();
        let run = TrainRun::new(&left.photos, &left.options).with_dataset_options(&left.how);
        let run = TrainRun { paced: left.paced.take(), began: Some(self.began), ..run };
        let part = PreparationPart::Teachers { watched: self.watched.clone(), place: left.place };
        let run = self.storing.stored(run, part, left.resume.take())?;
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
        let _ = observer(Event::Teacher(left.place.which, &trained));
        let mut stage = trained.stage(triangles, clock.elapsed().as_secs_f64());
        TeacherDetails::STAGE.clone_into(&mut stage.name);
        Ok((trained, stage))
    }
}
