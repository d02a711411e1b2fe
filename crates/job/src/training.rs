//! A training job, from options to the trained scene: plan, preparation, run, report.

use super::event::{Event, Observer, TrainBegins, TrainPart, begin, stopped_error};
use super::exposure::{self, ExposureDecision};
use super::teacher::{self, TeacherPlan, TeacherSource};
use std::path::PathBuf;
use std::time::Instant;
use trisplat_bake::TeacherDetails;
use trisplat_dataset::exposure::{ExposureEvidence, ExposureUse, Strengths};
use trisplat_dataset::{Dataset, DatasetKind, DatasetOptions, View};
use trisplat_scene::layered::{Layered, Origin};
use trisplat_scene::process::cpu_secs;
use trisplat_scene::report::{Counts, Report, StageDetails, StageReport, to_json};
use trisplat_scene::{Budget, Error, ImportedScene, Result, Seconds, Spending};
use trisplat_train::budget::{self, BudgetControl, Pace, PlanInput, StepLimit, WholeBudget};
use trisplat_train::{
    BackendOptions, Checkpoint, TrainInputs, TrainOptions, TrainOutputs, Trained,
    reconstruct_points,
};

/// A training job. [`TrainJob::new`] has the plain values; any field can be set
/// before the run.
///
/// ```
/// use std::ops::ControlFlow::Continue;
/// use trisplat_synthetic::SyntheticOptions;
/// use trisplat_job::TeacherSource;
/// use trisplat_dataset::Dataset;
/// use trisplat_dataset::DatasetOptions;
/// use trisplat_job::TrainJob;
/// use trisplat_train::TrainOptions;
///
/// let folder = tempfile::tempdir().unwrap();
/// trisplat_synthetic::write(folder.path(), &SyntheticOptions { views: 8, width: 24, points: 50, seed: 0, ..SyntheticOptions::default() })?;
/// let dataset = Dataset::load(folder.path(), &DatasetOptions::default())?;
/// let options = TrainOptions { steps: 20, max_triangles: 100, ..TrainOptions::default() };
///
/// let mut job = TrainJob::new(dataset, options);
/// job.teacher = Some(TeacherSource::Off);
/// let done = job.run(&mut |_| Continue(()))?;
/// assert_eq!(done.trained.steps, 20);
/// assert_eq!(done.report.stages[1].skipped.as_deref(), Some("`teacher` off"));
/// # Ok::<(), trisplat_scene::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct TrainJob {
    /// The photos; held-out ones evaluate the scene. A scene that teaches itself:
    /// [`teacher::dataset`](trisplat_teacher::dataset()).
    pub dataset: Dataset,
    /// Reading options of the photos.
    pub dataset_options: DatasetOptions,
    /// Training options and the layer of each; a resumed run has the options of its checkpoint.
    pub options: Layered<TrainOptions>,
    /// Scene to start from instead of the data set's points; best with the options of
    /// [`TrainOptions::from_scene`].
    pub from: Option<ImportedScene>,
    /// The requested teacher; `None`: none, or that of the resumed run.
    pub teacher: Option<TeacherSource>,
    /// Share of the steps on pictures of the teacher, 0 to 0.9; `None`: two thirds.
    pub teacher_share: Option<f64>,
    /// The file in which a resumed run finds its teacher; without it, the teacher is trained again.
    pub teacher_file: Option<PathBuf>,
    /// Time budget. It chooses steps, triangles and the size of photos.
    pub budget: Option<Budget>,
    /// Budget of the whole run, when `budget` is a share of it.
    pub(super) whole: Option<WholeBudget>,
    /// Start of the budget's clock; `None`: the moment the job runs.
    pub began: Option<Instant>,
    /// Training backend.
    pub backend: BackendOptions,
    /// Files that the run writes on the way.
    pub outputs: TrainOutputs,
    /// Checkpoint to resume from.
    pub resume: Option<Checkpoint>,
    /// Resume although photos, cameras, points or background differ from the checkpoint's.
    pub force_resume: bool,
}

/// The result of a training job: the scene and its report.
#[derive(Debug, Clone)]
pub struct TrainResult {
    /// The scene.
    pub trained: Trained,
    /// Options, stages and warnings. It names no files.
    pub report: Report,
    /// Outcome of the teacher decision.
    pub teacher: TeacherPlan,
    /// Share of the steps on the teacher's pictures; `None` without a teacher.
    pub teacher_share: Option<f64>,
}

impl TrainJob {
    /// A new run without files on the way, on photos read with [`DatasetOptions::default`]. Options
    /// that differ from those of their preset count as given.
    pub fn new(dataset: Dataset, options: TrainOptions) -> Self {
        let preset = TrainOptions::preset(options.preset);
        Self::with_layers(dataset, Layered::over(&preset, options))
    }

    /// [`TrainJob::new`] with options in layers.
    pub fn with_layers(dataset: Dataset, options: Layered<TrainOptions>) -> Self {
        Self {
            dataset,
            dataset_options: DatasetOptions::default(),
            options,
            from: None,
            teacher: None,
            teacher_share: None,
            teacher_file: None,
            budget: None,
            whole: None,
            began: None,
            backend: BackendOptions::default(),
            outputs: TrainOutputs::default(),
            resume: None,
            force_resume: false,
        }
    }

    /// Sets the CPU budget to `share` of `cpu_time`, or fixes the step count for reproducible
    /// output.
    pub(super) fn limit(&mut self, cpu_time: Option<Seconds>, share: f64) {
        match cpu_time {
            Some(time) => {
                let spent = cpu_secs();
                self.budget = Some(Budget::cpu(Seconds(spent + share * time.0)));
                self.whole = Some(WholeBudget {
                    seconds: time,
                    scale: share.recip(),
                    offset: -spent / share,
                });
            }
            None => self.options = self.options.clone().mark_given(&["steps"]),
        }
    }

    /// Plans, prepares and runs the training, to the end or until `observer` stops it.
    ///
    /// # Errors
    ///
    /// Errors of the preparation and of [`TrainInputs::start_on`]; photos that cannot be decoded;
    /// options that the budget chooses; an unreadable or solid teacher; a budget that is too small;
    /// a checkpoint of another run. [`Error::Stopped`] if it was stopped before its own first step:
    /// nothing is written, and the run begins again.
    pub fn run(mut self, observer: Observer<'_>) -> Result<TrainResult> {
        let began = self.began.unwrap_or_else(Instant::now);
        if self.from.is_none() {
            reconstruct_points(&mut self.dataset, self.dataset_options.photo_bytes())?;
        }
        if self.resume.is_none() {
            check(self.budget, &self.options)?;
        }
        let plan = self.teacher_plan();
        let mut stages: Vec<StageReport> = self.decide_exposure(observer)?.into_iter().collect();
        let mut step_limit = StepLimit::default();
        if plan == TeacherPlan::Train && !self.options.is_given("steps") {
            step_limit = teacher::run_limit(self.dataset.train().count());
        }
        let mut warnings: Vec<String> =
            self.from.iter().flat_map(|scene| scene.warnings.clone()).collect();
        let teacher = self.teacher_scene(&plan, began, &mut stages, observer)?;
        let budget_control = self.keep_to_budget(step_limit, began)?;
        warnings.extend(self.dataset.warnings.iter().cloned());
        let share = teacher.is_some().then(|| self.picture_share());
        let dataset_with_pictures = match (&teacher, share) {
            (Some(teacher), Some(share)) => {
                warnings.extend(teacher.warnings.iter().cloned());
                let options = &self.options.options;
                let reading = &self.dataset_options;
                Some(teacher::with_pictures(
                    &self.dataset,
                    teacher,
                    share,
                    options,
                    reading,
                    observer,
                )?)
            }
            _ => None,
        };
        let summary = budget_control.as_ref().map(|control| self.summary(&control.pace));
        let dataset = dataset_with_pictures.as_ref().unwrap_or(&self.dataset);
        let run = TrainInputs {
            outputs: self.outputs,
            from: self.from,
            resume: self.resume,
            budget_control,
            began: Some(began),
            force_resume: self.force_resume,
            ..TrainInputs::new(dataset, &self.options.options)
                .with_dataset_options(&self.dataset_options)
        };
        let mut run = run.start_on(&self.backend)?;
        warnings.append(&mut run.warnings);
        let triangles = run.triangles();
        let begins = TrainBegins {
            part: TrainPart::Scene,
            steps: run.options().steps,
            done: run.steps(),
            plan: summary,
            card: run.card.clone(),
            photos: Some(&self.dataset),
            curve: run.curve(),
            stages: &stages,
            warnings: &warnings,
        };
        let mut steps = begin(observer, &begins)?;
        let trained = run.finish(&mut steps)?;
        let seconds = began.elapsed().as_secs_f64();
        let mut report = Report { warnings, stages, seconds, ..Report::new("train") };
        report.options = serde_json::to_value(&trained.options).unwrap_or_default();
        report.stages.push(trained.stage(triangles, seconds));
        Ok(TrainResult { trained, report, teacher: plan, teacher_share: share })
    }

    /// The soft scene of the teacher: read, trained, or none. `stages` gets its stage.
    fn teacher_scene(
        &self,
        plan: &TeacherPlan,
        began: Instant,
        stages: &mut Vec<StageReport>,
        observer: Observer<'_>,
    ) -> Result<Option<ImportedScene>> {
        match plan {
            TeacherPlan::Without(why) => {
                stages.push(StageReport::skipped(TeacherDetails::STAGE, why.clone()));
                Ok(None)
            }
            TeacherPlan::Read(path) => teacher::soft_scene(path, &self.dataset_options).map(Some),
            TeacherPlan::Train => {
                let (teacher, stage) = self.train_teacher(began, observer)?;
                stages.push(stage);
                Ok(Some(teacher))
            }
        }
    }

    /// The share of the steps on pictures of a teacher; a resumed run keeps its number of pictures.
    fn picture_share(&self) -> f64 {
        let resumed_share = self.resume.as_ref().map(|checkpoint| {
            let all = checkpoint.meta.identity.photos.len().max(1);
            1.0 - self.dataset.train().count() as f64 / all as f64
        });
        self.teacher_share.or(resumed_share).unwrap_or(teacher::PICTURE_SHARE)
    }

    /// Description of the budget's plan for people.
    fn summary(&self, pace: &Pace) -> String {
        let end = if pace.is_enough() { "; more time gains nothing here" } else { "" };
        pace.summary() + end
    }

    /// Decides how far photos are corrected in exposure, unless the options say it or the scene to
    /// start from does; returns the stage of the report.
    ///
    /// # Errors
    ///
    /// Photos that cannot be decoded; a stopped training.
    fn decide_exposure(&mut self, observer: Observer<'_>) -> Result<Option<StageReport>> {
        let options = &self.options.options;
        let is_undecided = options.exposure == ExposureUse::Auto && self.resume.is_none();
        if !is_undecided || self.dataset.kind == DatasetKind::Drawn {
            return Ok(None);
        }
        if let Some(scene) = &self.from {
            let strengths = scene.provenance.exposure.map_or(Strengths::NONE, Strengths::from);
            self.options.options.exposure = strengths.to_use();
            return Ok(None);
        }
        let clock = Instant::now();
        // Short trainings do not obey a limit of the run's own steps.
        let decision = if self.outputs.max_cpu_secs > 0.0 {
            ExposureDecision::AsTaken("the run may end early (`max_cpu_secs`)")
        } else {
            let budget_secs = self.budget.map(|budget| budget.seconds.0);
            exposure::decide(&self.dataset, options, budget_secs, &self.dataset_options, observer)?
        };
        let name = ExposureEvidence::STAGE;
        Ok(Some(match decision {
            ExposureDecision::AsTaken(why) => {
                self.options.options.exposure = ExposureUse::Off;
                StageReport::skipped(name, why.into())
            }
            ExposureDecision::Judged(evidence) => {
                // A `Break` is obeyed by the teacher or the run, which come next.
                let _ = observer(Event::Exposure(&evidence));
                self.options.options.exposure = evidence.strengths.to_use();
                StageReport {
                    name: name.into(),
                    seconds: clock.elapsed().as_secs_f64(),
                    before: Counts::default(),
                    after: Counts::default(),
                    skipped: None,
                    details: to_json(&evidence),
                }
            }
        }))
    }

    /// Plan for the teacher.
    pub fn teacher_plan(&self) -> TeacherPlan {
        let photos = self.dataset.train().count();
        let stored = self.teacher_file.as_deref();
        match (&self.teacher, &self.resume) {
            (Some(source), resume) => TeacherPlan::requested(source, resume.is_some(), stored),
            (None, Some(checkpoint)) => TeacherPlan::resumed(checkpoint, photos, stored),
            (None, None) => TeacherPlan::Without("not asked for (`teacher` auto)".into()),
        }
    }

    /// Trains a teacher, with the report's stage. The limit of CPU seconds is that of the run's own
    /// steps.
    ///
    /// # Errors
    ///
    /// Errors of a training; a stopped training; a budget that is too small.
    fn train_teacher(
        &self,
        began: Instant,
        observer: Observer<'_>,
    ) -> Result<(ImportedScene, StageReport)> {
        let clock = Instant::now();
        let mut step_limit = teacher::teacher_limit(self.dataset.train().count());
        // Steps given for the run also hold for its teacher.
        step_limit.steps = step_limit.steps.filter(|_| !self.options.is_given("steps"));
        let spent = self.spending(began).seconds();
        let mut job = Self {
            dataset_options: self.dataset_options.clone(),
            options: teacher::teacher_options(&self.options, self.budget.is_some()),
            budget: self.budget.map(|budget| teacher::teacher_budget(budget, spent)),
            whole: self.budget.map(|budget| teacher::whole(budget, self.whole, spent)),
            ..Self::new(self.dataset.clone(), TrainOptions::default())
        };
        let budget_control = job.keep_to_budget(step_limit, began)?;
        let run = TrainInputs::new(&job.dataset, &job.options.options)
            .with_dataset_options(&job.dataset_options);
        // The run reports the card, so the teacher does not.
        let run = TrainInputs { budget_control, ..run }.start_on(&self.backend)?;
        let triangles = run.triangles();
        let part = TrainPart::Teacher;
        let steps = run.options().steps;
        let trained = run.finish(&mut begin(
            observer,
            &TrainBegins { part, steps, ..TrainBegins::default() },
        )?)?;
        if trained.stopped {
            return Err(stopped_error("the training of a soft teacher scene", &trained));
        }
        // A `Break` is obeyed by the run, which comes next.
        let _ = observer(Event::Teacher(&trained));
        let mut stage = trained.stage(triangles, clock.elapsed().as_secs_f64());
        TeacherDetails::STAGE.clone_into(&mut stage.name);
        Ok((trained.into(), stage))
    }

    /// The clock of the budget.
    fn spending(&self, began: Instant) -> Spending {
        Spending::of_process(self.budget.map(|budget| budget.clock).unwrap_or_default(), began)
    }

    /// Measures the machine and chooses steps, triangles and the size of photos, within
    /// `step_limit`.
    ///
    /// # Errors
    ///
    /// Errors of the first steps; photos that cannot be decoded; a budget that is too small.
    fn keep_to_budget(
        &mut self,
        step_limit: StepLimit,
        began: Instant,
    ) -> Result<Option<BudgetControl>> {
        let keeps_max_triangles = self.options.is_given("max_triangles");
        let Some(budget) = self.budget else {
            self.options.options =
                with_fewer_steps(&self.options.options, step_limit.steps, keeps_max_triangles);
            return Ok(None);
        };
        let options = &self.options.options;
        let how = &mut self.dataset_options;
        let spending = Spending::of_process(budget.clock, began);
        let speed = trisplat_train::measure_speed(
            &self.dataset,
            self.from.as_ref(),
            options,
            how.background.to_f32(),
            &spending,
        )?;
        let pace = budget::plan(&PlanInput {
            keeps_max_triangles,
            keeps_photo_size: how.max_size.is_some() || self.dataset.kind == DatasetKind::Drawn,
            from: self.from.as_ref().map(|scene| scene.scene.triangle_count() as u64),
            step_limit,
            whole: self.whole,
            ..PlanInput::new(&self.dataset, options, budget, spending.seconds(), speed)
        })?;
        self.options.options = pace.apply(options);
        if pace.plan.max_size.is_some() {
            how.max_size = pace.plan.max_size;
            let small = Dataset::load(&self.dataset.path, how)?;
            if small.points.is_empty() {
                // Points that were found stay.
                for (view, small) in self.dataset.views.iter_mut().zip(small.views) {
                    *view = View { tracked: std::mem::take(&mut view.tracked), ..small };
                }
            } else {
                self.dataset = small;
            }
        }
        Ok(Some(BudgetControl { pace, spending }))
    }
}

/// Refuses options that a budget chooses, whichever layer sets them.
fn check(budget: Option<Budget>, options: &Layered<TrainOptions>) -> Result<()> {
    let Some(budget) = budget else { return Ok(()) };
    let TrainOptions { steps, milestones, .. } = &options.options;
    for (key, value) in [("steps", steps.to_string()), ("milestones", format!("{milestones:?}"))] {
        let layer = match options.origin(key) {
            Origin::Preset => continue,
            Origin::File => " of `config`",
            Origin::Setting => " of `sets`",
            Origin::Given => "",
        };
        let wants = format!("to be left out{layer}: `{}` chooses the steps", budget.option());
        return Err(Error::invalid(key, value, wants));
    }
    Ok(())
}

/// `options` with at most `max_steps`, and proportionally fewer triangles unless these are given.
fn with_fewer_steps(
    options: &TrainOptions,
    max_steps: Option<u64>,
    keeps_max_triangles: bool,
) -> TrainOptions {
    let Some(steps) = max_steps.filter(|max_steps| *max_steps < options.steps) else {
        return options.clone();
    };
    let fewer = options.max_triangles as f64 * steps as f64 / options.steps as f64;
    let max_triangles =
        if keeps_max_triangles { options.max_triangles } else { (fewer as u64).max(1) };
    TrainOptions { steps: steps.max(1), max_triangles, ..options.clone() }
}

/// Options for reading the data set of a resumed run: a budget may have chosen the size of its
/// photos.
pub fn reading(how: &DatasetOptions, resume: Option<&Checkpoint>) -> DatasetOptions {
    let chosen = resume.and_then(|point| point.meta.pace.as_ref()?.plan.max_size);
    DatasetOptions { max_size: how.max_size.or(chosen), ..how.clone() }
}

/// Trains a soup on the photos of `dataset` that are not held out, as the command `train` does.
/// `observer` gets every step; `ControlFlow::Break` stops the training, whose result is then
/// the scene so far, with `stopped` set. [`TrainJob`] has all settings beside the options.
///
/// ```no_run
/// use std::ops::ControlFlow;
/// use trisplat_dataset::{Dataset, DatasetOptions};
/// use trisplat_job::train;
/// use trisplat_train::TrainOptions;
///
/// let photos = Dataset::load("photos", &DatasetOptions::default())?;
/// let trained = train(&photos, &TrainOptions::default(), &mut |_| ControlFlow::Continue(()))?;
/// trained.save("scene.ply")?;
/// # Ok::<(), trisplat_scene::Error>(())
/// ```
///
/// # Errors
///
/// Options out of range, no training photos, photos that cannot be decoded; a stop before the
/// scene's first step.
pub fn train(dataset: &Dataset, options: &TrainOptions, observer: Observer<'_>) -> Result<Trained> {
    Ok(TrainJob::new(dataset.clone(), options.clone()).run(observer)?.trained)
}
