//! The list of the files that this program wrote into a folder of the user's: no others are replaced or
//! removed there.
//!
//! Each file has its size and hash. A file, or a folder with a slash at its end, has none while it is being
//! written: it is entered before the first byte, so that whatever a killed run leaves is known as ours. What
//! is not in the list or has changed since, and what is reached through a link, belongs to the user.

use super::AtomicFile;
use super::folder::{AtomicFolder, remove_empty};
use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::{Component, Path, PathBuf};
use xxhash_rust::xxh3::Xxh3Default;

/// A longer file is no manifest.
const MAX_BYTES: u64 = 1 << 28;
const BUFFER_BYTES: usize = 1 << 20;

const UNKNOWN: &str = "is not a file that trisplat wrote";
const CHANGED: &str = "was changed after trisplat wrote it";
const LINK: &str = "is a link, which trisplat does not follow here";
const REMEDY: &str = "move it elsewhere, or give another folder";

/// The files of one folder.
#[derive(Debug)]
pub struct Manifest {
    root: PathBuf,
    /// Its own file, relative to the folder.
    name: &'static str,
    files: Files,
}

/// By name relative to the folder, with slashes.
type Files = BTreeMap<String, Option<Written>>;

/// A finished file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    bytes: u64,
    xxh3: String,
}

/// The manifest's file.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Stored {
    written_by_trisplat: Files,
}

/// What is at a name.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Found {
    Nothing,
    Ours,
    /// The user's, and why.
    Theirs(&'static str),
}

impl Manifest {
    /// Reads the list of `root` from its file `name`; empty if there is none.
    ///
    /// Errors: a file of that name that is no such list; what the operating system refuses.
    pub fn read(root: &Path, name: &'static str) -> Result<Self> {
        let path = root.join(name);
        let mut text = String::new();
        let files = match File::open(&path).and_then(|file| file.take(MAX_BYTES).read_to_string(&mut text)) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => Files::new(),
            Err(e) if e.kind() != io::ErrorKind::InvalidData => return Err(Error::io(&path, e)),
            _ => {
                let stored: Option<Stored> = serde_json::from_str(&text).ok();
                let files = stored.map(|stored| stored.written_by_trisplat);
                let files = files.filter(|files| files.keys().all(|name| stays_inside(name)));
                files.ok_or_else(|| theirs(&path, UNKNOWN))?
            }
        };
        Ok(Self { root: root.to_owned(), name, files })
    }

    /// Refuses a file of the user's at `name`.
    ///
    /// Errors: such a file; what the operating system refuses.
    pub fn check(&self, name: &str) -> Result<()> {
        match self.found(name)? {
            Found::Theirs(why) => Err(theirs(&self.root.join(name), why)),
            _ => Ok(()),
        }
    }

    /// [`Manifest::check`] of all files in the list.
    ///
    /// Errors: the same.
    pub fn check_all(&self) -> Result<()> {
        self.files.keys().filter(|name| !is_folder(name)).try_for_each(|name| self.check(name))
    }

    /// Enters `names` before they are written, by this process or another one. A name that ends with a slash
    /// stands for everything in that folder.
    ///
    /// Errors: those of [`Manifest::check`].
    pub fn begin(&mut self, names: &[&str]) -> Result<()> {
        let mut files = self.files.clone();
        for name in names.iter().filter(|name| self.files.get(**name) != Some(&None)) {
            self.below(name)?.iter().try_for_each(|file| self.check(file))?;
            files.retain(|file, _| !(is_folder(name) && file.starts_with(name)));
            files.insert((*name).to_owned(), None);
        }
        self.save(files)
    }

    /// Enters size and hash of what was begun.
    ///
    /// Errors: what the operating system refuses.
    pub fn finish(&mut self) -> Result<()> {
        let mut files = self.files.clone();
        for name in self.files.keys().filter(|name| self.files[*name].is_none()) {
            files.remove(name);
            for file in self.below(name)? {
                let path = self.root.join(&file);
                if std::fs::symlink_metadata(&path).is_ok_and(|meta| meta.is_file()) {
                    files.insert(file, Some(Written::of(&path)?));
                }
            }
        }
        self.save(files)
    }

    /// Removes those of `names` that are ours; others stay and leave the list.
    ///
    /// Errors: what the operating system refuses.
    pub fn remove(&mut self, names: &[&str]) -> Result<()> {
        let mut files = self.files.clone();
        for name in names {
            self.remove_ours(name)?;
            files.remove(*name);
        }
        self.save(files)
    }

    /// Removes every file of the list, then the list, and the folders that this leaves empty. The user's files
    /// stay.
    ///
    /// Errors: what the operating system refuses.
    pub fn clear(&mut self) -> Result<()> {
        for name in self.files.keys() {
            self.below(name)?.iter().try_for_each(|file| self.remove_ours(file))?;
        }
        self.files = Files::new();
        let path = self.root.join(self.name);
        ignore_missing(std::fs::remove_file(&path)).map_err(|e| Error::io(&path, e))?;
        remove_empty(&self.root, path.parent());
        Ok(())
    }

    /// Publishes `made`, whose folder is that of the list, see [`AtomicFolder::publish`], and in the same step
    /// removes files of the list that begin with `within` and have no successor.
    ///
    /// Errors: a file of the user's that would be replaced or removed; what the operating system refuses.
    pub fn publish(&mut self, made: AtomicFolder, within: &str, naming: &str) -> Result<()> {
        let mut files = self.files.clone();
        let mut new = Files::new();
        for name in made.names()? {
            let written = Written::of(&made.path().join(&name))?;
            new.insert(name.to_string_lossy().replace('\\', "/"), Some(written));
        }
        let mut stale = Vec::new();
        for name in self.files.keys().filter(|name| name.starts_with(within) && !new.contains_key(*name)) {
            for file in self.below(name)? {
                self.check(&file)?;
                if self.root.join(&file).exists() && !new.contains_key(&file) {
                    stale.push(PathBuf::from(file));
                }
            }
            files.remove(name);
        }
        for (name, written) in &new {
            match self.found(name)? {
                Found::Theirs(why) if why == LINK || !self.has(name, written)? => {
                    return Err(theirs(&self.root.join(name), why));
                }
                _ => {}
            }
        }
        files.extend(new);
        let path = made.path().join(self.name);
        std::fs::write(&path, text_of(&files)).map_err(|e| Error::io(&path, e))?;
        made.publish_instead(naming, &stale)?;
        self.files = files;
        Ok(())
    }

    /// Names in the list.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.files.keys().map(String::as_str)
    }

    fn found(&self, name: &str) -> Result<Found> {
        let mut path = self.root.clone();
        for part in Path::new(name).components() {
            path.push(part);
            match std::fs::symlink_metadata(&path) {
                Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(Found::Nothing),
                Err(e) => return Err(Error::io(&path, e)),
                Ok(meta) if meta.is_symlink() => return Ok(Found::Theirs(LINK)),
                Ok(_) => {}
            }
        }
        let begun = |key: &str| self.files.get(key) == Some(&None);
        Ok(match self.files.get(name) {
            _ if !path.is_file() => Found::Theirs(UNKNOWN),
            _ if begun(name) || name.match_indices('/').any(|(at, _)| begun(&name[..=at])) => Found::Ours,
            Some(written) if self.has(name, written)? => Found::Ours,
            Some(_) => Found::Theirs(CHANGED),
            None => Found::Theirs(UNKNOWN),
        })
    }

    /// True if the file at `name` is this one.
    fn has(&self, name: &str, written: &Option<Written>) -> Result<bool> {
        let (path, Some(written)) = (self.root.join(name), written) else { return Ok(false) };
        let is_long = std::fs::metadata(&path).is_ok_and(|meta| meta.len() == written.bytes);
        Ok(is_long && Written::of(&path)? == *written)
    }

    /// `name` itself, or the files in a folder.
    fn below(&self, name: &str) -> Result<Vec<String>> {
        let mut found = Vec::new();
        match is_folder(name) {
            true => collect(&self.root, name, &mut found).map_err(|e| Error::io(self.root.join(name), e))?,
            false => found.push(name.to_owned()),
        }
        Ok(found)
    }

    fn remove_ours(&self, name: &str) -> Result<()> {
        let path = self.root.join(name);
        if self.found(name)? == Found::Ours {
            ignore_missing(std::fs::remove_file(&path)).map_err(|e| Error::io(&path, e))?;
            remove_empty(&self.root, path.parent());
        }
        Ok(())
    }

    /// Writes the list, if it is another.
    fn save(&mut self, files: Files) -> Result<()> {
        if files == self.files {
            return Ok(());
        }
        let path = self.root.join(self.name);
        let mut file = AtomicFile::create(&path)?;
        file.write_all(text_of(&files).as_bytes()).map_err(|e| Error::io(&path, e))?;
        file.commit()?;
        self.files = files;
        Ok(())
    }
}

impl Written {
    fn of(path: &Path) -> Result<Self> {
        let io = |e| Error::io(path, e);
        let mut file = File::open(path).map_err(io)?;
        let (mut hash, mut bytes, mut buffer) = (Xxh3Default::new(), 0, vec![0; BUFFER_BYTES]);
        loop {
            match file.read(&mut buffer) {
                Ok(0) => break,
                Ok(read) => {
                    hash.update(&buffer[..read]);
                    bytes += read as u64;
                }
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => return Err(io(e)),
            }
        }
        Ok(Self { bytes, xxh3: format!("{:016x}", hash.digest()) })
    }
}

fn text_of(files: &Files) -> String {
    let stored = Stored { written_by_trisplat: files.clone() };
    serde_json::to_string_pretty(&stored).unwrap_or_default() + "\n"
}

fn theirs(path: &Path, why: &str) -> Error {
    Error::unsupported(path, format!("{why}; {REMEDY}"))
}

fn is_folder(name: &str) -> bool {
    name.ends_with('/')
}

/// False for a name that leads out of its folder.
fn stays_inside(name: &str) -> bool {
    !name.is_empty() && Path::new(name).components().all(|part| matches!(part, Component::Normal(_)))
}

fn ignore_missing(done: io::Result<()>) -> io::Result<()> {
    done.or_else(|e| if e.kind() == io::ErrorKind::NotFound { Ok(()) } else { Err(e) })
}

/// Names of all files below the folder `name` of `root`, which may be missing. A link counts as a file.
fn collect(root: &Path, name: &str, found: &mut Vec<String>) -> io::Result<()> {
    let path = root.join(name);
    if path.is_symlink() {
        found.push(name.trim_end_matches('/').to_owned());
        return Ok(());
    }
    let entries = match std::fs::read_dir(path) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(()),
        entries => entries?,
    };
    for entry in entries {
        let entry = entry?;
        let inner = format!("{name}{}", entry.file_name().to_string_lossy());
        match entry.file_type()?.is_dir() {
            true => collect(root, &format!("{inner}/"), found)?,
            false => found.push(inner),
        }
    }
    Ok(())
}

/// Removes `folder` and the folders below it, if there are no files in them.
pub fn remove_empty_folders(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            remove_empty_folders(&entry.path());
        }
    }
    // Fails if it is not empty.
    let _ = std::fs::remove_dir(folder);
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIST: &str = "state/files.json";

    /// A folder with `a/one`, `a/two` and the list.
    fn folder() -> (tempfile::TempDir, Manifest) {
        let folder = tempfile::tempdir().unwrap();
        let mut list = Manifest::read(folder.path(), LIST).unwrap();
        publish(&mut list, folder.path(), &["one", "two"]).unwrap();
        (folder, list)
    }

    fn publish(list: &mut Manifest, folder: &Path, names: &[&str]) -> Result<()> {
        let made = AtomicFolder::create(folder)?;
        for inner in ["a", "state"] {
            std::fs::create_dir(made.path().join(inner)).unwrap();
        }
        names.iter().for_each(|name| std::fs::write(made.path().join("a").join(name), name).unwrap());
        list.publish(made, "a/", "state/")
    }

    fn files(folder: &Path) -> Vec<String> {
        let mut found = Vec::new();
        collect(folder, "", &mut found).unwrap();
        found.sort();
        found
    }

    #[test]
    fn what_the_list_knows_is_replaced_and_removed_and_nothing_else() {
        let (folder, _) = folder();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("a/mine"), "mine").unwrap();
        let mut list = Manifest::read(folder.path(), LIST).unwrap();
        publish(&mut list, folder.path(), &["two", "three"]).unwrap();
        assert_eq!(files(folder.path()), ["a/mine", "a/three", "a/two", LIST]);

        for (name, text, why) in [("mine", "my own", UNKNOWN), ("two", "edited", CHANGED)] {
            std::fs::write(at("a").join(name), text).unwrap();
            let error = publish(&mut list, folder.path(), &[name, "three"]).unwrap_err().to_string();
            assert!(error.contains(why) && error.contains(name) && error.contains("move it"), "{error}");
            assert_eq!(std::fs::read_to_string(at("a").join(name)).unwrap(), text);
        }
        // A changed file without a successor stays too.
        assert!(publish(&mut list, folder.path(), &["three"]).is_err());
        assert!(list.check_all().is_err());
        list.clear().unwrap();
        assert_eq!(files(folder.path()), ["a/mine", "a/two"]);
    }

    #[test]
    fn what_is_being_written_is_ours_until_it_is_finished() {
        let (folder, mut list) = folder();
        let at = |name: &str| folder.path().join(name);
        list.begin(&["a/base", "models/"]).unwrap();
        // As after a kill: the list is read again.
        std::fs::create_dir_all(at("models/0")).unwrap();
        ["a/base", "models/0/m"].iter().for_each(|name| std::fs::write(at(name), "half").unwrap());
        let mut list = Manifest::read(folder.path(), LIST).unwrap();
        list.begin(&["a/base", "models/"]).unwrap();
        std::fs::write(at("a/base"), "whole").unwrap();
        list.finish().unwrap();
        let mut list = Manifest::read(folder.path(), LIST).unwrap();
        list.begin(&["models/"]).unwrap();
        list.finish().unwrap();
        std::fs::write(at("models/0/mine"), "mine").unwrap();
        assert!(list.begin(&["models/"]).unwrap_err().to_string().contains("mine"));
        std::fs::write(at("a/base"), "other").unwrap();
        assert!(list.begin(&["a/base"]).unwrap_err().to_string().contains(CHANGED));
        list.remove(&["a/base", "a/one"]).unwrap();
        assert_eq!(files(folder.path()), ["a/base", "a/two", "models/0/m", "models/0/mine", LIST]);
        list.clear().unwrap();
        assert_eq!(files(folder.path()), ["a/base", "models/0/mine"]);
    }

    #[cfg(unix)]
    #[test]
    fn nothing_is_changed_through_a_link_or_by_a_list_that_leads_elsewhere() {
        let (folder, mut list) = folder();
        let at = |name: &str| folder.path().join(name);
        // The user keeps the photos in one place only.
        std::fs::rename(at("a"), at("photos")).unwrap();
        std::os::unix::fs::symlink("photos", at("a")).unwrap();
        for names in [&["one", "two"][..], &["three"], &[]] {
            let error = publish(&mut list, folder.path(), names).unwrap_err().to_string();
            assert!(error.contains(LINK), "{error}");
        }
        list.clear().unwrap();
        assert_eq!(files(folder.path()), ["a", "photos/one", "photos/two"]);
        std::fs::create_dir(at("state")).unwrap();
        for text in ["notes", "{}", r#"{"written_by_trisplat": {"../x": null}}"#] {
            std::fs::write(at(LIST), text).unwrap();
            assert!(Manifest::read(folder.path(), LIST).unwrap_err().to_string().contains(UNKNOWN));
        }
    }
}
