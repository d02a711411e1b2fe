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
/// Default share of the steps on the teacher's pictures.
pub(super) const PICTURE_SHARE: f64 = 2.0 / 3.0;
/// Most training photos with which a run has a teacher by default. With more, watched photos may ask for one: see `watched.rs` and
/// docs/benchmarks/few-photos.md.
const FEW_PHOTOS: usize = 16;
/// Gain on watched photos, dB, below which a run has a teacher: more steps without one would memorise photos.
const LITTLE_GAIN: f64 = 0.2;
/// Steps per training photo after which a teacher, and its run, only memorise these photos.
const TEACHER_STEPS_PER_PHOTO: u64 = 85;
const STEPS_PER_PHOTO: u64 = 180;

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
    /// Gain of more steps on watched photos, dB; `None` without them.
    pub watched_gain: Option<f64>,
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
        match (self.photos, self.watched_gain) {
            (0 | 1, _) => Some("there is nothing between so few photos".into()),
            (..=FEW_PHOTOS, _) => None,
            (_, Some(gain)) if gain < LITTLE_GAIN => None,
            (_, Some(gain)) => Some(format!("more steps gain {gain:.1} dB on watched photos without one")),
            (photos, None) => Some(format!("{photos} photos are enough without one")),
        }
    }

    /// Whether to watch photos, because their number alone does not decide.
    pub(super) fn is_unsure(&self) -> bool {
        let with_few = Self { photos: 2, ..*self };
        with_few.needs_none().is_none() && (FEW_PHOTOS + 1..=watched::MOST_PHOTOS).contains(&self.photos)
    }
}

/// Limits of a run on `photos` with a teacher.
pub(super) fn enough(photos: usize) -> StepLimit {
    StepLimit { steps: Some(STEPS_PER_PHOTO * photos as u64), ..StepLimit::default() }
}

/// Limits of a teacher.
pub(super) fn enough_for_teacher(photos: usize) -> StepLimit {
    let steps = TEACHER_STEPS_PER_PHOTO * photos as u64;
    // A teacher shows large surfaces, so it gains more from a large number of steps on small photos than from few on large ones.
    StepLimit { steps: Some(steps), steps_of_full_photos: steps, ..StepLimit::default() }
}

/// Budget for a teacher after `spent` seconds of the run's budget.
pub(super) fn teacher_budget(run: Budget, spent: f64) -> Budget {
    Budget { seconds: Seconds(spent + (run.seconds.0 - spent) * BUDGET_SHARE), ..run }
}

/// Training options of a teacher. A budget chooses its triangles unless the run's are given.
///
/// Errors: none if options are in range.
pub(super) fn teacher_options(
    run: &Layered<TrainOptions>,
    has_budget: bool,
) -> Result<Layered<TrainOptions>> {
    let share = |count: u64, share: f64| ((count as f64 * share) as u64).max(1);
    let mut given = serde_json::json!({
        "preset": TrainPreset::Outdoor,
        "steps": share(run.options.steps, STEPS_SHARE),
        "seed": run.options.seed,
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
        watched_gain: None,
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
    fn watched_photos_may_ask_for_a_teacher_that_the_number_of_photos_does_not() {
        let most = UndecidedRun { photos: FEW_PHOTOS, ..FEW };
        let many = UndecidedRun { photos: FEW_PHOTOS + 1, ..FEW };
        assert!(most.needs_none().is_none() && many.needs_none().is_some() && many.is_unsure());
        let watched = |gain| UndecidedRun { watched_gain: Some(gain), ..many };
        assert_eq!([-0.5, 0.1].map(|gain| watched(gain).needs_none()), [None, None]);
        let why = watched(1.5).needs_none();
        assert!(why.as_ref().is_some_and(|why| why.contains("gain 1.5 dB")), "{why:?}");
        // Watched photos never remove a teacher.
        assert_eq!(UndecidedRun { photos: FEW_PHOTOS, ..watched(1.5) }.needs_none(), None);
        for sure in [
            most,
            UndecidedRun { photos: 101, ..FEW },
            UndecidedRun { preset: TrainPreset::Outdoor, ..many },
            UndecidedRun { starts_from_photos: false, ..many },
        ] {
            assert!(!sure.is_unsure(), "{sure:?}");
        }
    }

    #[test]
    fn runs_with_a_teacher_and_teachers_have_an_end() {
        assert_eq!([5, 14].map(|photos| enough(photos).steps), [900, 2520].map(Some));
        let of_teacher = enough_for_teacher(20);
        // A teacher without time for its steps on full photos gets smaller photos.
        assert_eq!((of_teacher.steps, of_teacher.steps_of_full_photos), (Some(1700), 1700));
    }

    #[test]
    fn a_teacher_is_smaller_than_what_it_teaches() -> Result<()> {
        let steps = serde_json::json!({ "steps": 1000, "seed": 7 });
        let run = Layers::default().given(steps).resolve(TrainOptions::preset)?;
        let teacher = teacher_options(&run, false)?.options;
        let preset = TrainOptions::preset(TrainPreset::Outdoor);
        assert_eq!((teacher.steps, teacher.max_triangles, teacher.seed), (550, 100_500, 7));
        assert_eq!(
            teacher_options(&run, true)?.options,
            TrainOptions { max_triangles: preset.max_triangles, ..teacher }
        );
        let given = Layers::default().given(serde_json::json!({ "max_triangles": 1000 }));
        let teacher = teacher_options(&given.resolve(TrainOptions::preset)?, true)?;
        assert!(teacher.is_given("max_triangles") && teacher.options.max_triangles == 670);
        Ok(())
    }
}
