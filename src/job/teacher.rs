//! Whether a training has a teacher, and how that is trained: a soft scene that shows what is to be seen between the photos.

use super::budget::{Budgeted, budgeted, with_fewer_steps};
use super::harden;
use super::observer::TrainJobObserver;
use crate::bake::teacher::TeacherDetails;
use crate::budget::{Budget, Seconds};
use crate::dataset::{Dataset, DatasetOptions};
use crate::error::{Error, Result};
use crate::formats;
use crate::layered::{Layered, Layers};
use crate::report::{StageDetails, StageReport};
use crate::scene::Loaded;
use crate::teacher;
use crate::train::budget::Paced;
use crate::train::device::OpenRun;
use crate::train::{BackendOptions, Checkpoint, RunOptions, TrainOptions, TrainPreset, TrainRun, Trained};
use std::convert::Infallible;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Instant;

/// Of the steps and the triangles of the run that it teaches, a teacher that is trained for it has this share.
const STEPS_SHARE: f64 = 0.55;
const TRIANGLES_SHARE: f64 = 0.67;
/// And of a budget; and all teachers of a run together at most.
const BUDGET_SHARE: f64 = 0.4;
const ALL_TEACHERS_SHARE: f64 = 0.55;
/// Photos to train on up to which a teacher counts fully, and those from which on it counts nothing; its weight falls linearly in between.
/// See docs/benchmarks/few-photos.md.
const FEW_PHOTOS: f64 = 20.0;
const MANY_PHOTOS: f64 = 28.0;
/// Share of the steps that look at the teacher's pictures with few photos, and where it was asked for with many.
const PICTURE_SHARES: [f64; 2] = [2.0 / 3.0, 0.5];
/// The least weight that is worth the teacher's training.
const LEAST_WEIGHT: f64 = 0.1;
/// Most teachers of a run. What several scenes show that were trained apart is closer than what any of them does.
const MOST_TEACHERS: usize = 3;
/// Steps per training photo after which a teacher, and the run that it teaches, come closer to these photos only. Each takes as many times
/// more as its teacher counts less.
const TEACHER_STEPS_PER_PHOTO: f64 = 85.0;
const STEPS_PER_PHOTO: f64 = 180.0;

/// Which scene teaches.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum TeacherSource {
    /// One that is trained for it.
    Auto,
    /// None.
    Off,
    /// That of a file.
    File(PathBuf),
}

impl FromStr for TeacherSource {
    type Err = Infallible;

    /// `auto`, `off`, or the name of a file.
    fn from_str(text: &str) -> std::result::Result<Self, Infallible> {
        Ok(match text {
            "auto" => Self::Auto,
            "off" => Self::Off,
            path => Self::File(path.into()),
        })
    }
}

/// What becomes of the teacher of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum TeacherPlan {
    /// There is none, and why.
    Without(String),
    /// It is the scene of a file.
    Read(PathBuf),
    /// It is trained first.
    Train,
}

/// A training that did not ask for a teacher, nor to do without one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UndecidedRun {
    /// Photos to train on.
    pub photos: usize,
    /// The preset of its options.
    pub preset: TrainPreset,
    /// It starts from photos and their points, and not from a scene.
    pub starts_from_photos: bool,
    /// CPU seconds after which it is stopped; 0: never.
    pub max_cpu_secs: f64,
}

impl UndecidedRun {
    /// Why it does without a teacher; `None`: it has one, which is trained first.
    pub fn needs_none(&self) -> Option<String> {
        if !self.starts_from_photos || self.preset != TrainPreset::Solid {
            return Some("by default only solid scenes that start from photos have one".into());
        }
        if self.max_cpu_secs > 0.0 {
            return Some("by default a run that `max_cpu_secs` may end early has none".into());
        }
        match self.photos {
            0 | 1 => Some("there is nothing between so few photos".into()),
            count if weight(count) < LEAST_WEIGHT => Some(format!("{count} photos are enough without one")),
            _ => None,
        }
    }
}

/// Weight of a teacher by default for this number of training photos: 1 with few, 0 with many.
fn weight(photos: usize) -> f64 {
    ((MANY_PHOTOS - photos as f64) / (MANY_PHOTOS - FEW_PHOTOS)).clamp(0.0, 1.0)
}

/// How much the teacher counts of a run that `asked` for it, or has it by default.
fn weight_of(photos: usize, asked: bool) -> f64 {
    if asked { 1.0 } else { weight(photos) }
}

/// Largest useful number of steps of a run on `photos` with a teacher, which was `asked` for or comes by default.
pub(super) fn most_steps(photos: usize, asked: bool) -> u64 {
    // A float that is too large becomes the largest integer.
    (STEPS_PER_PHOTO * photos as f64 / weight_of(photos, asked)) as u64
}

/// The most steps of its teacher.
fn most_teacher_steps(photos: usize, weight: f64) -> u64 {
    (TEACHER_STEPS_PER_PHOTO * photos as f64 / weight) as u64
}

/// Default share of the steps that look at pictures of a teacher, by the number of photos to train on.
pub fn picture_share(photos: usize, asked: bool) -> f64 {
    let [few, least] = PICTURE_SHARES;
    let by_photos = few * weight(photos);
    if asked { by_photos.max(least) } else { by_photos }
}

/// The part of a run's budget that its teachers are trained with, which count `weight`.
fn teacher_budget(run: Budget, weight: f64) -> Budget {
    Budget { seconds: Seconds(run.seconds.0 * BUDGET_SHARE * weight), ..run }
}

/// How a teacher of a run is trained that counts `weight`. A budget chooses its triangles, unless those of the run are given.
///
/// Errors: none of options that are in range.
fn teacher_options(
    run: &Layered<TrainOptions>,
    has_budget: bool,
    weight: f64,
) -> Result<Layered<TrainOptions>> {
    let share = |count: u64, share: f64| ((count as f64 * share) as u64).max(1);
    let mut given = serde_json::json!({
        "preset": TrainPreset::Outdoor,
        "steps": share(run.options.steps, STEPS_SHARE * weight),
        "seed": run.options.seed,
        "stereo": run.options.stereo,
    });
    if !has_budget || run.is_given("max_triangles") {
        given["max_triangles"] = share(run.options.max_triangles, TRIANGLES_SHARE).into();
    }
    Layers::default().given(given).resolve(TrainOptions::preset)
}

impl TeacherPlan {
    /// Of a run that asks for a teacher. A run that goes on reads the one that was trained for it, at `kept`.
    pub fn asked(source: &TeacherSource, resumes: bool, kept: Option<&Path>) -> Self {
        match (source, kept.filter(|_| resumes)) {
            (TeacherSource::Off, _) => Self::Without("`teacher` off".into()),
            (TeacherSource::File(path), _) => Self::Read(path.clone()),
            (TeacherSource::Auto, Some(kept)) => Self::Read(kept.to_owned()),
            (TeacherSource::Auto, None) => Self::Train,
        }
    }

    /// Of a run that does not say, from its beginning.
    pub fn by_default(run: &UndecidedRun) -> Self {
        run.needs_none().map_or(Self::Train, Self::Without)
    }

    /// Of a resumed run on `photos` that does not say. It has a teacher exactly when it began with one, which is at `kept`, if
    /// that is known.
    pub fn resumed(checkpoint: &Checkpoint, photos: usize, kept: Option<&Path>) -> Self {
        // Pictures of a teacher are photos to a run.
        let was_taught = checkpoint.meta.identity.photos.len() > photos;
        match kept {
            _ if !was_taught => Self::Without("the resumed run has none".into()),
            None => Self::Train,
            Some(path) if path.exists() => Self::Read(path.to_owned()),
            Some(path) => {
                Self::Without(format!("the teacher of the resumed run is not at {}", path.display()))
            }
        }
    }

    /// The file that is read.
    pub fn input(&self) -> Option<&Path> {
        match self {
            Self::Read(path) => Some(path),
            _ => None,
        }
    }
}

/// Ending of the names of files that teachers are kept in.
pub const TEACHER_FILE: &str = "teacher.ply";

/// The files that the teachers of a run are kept in, beginning with `first`: `a.teacher.ply`, `a.teacher-2.ply`, `a.teacher-3.ply`.
pub fn teacher_files(first: &Path) -> Vec<PathBuf> {
    let name = |i: usize| {
        let stem = first.file_stem().unwrap_or_default().to_string_lossy();
        first
            .with_file_name(format!("{stem}-{i}.{}", first.extension().unwrap_or_default().to_string_lossy()))
    };
    std::iter::once(first.to_owned()).chain((2..=MOST_TEACHERS).map(name)).collect()
}

/// The teachers of a run, trained.
pub(super) struct Teachers {
    /// Their scenes.
    pub(super) scenes: Vec<Loaded>,
    /// What was done.
    pub(super) stage: StageReport,
}

/// The run that teachers are trained for.
pub(super) struct TaughtRun<'a> {
    /// The photos, and how they were read.
    pub(super) photos: &'a Dataset,
    pub(super) how: &'a DatasetOptions,
    pub(super) options: &'a Layered<TrainOptions>,
    pub(super) budget: Option<Budget>,
    pub(super) began: Instant,
    pub(super) backend: &'a BackendOptions,
    /// CPU seconds after which it is stopped; 0: never.
    pub(super) max_cpu_secs: f64,
    /// The teacher was asked for.
    pub(super) asked: bool,
}

impl TaughtRun<'_> {
    /// Trains its teachers: one, and more of them in the time that the first leaves.
    ///
    /// Errors: those of a training; one that was stopped; a budget that is too small.
    pub(super) fn train_teachers(&self, observer: &mut dyn TrainJobObserver) -> Result<Teachers> {
        let (clock, mut how) = (Instant::now(), self.how.clone());
        let photos = self.photos.train().count();
        let weight = weight_of(photos, self.asked);
        let budget = self.budget.map(|budget| teacher_budget(budget, weight));
        let mut options = teacher_options(self.options, budget.is_some(), weight)?;
        // Steps that are given for the run are given for its teacher, too.
        let most = Some(most_teacher_steps(photos, weight)).filter(|_| !self.options.is_given("steps"));
        if budget.is_none() {
            let triangles_given = self.options.is_given("max_triangles");
            options.options = with_fewer_steps(options.options, most, triangles_given);
        }
        let Budgeted { dataset, options, paced } =
            budgeted(self.photos.clone(), options, None, budget, most, self.began, &mut how)?;
        let began_secs = paced.as_ref().map(|paced| paced.spending.seconds());
        let (trained, stage) = self.train_teacher(0, (&dataset, &how), &options, paced, observer)?;
        let more = match (&trained.paced, began_secs, budget) {
            (Some(paced), Some(began), Some(budget)) => {
                let share = ALL_TEACHERS_SHARE / BUDGET_SHARE;
                let fit = share * budget.seconds.0 / (paced.spending.seconds() - began);
                (fit as usize).clamp(1, MOST_TEACHERS) - 1
            }
            _ => 0,
        };
        let like = trained.options.clone();
        let mut scenes = vec![trained.into()];
        for which in 1..=more {
            let options = TrainOptions { seed: like.seed.wrapping_add(which as u64), ..like.clone() };
            let (trained, _) = self.train_teacher(which, (&dataset, &how), &options, None, observer)?;
            scenes.push(trained.into());
        }
        let stage = StageReport { seconds: clock.elapsed().as_secs_f64(), ..stage };
        Ok(Teachers { scenes, stage })
    }

    /// Trains teacher `which` on `photos`, which were read as the options beside them say.
    fn train_teacher(
        &self,
        which: usize,
        (photos, how): (&Dataset, &DatasetOptions),
        options: &TrainOptions,
        paced: Option<Paced>,
        observer: &mut dyn TrainJobObserver,
    ) -> Result<(Trained, StageReport)> {
        let clock = Instant::now();
        let outputs = RunOptions { max_cpu_secs: self.max_cpu_secs, ..RunOptions::default() };
        let run = TrainRun::new(photos, options).with_dataset_options(how);
        let run = TrainRun { outputs, paced, ..run };
        // What there is to say of the card is said of the run that it teaches.
        let OpenRun { run, .. } = run.start_at(self.backend)?;
        let triangles = run.triangles();
        let trained = {
            let mut steps = observer.teacher_begins(options, self.asked)?;
            run.finish(&mut *steps)?
        };
        if trained.stopped {
            let value = format!("stopped after {} of {} steps", trained.steps, trained.options.steps);
            return Err(Error::invalid("teacher", value, "all of its steps; nothing was written"));
        }
        observer.keep_teacher(which, &trained)?;
        let mut stage = trained.stage(triangles, clock.elapsed().as_secs_f64());
        TeacherDetails::STAGE.clone_into(&mut stage.name);
        Ok((trained, stage))
    }
}

/// `photos`, and beside them the mean pictures of the soft `scenes`: as many as make up `share` of what a run with `options` is trained on.
///
/// Errors: no room on the disk.
pub(super) fn with_pictures(
    photos: &Dataset,
    scenes: &[Loaded],
    share: f64,
    options: &TrainOptions,
    how: &DatasetOptions,
    observer: &mut dyn TrainJobObserver,
) -> Result<Dataset> {
    let drawing = options.drawing(how.background.to_f32());
    let mut drew = |done, all| observer.drew(done, all);
    teacher::beside(photos, scenes, &drawing, share, how.photo_bytes(), &mut drew)
}

/// The soft scene of a file, and those that were kept beside it if a run named it.
///
/// Errors: a file that cannot be read, a scene that is solid.
pub(super) fn soft_scenes(path: &Path, how: &DatasetOptions) -> Result<Vec<Loaded>> {
    let mut scenes = vec![soft_scene(path, how)?];
    // Beside a file of any other name may lie any other scene.
    if path.to_string_lossy().ends_with(TEACHER_FILE) {
        for file in teacher_files(path).iter().skip(1).filter(|file| file.exists()) {
            scenes.push(soft_scene(file, how)?);
        }
    }
    Ok(scenes)
}

/// The soft scene of a file.
///
/// Errors: a file that cannot be read, a scene that is solid.
fn soft_scene(path: &Path, how: &DatasetOptions) -> Result<Loaded> {
    let scene = formats::read(path, &how.read_options(3))?;
    match harden::needless(&scene) {
        Some(_) => {
            let wants = "a soft scene, as `trisplat train --preset outdoor` makes it";
            Err(Error::invalid("teacher", path.display(), wants))
        }
        None => Ok(scene),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::StereoUse;

    const FEW: UndecidedRun =
        UndecidedRun { photos: 8, preset: TrainPreset::Solid, starts_from_photos: true, max_cpu_secs: 0.0 };

    #[test]
    fn solid_scenes_of_few_photos_have_a_teacher() {
        assert_eq!(FEW.needs_none(), None);
        for (run, why) in [
            (UndecidedRun { photos: 1, ..FEW }, "nothing between"),
            (UndecidedRun { photos: 100, ..FEW }, "100 photos are enough"),
            (UndecidedRun { preset: TrainPreset::Outdoor, ..FEW }, "only solid scenes"),
            (UndecidedRun { starts_from_photos: false, ..FEW }, "only solid scenes"),
            (UndecidedRun { max_cpu_secs: 5.0, ..FEW }, "max_cpu_secs"),
        ] {
            assert!(run.needs_none().is_some_and(|reason| reason.contains(why)), "{run:?}");
        }
    }

    #[test]
    fn a_teacher_counts_less_the_more_photos_there_are_without_a_step() {
        assert_eq!([2, 20, 24, 28, 200].map(weight), [1.0, 1.0, 0.5, 0.0, 0.0]);
        for photos in 2..100 {
            assert!((weight(photos) - weight(photos + 1)).abs() <= 0.125 + 1e-9, "{photos}");
            let shares = [photos, photos + 1].map(|photos| picture_share(photos, false));
            assert!((shares[0] - shares[1]).abs() < 0.09, "{photos}: {shares:?}");
        }
        assert_eq!(picture_share(100, true), 0.5);
        assert!(UndecidedRun { photos: 27, ..FEW }.needs_none().is_none());
    }

    #[test]
    fn few_photos_have_an_end_and_many_have_none() {
        let most = |photos| most_steps(photos, false);
        assert_eq!([10, 20, 24].map(most), [1800, 3600, 8640]);
        assert_eq!(most(28), u64::MAX);
        assert!((2..28).all(|photos| most(photos) < most(photos + 1)));
        assert_eq!(most_teacher_steps(20, 1.0), 1700);
    }

    #[test]
    fn a_teacher_is_smaller_than_what_it_teaches() -> Result<()> {
        let steps = serde_json::json!({ "steps": 1000, "seed": 7, "stereo": "on" });
        let run = Layers::default().given(steps).resolve(TrainOptions::preset)?;
        let teacher = teacher_options(&run, false, 1.0)?.options;
        let preset = TrainOptions::preset(TrainPreset::Outdoor);
        assert_eq!((teacher.steps, teacher.max_triangles, teacher.seed), (550, 100_500, 7));
        assert_eq!(teacher.stereo, StereoUse::On);
        assert_eq!(
            teacher_options(&run, true, 1.0)?.options,
            TrainOptions { max_triangles: preset.max_triangles, ..teacher }
        );
        let given = Layers::default().given(serde_json::json!({ "max_triangles": 1000 }));
        let teacher = teacher_options(&given.resolve(TrainOptions::preset)?, true, 1.0)?;
        assert!(teacher.is_given("max_triangles") && teacher.options.max_triangles == 670);
        Ok(())
    }
}
