//! A training job, from options to the trained scene: plan, preparation, run, report.

use super::budget::{self, Budgeted};
use super::event::{Event, Observer, TrainBegins, TrainPart, begin};
use super::preparation::{self, Preparation, PreparationPart, Resumed, Storing};
use super::taught::TaughtRun;
use super::teacher::{self, TeacherPlan, TeacherSource, UndecidedRun};
use super::watched::{self, TrialRun, WatchedTraining};
use super::watching::Watching;
use std::path::PathBuf;
use std::time::Instant;
use trisplat_bake::TeacherDetails;
use trisplat_dataset::{Dataset, DatasetKind, DatasetOptions};
use trisplat_scene::{
    Budget, Error, ImportedScene, Result, Seconds, Spending,
    layered::Layered,
    process::cpu_secs,
    report::{Report, StageDetails, StageReport},
};
use trisplat_train::{
    BackendOptions, Checkpoint, OpenRun, RunOptions, TrainOptions, TrainRun, Trained,
    budget::{Paced, StepLimit},
};

/// A training as it is asked for. [`TrainJob::new`] has the plain values; any field can be set before the run.
///
/// ```
/// use std::ops::ControlFlow::Continue;
/// use trisplat_dataset::synthetic::{self, SyntheticOptions};
/// use trisplat_job::TeacherSource;
/// use trisplat_dataset::Dataset;
/// use trisplat_dataset::DatasetOptions;
/// use trisplat_job::TrainJob;
/// use trisplat_train::TrainOptions;
///
/// let folder = tempfile::tempdir().unwrap();
/// synthetic::write(folder.path(), &SyntheticOptions { views: 8, width: 24, points: 50, seed: 0, ..SyntheticOptions::default() })?;
/// let dataset = Dataset::load(folder.path(), &DatasetOptions::default())?;
/// let options = TrainOptions { steps: 20, max_triangles: 100, ..TrainOptions::default() };
///
/// let mut job = TrainJob::new(dataset, options);
/// job.teacher = Some(TeacherSource::Off);
/// let done = job.run(&mut |_| Continue(()))?;
/// assert_eq!(done.trained.steps, 20);
/// assert_eq!(done.report.stages[0].skipped.as_deref(), Some("`teacher` off"));
/// # Ok::<(), trisplat_scene::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct TrainJob {
    /// The photos; held-out ones evaluate the scene. A scene that teaches itself: [`teacher::dataset`](trisplat_teacher::dataset()).
    pub dataset: Dataset,
    /// Options that they were read with.
    pub dataset_options: DatasetOptions,
    /// Training options and the layer of each; a resumed run has the options of its checkpoint.
    pub options: Layered<TrainOptions>,
    /// Scene to start from instead of the data set's points; best with the options of [`TrainOptions::from_scene`].
    pub from: Option<ImportedScene>,
    /// The requested teacher; `None`: the number of photos and short trainings decide.
    pub teacher: Option<TeacherSource>,
    /// Share of the steps on pictures of the teacher, 0 to 0.9; `None`: depends on the number of photos.
    pub teacher_share: Option<f64>,
    /// The file in which a resumed run finds its teacher; without it, the teacher is trained again.
    pub teacher_file: Option<PathBuf>,
    /// Time budget. It chooses steps, triangles and the size of photos.
    pub budget: Option<Budget>,
    /// Result of the short trainings; `None` before [`TrainJob::watch`], and if they have nothing to decide.
    pub watched: Option<TrialRun>,
    /// Wall-clock time of the short trainings.
    pub watch_secs: f64,
    /// Start of the budget's clock; `None`: the moment the job runs.
    pub began: Option<Instant>,
    /// Training backend.
    pub backend: BackendOptions,
    /// Files that the run writes on the way.
    pub outputs: RunOptions,
    /// Checkpoint to resume from: that of the run, or of a training that its preparation needs.
    pub resume: Option<Checkpoint>,
    /// Resume although photos, cameras, points or background differ from the checkpoint's.
    pub force_resume: bool,
    /// The preparation that goes on.
    preparation: Option<Resumed>,
}

/// A trained scene and its report.
#[derive(Debug, Clone)]
pub struct TrainDone {
    /// The scene.
    pub trained: Trained,
    /// Options, stages and warnings. It names no files.
    pub report: Report,
    /// What became of its teacher.
    pub teacher: TeacherPlan,
    /// Share of the steps on the teacher's pictures; `None` without a teacher.
    pub teacher_share: Option<f64>,
}

/// A training with its photos, options and teacher ready.
struct ReadyTrain {
    /// The photos alone, if there are pictures of a teacher.
    photos: Option<Dataset>,
    teacher: TeacherPlan,
    teacher_share: Option<f64>,
    /// Stages so far: the short trainings, and the teacher's training or the reason for having none.
    stages: Vec<StageReport>,
    warnings: Vec<String>,
    /// Whether watched photos decided about this run.
    watched: bool,
    dataset_options: DatasetOptions,
    options: TrainOptions,
    paced: Option<Paced>,
    from: Option<ImportedScene>,
    backend: BackendOptions,
    outputs: RunOptions,
    resume: Option<Checkpoint>,
    force_resume: bool,
    began: Instant,
}

impl TrainJob {
    /// A new run without files on the way, on photos read with [`DatasetOptions::default`]. Options that differ
    /// from those of their preset count as given.
    pub fn new(dataset: Dataset, options: TrainOptions) -> Self {
        let preset = TrainOptions::preset(options.preset);
        Self {
            dataset,
            dataset_options: DatasetOptions::default(),
            options: Layered::over(&preset, options),
            from: None,
            teacher: None,
            teacher_share: None,
            teacher_file: None,
            budget: None,
            watched: None,
            watch_secs: 0.0,
            began: None,
            backend: BackendOptions::default(),
            outputs: RunOptions::default(),
            resume: None,
            force_resume: false,
            preparation: None,
        }
    }

    /// Gives the run this CPU time from now on; without one, the steps of its options, which count as given: then equal jobs make equal bytes.
    pub(super) fn limit(&mut self, cpu_time: Option<Seconds>) {
        match cpu_time {
            Some(time) => self.budget = Some(Budget::cpu(Seconds(cpu_secs() + time.0))),
            None => self.options = self.options.clone().giving(&["steps"]),
        }
    }

    /// Plans, prepares and runs the training, to the end or until `observer` stops it.
    ///
    /// Errors: those of the preparation and of [`TrainRun::start_at`]; photos that cannot be decoded.
    /// [`Error::Stopped`] if it was stopped before its own first step; its checkpoint is one for `resume` all the same.
    pub fn run(self, observer: Observer<'_>) -> Result<TrainDone> {
        let (dataset, mut ready) = self.prepare(observer)?;
        let (teacher, teacher_share) = (ready.teacher.clone(), ready.teacher_share);
        let (plan, stages, began) = (ready.budget_summary(), std::mem::take(&mut ready.stages), ready.began);
        let (mut warnings, photos) = (std::mem::take(&mut ready.warnings), ready.photos.take());
        let OpenRun { run, card, warnings: about_start } = ready.open(&dataset)?;
        warnings.extend(about_start);
        let triangles = run.triangles();
        let begins = TrainBegins {
            part: TrainPart::Scene,
            steps: run.options().steps,
            done: run.steps(),
            plan,
            card,
            photos: Some(photos.as_ref().unwrap_or(&dataset)),
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
        Ok(TrainDone { trained, report, teacher, teacher_share })
    }

    /// Runs short trainings that leave some photos out, if there is time. They decide about a teacher, if the number of
    /// photos does not. [`TrainJob::run`] calls this unless it was called before.
    ///
    /// Errors: options that the budget chooses, undecodable photos, a stopped training, a checkpoint of another run.
    pub fn watch(&mut self, observer: Observer<'_>) -> Result<()> {
        self.unpack()?;
        if self.resume.is_none() {
            budget::check(self.budget, &self.options)?;
        }
        let unsure = self.teacher.is_none() && self.undecided().is_unsure();
        // Small photos kept in memory lose the crop of the full ones.
        let cut = self.dataset.train().any(|view| view.photo.is_cut());
        let is_over = self.resume.is_some() || self.watched.is_some() || self.is_teaching();
        if !unsure || !self.has_time_to_watch() || cut || is_over {
            return Ok(());
        }
        let (how, began) = (self.dataset_options.clone(), self.began.unwrap_or_else(Instant::now));
        let (earlier, seed) = (self.earlier_trials(), self.options.options.seed);
        let mut watching = Watching::new(&self.dataset, &how, seed, self.storing(began), earlier)?;
        let watched = watching.run(observer)?;
        // The teacher or the run, which come next, ask whether to go on.
        let _ = observer(Event::Watched(&watched));
        self.watch_secs = watching.seconds();
        self.watched = Some(watched);
        Ok(())
    }

    /// The checkpoint of a training that a preparation needs resumes that training: the run itself begins again, with all that
    /// it began with.
    fn unpack(&mut self) -> Result<()> {
        let Some(prepared) = self.resume.as_mut().and_then(|point| point.meta.prepares.take()) else {
            return Ok(());
        };
        if let Some(TeacherSource::Off | TeacherSource::File(_)) = &self.teacher {
            let wants = "`teacher` auto or nothing, as the run began";
            return Err(Error::invalid("resume", "of a run that was stopped before its teacher", wants));
        }
        let (run, spent_secs) = preparation::unpack(prepared)?;
        let Preparation { options, budget, max_cpu_secs, asked, teacher_share, part } = run;
        (self.options, self.budget) = (options, budget);
        self.teacher = asked.then_some(TeacherSource::Auto);
        self.teacher_share = self.teacher_share.or(teacher_share);
        if let PreparationPart::Teacher { watched, .. } = &part {
            self.watched.clone_from(watched);
        }
        let checkpoint = self.resume.take();
        self.preparation = Some(Resumed { part, checkpoint, spent_secs, max_cpu_secs });
        Ok(())
    }

    /// Whether the preparation goes on at a teacher.
    fn is_teaching(&self) -> bool {
        let part = self.preparation.as_ref().map(|resumed| &resumed.part);
        matches!(part, Some(PreparationPart::Teacher { .. }))
    }

    /// Results of the short trainings of an earlier process, and the one that it was stopped in.
    fn earlier_trials(&mut self) -> (Vec<WatchedTraining>, Option<Checkpoint>) {
        match &mut self.preparation {
            Some(Resumed { part: PreparationPart::Watching(done), checkpoint, .. }) => {
                (done.clone(), checkpoint.take())
            }
            _ => (Vec::new(), None),
        }
    }

    /// The teacher that an earlier process was stopped in, and the size of its photos.
    fn stopped_teacher(&mut self) -> Option<(Checkpoint, Option<u32>)> {
        let Resumed { part, checkpoint, .. } = self.preparation.as_mut()?;
        let PreparationPart::Teacher { max_size, .. } = part else { return None };
        Some((checkpoint.take()?, *max_size))
    }

    /// Where and how trainings of the preparation are stored.
    fn storing(&self, began: Instant) -> Storing {
        let RunOptions { checkpoint, keep, checkpoint_every, max_cpu_secs, .. } = self.outputs.clone();
        Storing {
            outputs: RunOptions { checkpoint, keep, checkpoint_every, max_cpu_secs, ..RunOptions::default() },
            force_resume: self.force_resume,
            spending: self.spending(began),
            run: Preparation {
                options: self.options.clone(),
                budget: self.budget,
                max_cpu_secs: self.max_cpu_secs(),
                asked: self.teacher.is_some(),
                teacher_share: self.teacher_share,
                part: PreparationPart::Watching(Vec::new()),
            },
        }
    }

    /// The clock of the budget.
    fn spending(&self, began: Instant) -> Spending {
        let clock = self.budget.map(|budget| budget.clock).unwrap_or_default();
        let before = self.preparation.as_ref().map_or(0.0, |resumed| resumed.spent_secs);
        Spending::of_process(clock, began).after(before)
    }

    /// The limit of CPU seconds that the run began with, which decides about its preparation.
    fn max_cpu_secs(&self) -> f64 {
        self.preparation.as_ref().map_or(self.outputs.max_cpu_secs, |resumed| resumed.max_cpu_secs)
    }

    /// Whether there are photos to watch, and time for short trainings.
    fn has_time_to_watch(&self) -> bool {
        match self.budget {
            Some(budget) => watched::fits(budget.seconds.0, self.dataset.train().count()),
            // Short trainings do not obey the run's limit.
            None if self.max_cpu_secs() > 0.0 => false,
            None => watched::fits_beside(&self.options.options, &self.dataset),
        }
    }

    /// What becomes of the teacher.
    pub fn teacher_plan(&self) -> TeacherPlan {
        let (photos, kept) = (self.dataset.train().count(), self.teacher_file.as_deref());
        match (&self.teacher, &self.resume) {
            (Some(source), resume) => TeacherPlan::asked(source, resume.is_some(), kept),
            (None, Some(checkpoint)) => TeacherPlan::resumed(checkpoint, photos, kept),
            (None, None) => TeacherPlan::by_default(&self.undecided()),
        }
    }

    /// The run without the request for or against a teacher.
    fn undecided(&self) -> UndecidedRun {
        UndecidedRun {
            photos: self.dataset.train().count(),
            watched_gain: self.watched.as_ref().and_then(TrialRun::gain),
            preset: self.options.options.preset,
            starts_from_photos: self.from.is_none() && self.dataset.kind != DatasetKind::Drawn,
            max_cpu_secs: self.max_cpu_secs(),
        }
    }

    /// Prepares the training pictures: photos in the size that the budget allows, and pictures of the teacher.
    ///
    /// Errors: options that the budget chooses; an unreadable or solid teacher; errors of the teacher's training; a budget that is
    /// too small; a checkpoint of another run; [`Error::Stopped`].
    fn prepare(mut self, observer: Observer<'_>) -> Result<(Dataset, ReadyTrain)> {
        let began = self.began.unwrap_or_else(Instant::now);
        self.watch(observer)?;
        let plan = self.teacher_plan();
        let mut enough = StepLimit::default();
        let (teacher, stage) = match &plan {
            TeacherPlan::Without(why) => {
                (None, Some(StageReport::skipped(TeacherDetails::STAGE, why.clone())))
            }
            TeacherPlan::Read(path) => (Some(teacher::soft_scene(path, &self.dataset_options)?), None),
            TeacherPlan::Train => {
                if !self.options.is_given("steps") {
                    enough = teacher::enough(self.dataset.train().count());
                }
                let stopped = self.stopped_teacher();
                let (teacher, stage) = self.taught(began).train_teacher(stopped, observer)?;
                (Some(teacher), Some(stage))
            }
        };
        if self.preparation.as_ref().is_some_and(|resumed| resumed.checkpoint.is_some()) {
            let wants = "the photos and options of its run";
            return Err(Error::invalid("resume", "of a preparation that these photos do not need", wants));
        }
        let spending = self.spending(began);
        let mut how = self.dataset_options;
        let Budgeted { dataset, options, paced } = budget::budgeted(
            self.dataset,
            self.options,
            self.from.as_ref(),
            self.budget,
            enough,
            spending,
            &mut how,
        )?;
        let from_warnings = self.from.iter().flat_map(|scene| &scene.warnings);
        let mut warnings: Vec<String> = from_warnings.chain(&dataset.warnings).cloned().collect();
        let (dataset, photos, teacher_share) = match teacher {
            Some(teacher) => {
                // A resumed run keeps its number of pictures.
                let begun = self.resume.as_ref().map(|checkpoint| {
                    1.0 - dataset.train().count() as f64 / checkpoint.meta.identity.photos.len().max(1) as f64
                });
                let share = self.teacher_share.or(begun).unwrap_or(teacher::PICTURE_SHARE);
                let beside = teacher::with_pictures(&dataset, &teacher, share, &options, &how, observer)?;
                warnings.extend(teacher.warnings);
                (beside, Some(dataset), Some(share))
            }
            None => (dataset, None, None),
        };
        let watched = self.watched.iter().map(|watched| watched.stage(self.watch_secs));
        let ready = ReadyTrain {
            photos,
            teacher: plan,
            teacher_share,
            stages: watched.into_iter().chain(stage).collect(),
            warnings,
            watched: self.watched.is_some(),
            dataset_options: how,
            options,
            paced,
            from: self.from,
            backend: self.backend,
            outputs: self.outputs,
            resume: self.resume,
            force_resume: self.force_resume,
            began,
        };
        Ok((dataset, ready))
    }

    /// The run as its teacher needs it.
    fn taught(&self, began: Instant) -> TaughtRun<'_> {
        TaughtRun {
            photos: &self.dataset,
            how: &self.dataset_options,
            options: &self.options,
            budget: self.budget,
            began,
            backend: &self.backend,
            storing: self.storing(began),
            watched: self.watched.clone(),
        }
    }
}

impl ReadyTrain {
    /// Description of the budget's plan for people; `None` without a budget.
    fn budget_summary(&self) -> Option<String> {
        let pace = &self.paced.as_ref()?.pace;
        let why = if self.watched { "watched photos" } else { "photos are few" };
        let end =
            if pace.is_enough() { format!("; more time gains nothing here ({why})") } else { String::new() };
        Some(pace.summary() + &end)
    }

    /// Sets up the run on the prepared photos and pictures.
    ///
    /// Errors: those of [`TrainRun::start_at`].
    fn open(self, dataset: &Dataset) -> Result<OpenRun<'_>> {
        let run = TrainRun::new(dataset, &self.options).with_dataset_options(&self.dataset_options);
        let run = TrainRun {
            outputs: self.outputs,
            from: self.from,
            resume: self.resume,
            paced: self.paced,
            began: Some(self.began),
            force_resume: self.force_resume,
            ..run
        };
        let mut open = run.start_at(&self.backend)?;
        open.warnings
            .extend(open.run.differences().iter().map(|difference| format!("resumed although {difference}")));
        Ok(open)
    }
}

/// Options for reading the data set of a resumed run: a budget may have chosen the size of its photos.
pub fn reading(how: &DatasetOptions, resume: Option<&Checkpoint>) -> DatasetOptions {
    // A training that prepares a run does not choose for it.
    let resume = resume.filter(|point| point.meta.prepares.is_none());
    let chosen = resume.and_then(|point| point.meta.pace.as_ref()?.plan.max_size);
    DatasetOptions { max_size: how.max_size.or(chosen), ..how.clone() }
}

/// Trains a soup on the photos of `dataset` that are not held out, as the command `train` does. `observer` is told of every
/// step; `ControlFlow::Break` stops the training, whose result is then the scene so far, with `stopped` set.
/// [`TrainJob`] has everything that can be asked for beside the options.
///
/// Errors: options out of range, no training photos, photos that cannot be decoded; a stop before the scene's first step.
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
pub fn train(dataset: &Dataset, options: &TrainOptions, observer: Observer<'_>) -> Result<Trained> {
    Ok(TrainJob::new(dataset.clone(), options.clone()).run(observer)?.trained)
}
