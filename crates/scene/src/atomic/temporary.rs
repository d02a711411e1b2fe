//! Temporary files, one for each target, and new folders: this process removes them again unless
//! they are kept.

use super::names::{ASIDE, temporary_name};
use crate::error::{Error, Result};
use std::cmp::Reverse;
use std::fs::{File, TryLockError};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Size of a write buffer, bytes: large enough that most writes are only copies.
pub(super) const BUFFER_BYTES: usize = 1 << 20;

/// Maximum number of tries, because others may sweep the same name at the same time.
const MAX_TRIES: usize = 16;

/// A file beside its target that is removed on drop, unless it took the target's name.
#[derive(Debug)]
pub(super) struct Temporary {
    pub(super) file: BufWriter<File>,
    pub(super) path: PathBuf,
    pub(super) target: PathBuf,
    /// No file had the target's name when this one was started.
    pub(super) is_new: bool,
    pub(super) published: bool,
    /// Existing files that only this one names; they are removed with it.
    pub(super) named_files: Vec<PathBuf>,
    /// New folders for those; dropped after them.
    pub(super) folders: Vec<MadeFolders>,
}

impl Temporary {
    /// Starts the file of `target`, and removes the one of a killed process.
    pub(super) fn create(target: &Path) -> io::Result<Self> {
        let path = temporary_name(target);
        for _ in 0..MAX_TRIES {
            // Locked until the file is registered: a signal comes before it exists, or removes it.
            let mut list = list();
            match File::options().write(true).create_new(true).open(&path) {
                Ok(file) if lock(&file) && is_at(&file, &path) => {
                    list.push(path.clone());
                    let file = BufWriter::with_capacity(BUFFER_BYTES, file);
                    return Ok(Self {
                        file,
                        path,
                        target: target.to_owned(),
                        is_new: !target.exists(),
                        published: false,
                        named_files: Vec::new(),
                        folders: Vec::new(),
                    });
                }
                // Another process removed it before it was locked.
                Ok(_) => {}
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => sweep(&path)?,
                Err(e) => return Err(e),
            }
        }
        Err(busy())
    }

    /// Waits until every byte is on the disk.
    pub(super) fn sync(&mut self) -> io::Result<()> {
        self.file.flush()?;
        self.file.get_ref().sync_all()
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        let unnamed: &[PathBuf] = if self.published { &[] } else { &self.named_files };
        for path in unnamed {
            // The next run removes the rest.
            let _ = std::fs::remove_file(path);
            unregister(path);
        }
        if !self.published {
            let _ = std::fs::remove_file(&self.path);
        }
        unregister(&self.path);
    }
}

/// Removes a temporary file without a writer.
pub(super) fn sweep(path: &Path) -> io::Result<()> {
    let left = match File::options().read(true).write(true).open(path) {
        Ok(file) => file,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(e) => return Err(e),
    };
    if !lock(&left) {
        return Err(busy());
    }
    if is_at(&left, path) {
        std::fs::remove_file(path)?;
    }
    Ok(())
}

fn busy() -> io::Error {
    io::Error::new(
        io::ErrorKind::ResourceBusy,
        "another program is writing this file; wait for it, or give another name",
    )
}

/// False when another process has the file; true on systems without locks.
fn lock(file: &File) -> bool {
    !matches!(file.try_lock(), Err(TryLockError::WouldBlock))
}

/// True when the file still has the name under which it was opened.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    match (file.metadata(), std::fs::symlink_metadata(path)) {
        (Ok(a), Ok(b)) => (a.dev(), a.ino()) == (b.dev(), b.ino()),
        _ => false,
    }
}

#[cfg(not(unix))]
fn is_at(_: &File, path: &Path) -> bool {
    path.exists()
}

/// The temporary files of this process. Locked while files get their names, so that a signal cannot
/// interrupt.
static TEMPORARY: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

pub(super) fn list() -> MutexGuard<'static, Vec<PathBuf>> {
    TEMPORARY.lock().unwrap_or_else(PoisonError::into_inner)
}

pub(super) fn register(path: &Path) {
    list().push(path.to_owned());
}

pub(super) fn unregister(path: &Path) {
    forget(&mut list(), path);
}

pub(super) fn forget(list: &mut Vec<PathBuf>, path: &Path) {
    if let Some(at) = list.iter().position(|one| one == path) {
        list.swap_remove(at);
    }
}

/// Removes every temporary file of this process and keeps files from getting names: for a process
/// that is about to end without dropping its values. It must end then.
pub fn remove_temporaries() {
    let mut list = list();
    // Files of a folder are removed before the folder.
    list.sort_by_key(|path| Reverse(path.components().count()));
    for path in list.drain(..) {
        // The next run removes the rest.
        let _ = if path.ends_with(ASIDE) {
            std::fs::remove_dir_all(&path)
        } else {
            // An empty folder that was made for an output.
            std::fs::remove_file(&path).or_else(|_| std::fs::remove_dir(&path))
        };
    }
    std::mem::forget(list);
}

/// New folders: on drop, empty ones are removed.
#[derive(Debug)]
pub struct MadeFolders {
    /// Inner folders first.
    folders: Vec<PathBuf>,
}

impl MadeFolders {
    /// Makes `folder` and its parents if missing.
    ///
    /// # Errors
    ///
    /// Errors of the operating system.
    pub fn make(folder: &Path) -> Result<Self> {
        let missing =
            folder.ancestors().take_while(|path| !path.as_os_str().is_empty() && !path.exists());
        let made = Self { folders: missing.map(Path::to_owned).collect() };
        std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
        for path in &made.folders {
            register(path);
        }
        Ok(made)
    }
}

impl Drop for MadeFolders {
    fn drop(&mut self) {
        for folder in &self.folders {
            // Fails if it is not empty.
            let _ = std::fs::remove_dir(folder);
            unregister(folder);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signal_finds_every_temporary_file_that_exists() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("a.glb");
        // As a process that is about to end.
        let ending = list();
        let made = std::thread::scope(|scope| {
            let writer = scope.spawn(|| Temporary::create(&target).unwrap());
            std::thread::sleep(std::time::Duration::from_millis(200));
            assert!(!temporary_name(&target).exists(), "it would be left behind");
            drop(ending);
            writer.join().unwrap()
        });
        assert!(list().contains(&made.path) && made.path.exists());
    }

    #[test]
    fn a_folder_in_which_nothing_came_to_be_goes_again() {
        let parent = tempfile::tempdir().unwrap();
        let old = parent.path().join("old");
        let new = parent.path().join("new");
        std::fs::create_dir(&old).unwrap();
        drop([MadeFolders::make(&old).unwrap(), MadeFolders::make(&new.join("a/b")).unwrap()]);
        assert!(old.exists() && !new.exists(), "what was there stays");
        let made = MadeFolders::make(&new.join("a/b")).unwrap();
        std::fs::write(new.join("a/file"), "").unwrap();
        drop(made);
        assert!(new.join("a/file").exists() && !new.join("a/b").exists());
    }
}
