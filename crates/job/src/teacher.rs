//! The teacher: a soft scene that is trained first and drawn from between the photos. Decides
//! whether a run has one, and how it is trained.

use super::event::{Observer, on_drawn};
use super::harden;
use std::convert::Infallible;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_formats as formats;
use trisplat_scene::layered::Layered;
use trisplat_scene::{Budget, Error, ImportedScene, Result, Seconds};
use trisplat_teacher as teacher;
use trisplat_train::budget::{StepLimit, WholeBudget};
use trisplat_train::{Checkpoint, TrainOptions, TrainPreset};

/// Steps and triangles of a teacher, as a share of the run's.
const STEPS_SHARE: f64 = 0.55;
const TRIANGLES_SHARE: f64 = 0.67;
/// Time of a teacher as a share of the budget.
const BUDGET_SHARE: f64 = 0.4;
/// Default share of the steps on the teacher's pictures.
pub(super) const PICTURE_SHARE: f64 = 2.0 / 3.0;
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

/// Plan for the teacher of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TeacherPlan {
    /// No teacher, with the reason.
    Without(String),
    /// Read from a file.
    Read(PathBuf),
    /// Trained first.
    Train,
}

/// Step limit of a run on `photos` with a teacher.
pub(super) fn run_limit(photos: usize) -> StepLimit {
    StepLimit { steps: Some(STEPS_PER_PHOTO * photos as u64), ..StepLimit::default() }
}

/// Step limit of a teacher.
pub(super) fn teacher_limit(photos: usize) -> StepLimit {
    let steps = TEACHER_STEPS_PER_PHOTO * photos as u64;
    // A teacher shows large surfaces, so it gains more from a large number of steps on small photos
    // than from few on large ones.
    StepLimit { steps: Some(steps), steps_of_full_photos: steps }
}

/// Budget for a teacher after `spent` seconds of the run's budget.
pub(super) fn teacher_budget(run: Budget, spent: f64) -> Budget {
    Budget { seconds: Seconds(spent + (run.seconds.0 - spent) * BUDGET_SHARE), ..run }
}

/// The budget that a teacher gets a share of: that of the run, or `whole`, which contains it.
pub(super) fn whole(run: Budget, whole: Option<WholeBudget>, spent: f64) -> WholeBudget {
    let whole = whole.unwrap_or(WholeBudget { seconds: run.seconds, scale: 1.0, offset: 0.0 });
    let scale = whole.scale / BUDGET_SHARE;
    let offset = whole.offset + whole.scale * spent * (1.0 - 1.0 / BUDGET_SHARE);
    WholeBudget { scale, offset, ..whole }
}

/// Training options of a teacher. A budget chooses its triangles unless the run's are given.
pub(super) fn teacher_options(
    run: &Layered<TrainOptions>,
    has_budget: bool,
) -> Layered<TrainOptions> {
    let share = |count: u64, share: f64| ((count as f64 * share) as u64).max(1);
    let preset = TrainOptions::preset(TrainPreset::Outdoor);
    let keeps_max_triangles = run.is_given("max_triangles");
    let max_triangles = if has_budget && !keeps_max_triangles {
        preset.max_triangles
    } else {
        share(run.options.max_triangles, TRIANGLES_SHARE)
    };
    let steps = share(run.options.steps, STEPS_SHARE);
    let TrainOptions { seed, exposure, .. } = run.options;
    let options = TrainOptions { steps, max_triangles, seed, exposure, ..preset };
    let layered = Layered::over(&options, options.clone());
    if keeps_max_triangles { layered.mark_given(&["max_triangles"]) } else { layered }
}

impl TeacherPlan {
    /// The plan of a run with a requested teacher. A resumed run reads its own teacher at `stored`.
    pub fn requested(source: &TeacherSource, resumes: bool, stored: Option<&Path>) -> Self {
        match (source, stored.filter(|_| resumes)) {
            (TeacherSource::Off, _) => Self::Without("`teacher` off".into()),
            (TeacherSource::File(path), _) => Self::Read(path.clone()),
            (TeacherSource::Auto, Some(stored)) => Self::Read(stored.to_owned()),
            (TeacherSource::Auto, None) => Self::Train,
        }
    }

    /// The plan of a resumed run on `photos` without a request. It has a teacher exactly when it
    /// began with one, stored at `stored` if that is known.
    pub fn resumed(checkpoint: &Checkpoint, photos: usize, stored: Option<&Path>) -> Self {
        // A run counts pictures of its teacher as photos.
        let had_teacher = checkpoint.meta.identity.photos.len() > photos;
        match stored {
            _ if !had_teacher => Self::Without("the resumed run has none".into()),
            None => Self::Train,
            Some(path) if path.exists() => Self::Read(path.to_owned()),
            Some(path) => Self::Without(format!(
                "the teacher of the resumed run is not at {}",
                path.display()
            )),
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

/// `photos` and pictures of the soft `scene`, which get `share` of the steps of a run with
/// `options`.
///
/// # Errors
///
/// No room on the disk.
pub(super) fn with_pictures(
    photos: &Dataset,
    scene: &ImportedScene,
    share: f64,
    options: &TrainOptions,
    how: &DatasetOptions,
    observer: Observer<'_>,
) -> Result<Dataset> {
    let drawing = options.drawing(how.background.to_f32());
    teacher::with_soft_pictures(
        photos,
        scene,
        &drawing,
        share,
        how.photo_bytes(),
        &mut on_drawn(observer),
    )
}

/// The soft scene of a file.
///
/// # Errors
///
/// A file that cannot be read, a scene that is solid.
pub(super) fn soft_scene(path: &Path, how: &DatasetOptions) -> Result<ImportedScene> {
    let scene = formats::read(path, &how.read_options(3))?;
    match harden::reason_to_skip(&scene) {
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
    use trisplat_scene::layered::Layers;

    #[test]
    fn runs_with_a_teacher_and_teachers_have_an_end() {
        assert_eq!([5, 14].map(|photos| run_limit(photos).steps), [900, 2520].map(Some));
        let of_teacher = teacher_limit(20);
        // A teacher without time for its steps on full photos gets smaller photos.
        assert_eq!((of_teacher.steps, of_teacher.steps_of_full_photos), (Some(1700), 1700));
    }

    #[test]
    fn a_teacher_is_smaller_than_what_it_teaches() -> Result<()> {
        let steps = serde_json::json!({ "steps": 1000, "seed": 7 });
        let run = Layers::default().with_options(steps).resolve(TrainOptions::preset)?;
        let teacher = teacher_options(&run, false).options;
        let preset = TrainOptions::preset(TrainPreset::Outdoor);
        assert_eq!((teacher.steps, teacher.max_triangles, teacher.seed), (550, 100_500, 7));
        assert_eq!(
            teacher_options(&run, true).options,
            TrainOptions { max_triangles: preset.max_triangles, ..teacher }
        );
        let given = Layers::default().with_options(serde_json::json!({ "max_triangles": 1000 }));
        let teacher = teacher_options(&given.resolve(TrainOptions::preset)?, true);
        assert!(teacher.is_given("max_triangles") && teacher.options.max_triangles == 670);
        Ok(())
    }
}
