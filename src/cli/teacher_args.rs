//! The flags of a training's teacher.

use super::harden::share;
use std::path::{Path, PathBuf};
use trisplat_job::{TEACHER_FILE, TeacherSource};

/// The teacher: a soft scene beside the photos.
#[derive(Debug, clap::Args)]
pub struct TeacherArgs {
    /// Also train on pictures of this soft scene, drawn from half way between neighbouring photos. auto:
    /// train one first and keep it as OUT.teacher.ply. off: no teacher. Solid scenes of up to 16 photos
    /// have auto, unless --max-cpu-secs is given. With 17 to 100 photos, a run that is long enough
    /// decides by short trial trainings.
    #[arg(long, value_name = "SCENE|auto|off", requires = "dataset")]
    pub teacher: Option<TeacherSource>,
    /// Share of the steps that use these pictures, 0 to 0.9, at most one picture per place between the
    /// photos. Two thirds by default.
    #[arg(long, value_name = "SHARE", requires = "teacher", value_parser = share)]
    pub teacher_share: Option<f64>,
}

/// The path of a teacher that is trained for `output`.
pub(super) fn beside(output: &Path) -> PathBuf {
    output.with_extension(TEACHER_FILE)
}
