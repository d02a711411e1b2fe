//! What the files of an output are called while it is written.

use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::xxh3_64;

/// Names of files may be so long everywhere, bytes.
const MAX_NAME_BYTES: usize = 255;
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

/// Where `path` leads when its last part is a symbolic link, to a file that may not be there yet.
pub fn resolved(path: &Path) -> PathBuf {
    let mut path = path.to_owned();
    for _ in 0..MAX_LINKS {
        let Ok(to) = std::fs::read_link(&path) else { break };
        path = path.parent().unwrap_or(Path::new("")).join(to);
    }
    path
}
