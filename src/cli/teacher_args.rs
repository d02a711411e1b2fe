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
    /// What the flag asks for in a run that writes `output`; one that is trained for a run is read by those that resume it. `None`: it was
    /// not given.
    pub(super) fn asked(&self, output: &Path, resumes: bool) -> Option<TeacherPlan> {
        Some(match self.teacher.as_ref()? {
            TeacherSource::Off => TeacherPlan::Without("`teacher` off".into()),
            TeacherSource::File(path) => TeacherPlan::Read(path.clone()),
            TeacherSource::Auto if resumes => TeacherPlan::Read(beside(output)),
            TeacherSource::Auto => TeacherPlan::Train(beside(output)),
        })
    }
}

impl TeacherPlan {
    /// Of a run that writes `output` and was not asked. `needless`: why it does without.
    pub(super) fn unasked(output: &Path, resumes: bool, needless: Option<String>) -> Self {
        let path = beside(output);
        match needless {
            Some(why) => Self::Without(why),
            None if !resumes => Self::Train(path),
            None if path.exists() => Self::Read(path),
            None => {
                Self::Without(format!("the teacher of the run that goes on is not at {}", path.display()))
            }
        }
    }

    /// The file that is read.
    pub(super) fn input(&self) -> Option<&Path> {
        match self {
            Self::Read(path) => Some(path),
            _ => None,
        }
    }

    /// The file that is written.
    pub(super) fn output(&self) -> Option<&Path> {
        match self {
            Self::Train(path) => Some(path),
            _ => None,
        }
    }
}

/// Where a teacher is left that was trained for `output`.
fn beside(output: &Path) -> PathBuf {
    output.with_extension("teacher.ply")
}
