//! Guards the files that a command writes, before any work: none is an input, another output or,
//! without `--force`, an existing file; each can be written. Every command asks this for every file
//! that it writes.

use super::inputs::Inputs;
use super::messages;
use serde::Serialize;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use trisplat_dataset::Dataset;
use trisplat_dataset::capture::is_camera_file;
use trisplat_formats::output::Output;
use trisplat_scene::atomic::{
    AtomicFile, FileId, FolderLock, MadeFolders, StartedFiles, folder_of, resolved,
};
use trisplat_scene::{Error, Result, input};

/// The inputs and outputs of a command.
#[derive(Debug)]
pub(super) struct Outputs<'a> {
    replace: bool,
    read: &'a Inputs,
    inputs: HashMap<FileId, PathBuf>,
    /// Inputs that later outputs may replace.
    resumed: HashMap<FileId, PathBuf>,
    planned: Vec<Planned>,
    /// Outputs that an interrupted run of the same command wrote, which may be replaced.
    pub(super) unfinished: Vec<PathBuf>,
    /// Folders of outputs, and whether an input in one of them is in danger.
    folders: Vec<(&'static str, PathBuf, IsEndangered)>,
    /// Held until the command ends.
    locks: Vec<FolderLock>,
    files: StartedFiles,
    /// New folders; dropped after the files in them.
    made: Vec<MadeFolders>,
}

/// True for an input in a folder of outputs that might be replaced or removed.
type IsEndangered = fn(&Path) -> bool;

/// A file that will be written.
#[derive(Debug)]
struct Planned {
    option: &'static str,
    path: PathBuf,
    id: FileId,
    /// True for a file that must not exist yet.
    is_new: bool,
}

impl<'a> Outputs<'a> {
    /// Of a command that reads `read`; with `replace` existing files may be replaced.
    pub(super) fn new(read: &'a Inputs, replace: bool) -> Self {
        Self {
            replace,
            read,
            inputs: by_identity(read.files()),
            resumed: HashMap::new(),
            planned: Vec::new(),
            unfinished: Vec::new(),
            folders: Vec::new(),
            locks: Vec::new(),
            files: StartedFiles::default(),
            made: Vec::new(),
        }
    }

    /// Adds an input whose option is not that of a path, and the files that it names.
    pub(super) fn add_input(&mut self, path: &Path) {
        self.inputs.extend(by_identity(self.read.files_of(path)));
    }

    /// Adds a checkpoint, or those of a folder: inputs until [`Outputs::release`].
    pub(super) fn add_resumed(&mut self, path: &Path) {
        let inside = input::entries(path).filter(|path| path.is_file());
        self.resumed.extend(by_identity(inside.chain([path.to_owned()])));
    }

    /// Later outputs may replace what the run goes on from, and existing files if `replace`.
    pub(super) fn release(&mut self, replace: bool) {
        self.replace = replace;
        self.resumed.clear();
    }

    /// A folder of pictures, made if missing, whose names begin like `begin`; it must not be that
    /// of the photos.
    pub(super) fn plan_pictures(
        &mut self,
        option: &'static str,
        folder: &Path,
        begin: &str,
    ) -> Result<()> {
        self.check_folder(option, folder, is_camera_file)?;
        let is_one = |name: &str| name.starts_with(begin) && name.ends_with(".png");
        let mut entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        if !self.replace && entries.any(|entry| entry.file_name().to_str().is_some_and(is_one)) {
            let wants = "a folder without pictures of an earlier run, or --force to replace them";
            return Err(Error::invalid(option, folder.display(), wants));
        }
        self.make_folder(folder)?;
        self.lock_folder(folder)?;
        // Its pictures have names of this length.
        AtomicFile::create(&folder.join(format!("{begin}000000.png"))).map(drop)
    }

    /// Plans a folder for files with names of their own; it must not hold an input that is
    /// `is_endangered`.
    pub(super) fn check_folder(
        &mut self,
        option: &'static str,
        folder: &Path,
        is_endangered: IsEndangered,
    ) -> Result<()> {
        self.folders.push((option, folder.to_owned(), is_endangered));
        self.check_inputs()
    }

    /// Makes a folder for outputs if missing; it is removed if it stays empty.
    pub(super) fn make_folder(&mut self, folder: &Path) -> Result<()> {
        self.made.push(MadeFolders::make(folder)?);
        Ok(())
    }

    /// Keeps other programs from writing into the existing `folder` until the command ends.
    pub(super) fn lock_folder(&mut self, folder: &Path) -> Result<()> {
        self.locks.push(FolderLock::take(folder)?);
        Ok(())
    }

    /// Plans to write `path`, named by `option`.
    ///
    /// # Errors
    ///
    /// A folder, a path without a folder, a file that is read or written already, an existing file.
    pub(super) fn plan(&mut self, option: &'static str, path: &Path) -> Result<()> {
        let refuse = |wants: String| Err(Error::invalid(option, path.display(), wants));
        let meta = std::fs::metadata(path).ok();
        let id = FileId::of(path);
        if meta.as_ref().is_some_and(std::fs::Metadata::is_dir) {
            return refuse("a file name; this is a folder".into());
        }
        // A device may take several outputs.
        let device = path.as_os_str() != "-" && meta.as_ref().is_some_and(|meta| !meta.is_file());
        if let Some(other) = self.planned.iter().find(|other| other.id == id && !device) {
            return refuse(format!("a file that {} does not write too", other.option));
        }
        if !is_stream(path) && !folder_of(&resolved(path)).is_dir() {
            let folder = folder_of(&resolved(path)).display().to_string();
            let folder =
                if folder.contains(char::is_whitespace) { format!("'{folder}'") } else { folder };
            let make = if cfg!(windows) { "mkdir" } else { "mkdir -p" };
            return refuse(format!(
                "a file in a folder that exists; `{make} {folder}` makes this one"
            ));
        }
        let replaced = self.replace || self.unfinished.iter().any(|one| one == path);
        let is_new = !replaced && path.as_os_str() != "-" && !device;
        let planned = Planned { option, path: path.to_owned(), id, is_new };
        self.check_input(&planned)?;
        planned.check_new()?;
        self.planned.push(planned);
        Ok(())
    }

    /// Plans to write the files of a scene, and the folder of its tiles.
    ///
    /// # Errors
    ///
    /// Errors of [`Outputs::plan`]; a folder of tiles that holds an input.
    pub(super) fn plan_scene(&mut self, scene: &Output) -> Result<()> {
        scene.paths().try_for_each(|path| self.plan("--output", path))?;
        scene.tiles().map_or(Ok(()), |folder| self.check_folder("--output", &folder, |_| true))
    }

    /// Plans and starts the files of a scene and its report, if one is asked for. A dry run
    /// replaces nothing.
    pub(super) fn start_scene(
        &mut self,
        scene: &Output,
        dry_run: bool,
        report: Option<&Path>,
    ) -> Result<StartedFiles> {
        let replace = self.replace;
        self.replace |= dry_run;
        self.plan_scene(scene)?;
        self.replace = replace;
        self.reserve_report(report)?;
        let files = if dry_run { scene.dry_run() } else { scene.start()? };
        self.recheck().map(|()| files)
    }

    /// Plans to write `path` and starts it, so that no other program does.
    pub(super) fn reserve(&mut self, option: &'static str, path: &Path) -> Result<()> {
        self.plan(option, path)?;
        self.files.add(path)?;
        self.recheck()
    }

    /// Plans to write a report, if one is asked for, and starts it.
    pub(super) fn reserve_report(&mut self, path: Option<&Path>) -> Result<()> {
        path.map_or(Ok(()), |path| self.reserve("--report", path))
    }

    /// Writes a report that was claimed.
    pub(super) fn save_report(
        &mut self,
        path: Option<&Path>,
        report: &impl Serialize,
    ) -> Result<()> {
        path.map_or(Ok(()), |path| messages::save_json(report, self.take(path)?))
    }

    /// Plans to write `path` later or repeatedly; fails if it cannot be written. The reader of a
    /// pipe would take a try for all.
    pub(super) fn check_writable(&mut self, option: &'static str, path: &Path) -> Result<()> {
        self.plan(option, path)?;
        if is_stream(path) { Ok(()) } else { AtomicFile::create(path).map(drop) }
    }

    /// Fails if another program wrote a planned file before it was started.
    pub(super) fn recheck(&self) -> Result<()> {
        self.planned.iter().try_for_each(Planned::check_new)
    }

    /// Adds the photos and masks of `dataset`, wherever they are, to the inputs.
    ///
    /// # Errors
    ///
    /// One of them is an output.
    pub(super) fn forbid_overwriting_photos(&mut self, dataset: &Dataset) -> Result<()> {
        let photos =
            dataset.views.iter().flat_map(|v| std::iter::once(&v.photo.path).chain(&v.photo.mask));
        self.inputs.extend(by_identity(photos.cloned()));
        self.check_inputs()
    }

    /// Fails if an input is an output.
    fn check_inputs(&self) -> Result<()> {
        self.planned.iter().try_for_each(|planned| self.check_input(planned))?;
        for (option, folder, is_endangered) in &self.folders {
            let id = FileId::of(folder);
            let mut parents: HashMap<&Path, bool> = HashMap::new();
            for input in
                self.inputs.values().chain(self.resumed.values()).filter(|path| is_endangered(path))
            {
                let parent = folder_of(input);
                if !*parents.entry(parent).or_insert_with(|| FileId::of(parent) == id) {
                    continue;
                }
                let name = input.file_name().unwrap_or_default().to_string_lossy();
                let wants = format!("a folder that does not hold inputs, as {name}");
                return Err(Error::invalid(*option, folder.display(), wants));
            }
        }
        Ok(())
    }

    fn check_input(&self, Planned { option, path, id, .. }: &Planned) -> Result<()> {
        if self.inputs.contains_key(id) || self.resumed.contains_key(id) {
            Err(Error::invalid(*option, path.display(), "a file that is not also an input"))
        } else {
            Ok(())
        }
    }

    /// The started file of a path that was claimed.
    pub(super) fn take(&mut self, path: &Path) -> Result<AtomicFile> {
        self.files.take(path)
    }
}

impl Planned {
    fn check_new(&self) -> Result<()> {
        if self.is_new && self.path.exists() {
            Err(Error::invalid(
                self.option,
                self.path.display(),
                "a new file, or --force to replace it",
            ))
        } else {
            Ok(())
        }
    }
}

/// Files by identity; streams and names of nothing are left out.
fn by_identity(files: impl IntoIterator<Item = PathBuf>) -> HashMap<FileId, PathBuf> {
    let files = files.into_iter().filter(|path| !is_stream(path) && !path.as_os_str().is_empty());
    files.map(|path| (FileId::of(&path), path)).collect()
}

fn is_stream(path: &Path) -> bool {
    path.as_os_str() == "-"
        || std::fs::metadata(path).is_ok_and(|meta| !meta.is_file() && !meta.is_dir())
}
