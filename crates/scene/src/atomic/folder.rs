//! Folders of files that belong together, too many to be open at once.
//!
//! They are made in an inner folder, `.folder.trisplat.new`, and moved to their places when all are
//! on the disk. Old files are moved into it first, and an error puts them back. From when its part
//! `new` is called `whole`, the next run finishes what a killed run began.

use super::names::{ASIDE, folder_of};
use super::temporary::{MadeFolders, Temporary, forget, list, register, unregister};
use super::{Move, replace, sync_folder};
use crate::error::{Error, Result};
use std::collections::VecDeque;
use std::fs::File;
use std::io;
use std::path::{Component, Path, PathBuf};

/// Keeps others from writing into a folder while it is held.
#[derive(Debug)]
pub struct FolderLock(#[expect(dead_code, reason = "held until it is dropped")] Temporary);

impl FolderLock {
    /// Of an existing folder.
    ///
    /// # Errors
    ///
    /// Another program that writes into it; errors of the operating system.
    pub fn take(folder: &Path) -> Result<Self> {
        let busy = |e: io::Error| match e.kind() {
            io::ErrorKind::ResourceBusy => io::Error::new(
                io::ErrorKind::ResourceBusy,
                "another program is writing into this folder; wait for it, or give another folder",
            ),
            _ => e,
        };
        Temporary::create(&folder.join("folder")).map(Self).map_err(|e| Error::io(folder, busy(e)))
    }
}

/// A folder under construction. Files of other names in it are left alone; dropping it leaves the
/// folder unchanged.
#[derive(Debug)]
pub struct AtomicFolder {
    folder: PathBuf,
    aside: PathBuf,
    new: PathBuf,
    lock: Option<FolderLock>,
    /// New folders. Dropped after the lock, which is inside.
    _made: MadeFolders,
}

impl AtomicFolder {
    /// Starts the files of `folder`, which is made if missing. What a killed process was moving in
    /// is moved in.
    ///
    /// # Errors
    ///
    /// Another program that writes into it; errors of the operating system.
    pub fn create(folder: &Path) -> Result<Self> {
        let io = |e| Error::io(folder, e);
        let made = MadeFolders::make(folder)?;
        let lock = FolderLock::take(folder)?;
        let aside = folder.join(ASIDE);
        if aside.exists() {
            move_in(folder, &aside, "")?;
            std::fs::remove_dir_all(&aside).map_err(io)?;
        }
        register(&aside);
        let new = aside.join("new");
        let this = Self { folder: folder.to_owned(), aside, new, lock: Some(lock), _made: made };
        std::fs::create_dir_all(&this.new).map_err(io)?;
        Ok(this)
    }

    /// Finishes the moves that a killed process left half done in `folder`.
    ///
    /// # Errors
    ///
    /// As for [`AtomicFolder::create`].
    pub fn recover(folder: &Path) -> Result<()> {
        if folder.join(ASIDE).exists() { Self::create(folder).map(drop) } else { Ok(()) }
    }

    /// The folder where its files are made, under their final names.
    pub fn path(&self) -> &Path {
        &self.new
    }

    /// Make the folders for a file `name` of this folder. Return where it is to be written.
    ///
    /// # Errors
    /// A name that leads out of the folder; errors of the operating system.
    pub fn place(&self, name: impl AsRef<Path>) -> Result<PathBuf> {
        let name = name.as_ref();
        let is_inside = name.components().all(|part| matches!(part, Component::Normal(_)));
        if !is_inside || name.as_os_str().is_empty() {
            let reason = format!(
                "{name:?} leads out of this folder, where it would be written; rename the input that has this name"
            );
            return Err(Error::unsupported(&self.folder, reason));
        }
        let path = self.new.join(name);
        let parent = folder_of(&path);
        std::fs::create_dir_all(parent).map_err(|e| Error::io(parent, e))?;
        Ok(path)
    }

    /// Moves the files to their places when they are on the disk. Files whose name begins with
    /// `naming` name the others and come last. After an error each name has its old file.
    ///
    /// # Errors
    ///
    /// Errors of the operating system.
    pub fn publish(self, naming: &str) -> Result<()> {
        let io = |e| Error::io(&self.folder, e);
        let mut names = Vec::new();
        collect(&self.new, Path::new(""), &mut names).map_err(io)?;
        names.iter().try_for_each(|name| sync(&self.new.join(name))).map_err(io)?;
        std::fs::rename(&self.new, self.aside.join("whole")).map_err(io)?;
        let moved = move_in(&self.folder, &self.aside, naming);
        if moved.is_err() && holds_files(&self.aside.join("old")) {
            // They could not be put back, and the next run goes on.
            std::mem::forget(self);
            return moved;
        }
        moved?;
        sync_folder(&self.folder).map_err(io)
    }
}

impl Drop for AtomicFolder {
    fn drop(&mut self) {
        // Try again after a failure, because obstacles may be temporary. The next run removes the
        // rest.
        let remove = |_: io::Error| std::fs::remove_dir_all(&self.aside);
        let _ = std::fs::remove_dir_all(&self.aside).or_else(remove);
        unregister(&self.aside);
        self.lock = None;
    }
}

/// Names of all files below `folder`, relative to it.
fn collect(folder: &Path, below: &Path, names: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in std::fs::read_dir(folder.join(below))? {
        let entry = entry?;
        let name = below.join(entry.file_name());
        if entry.file_type()?.is_dir() { collect(folder, &name, names)? } else { names.push(name) }
    }
    Ok(())
}

fn sync(path: &Path) -> io::Result<()> {
    // Unix syncs files that are read-only, as copied photos may be; Windows only those that may be
    // written.
    File::options().read(true).write(cfg!(not(unix))).open(path)?.sync_all()
}

fn holds_files(folder: &Path) -> bool {
    let mut names = Vec::new();
    collect(folder, Path::new(""), &mut names).is_ok() && !names.is_empty()
}

/// Moves whole files to their places, names that begin with `naming` last, and the old files out of
/// them.
fn move_in(folder: &Path, aside: &Path, naming: &str) -> Result<()> {
    let whole = aside.join("whole");
    let old = aside.join("old");
    let mut names = Vec::new();
    if whole.exists() {
        collect(&whole, Path::new(""), &mut names).map_err(|e| Error::io(folder, e))?;
    }
    // A file that came after an old one was moved away is not ours.
    names.retain(|name| !(old.join(name).exists() && folder.join(name).exists()));
    names.sort();
    names.sort_by_key(|name| name.starts_with(naming));
    // The last first, because on drop those inside are to go first.
    let mut made = VecDeque::new();
    for inside in names.iter().flat_map(|name| [folder.join(name), old.join(name)]) {
        made.push_front(MadeFolders::make(inside.parent().unwrap_or(folder))?);
    }
    let to = |name: &PathBuf| Move {
        from: whole.join(name),
        target: folder.join(name),
        old: old.join(name),
    };
    let moves: Vec<Move> = names.iter().map(to).collect();
    // Locked while files get their names: a signal waits.
    let mut live = list();
    let moved = replace(&moves);
    if moved.is_err() && holds_files(&old) {
        forget(&mut live, aside);
    }
    drop(live);
    moved.map_err(|(at, error)| Error::io(&moves[at].target, error))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fill(made: &AtomicFolder, text: &str) {
        for name in ["images/a", "images/b", "list"] {
            std::fs::write(made.place(name).unwrap(), text).unwrap();
        }
    }

    fn found(folder: &Path) -> Vec<(PathBuf, String)> {
        let mut names = Vec::new();
        collect(folder, Path::new(""), &mut names).unwrap();
        names.sort();
        let text = |name: &PathBuf| std::fs::read_to_string(folder.join(name)).unwrap();
        names.iter().map(|name| (name.clone(), text(name))).collect()
    }

    fn all(text: &str) -> Vec<(PathBuf, String)> {
        ["images/a", "images/b", "list"].map(|name| (name.into(), text.into())).to_vec()
    }

    #[test]
    fn a_folder_appears_whole_or_not_at_all() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("set");
        let made = AtomicFolder::create(&folder).unwrap();
        fill(&made, "dropped");
        drop(made);
        assert!(!folder.exists());
        for text in ["new", "newer"] {
            let made = AtomicFolder::create(&folder).unwrap();
            fill(&made, text);
            made.publish("list").unwrap();
            assert_eq!(found(&folder), all(text));
        }
        let made = AtomicFolder::create(&folder).unwrap();
        fill(&made, "dropped");
        drop(made);
        assert_eq!(found(&folder), all("newer"));
    }

    #[test]
    fn a_file_outside_of_the_folder_is_refused() {
        let parent = tempfile::tempdir().unwrap();
        let made = AtomicFolder::create(&parent.path().join("set")).unwrap();
        for name in ["", "..", "../x", "a/../../x", "a/..", "/x"] {
            let error = made.place(name).unwrap_err().to_string();
            assert!(error.contains("leads out of this folder"), "{name}: {error}");
        }
    }

    #[test]
    fn a_folder_that_cannot_be_published_stays_as_it_was() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path();
        std::fs::create_dir(folder.join("images")).unwrap();
        std::fs::write(folder.join("images/a"), "mine").unwrap();
        // The place of a file is a folder of the user's.
        std::fs::create_dir(folder.join("list")).unwrap();
        std::fs::write(folder.join("list/mine"), "mine").unwrap();
        let before = found(folder);
        let made = AtomicFolder::create(folder).unwrap();
        fill(&made, "new");
        assert!(made.publish("list").unwrap_err().to_string().contains("list"));
        assert_eq!(found(folder), before);
        assert!(!folder.join("images/b").exists());
    }

    #[test]
    fn what_a_killed_process_began_is_finished() {
        for moved in 0..6 {
            let parent = tempfile::tempdir().unwrap();
            let folder = parent.path();
            std::fs::write(folder.join("list"), "old").unwrap();
            let at = |name: &str| folder.join(ASIDE).join(name);
            // As a kill leaves it before the files are known to be whole, and after each move.
            let new = if moved == 0 { "new" } else { "whole" };
            for name in ["old/images", &format!("{new}/images")] {
                std::fs::create_dir_all(at(name)).unwrap();
            }
            for (name, _) in all("") {
                std::fs::write(at(new).join(name), "new").unwrap();
            }
            std::fs::create_dir(folder.join("images")).unwrap();
            let moves = [
                ("list", "", "old/"),
                ("images/a", "whole/", ""),
                ("images/b", "whole/", ""),
                ("list", "whole/", ""),
            ];
            for (name, from, to) in moves.iter().take((moved as usize).saturating_sub(1)) {
                let place = |aside: &str| {
                    if aside.is_empty() { folder.join(name) } else { at(aside).join(name) }
                };
                std::fs::rename(place(from), place(to)).unwrap();
            }
            AtomicFolder::recover(folder).unwrap();
            let wants = if moved == 0 { vec![("list".into(), "old".into())] } else { all("new") };
            assert_eq!(found(folder), wants, "{moved} were moved");
        }
    }

    #[test]
    fn what_came_after_a_kill_stays() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path();
        for name in ["old", "whole"] {
            std::fs::create_dir_all(folder.join(ASIDE).join(name)).unwrap();
            std::fs::write(folder.join(ASIDE).join(name).join("list"), name).unwrap();
        }
        std::fs::write(folder.join("list"), "mine").unwrap();
        AtomicFolder::recover(folder).unwrap();
        assert_eq!(found(folder), [("list".into(), "mine".into())]);
    }

    #[test]
    fn one_of_two_writers_of_a_folder_wins_and_the_other_says_so() {
        let parent = tempfile::tempdir().unwrap();
        let first = AtomicFolder::create(parent.path()).unwrap();
        let second = AtomicFolder::create(parent.path()).unwrap_err().to_string();
        assert!(second.contains("another program is writing into this folder"), "{second}");
        drop(first);
        assert!(FolderLock::take(parent.path()).is_ok());
        assert_eq!(found(parent.path()), []);
    }
}
