//! The last checkpoints of a run: one file, or several; the oldest is removed when a new one is whole.

use super::checkpoint::{self, Checkpoint};
use std::path::{Path, PathBuf};
use trisplat_scene::{Error, Result};

/// Endings of checkpoints in a folder.
const ENDING: &str = "checkpoint";
/// Precedes the number of steps in the name of one of several checkpoints.
const STEP: &str = ".step-";

/// Writes `checkpoint` to `path`. With `keep` above 1, it writes files with the number of steps in their
/// names, and keeps the last `keep`. Returns the name of the file.
///
/// Errors: what the operating system refuses.
pub fn write(path: &Path, checkpoint: &Checkpoint, keep: u32) -> Result<PathBuf> {
    if keep <= 1 {
        return checkpoint::write(path, checkpoint).map(|()| path.to_owned());
    }
    let newest = of_step(path, checkpoint.meta.step);
    checkpoint::write(&newest, checkpoint)?;
    // Files of later steps come from before this run resumed at an earlier one, so they are older.
    let mut kept = kept(path);
    kept.sort_by_key(|(step, _)| (*step <= checkpoint.meta.step, *step));
    let surplus = kept.len().saturating_sub(keep as usize);
    for (_, old) in &kept[..surplus] {
        std::fs::remove_file(old).map_err(|e| Error::io(old, e))?;
    }
    Ok(newest)
}

/// The file of the checkpoint after `step` steps: `scene.step-00000500.checkpoint`.
pub fn of_step(path: &Path, step: u64) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let ending = path.extension().unwrap_or(ENDING.as_ref()).to_string_lossy();
    path.with_file_name(format!("{stem}{STEP}{step:08}.{ending}"))
}

/// Steps and names of the numbered checkpoints of `path`.
pub fn kept(path: &Path) -> Vec<(u64, PathBuf)> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let step = |found: PathBuf| {
        let digits = found.file_stem()?.to_str()?.rsplit_once(STEP)?.1.to_owned();
        let step = digits.parse().ok()?;
        (of_step(path, step).file_name() == found.file_name()).then_some((step, found))
    };
    entries.filter_map(|entry| step(entry.path())).collect()
}

/// The newest whole checkpoint of a folder, and the faults of newer ones.
///
/// Errors: no checkpoint at all; none that is whole.
pub fn newest(folder: &Path) -> Result<(PathBuf, Checkpoint, Vec<String>)> {
    let entries = std::fs::read_dir(folder).map_err(|e| Error::io(folder, e))?;
    let mut files: Vec<(std::time::SystemTime, PathBuf)> = entries
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.is_file() && path.extension().is_some_and(|ending| ending == ENDING))
        .filter_map(|path| Some((path.metadata().and_then(|meta| meta.modified()).ok()?, path)))
        .collect();
    files.sort();
    let mut broken = Vec::new();
    for (_, path) in files.into_iter().rev() {
        match checkpoint::read(&path) {
            Ok(checkpoint) => return Ok((path, checkpoint, broken)),
            Err(error) => broken.push(error.to_string()),
        }
    }
    let reason = match broken.is_empty() {
        true => "holds no file that ends with .checkpoint; give the file of a checkpoint".to_owned(),
        false => format!("holds no whole checkpoint: {}", broken.join("; ")),
    };
    Err(Error::unsupported(folder, reason))
}
