//! What the files of an output are called while it is written.

use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::xxh3_64;

/// Names of files may be so long everywhere, bytes.
const MAX_NAME_BYTES: usize = 255;
/// See [`aside_folder`].
const ASIDE_FOLDER: &str = ".folder.trisplat.new";
/// Links that are followed, as many as Linux follows.
const MAX_LINKS: usize = 40;

/// The temporary file of `target`: `.NAME.trisplat.tmp` beside it.
pub fn temporary_name(target: &Path) -> PathBuf {
    beside(target, "tmp")
}

/// Where the file that `target` replaces is while its set is published.
pub(super) fn aside_name(target: &Path) -> PathBuf {
    beside(target, "old")
}

/// The folder inside `folder` in which its files are made.
pub(super) fn aside_folder(folder: &Path) -> PathBuf {
    folder.join(ASIDE_FOLDER)
}

pub(super) fn is_aside_folder(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name == ASIDE_FOLDER)
}

/// The file whose lock a folder's writer holds.
pub(super) fn folder_lock(folder: &Path) -> PathBuf {
    folder.join("folder")
}

/// The name of the target of a temporary file of this name.
pub(super) fn target_of_temporary(name: &str) -> Option<&str> {
    name.strip_prefix('.')?.strip_suffix(".trisplat.tmp")
}

/// True of names that only a writer of this program gives, and a killed one leaves.
pub fn is_leftover(name: &str) -> bool {
    name.starts_with('.')
        && [".trisplat.tmp", ".trisplat.old", ".trisplat.new"].iter().any(|end| name.ends_with(end))
}

/// `.NAME.trisplat.ENDING` beside `target`; a name too long for that is replaced by its hash.
fn beside(target: &Path, ending: &str) -> PathBuf {
    let name = target.file_name().unwrap_or_default();
    let ending = format!(".trisplat.{ending}");
    let mut whole = std::ffi::OsString::from(".");
    match name.len() + 1 + ending.len() <= MAX_NAME_BYTES {
        true => whole.push(name),
        false => whole.push(format!("{:016x}", xxh3_64(name.as_encoded_bytes()))),
    }
    whole.push(ending);
    target.with_file_name(whole)
}

/// Where `path` leads when its last part is a symbolic link, to a file that need not exist yet.
pub fn resolved(path: &Path) -> PathBuf {
    let mut path = path.to_owned();
    for _ in 0..MAX_LINKS {
        let Ok(to) = std::fs::read_link(&path) else { break };
        path = path.parent().unwrap_or(Path::new("")).join(to);
    }
    path
}
