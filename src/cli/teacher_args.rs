//! The flags of the scene that teaches a training.

use super::harden::share;
use crate::job::teacher::{TEACHER_FILE, TeacherSource};
use std::path::{Path, PathBuf};

/// A soft scene beside the photos.
#[derive(Debug, clap::Args)]
pub struct TeacherArgs {
    /// Train on pictures of this soft scene too, drawn from half way between neighbouring photos. auto: train one first and keep it as
    /// OUT.teacher.ply; where it is ready early, up to two more, whose mean picture counts. off: do without. Solid scenes of fewer than
    /// 28 photos have auto, which counts less the more photos there are beyond 20, unless --max-cpu-secs is given. With a budget, short
    /// trainings that leave photos out may ask for it up to 100 photos, and say how long it trains.
    #[arg(long, value_name = "SCENE|auto|off", requires = "dataset")]
    pub teacher: Option<TeacherSource>,
    /// Share of the steps that look at them, 0 to 0.9, at most one picture per place between the photos. By default two thirds with 20 photos
    /// or fewer, and less with more, as the teacher counts less; half or more where one is asked for.
    #[arg(long, value_name = "SHARE", requires = "teacher", value_parser = share)]
    pub teacher_share: Option<f64>,
}

/// Where a teacher is left that is trained for `output`.
pub(super) fn beside(output: &Path) -> PathBuf {
    output.with_extension(TEACHER_FILE)
}
