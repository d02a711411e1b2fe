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
    /// None.
    Off,
    /// That of a file.
    File(PathBuf),
}

impl FromStr for TeacherSource {
    type Err = Infallible;

    fn from_str(text: &str) -> std::result::Result<Self, Infallible> {
        Ok(match text {
            "auto" => Self::Auto,
            "off" => Self::Off,
            path => Self::File(path.into()),
        })
    }
}

/// A soft scene beside the photos.
#[derive(Debug, clap::Args)]
pub struct TeacherArgs {
    /// Look at pictures of this soft scene too, from half way between neighbouring photos, where it says what the photos do not; auto: train
    /// one first, which is left as OUT.teacher.ply; off: do without. Solid scenes of 20 photos or fewer have auto, unless --max-cpu-secs is given.
    #[arg(long, value_name = "SCENE|auto|off", requires = "dataset")]
    pub teacher: Option<TeacherSource>,
    /// Share of the steps that look at them, 0 to 0.9, fewer where there are not as many places between the photos; 0.5 unless given, two thirds
    /// with 20 photos or fewer.
    #[arg(long, value_name = "SHARE", requires = "teacher", value_parser = share)]
    pub teacher_share: Option<f64>,
}

/// What becomes of the flags for a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum TeacherPlan {
    /// None, and why not.
    Without(String),
    /// The scene of a file.
    Read(PathBuf),
    /// One that is trained first, and left here.
    Train(PathBuf),
}

impl TeacherArgs {
    /// What the flags mean for a run that writes `output`; one that is trained for a run is read by those that resume it. Without a flag
    /// `needless` decides: why the run does without.
    pub(super) fn plan(&self, output: &Path, resumes: bool, needless: Option<String>) -> TeacherPlan {
        let beside = output.with_extension("teacher.ply");
        match (&self.teacher, needless) {
            (Some(TeacherSource::Off), _) => TeacherPlan::Without("`teacher` off".into()),
            (Some(TeacherSource::File(path)), _) => TeacherPlan::Read(path.clone()),
            (None, Some(why)) => TeacherPlan::Without(why),
            (None, None) if resumes && !beside.exists() => TeacherPlan::Without(format!(
                "the teacher of the run that goes on is not at {}",
                beside.display()
            )),
            (Some(TeacherSource::Auto) | None, _) if resumes => TeacherPlan::Read(beside),
            (Some(TeacherSource::Auto) | None, _) => TeacherPlan::Train(beside),
        }
    }
}

impl TeacherPlan {
    /// Why there is none.
    pub(super) fn reason(&self) -> Option<String> {
        match self {
            Self::Without(why) => Some(why.clone()),
            _ => None,
        }
    }

    /// The file that is read.
    pub(super) fn input(&self) -> Option<PathBuf> {
        match self {
            Self::Read(path) => Some(path.clone()),
            _ => None,
        }
    }

    /// The file that is written.
    pub(super) fn output(&self) -> Option<PathBuf> {
        match self {
            Self::Train(path) => Some(path.clone()),
            _ => None,
        }
    }
}
