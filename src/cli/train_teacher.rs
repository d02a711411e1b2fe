//! `trisplat train --teacher`: a soft scene that shows what is to be seen between the photos.

use super::Global;
use super::harden;
use super::layers;
use super::outputs::Outputs;
use super::teacher_args::TeacherPlan;
use super::train_args::TrainArgs;
use super::train_budget::{self, Planned, Planning};
use super::train_progress::Bar;
use crate::bake::teacher::TeacherDetails;
use crate::budget::{Budget, Seconds};
use crate::dataset::{Dataset, DatasetOptions};
use crate::error::{Error, Result};
use crate::formats;
use crate::report::{OutputReport, StageDetails, StageReport};
use crate::scene::Loaded;
use crate::train::device::OpenRun;
use crate::train::{Checkpoint, RunOptions, TrainOptions, TrainPreset, TrainRun};
use clap::ArgMatches;
use std::path::Path;
use std::time::Instant;

/// Of the steps and the triangles of the run that it teaches, a teacher that is trained for it has this share.
const STEPS_SHARE: f64 = 0.55;
const TRIANGLES_SHARE: f64 = 0.67;
/// And of a budget.
const BUDGET_SHARE: f64 = 0.4;
/// Photos to train on up to which a solid scene has a teacher without being asked: see docs/benchmarks/training.md, "Few photos and a teacher".
const FEW_PHOTOS: usize = 20;
/// Share of the steps that look at its pictures with as few photos, and with more.
const SHARES: [f64; 2] = [2.0 / 3.0, 0.5];

/// A scene that teaches.
struct Teacher {
    scene: Loaded,
    /// How it was trained, if it was trained now, and the file that it was left in.
    trained: Option<(StageReport, OutputReport)>,
}

/// What a run is on, and what became of its teacher.
pub(super) struct Taught {
    /// The photos, in the size that was chosen, the options, with what was chosen, and what keeps the run to its budget.
    pub(super) planned: Planned,
    /// The photos and the pictures of the teacher; `None` without one.
    pub(super) dataset: Option<Dataset>,
    /// How the teacher was trained, or why there is none; `None` of one that was read.
    pub(super) stage: Option<StageReport>,
    /// Where the teacher comes from.
    pub(super) plan: TeacherPlan,
    /// The file that it was left in.
    pub(super) output: Option<OutputReport>,
    /// What is wrong with the teacher's file.
    pub(super) warnings: Vec<String>,
}

/// What a teacher is made for.
pub(super) struct Lesson<'a> {
    pub(super) args: &'a TrainArgs,
    pub(super) matches: &'a ArgMatches,
    pub(super) global: &'a Global,
    /// The scene that the run starts from.
    pub(super) from: Option<&'a Loaded>,
    /// How the run is trained.
    pub(super) options: TrainOptions,
    /// The checkpoint that the run goes on from.
    pub(super) resumes: Option<&'a Checkpoint>,
    /// When the command began.
    pub(super) began: Instant,
}

impl Lesson<'_> {
    /// Makes ready what the run is on: `photos`, as they were read, and pictures of its teacher. `how` is how they were read; it gets the
    /// size that was chosen. A teacher that is trained is written to its one of `files`.
    ///
    /// Errors: a file that cannot be read, a scene in it that is solid; those of a training; a training that was stopped; a budget that is
    /// too small.
    pub(super) fn begin(
        self,
        photos: Dataset,
        how: &mut DatasetOptions,
        files: &mut Outputs,
    ) -> Result<Taught> {
        let args = self.args;
        let plan = match args.teacher.asked(&args.output, self.resumes.is_some()) {
            Some(plan) => plan,
            None => {
                let needless = self.needless(&photos);
                let plan = TeacherPlan::unasked(&args.output, self.resumes.is_some(), needless);
                // What was asked for is claimed already.
                plan.output().map_or(Ok(()), |path| files.claim("--teacher", path))?;
                plan
            }
        };
        let mut stage = None;
        let teacher = match &plan {
            TeacherPlan::Without(why) => {
                stage = Some(StageReport::unneeded(TeacherDetails::STAGE, why.clone()));
                None
            }
            TeacherPlan::Read(path) => Some(Teacher { scene: soft_scene(path, how)?, trained: None }),
            TeacherPlan::Train(path) => Some(self.train(&photos, how.clone(), path, files)?),
        };
        let planned =
            self.planning(train_budget::given(args), self.from).plan(photos, self.options.clone(), how)?;
        let mut taught = Taught { planned, plan, dataset: None, stage, output: None, warnings: Vec::new() };
        if let Some(Teacher { scene, trained }) = teacher {
            let Planned { dataset: photos, options, .. } = &taught.planned;
            let share = args.teacher.teacher_share.unwrap_or_else(|| share(photos));
            taught.dataset = Some(harden::beside(photos, &scene, share, options, how, self.global)?);
            (taught.stage, taught.output) = trained.unzip();
            taught.warnings = scene.warnings;
        }
        Ok(taught)
    }

    /// Why the run does without a teacher unless it is asked for one.
    fn needless(&self, photos: &Dataset) -> Option<String> {
        let (args, count) = (self.args, photos.train().count());
        if let Some(checkpoint) = self.resumes {
            // Pictures of a teacher are photos to a run.
            let was_taught = checkpoint.meta.identity.photos.len() > count;
            return (!was_taught).then(|| "the run that goes on has none".into());
        }
        let is_of_photos = args.dataset.is_some() && self.from.is_none();
        if !is_of_photos || self.options.preset != TrainPreset::Solid {
            return Some("unasked, only solid scenes that start from photos have one".into());
        }
        if args.max_cpu_secs > 0.0 {
            return Some("unasked, a run that `max_cpu_secs` may end early has none".into());
        }
        match count {
            0 | 1 => Some("there is nothing between so few photos".into()),
            2..=FEW_PHOTOS => None,
            _ => Some(format!("{count} photos are enough without one")),
        }
    }

    fn planning<'a>(&'a self, budget: Option<Budget>, from: Option<&'a Loaded>) -> Planning<'a> {
        Planning { args: self.args, matches: self.matches, budget, from, began: self.began }
    }

    /// Trains one and writes it to `path`, one of `files`.
    fn train(
        &self,
        photos: &Dataset,
        mut how: DatasetOptions,
        path: &Path,
        files: &mut Outputs,
    ) -> Result<Teacher> {
        let (clock, args) = (Instant::now(), self.args);
        let budget = train_budget::given(args).map(|budget| {
            let seconds = Seconds(budget.seconds.0 * BUDGET_SHARE);
            Budget { seconds, ..budget }
        });
        let (photos, options) = (photos.clone(), self.teacher_options(budget.is_some()));
        let Planned { dataset, options, paced } =
            self.planning(budget, None).plan(photos, options, &mut how)?;
        let outputs = RunOptions { max_cpu_secs: args.max_cpu_secs, ..RunOptions::default() };
        let run = TrainRun::new(&dataset, &options).with_dataset_options(&how);
        let run = TrainRun { outputs, paced, ..run };
        // What there is to say of the card is said of the run that it teaches.
        let OpenRun { run, .. } = run.start_at(&args.backend_options)?;
        let triangles = run.triangles();
        let mut bar = Bar::new(self.global, options.steps, 0, None, &[])?;
        let unasked =
            if args.teacher.teacher.is_none() { ", as photos are few (--teacher off: not)" } else { "" };
        bar.line(&format!("a soft scene is trained first, to teach: {} steps{unasked}", options.steps));
        let trained = run.finish(&mut bar)?;
        bar.done();
        if trained.stopped {
            let value = format!("stopped after {} of {} steps", trained.steps, trained.options.steps);
            return Err(Error::invalid("--teacher", value, "all of its steps; nothing was written"));
        }
        let mut stage = trained.stage(triangles, clock.elapsed().as_secs_f64());
        TeacherDetails::STAGE.clone_into(&mut stage.name);
        let bytes = files.take(path).and_then(|file| trained.save_to(file))?;
        let output = OutputReport { path: path.display().to_string(), bytes };
        Ok(Teacher { scene: trained.into(), trained: Some((stage, output)) })
    }

    /// How the teacher is trained. A budget chooses its triangles, unless those of the run are given.
    fn teacher_options(&self, has_budget: bool) -> TrainOptions {
        let (run, preset) = (&self.options, TrainOptions::preset(TrainPreset::Outdoor));
        let share = |count: u64, share: f64| ((count as f64 * share) as u64).max(1);
        let max_triangles = match has_budget && !layers::is_typed(self.matches, "max_triangles") {
            true => preset.max_triangles,
            false => share(run.max_triangles, TRIANGLES_SHARE),
        };
        TrainOptions { steps: share(run.steps, STEPS_SHARE), max_triangles, seed: run.seed, ..preset }
    }
}

/// Share of the steps that look at pictures of a teacher unless it is given.
fn share(photos: &Dataset) -> f64 {
    let [few, more] = SHARES;
    if photos.train().count() <= FEW_PHOTOS { few } else { more }
}

/// The soft scene of a file.
///
/// Errors: a file that cannot be read, a scene that is solid.
fn soft_scene(path: &Path, how: &DatasetOptions) -> Result<Loaded> {
    let scene = formats::read(path, &how.read_options(3))?;
    match harden::needless(&scene) {
        Some(_) => {
            let wants = "a soft scene, as `trisplat train --preset outdoor` makes it";
            Err(Error::invalid("--teacher", path.display(), wants))
        }
        None => Ok(scene),
    }
}
