//! The teacher: a soft scene that is trained first and drawn from between the photos. Decides whether a run has one, and how it is trained.

use super::event::{Observer, drew};
use super::harden;
use super::watched;
use std::convert::Infallible;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_formats as formats;
use trisplat_scene::{
    Budget, Error, ImportedScene, Result, Seconds,
    layered::{Layered, Layers},
};
use trisplat_teacher as teacher;
use trisplat_train::{Checkpoint, TrainOptions, TrainPreset, budget::StepLimit};

/// Steps and triangles of a teacher, as a share of the run's.
const STEPS_SHARE: f64 = 0.55;
const TRIANGLES_SHARE: f64 = 0.67;
/// Time of a teacher as a share of the budget.
const BUDGET_SHARE: f64 = 0.4;
/// Numbers of training photos up to which a teacher has weight 1, and from which on weight 0; linear in between.
/// Watched photos may ask for more: see `watched.rs` and docs/benchmarks/few-photos.md.
const FEW_PHOTOS: f64 = 14.0;
const MANY_PHOTOS: f64 = 18.0;
/// Share of the steps on the teacher's pictures: with few photos, and at least if requested with many.
const PICTURE_SHARES: [f64; 2] = [2.0 / 3.0, 0.5];
/// The least weight that is worth the teacher's training.
const LEAST_WEIGHT: f64 = 0.1;
/// Steps per training photo after which a teacher, and its run, only memorise these photos. Divided by the teacher's weight.
const TEACHER_STEPS_PER_PHOTO: f64 = 85.0;
const STEPS_PER_PHOTO: f64 = 180.0;

/// Source of the teacher.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TeacherSource {
    /// Train one for this run.
    Auto,
    /// None.
    Off,
    /// Read from a file.
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
pub enum TeacherPlan {
    /// No teacher, with the reason.
    Without(String),
    /// Read from a file.
    Read(PathBuf),
    /// It is trained first.
    Train,
}

/// A training without a request for or against a teacher.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UndecidedRun {
    /// Photos to train on.
    pub photos: usize,
    /// Result of the watched photos; `None` without them.
    pub watched: Option<WatchedGain>,
    /// The preset of its options.
    pub preset: TrainPreset,
    /// Whether it starts from photos and their points instead of a scene.
    pub starts_from_photos: bool,
    /// CPU seconds after which it is stopped; 0: never.
    pub max_cpu_secs: f64,
}

impl UndecidedRun {
    /// The reason for having no teacher; `None`: a teacher is trained first.
    pub fn needs_none(&self) -> Option<String> {
        if !self.starts_from_photos || self.preset != TrainPreset::Solid {
            return Some("by default only solid scenes that start from photos have one".into());
        }
        if self.max_cpu_secs > 0.0 {
            return Some("by default a run that `max_cpu_secs` may end early has none".into());
        }
        match self.photos {
            0 | 1 => Some("there is nothing between so few photos".into()),
            count if self.weight() < LEAST_WEIGHT => Some(match self.watched {
                Some(WatchedGain { decibels, .. }) => {
                    format!("more steps gain {decibels:.1} dB on watched photos without one")
                }
                None => format!("{count} photos are enough without one"),
            }),
            _ => None,
        }
    }

    /// Whether to watch photos, because their number alone does not decide.
    pub(super) fn is_unsure(&self) -> bool {
        let without = Self { watched: None, ..*self };
        let possible = Self { photos: 2, ..without }.needs_none().is_none();
        possible && without.weight() < 1.0 && self.photos <= watched::MOST_PHOTOS
    }

    /// Weight of the teacher: the larger of the weights by number of photos and by watched photos.
    pub(super) fn weight(&self) -> f64 {
        weight(self.photos).max(self.watched.map_or(0.0, |watched| watched.teacher_weight))
    }
}

/// Result of watched photos for a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WatchedGain {
    /// Gain of more steps on them, dB.
    pub decibels: f64,
    /// Weight of a teacher, 0 to 1.
    pub teacher_weight: f64,
}

/// Default weight of a teacher for this number of training photos: 1 with few, 0 with many.
fn weight(photos: usize) -> f64 {
    ((MANY_PHOTOS - photos as f64) / (MANY_PHOTOS - FEW_PHOTOS)).clamp(0.0, 1.0)
}

/// Limits of a run on `photos` with a teacher of this `weight`.
pub(super) fn enough(photos: usize, weight: f64) -> StepLimit {
    StepLimit { steps: Some(worth(STEPS_PER_PHOTO, photos, weight)), ..StepLimit::default() }
}

/// Most steps.
fn worth(per_photo: f64, photos: usize, weight: f64) -> u64 {
    // A float that is too large becomes the largest integer.
    (per_photo * photos as f64 / weight) as u64
}

/// Limits of a teacher.
pub(super) fn enough_for_teacher(photos: usize, weight: f64) -> StepLimit {
    let steps = worth(TEACHER_STEPS_PER_PHOTO, photos, weight);
    // A teacher shows large surfaces, so it gains more from a large number of steps on small photos than from few on large ones.
    StepLimit { steps: Some(steps), steps_of_full_photos: steps, ..StepLimit::default() }
}

/// Default share of the steps on pictures of a teacher of this weight; at least a minimum if `asked` for.
pub(super) fn picture_share(weight: f64, asked: bool) -> f64 {
    let [few, least] = PICTURE_SHARES;
    let by_weight = few * weight;
    if asked { by_weight.max(least) } else { by_weight }
}

/// Budget for a teacher of this `weight` after `spent` seconds of the run's budget.
pub(super) fn teacher_budget(run: Budget, weight: f64, spent: f64) -> Budget {
    Budget { seconds: Seconds(spent + (run.seconds.0 - spent) * BUDGET_SHARE * weight), ..run }
}

/// Training options of a teacher of this `weight`. A budget chooses its triangles unless the run's are given.
///
/// Errors: none if options are in range.
pub(super) fn teacher_options(
    run: &Layered<TrainOptions>,
    has_budget: bool,
    weight: f64,
) -> Result<Layered<TrainOptions>> {
    let share = |count: u64, share: f64| ((count as f64 * share) as u64).max(1);
    let mut given = serde_json::json!({
        "preset": TrainPreset::Outdoor,
        "steps": share(run.options.steps, STEPS_SHARE * weight),
        "seed": run.options.seed,
        "poses": run.options.poses,
    });
    if !has_budget || run.is_given("max_triangles") {
        given["max_triangles"] = share(run.options.max_triangles, TRIANGLES_SHARE).into();
    }
    Layers::default().given(given).resolve(TrainOptions::preset)
}

impl TeacherPlan {
    /// The plan of a run with a requested teacher. A resumed run reads its own teacher at `kept`.
    pub fn asked(source: &TeacherSource, resumes: bool, kept: Option<&Path>) -> Self {
        match (source, kept.filter(|_| resumes)) {
            (TeacherSource::Off, _) => Self::Without("`teacher` off".into()),
            (TeacherSource::File(path), _) => Self::Read(path.clone()),
            (TeacherSource::Auto, Some(kept)) => Self::Read(kept.to_owned()),
            (TeacherSource::Auto, None) => Self::Train,
        }
    }

    /// The plan of a new run without a request.
    pub fn by_default(run: &UndecidedRun) -> Self {
        run.needs_none().map_or(Self::Train, Self::Without)
    }

    /// The plan of a resumed run on `photos` without a request. It has a teacher exactly when it began with one, kept at `kept` if
    /// that is known.
    pub fn resumed(checkpoint: &Checkpoint, photos: usize, kept: Option<&Path>) -> Self {
        // A run counts pictures of its teacher as photos.
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

/// Extension of a teacher's file.
pub const TEACHER_FILE: &str = "teacher.ply";

/// `photos` and pictures of the soft `scene`, which get `share` of the steps of a run with `options`.
///
/// Errors: no room on the disk.
pub(super) fn with_pictures(
    photos: &Dataset,
    scene: &ImportedScene,
    share: f64,
    options: &TrainOptions,
    how: &DatasetOptions,
    observer: Observer<'_>,
) -> Result<Dataset> {
    let drawing = options.drawing(how.background.to_f32());
    teacher::beside(photos, scene, &drawing, share, how.photo_bytes(), &mut drew(observer))
}

/// The soft scene of a file.
///
/// Errors: a file that cannot be read, a scene that is solid.
pub(super) fn soft_scene(path: &Path, how: &DatasetOptions) -> Result<ImportedScene> {
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

    const FEW: UndecidedRun = UndecidedRun {
        photos: 8,
        watched: None,
        preset: TrainPreset::Solid,
        starts_from_photos: true,
        max_cpu_secs: 0.0,
    };

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
        assert_eq!([2, 14, 16, 18, 200].map(weight), [1.0, 1.0, 0.5, 0.0, 0.0]);
        for photos in 2..100 {
            assert!((weight(photos) - weight(photos + 1)).abs() <= 0.25 + 1e-9, "{photos}");
            let shares = [photos, photos + 1].map(|photos| picture_share(weight(photos), false));
            assert!((shares[0] - shares[1]).abs() < 0.17, "{photos}: {shares:?}");
        }
        assert_eq!(picture_share(weight(100), true), 0.5);
        assert!(UndecidedRun { photos: 17, ..FEW }.needs_none().is_none());
    }

    #[test]
    fn watched_photos_may_ask_for_a_teacher_that_the_number_of_photos_does_not() {
        let many = UndecidedRun { photos: 37, ..FEW };
        let watched = |decibels, teacher_weight| UndecidedRun {
            watched: Some(WatchedGain { decibels, teacher_weight }),
            ..many
        };
        assert!(many.needs_none().is_some() && many.is_unsure());
        assert_eq!((watched(-0.5, 1.0).needs_none(), watched(-0.5, 1.0).weight()), (None, 1.0));
        let why = watched(1.5, 0.0).needs_none();
        assert!(why.as_ref().is_some_and(|why| why.contains("gain 1.5 dB")), "{why:?}");
        // Watched photos never remove a teacher.
        assert_eq!(UndecidedRun { photos: 15, ..watched(1.5, 0.0) }.weight(), weight(15));
        for sure in [
            FEW,
            UndecidedRun { photos: 101, ..FEW },
            UndecidedRun { preset: TrainPreset::Outdoor, ..many },
            UndecidedRun { starts_from_photos: false, ..many },
        ] {
            assert!(!sure.is_unsure(), "{sure:?}");
        }
    }

    #[test]
    fn few_photos_have_an_end_and_many_have_none() {
        let most = |photos| enough(photos, weight(photos)).steps.unwrap();
        assert_eq!([5, 14, 16].map(most), [900, 2520, 5760]);
        assert_eq!(most(18), u64::MAX);
        assert!((2..18).all(|photos| most(photos) < most(photos + 1)));
    }

    #[test]
    fn less_weight_trains_longer() {
        assert_eq!([1.0, 0.5].map(|weight| enough(20, weight).steps), [3600, 7200].map(Some));
        let of_teacher = enough_for_teacher(20, 1.0);
        // A teacher without time for its steps on full photos gets smaller photos.
        assert_eq!((of_teacher.steps, of_teacher.steps_of_full_photos), (Some(1700), 1700));
    }

    #[test]
    fn a_teacher_is_smaller_than_what_it_teaches() -> Result<()> {
        let steps = serde_json::json!({ "steps": 1000, "seed": 7 });
        let run = Layers::default().given(steps).resolve(TrainOptions::preset)?;
        let teacher = teacher_options(&run, false, 1.0)?.options;
        let preset = TrainOptions::preset(TrainPreset::Outdoor);
        assert_eq!((teacher.steps, teacher.max_triangles, teacher.seed), (550, 100_500, 7));
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
