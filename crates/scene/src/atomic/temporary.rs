//! The temporary file of a target: one name, one owner.

use super::live;
use super::made::MadeFolders;
use super::names::{aside_name, temporary_name};
use std::fs::{File, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Number of tries, because others may sweep the same name at the same time.
const TRIES: usize = 16;

/// A file beside its target that is removed on drop, unless it took the target's name.
#[derive(Debug)]
pub(super) struct Temporary {
    file: File,
    pub(super) path: PathBuf,
    pub(super) target: PathBuf,
    /// No file had the target's name when this one was started.
    pub(super) is_new: bool,
    pub(super) published: bool,
    /// Existing files that only this one names; they are removed with it.
    pub(super) named: Vec<PathBuf>,
    /// New folders for those; dropped after them.
    pub(super) folders: Vec<MadeFolders>,
}

impl Temporary {
    /// Starts the file of `target`, and removes that of a killed process.
    pub(super) fn create(target: &Path) -> io::Result<Self> {
        let path = temporary_name(target);
        for _ in 0..TRIES {
            match File::options().write(true).create_new(true).open(&path) {
                Ok(file) if lock(&file) && is_at(&file, &path) => {
                    live::register(&path);
                    // An older one that was moved aside counts, because it is put back.
                    let is_new = !target.exists() && !aside_name(target).exists();
                    let target = target.to_owned();
                    return Ok(Self {
                        file,
                        path,
                        target,
                        is_new,
                        published: false,
                        named: vec![],
                        folders: vec![],
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
    pub(super) fn sync(&self) -> io::Result<()> {
        self.file.sync_all()
    }
}

impl Write for Temporary {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        self.file.write(buf)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        let unnamed: &[PathBuf] = if self.published { &[] } else { &self.named };
        for path in unnamed {
            // The next run removes the rest.
            let _ = std::fs::remove_file(path);
            live::unregister(path);
        }
        if !self.published {
            let _ = std::fs::remove_file(&self.path);
        }
        live::unregister(&self.path);
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
