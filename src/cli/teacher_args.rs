//! The flags of the scene that teaches a training.

use super::harden::share;
use std::convert::Infallible;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Which scene teaches.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TeacherSource {
    /// One that is trained for it.
    Auto,
    /// That of a file.
    File(PathBuf),
}

impl FromStr for TeacherSource {
    type Err = Infallible;

    fn from_str(text: &str) -> std::result::Result<Self, Infallible> {
        Ok(if text == "auto" { Self::Auto } else { Self::File(text.into()) })
    }
}

/// A soft scene beside the photos.
#[derive(Debug, clap::Args)]
pub struct TeacherArgs {
    /// Look at pictures of this soft scene too, from half way between neighbouring photos, where it says what the photos do not; auto: train
    /// one first, which is left as OUT.teacher.ply.
    #[arg(long, value_name = "SCENE|auto", requires = "dataset")]
    pub teacher: Option<TeacherSource>,
    /// Share of the steps that look at them, 0 to 0.9; fewer where there are not as many places between the photos.
    #[arg(long, value_name = "SHARE", default_value_t = 0.5, requires = "teacher", value_parser = share)]
    pub teacher_share: f64,
}

impl TeacherArgs {
    /// The file of the scene when it is read by a run that writes `output`; one that is trained for a run is read by those that resume it.
    pub(super) fn input(&self, output: &Path, resumes: bool) -> Option<PathBuf> {
        match self.teacher.as_ref()? {
            TeacherSource::File(path) => Some(path.clone()),
            TeacherSource::Auto => resumes.then(|| beside(output)),
        }
    }

    /// The file of the scene when it is trained.
    pub(super) fn output(&self, output: &Path, resumes: bool) -> Option<PathBuf> {
        (self.teacher == Some(TeacherSource::Auto) && !resumes).then(|| beside(output))
    }
}

/// Where a teacher is left that was trained for `output`.
fn beside(output: &Path) -> PathBuf {
    output.with_extension("teacher.ply")
}
