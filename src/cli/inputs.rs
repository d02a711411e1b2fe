//! The inputs of a command: every path that was typed, unless its option names an output.

use clap::ArgMatches;
use clap::parser::ValueSource;
use std::path::{Path, PathBuf};
use trisplat_job::files_of;
use trisplat_scene::Limits;

/// The options that name outputs: files, and folders for files. A path of any other option is read,
/// so that a new option cannot be forgotten.
pub const OUTPUTS: [&str; 10] = [
    "checkpoint",
    "folder",
    "log",
    "output",
    "page",
    "preview",
    "report",
    "save_renders",
    "screenshots",
    "work",
];
/// The option that names what a run goes on from and then replaces: the command guards it itself.
pub const RESUMED: &str = "resume";
/// The option that names the folder of photos in a data set.
pub const IMAGES: &str = "images";

/// Inputs of a command.
#[derive(Debug, Clone)]
pub struct Inputs {
    paths: Vec<PathBuf>,
    /// The folder of photos in each data set.
    images: PathBuf,
    limits: Limits,
}

impl Inputs {
    /// Of a command that was typed like this.
    pub(super) fn typed(matches: &ArgMatches, limits: Limits) -> Self {
        let mut inputs = Self { paths: Vec::new(), images: IMAGES.into(), limits };
        inputs.add(matches);
        inputs
    }

    fn add(&mut self, matches: &ArgMatches) {
        for id in matches.ids().map(clap::Id::as_str) {
            let Ok(Some(mut paths)) = matches.try_get_many::<PathBuf>(id) else { continue };
            match id {
                IMAGES => self.images = paths.next_back().cloned().unwrap_or_default(),
                _ if OUTPUTS.contains(&id) || id == RESUMED => {}
                _ if matches.value_source(id) != Some(ValueSource::CommandLine) => {}
                _ => self.paths.extend(paths.cloned()),
            }
        }
        if let Some((_, inner)) = matches.subcommand() {
            self.add(inner);
        }
    }

    /// Every file that is read.
    pub(super) fn files(&self) -> Vec<PathBuf> {
        self.paths.iter().flat_map(|path| self.files_of(path)).collect()
    }

    /// `path` and the files that it names.
    pub(super) fn files_of(&self, path: &Path) -> Vec<PathBuf> {
        files_of(path, &self.images, &self.limits)
    }
}
