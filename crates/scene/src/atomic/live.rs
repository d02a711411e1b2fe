//! The temporary files of this process.

use super::names::is_aside_folder;
use std::cmp::Reverse;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

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

/// Removes every temporary file of this process and keeps files from getting names: for a process that is about to end
/// without dropping its values. It must end then.
pub fn remove_temporaries() {
    let mut list = list();
    // Files of a folder are removed before the folder.
    list.sort_by_key(|path| Reverse(path.components().count()));
    for path in list.drain(..) {
        // The next run removes the rest.
        let _ = match is_aside_folder(&path) {
            true => std::fs::remove_dir_all(&path),
            // An empty folder that was made for an output.
            false => std::fs::remove_file(&path).or_else(|_| std::fs::remove_dir(&path)),
        };
    }
    std::mem::forget(list);
}
