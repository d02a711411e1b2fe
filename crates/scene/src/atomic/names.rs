//! Names of an output's files during writing.

use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::xxh3_64;

/// Longest file name that works everywhere, bytes.
const MAX_NAME_BYTES: usize = 255;
/// See [`aside_folder`].
const ASIDE_FOLDER: &str = ".folder.trisplat.new";
/// Most links to follow, as on Linux.
const MAX_LINKS: usize = 40;

/// The temporary file of `target`: `.NAME.trisplat.tmp` beside it.
pub fn temporary_name(target: &Path) -> PathBuf {
    beside(target, "tmp")
}

/// The name of the replaced file of `target` while its set is published.
pub(super) fn aside_name(target: &Path) -> PathBuf {
    beside(target, "old")
}

/// The inner folder of `folder` for making its files.
pub(super) fn aside_folder(folder: &Path) -> PathBuf {
    folder.join(ASIDE_FOLDER)
}

pub(super) fn is_aside_folder(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name == ASIDE_FOLDER)
}

/// The lock file of a folder's writer.
pub(super) fn folder_lock(folder: &Path) -> PathBuf {
    folder.join("folder")
}

/// The name of a temporary file's target.
pub(super) fn target_of_temporary(name: &str) -> Option<&str> {
    name.strip_prefix('.')?.strip_suffix(".trisplat.tmp")
}

/// True for names that only this program gives, and a killed run leaves.
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

/// The target of `path` if its last part is a symbolic link; the target may not exist yet.
pub fn resolved(path: &Path) -> PathBuf {
    let mut path = path.to_owned();
    for _ in 0..MAX_LINKS {
        let Ok(to) = std::fs::read_link(&path) else { break };
        path = path.parent().unwrap_or(Path::new("")).join(to);
    }
    path
}
