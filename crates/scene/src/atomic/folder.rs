//! Folders of files that belong together, too many to be open at once.
//!
//! They are made in an inner folder, `.folder.trisplat.new`, and moved to their places when all are on the
//! disk. Old files are moved aside first, and an error puts them back. A list of the moves, written before
//! the first one, lets the next run undo those of a killed run.

use super::live;
use super::made::MadeFolders;
use super::names::{aside_folder, aside_name, folder_lock, temporary_name};
use super::temporary::Temporary;
use crate::error::{Error, Result};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

/// The list of moves, each ending with a zero byte. If a killed run leaves it, the moves are undone.
const LIST: &str = ".moves";
/// The same after all moves: only old files remain to be removed.
const DONE: &str = ".moved";

/// Keeps others from writing into a folder while it is held.
#[derive(Debug)]
pub struct FolderLock {
    _file: Temporary,
    /// A process that held it was killed.
    interrupted: bool,
}

impl FolderLock {
    /// Of an existing folder.
    ///
    /// Errors: another program that writes into it; what the operating system refuses.
    pub fn take(folder: &Path) -> Result<Self> {
        let lock = folder_lock(folder);
        let interrupted = temporary_name(&lock).exists();
        let busy = |e: io::Error| match e.kind() {
            io::ErrorKind::ResourceBusy => io::Error::new(
                io::ErrorKind::ResourceBusy,
                "another program is writing into this folder; wait for it, or give another folder",
            ),
            _ => e,
        };
        let file = Temporary::create(&lock).map_err(|e| Error::io(folder, busy(e)))?;
        Ok(Self { _file: file, interrupted })
    }
}

/// A folder under construction. Files of other names in it are left alone; dropping it leaves the folder
/// unchanged.
#[derive(Debug)]
pub struct AtomicFolder {
    folder: PathBuf,
    aside: PathBuf,
    lock: Option<FolderLock>,
    /// New folders. Dropped after the lock, which is inside.
    _made: MadeFolders,
}

impl AtomicFolder {
    /// Starts the files of `folder`, which is made if missing. The moves of a killed process are undone.
    ///
    /// Errors: another program that writes into it; what the operating system refuses.
    pub fn create(folder: &Path) -> Result<Self> {
        let io = |e| Error::io(folder, e);
        let made = MadeFolders::make(folder)?;
        let lock = FolderLock::take(folder)?;
        let aside = aside_folder(folder);
        if aside.exists() {
            if lock.interrupted {
                let finish = |()| remove_old(folder, &read_list(&aside, DONE)?);
                undo(folder, &aside).and_then(finish).map_err(io)?;
            }
            std::fs::remove_dir_all(&aside).map_err(io)?;
        }
        live::register(&aside);
        let this = Self { folder: folder.to_owned(), aside, lock: Some(lock), _made: made };
        std::fs::create_dir(&this.aside).map_err(io)?;
        Ok(this)
    }

    /// Undoes the moves that a killed process left half done in `folder`.
    ///
    /// Errors: those of [`AtomicFolder::create`].
    pub fn recover(folder: &Path) -> Result<()> {
        match aside_folder(folder).exists() {
            true => Self::create(folder).map(drop),
            false => Ok(()),
        }
    }

    /// The folder where its files are made, under their final names.
    pub fn path(&self) -> &Path {
        &self.aside
    }

    /// Names of the files made so far, sorted.
    fn names(&self) -> Result<Vec<PathBuf>> {
        let mut names = Vec::new();
        collect(&self.aside, Path::new(""), &mut names).map_err(|e| Error::io(&self.folder, e))?;
        names.sort();
        Ok(names)
    }

    /// Moves the files to their places when they are on the disk. Those that begin with `naming`, which name
    /// the others, come last. After an error each name has its old file.
    ///
    /// Errors: what the operating system refuses.
    pub fn publish(self, naming: &str) -> Result<()> {
        let io = |e| Error::io(&self.folder, e);
        let mut names = self.names()?;
        names.sort_by_key(|name| name.starts_with(naming));
        names.iter().try_for_each(|name| sync(&self.aside.join(name))).map_err(io)?;
        let list = self.aside.join(LIST);
        let moves = moves(&self.folder, &names);
        write_list(&list, &moves).map_err(io)?;
        // Locked while files get their names: a signal waits.
        let live = live::list();
        let replaced = replace(&self.folder, &self.aside, &names)
            .and_then(|()| std::fs::rename(&list, self.aside.join(DONE)));
        if let Err(error) = replaced {
            // Best effort.
            let _ = undo(&self.folder, &self.aside);
            return Err(io(error));
        }
        // Try again after a failure. The next run replaces the rest.
        let _ = remove_old(&self.folder, &moves).or_else(|_| remove_old(&self.folder, &moves));
        drop(live);
        sync_folder(&self.folder);
        Ok(())
    }
}

impl Drop for AtomicFolder {
    fn drop(&mut self) {
        // Try again after a failure, because obstacles may be temporary. The next run removes the rest.
        let remove = |_: io::Error| std::fs::remove_dir_all(&self.aside);
        let _ = std::fs::remove_dir_all(&self.aside).or_else(remove);
        live::unregister(&self.aside);
        self.lock = None;
    }
}

/// Names of all files below `folder`, relative to it.
fn collect(folder: &Path, below: &Path, names: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in std::fs::read_dir(folder.join(below))? {
        let entry = entry?;
        let name = below.join(entry.file_name());
        match entry.file_type()?.is_dir() {
            true => collect(folder, &name, names)?,
            false => names.push(name),
        }
    }
    Ok(())
}

fn sync(path: &Path) -> io::Result<()> {
    // Unix syncs files that are read-only, as copied photos may be; Windows only those that may be written.
    File::options().read(true).write(cfg!(not(unix))).open(path)?.sync_all()
}

/// A name, with `+` for a new file and `=` for a replaced one.
type Move = (char, PathBuf);

fn moves(folder: &Path, names: &[PathBuf]) -> Vec<Move> {
    let mark = |name: &PathBuf| if folder.join(name).exists() { '=' } else { '+' };
    names.iter().map(|name| (mark(name), name.clone())).collect()
}

fn write_list(list: &Path, moves: &[Move]) -> io::Result<()> {
    let line = |(mark, name): &Move| format!("{mark}{}\0", name.display());
    std::fs::write(list, moves.iter().map(line).collect::<String>())?;
    sync(list)
}

/// Moves the old files of all names aside, first those that name others, then new ones in.
fn replace(folder: &Path, aside: &Path, names: &[PathBuf]) -> io::Result<()> {
    for target in names.iter().rev().map(|name| folder.join(name)).filter(|target| target.exists()) {
        std::fs::rename(&target, aside_name(&target))?;
    }
    for name in names {
        let target = folder.join(name);
        std::fs::create_dir_all(target.parent().unwrap_or(folder))?;
        std::fs::rename(aside.join(name), target)?;
    }
    Ok(())
}

/// The moves of the list `name`; none without a list.
fn read_list(aside: &Path, name: &str) -> io::Result<Vec<Move>> {
    let text = match std::fs::read_to_string(aside.join(name)) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        text => text?,
    };
    let moves =
        text.split_terminator('\0').filter_map(|line| Some((line.chars().next()?, line.get(1..)?.into())));
    Ok(moves.collect())
}

/// Puts old files back and removes new ones, by the list; without one nothing was moved.
fn undo(folder: &Path, aside: &Path) -> io::Result<()> {
    for (mark, name) in read_list(aside, LIST)? {
        let (target, waiting) = (folder.join(&name), aside.join(&name));
        let old = aside_name(&target);
        if old.exists() {
            std::fs::rename(&old, &target)?;
        } else if mark == '+' {
            if !waiting.exists() && target.exists() {
                std::fs::remove_file(&target)?;
            }
            // Its folder may have been made before the move.
            remove_empty(folder, target.parent());
        }
    }
    Ok(())
}

/// Removes old files that were moved aside for new ones which are all in their places, and folders that are
/// empty without them.
fn remove_old(folder: &Path, moves: &[Move]) -> io::Result<()> {
    for (_, name) in moves.iter().filter(|(mark, _)| *mark == '=') {
        let target = folder.join(name);
        let old = aside_name(&target);
        if old.exists() {
            std::fs::remove_file(old)?;
        }
        if !target.exists() {
            remove_empty(folder, target.parent());
        }
    }
    Ok(())
}

/// Removes `below` and its parents up to `folder`, while they are empty. Inner ones may be missing.
fn remove_empty(folder: &Path, below: Option<&Path>) {
    let mut below = below;
    let goes = |empty: &Path| std::fs::remove_dir(empty).is_ok() || !empty.exists();
    while let Some(empty) = below.filter(|empty| *empty != folder && goes(empty)) {
        below = empty.parent();
    }
}

/// Waits until the names are on the disk, if the system supports it.
fn sync_folder(folder: &Path) {
    if cfg!(unix) {
        let _ = File::open(folder).and_then(|open| open.sync_all());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fill(made: &AtomicFolder, text: &str) {
        std::fs::create_dir_all(made.path().join("images")).unwrap();
        for name in ["images/a", "images/b", "list"] {
            std::fs::write(made.path().join(name), text).unwrap();
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
    fn a_folder_that_cannot_be_published_stays_as_it_was() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path();
        std::fs::create_dir(folder.join("images")).unwrap();
        std::fs::write(folder.join("images/a"), "mine").unwrap();
        // The place of a file is a folder that is not empty.
        std::fs::create_dir_all(aside_name(&folder.join("list")).join("full")).unwrap();
        std::fs::write(folder.join("list"), "mine").unwrap();
        let before = found(folder);
        let made = AtomicFolder::create(folder).unwrap();
        fill(&made, "new");
        assert!(made.publish("list").is_err());
        assert_eq!(found(folder), before);
    }

    #[test]
    fn what_a_killed_process_began_is_undone() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path();
        std::fs::write(folder.join("list"), "old").unwrap();
        for moved in 0..4 {
            let made = AtomicFolder::create(folder).unwrap();
            fill(&made, "new");
            let names: Vec<PathBuf> = all("").into_iter().map(|(name, _)| name).collect();
            write_list(&made.path().join(LIST), &moves(folder, &names)).unwrap();
            std::fs::rename(folder.join("list"), aside_name(&folder.join("list"))).unwrap();
            for name in &names[..moved] {
                std::fs::create_dir_all(folder.join("images")).unwrap();
                std::fs::rename(made.path().join(name), folder.join(name)).unwrap();
            }
            // The folder of the first is made before it is moved.
            std::fs::create_dir_all(folder.join("images")).unwrap();
            // As a kill leaves it: nothing is dropped.
            let (aside, lock) = (made.path().to_owned(), temporary_name(&folder_lock(folder)));
            let kept = parent.path().with_extension("kept");
            std::fs::rename(&aside, &kept).unwrap();
            drop(made);
            std::fs::rename(&kept, &aside).unwrap();
            std::fs::write(&lock, "").unwrap();
            drop(AtomicFolder::create(folder).unwrap());
            assert_eq!(found(folder), [("list".into(), "old".into())], "{moved} were moved");
            assert!(!folder.join("images").exists(), "{moved} were moved");
        }
    }

    #[test]
    fn folders_of_which_only_the_outer_one_was_made_are_undone() {
        let parent = tempfile::tempdir().unwrap();
        std::fs::create_dir(parent.path().join("sparse")).unwrap();
        remove_empty(parent.path(), Some(&parent.path().join("sparse/0")));
        assert!(parent.path().exists() && !parent.path().join("sparse").exists());
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
