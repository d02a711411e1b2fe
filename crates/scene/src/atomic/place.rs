//! Files get their names: all of a set, or none.
//!
//! A single file takes its name by a rename, which is atomic. If several replace others, the old ones are
//! moved aside first, beginning with the file that names the others. So no reader finds an old file beside a
//! new one. The new ones follow in order, with the naming file last. An error puts the old ones back. After a
//! kill, the next run with these names does so: the last temporary file exists if and only if the set was
//! incomplete.

use super::live;
use super::names::{aside_name, resolved, temporary_name};
use super::temporary::Temporary;
use crate::error::{Error, Result};
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

/// True when a temporary file of `last`, the naming file of a set, exists.
pub(super) fn was_interrupted(last: &Path) -> bool {
    temporary_name(&resolved(last)).exists()
}

/// Puts back old files of `paths` that a killed process moved aside, or removes them if all new ones are in
/// place.
pub(super) fn recover(paths: &[&Path], interrupted: bool) -> io::Result<()> {
    for path in paths {
        let target = resolved(path);
        let aside = aside_name(&target);
        if aside.exists() {
            match interrupted {
                true => std::fs::rename(&aside, &target)?,
                false => std::fs::remove_file(&aside)?,
            }
        }
    }
    Ok(())
}

/// Gives files that belong together the names of their targets, in this order, ending with the one that names
/// the others. Each comes with the user's path, for messages.
pub(super) fn place(mut set: Vec<(PathBuf, BufWriter<Temporary>)>) -> Result<()> {
    let mut set: Vec<(&Path, &mut Temporary)> =
        set.iter_mut().map(|(path, file)| (path.as_path(), file.get_mut())).collect();
    // Locked while files get their names: a signal waits.
    let mut list = live::list();
    for (path, file) in &set {
        if file.is_new && file.target.exists() {
            return Err(Error::io(path, appeared()));
        }
    }
    match &mut set[..] {
        [] => {}
        [(path, only)] => std::fs::rename(&only.path, &only.target).map_err(|e| Error::io(path, e))?,
        several => replace(several)?,
    }
    for (_, file) in &mut set {
        file.published = true;
        live::forget(&mut list, &file.path);
        file.named.iter().for_each(|path| live::forget(&mut list, path));
    }
    drop(list);
    sync_folders(&set)
}

fn appeared() -> io::Error {
    io::Error::new(
        io::ErrorKind::AlreadyExists,
        "was written by another program since this one began; it was left as it is",
    )
}

/// Moves old files aside and new ones in, or everything back.
fn replace(set: &mut [(&Path, &mut Temporary)]) -> Result<()> {
    let (mut aside, mut placed) = (Vec::new(), Vec::new());
    let replaced = (|| {
        for (path, file) in set.iter().rev().filter(|(_, file)| file.target.exists()) {
            let name = aside_name(&file.target);
            std::fs::rename(&file.target, &name).map_err(|e| Error::io(path, e))?;
            aside.push((name, file.target.clone()));
        }
        for (path, file) in set.iter() {
            std::fs::rename(&file.path, &file.target).map_err(|e| Error::io(path, e))?;
            placed.push(file.target.clone());
        }
        Ok(())
    })();
    if replaced.is_err() {
        // Best effort: each name gets its old file back, or none.
        for target in &placed {
            let _ = std::fs::remove_file(target);
        }
        for (name, target) in aside.iter().rev() {
            let _ = std::fs::rename(name, target);
        }
        return replaced;
    }
    for (name, _) in &aside {
        // The next run removes it.
        let _ = std::fs::remove_file(name);
    }
    Ok(())
}

/// Waits until the names are on the disk.
#[cfg(unix)]
fn sync_folders(set: &[(&Path, &mut Temporary)]) -> Result<()> {
    let mut synced: Vec<&Path> = Vec::new();
    for (path, file) in set {
        let folder = file.target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if synced.contains(&folder) {
            continue;
        }
        synced.push(folder);
        // A folder that is writable but not readable cannot be opened.
        let Ok(open) = std::fs::File::open(folder) else { continue };
        match open.sync_all() {
            // Some file systems do not support this for folders.
            Err(e) if !matches!(e.kind(), io::ErrorKind::InvalidInput | io::ErrorKind::Unsupported) => {
                return Err(Error::io(path, e));
            }
            _ => {}
        }
    }
    Ok(())
}

/// Only Unix lets a program sync a folder; elsewhere the file system's journal keeps the order.
#[cfg(not(unix))]
fn sync_folders(_: &[(&Path, &mut Temporary)]) -> Result<()> {
    Ok(())
}
