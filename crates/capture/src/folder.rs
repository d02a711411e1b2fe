//! The folder in which a run works. A new capture is made in place. One that replaces a capture of other inputs is made inside of
//! it, in `capture/next`, and takes its place when it is whole.

use super::stored::{self, FILES, StoredPhotos, WORK, place};
use std::path::{Path, PathBuf};
use trisplat_scene::{
    Error, Result,
    atomic::{self, AtomicFolder, FolderLock, Manifest},
    input,
};

/// Files of a model.
const MODEL_FILES: [&str; 5] = ["cameras", "images", "points3D", "rigs", "frames"];
/// What the pose program and the steps that need it write.
const POSE_FILES: [&str; 8] = [
    "capture/steps.json",
    "capture/poses.log",
    "capture/poses.lock",
    "capture/pairs.txt",
    "capture/database.db",
    "capture/database.db-shm",
    "capture/database.db-wal",
    "capture/models/",
];

/// A capture's folder.
#[derive(Debug)]
pub(super) struct CaptureFolder {
    /// Where this run works.
    pub(super) path: PathBuf,
    /// Its files.
    pub(super) manifest: Manifest,
    /// The folder of the job.
    target: PathBuf,
}

impl CaptureFolder {
    /// The folder for photos of `key` in the job's folder `target`.
    ///
    /// Errors: a folder that holds another capture, unless `force`, or something else; files of the user's among those to be
    /// replaced.
    pub(super) fn choose(target: &Path, key: &str, force: bool) -> Result<Self> {
        AtomicFolder::recover(target)?;
        let next = place(target, "next");
        let before: Option<StoredPhotos> = stored::read(&place(target, "photos.json"))?;
        match before {
            Some(before) if before.key != key && force => {
                Manifest::read(target, FILES)?.check_all()?;
                AtomicFolder::recover(&next)?;
                let begun: Option<StoredPhotos> = stored::read(&place(&next, "photos.json"))?;
                if begun.is_none_or(|begun| begun.key != key) {
                    clear(&next)?;
                }
                Self::open(next, target)
            }
            Some(before) if before.key != key => {
                let wants = "a new folder, as this one holds the capture of other inputs; or `force`, to replace that";
                Err(Error::invalid("output", target.display(), wants))
            }
            None if holds_something(target) => {
                Err(Error::invalid("output", target.display(), "a new or empty folder"))
            }
            _ => {
                clear(&next)?;
                Self::open(target.to_owned(), target)
            }
        }
    }

    fn open(path: PathBuf, target: &Path) -> Result<Self> {
        let manifest = Manifest::read(&path, FILES)?;
        Ok(Self { path, manifest, target: target.to_owned() })
    }

    /// Its photos, if all are there.
    pub(super) fn photos(&self) -> Result<Option<StoredPhotos>> {
        let photos: Option<StoredPhotos> = stored::read(&place(&self.path, "photos.json"))?;
        let is_there = |name: &String| self.path.join("images").join(name).is_file();
        Ok(photos.filter(|photos| photos.photos.iter().all(|photo| is_there(&photo.name))))
    }

    /// Starts files that will be published together.
    pub(super) fn make(&self) -> Result<AtomicFolder> {
        AtomicFolder::create(&self.path)
    }

    /// Enters what the pose program will write.
    ///
    /// Errors: files of the user's among these, or where the model will be.
    pub(super) fn begin_poses(&mut self) -> Result<()> {
        model_files().try_for_each(|name| self.manifest.check(&format!("sparse/0/{name}")))?;
        self.manifest.begin(&POSE_FILES)
    }

    /// Removes the pose program's database.
    pub(super) fn remove_database(&self) -> Result<()> {
        POSE_FILES.iter().filter(|name| name.contains("database")).try_for_each(|name| {
            let path = self.path.join(name);
            match std::fs::remove_file(&path) {
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::io(&path, e)),
                _ => Ok(()),
            }
        })
    }

    /// Publishes the model in `from`.
    pub(super) fn publish_model(&mut self, from: &Path) -> Result<()> {
        let made = self.make()?;
        let sparse = made.path().join("sparse").join("0");
        std::fs::create_dir_all(&sparse).map_err(|e| Error::io(&sparse, e))?;
        for name in model_files() {
            let from = from.join(&name);
            if from.is_file() {
                input::copy(&from, &sparse.join(name))?;
            }
        }
        let state = made.path().join(WORK);
        std::fs::create_dir_all(&state).map_err(|e| Error::io(&state, e))?;
        self.manifest.publish(made, "sparse/", "sparse/0/images")
    }

    /// Puts a whole capture that was made in `capture/next` in the place of the old one.
    pub(super) fn take_place(&mut self) -> Result<()> {
        if self.path == self.target {
            return Ok(());
        }
        self.manifest.finish()?;
        let mut whole = Self::open(self.target.clone(), &self.target)?;
        let made = whole.make()?;
        for name in self.manifest.names() {
            let (from, to) = (self.path.join(name), made.path().join(name));
            if from.is_file() {
                let folder = to.parent().unwrap_or(&to);
                std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
                // Not every file system has links.
                if std::fs::hard_link(&from, &to).is_err() {
                    input::copy(&from, &to)?;
                }
            }
        }
        whole.manifest.publish(made, "", WORK)?;
        clear(&self.path)?;
        *self = whole;
        Ok(())
    }
}

/// Names of the files that a model may have.
fn model_files() -> impl Iterator<Item = String> {
    MODEL_FILES.iter().flat_map(|name| ["bin", "txt"].map(|ending| format!("{name}.{ending}")))
}

/// Removes the capture in `folder`, which may be missing. Files of the user's stay.
fn clear(folder: &Path) -> Result<()> {
    if !folder.exists() {
        return Ok(());
    }
    AtomicFolder::recover(folder)?;
    let lock = FolderLock::take(folder)?;
    Manifest::read(folder, FILES)?.clear()?;
    drop(lock);
    atomic::remove_empty_folders(folder);
    Ok(())
}

/// True for a folder with more than what killed runs leave.
fn holds_something(folder: &Path) -> bool {
    let counts = |entry: std::io::Result<std::fs::DirEntry>| {
        entry.is_ok_and(|entry| !atomic::is_leftover(&entry.file_name().to_string_lossy()))
    };
    std::fs::read_dir(folder).is_ok_and(|mut entries| entries.any(counts))
}
