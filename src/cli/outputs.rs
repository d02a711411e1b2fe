//! Guards the files that a command writes, before any work: none is an input, a photo, another output or,
//! without `--force`, an existing file; each can be written.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use trisplat_dataset::Dataset;
use trisplat_scene::atomic::{AtomicFile, FolderLock, MadeFolders, resolved};
use trisplat_scene::error::{Error, Result};

/// Other files of a data set than photos, by the beginning of their names.
const DATASET_FILES: [&str; 6] = ["transforms", "test.txt", "cameras.", "images.", "points3D.", "rigs."];
/// Folders of a data set that hold such files.
const DATASET_FOLDERS: [&str; 3] = ["", "sparse", "sparse/0"];

/// The inputs and outputs of a command.
#[derive(Debug, Default)]
pub(super) struct Outputs {
    replace: bool,
    inputs: HashSet<FileId>,
    photos: HashSet<FileId>,
    planned: Vec<Planned>,
    /// The option that names each of them.
    options: HashMap<FileId, &'static str>,
    folders: Vec<(&'static str, PathBuf)>,
    /// Held until the command ends.
    locks: Vec<FolderLock>,
    files: Vec<AtomicFile>,
    /// New folders; dropped after the files in them.
    made: Vec<MadeFolders>,
}

/// A file that will be written.
#[derive(Debug)]
struct Planned {
    option: &'static str,
    path: PathBuf,
    id: FileId,
    /// It must not exist yet.
    is_new: bool,
}

impl Outputs {
    /// Of a command that reads `inputs`; with `replace` existing files may be replaced.
    pub(super) fn new<'a>(inputs: impl IntoIterator<Item = &'a Path>, replace: bool) -> Self {
        let inputs = inputs.into_iter().filter(|path| !is_stream(path)).map(FileId::of).collect();
        Self { replace, inputs, ..Self::default() }
    }

    /// The files of a data set are inputs too.
    pub(super) fn with_dataset(mut self, dataset: Option<&Path>) -> Self {
        let files = dataset.into_iter().flat_map(dataset_files);
        self.inputs.extend(files.map(|path| FileId::of(&path)));
        self
    }

    /// Adds an input.
    pub(super) fn add_input(&mut self, path: &Path) {
        self.inputs.insert(FileId::of(path));
    }

    /// A file that later outputs may replace, although it is read.
    pub(super) fn remove_input(&mut self, path: &Path) {
        self.inputs.remove(&FileId::of(path));
    }

    /// A folder of pictures, made if missing; it must not be that of the photos.
    pub(super) fn plan_folder(&mut self, option: &'static str, folder: &Path) -> Result<()> {
        self.make_folder(folder)?;
        self.lock_folder(folder)?;
        // Its pictures have names of this length.
        AtomicFile::create(&folder.join("step-000000.png")).map(drop)?;
        self.folders.push((option, folder.to_owned()));
        Ok(())
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

    /// Whether later outputs may replace existing files.
    pub(super) fn replacing(&mut self, replace: bool) {
        self.replace = replace;
    }

    /// Plans to write `path`, named by `option`.
    ///
    /// Errors: a folder, a path without a folder, a file that is read or written already, an existing file.
    pub(super) fn plan(&mut self, option: &'static str, path: &Path) -> Result<()> {
        let refuse = |wants: String| Err(Error::invalid(option, path.display(), wants));
        let (meta, id) = (std::fs::metadata(path).ok(), FileId::of(path));
        if meta.as_ref().is_some_and(std::fs::Metadata::is_dir) {
            return refuse("a file name; this is a folder".into());
        }
        if self.inputs.contains(&id) {
            return refuse("a file that is not also an input".into());
        }
        if self.photos.contains(&id) {
            return refuse("a file that is not also a photo".into());
        }
        // A device may take several outputs.
        let device = path.as_os_str() != "-" && meta.as_ref().is_some_and(|meta| !meta.is_file());
        if let Some(other) = self.options.get(&id).filter(|_| !device) {
            return refuse(format!("a file that {other} does not write too"));
        }
        if !is_stream(path) && !folder(&resolved(path)).is_dir() {
            return refuse("a file in a folder that exists".into());
        }
        let is_new = !self.replace && path.as_os_str() != "-" && !device;
        self.options.insert(id.clone(), option);
        let planned = Planned { option, path: path.to_owned(), id, is_new };
        planned.check_new()?;
        self.planned.push(planned);
        Ok(())
    }

    /// Plans to write `path` and starts it, so that no other program does.
    pub(super) fn claim(&mut self, option: &'static str, path: &Path) -> Result<()> {
        self.plan(option, path)?;
        self.files.push(AtomicFile::create(path)?);
        self.confirm()
    }

    /// Plans and starts files that belong together; the one that names the others comes last.
    pub(super) fn claim_set(&mut self, files: &[(&'static str, &PathBuf)]) -> Result<Vec<AtomicFile>> {
        files.iter().try_for_each(|(option, path)| self.plan(option, path))?;
        let paths: Vec<&Path> = files.iter().map(|(_, path)| path.as_path()).collect();
        let set = AtomicFile::create_all(&paths)?;
        self.confirm()?;
        Ok(set)
    }

    /// Plans to write `path` repeatedly; fails if it cannot be written.
    pub(super) fn probe(&mut self, option: &'static str, path: &Path) -> Result<()> {
        self.plan(option, path)?;
        AtomicFile::create(path).map(drop)
    }

    /// Fails if another program wrote a planned file before it was started.
    pub(super) fn confirm(&self) -> Result<()> {
        self.planned.iter().try_for_each(Planned::check_new)
    }

    /// Fails if a planned file, now or later, is a photo of `dataset`.
    pub(super) fn spare_photos(&mut self, dataset: &Dataset) -> Result<()> {
        let photos = dataset.views.iter().flat_map(|v| std::iter::once(&v.photo.path).chain(&v.photo.mask));
        self.photos.extend(photos.filter(|path| !path.as_os_str().is_empty()).map(|path| FileId::of(path)));
        let of_photos: HashSet<FileId> =
            dataset.views.iter().filter_map(|view| view.photo.path.parent()).map(FileId::of).collect();
        if let Some((option, path)) =
            self.folders.iter().find(|(_, path)| of_photos.contains(&FileId::of(path)))
        {
            return Err(Error::invalid(*option, path.display(), "a folder that does not hold the photos"));
        }
        match self.planned.iter().find(|planned| self.photos.contains(&planned.id)) {
            Some(Planned { option, path, .. }) => {
                Err(Error::invalid(*option, path.display(), "a file that is not also a photo"))
            }
            None => Ok(()),
        }
    }

    /// The started file of a path that was claimed.
    pub(super) fn take(&mut self, path: &Path) -> Result<AtomicFile> {
        match self.files.iter().position(|file| file.path() == path) {
            Some(at) => Ok(self.files.swap_remove(at)),
            None => AtomicFile::create(path),
        }
    }
}

impl Planned {
    fn check_new(&self) -> Result<()> {
        match self.is_new && self.path.exists() {
            true => {
                Err(Error::invalid(self.option, self.path.display(), "a new file, or --force to replace it"))
            }
            false => Ok(()),
        }
    }
}

/// Identity of a file: equal for all names and links, whether it exists or not.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum FileId {
    /// Device and number of an existing file.
    #[cfg(unix)]
    Number(u64, u64),
    /// The full name of a missing file, or on systems without file numbers.
    Name(PathBuf),
}

impl FileId {
    fn of(path: &Path) -> Self {
        let path = resolved(path);
        #[cfg(unix)]
        if let Ok(meta) = std::fs::metadata(&path) {
            use std::os::unix::fs::MetadataExt;
            return Self::Number(meta.dev(), meta.ino());
        }
        if let Ok(full) = std::fs::canonicalize(&path) {
            return Self::Name(full);
        }
        let name = path.file_name().unwrap_or_default().to_owned();
        // Names that differ only in case are one file on most disks of these systems.
        let name = match cfg!(any(windows, target_os = "macos")) {
            true => name.to_string_lossy().to_lowercase().into(),
            false => name,
        };
        let folder = folder(&path);
        Self::Name(std::fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned()).join(name))
    }
}

fn is_stream(path: &Path) -> bool {
    path.as_os_str() == "-" || std::fs::metadata(path).is_ok_and(|meta| !meta.is_file() && !meta.is_dir())
}

fn folder(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The pose files of the data set at `path`.
fn dataset_files(path: &Path) -> Vec<PathBuf> {
    let root = if path.is_dir() { path } else { folder(path) };
    let is_one = |name: &str| DATASET_FILES.iter().any(|start| name.starts_with(start));
    let mut files = vec![path.to_owned()];
    for folder in DATASET_FOLDERS {
        let Ok(entries) = std::fs::read_dir(root.join(folder)) else { continue };
        let found = entries.flatten().filter(|entry| entry.file_name().to_str().is_some_and(is_one));
        files.extend(found.map(|entry| entry.path()));
    }
    // The cloud of a transforms.json may have any name.
    let jsons = files.iter().filter(|path| path.extension().is_some_and(|ending| ending == "json"));
    let cloud = |path: &PathBuf| -> Option<PathBuf> {
        let value: serde_json::Value = serde_json::from_slice(&std::fs::read(path).ok()?).ok()?;
        Some(root.join(value.get("ply_file_path")?.as_str()?))
    };
    let clouds: Vec<PathBuf> = jsons.filter_map(cloud).collect();
    files.extend(clouds);
    files
}
