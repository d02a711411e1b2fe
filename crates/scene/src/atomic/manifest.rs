//! The list of the files that this program wrote into a folder of the user's: no others are
//! replaced or removed there.
//!
//! Each file has its size and hash. A file has none while it is being written: it is entered before
//! the first byte, so that files of a killed run are known as ours. A file that is not in the list
//! or has changed since, and a link, belong to the user.

use super::{AtomicFile, hash_of};
use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// Maximum size of a manifest, bytes.
const MAX_BYTES: u64 = 1 << 28;

const UNKNOWN: &str = "is not a file that trisplat wrote";
const CHANGED: &str = "was changed after trisplat wrote it";
const LINK: &str = "is a link, which trisplat does not follow here";
const REMEDY: &str = "move it elsewhere, or give another folder";

/// The files of one folder.
#[derive(Debug)]
pub struct FileManifest {
    root: PathBuf,
    /// Its own file, relative to the folder.
    name: &'static str,
    files: Files,
}

/// Files by their names in the folder; `None` for one that is being written.
type Files = BTreeMap<String, Option<FileFingerprint>>;

/// A finished file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FileFingerprint {
    bytes: u64,
    xxh3: String,
}

/// The manifest's file.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Stored {
    written_by_trisplat: Files,
}

impl FileManifest {
    /// Reads the list of `root` from its file `name`; empty if there is none.
    ///
    /// # Errors
    ///
    /// A file of that name that is no such list; errors of the operating system.
    pub fn read(root: &Path, name: &'static str) -> Result<Self> {
        let path = root.join(name);
        let mut text = String::new();
        let files = match File::open(&path)
            .and_then(|file| file.take(MAX_BYTES).read_to_string(&mut text))
        {
            Err(e) if e.kind() == io::ErrorKind::NotFound => Files::new(),
            Err(e) if e.kind() != io::ErrorKind::InvalidData => return Err(Error::io(&path, e)),
            _ => {
                let stored: Option<Stored> = serde_json::from_str(&text).ok();
                let files = stored.map(|stored| stored.written_by_trisplat);
                // A name that leads out of the folder is not of this program.
                let files = files.filter(|files| files.keys().all(|name| is_plain(name)));
                files.ok_or_else(|| foreign_file(&path, UNKNOWN))?
            }
        };
        Ok(Self { root: root.to_owned(), name, files })
    }

    /// Enters `names` before they are written.
    ///
    /// # Errors
    ///
    /// A file of the user's under such a name; errors of the operating system.
    pub fn begin(&mut self, names: &[&str]) -> Result<()> {
        let mut files = self.files.clone();
        for name in names {
            if let Some(why) = self.foreign_reason(name)? {
                return Err(foreign_file(&self.root.join(name), why));
            }
            files.insert((*name).to_owned(), None);
        }
        self.save(files)
    }

    /// Enters size and hash of the files that [`FileManifest::begin`] entered.
    ///
    /// # Errors
    ///
    /// Errors of the operating system.
    pub fn finish(&mut self) -> Result<()> {
        let mut files = self.files.clone();
        for name in self.files.keys().filter(|name| self.files[*name].is_none()) {
            let path = self.root.join(name);
            if std::fs::symlink_metadata(&path).is_ok_and(|meta| meta.is_file()) {
                files.insert(name.clone(), Some(FileFingerprint::of(&path)?))
            } else {
                files.remove(name).flatten().map(Some)
            };
        }
        self.save(files)
    }

    /// Removes the file `name` if it is ours.
    ///
    /// # Errors
    ///
    /// Errors of the operating system.
    pub fn remove(&mut self, name: &str) -> Result<()> {
        if self.foreign_reason(name)?.is_none() {
            remove(&self.root.join(name))?;
        }
        let mut files = self.files.clone();
        files.remove(name);
        self.save(files)
    }

    /// Removes every file of the list, then the list. The user's files stay.
    ///
    /// # Errors
    ///
    /// Errors of the operating system.
    pub fn clear(&mut self) -> Result<()> {
        for name in self.files.keys() {
            if self.foreign_reason(name)?.is_none() {
                remove(&self.root.join(name))?;
            }
        }
        self.files = Files::new();
        remove(&self.root.join(self.name))
    }

    /// The reason why the file `name` belongs to the user; `None` for our files and for a missing
    /// one.
    fn foreign_reason(&self, name: &str) -> Result<Option<&'static str>> {
        let path = self.root.join(name);
        match std::fs::symlink_metadata(&path) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(Error::io(&path, e)),
            Ok(meta) if meta.is_symlink() => return Ok(Some(LINK)),
            Ok(meta) if !meta.is_file() => return Ok(Some(UNKNOWN)),
            Ok(_) => {}
        }
        Ok(match self.files.get(name) {
            Some(None) => None,
            Some(Some(written)) if FileFingerprint::of(&path)? == *written => None,
            Some(Some(_)) => Some(CHANGED),
            None => Some(UNKNOWN),
        })
    }

    /// Writes the list, if it is another.
    fn save(&mut self, files: Files) -> Result<()> {
        if files == self.files {
            return Ok(());
        }
        let path = self.root.join(self.name);
        let stored = Stored { written_by_trisplat: files.clone() };
        let text = serde_json::to_string_pretty(&stored).unwrap_or_default();
        AtomicFile::create(&path)?.commit_with(text + "\n")?;
        self.files = files;
        Ok(())
    }
}

impl FileFingerprint {
    fn of(path: &Path) -> Result<Self> {
        let (bytes, hash) = hash_of(path).map_err(|e| Error::io(path, e))?;
        Ok(Self { bytes, xxh3: format!("{hash:016x}") })
    }
}

fn foreign_file(path: &Path, why: &str) -> Error {
    Error::unsupported(path, format!("{why}; {REMEDY}"))
}

/// True for the name of a file in the folder itself.
fn is_plain(name: &str) -> bool {
    Path::new(name).file_name().is_some_and(|file| file == name)
}

/// Removes a file, which may be missing.
fn remove(path: &Path) -> Result<()> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(Error::io(path, e)),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIST: &str = "files.json";

    /// A folder with the finished files `one` and `two`.
    fn folder() -> (tempfile::TempDir, FileManifest) {
        let folder = tempfile::tempdir().unwrap();
        let mut list = FileManifest::read(folder.path(), LIST).unwrap();
        list.begin(&["one", "two"]).unwrap();
        for name in ["one", "two"] {
            std::fs::write(folder.path().join(name), name).unwrap();
        }
        list.finish().unwrap();
        let list = FileManifest::read(folder.path(), LIST).unwrap();
        (folder, list)
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        let mut names: Vec<String> = entries
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn what_the_list_knows_is_replaced_and_removed_and_nothing_else() {
        let (folder, mut list) = folder();
        let at = |name: &str| folder.path().join(name);
        list.begin(&["one", "three"]).unwrap();
        list.finish().unwrap();
        for (name, text, why) in [("mine", "my own", UNKNOWN), ("two", "edited", CHANGED)] {
            std::fs::write(at(name), text).unwrap();
            let error = list.begin(&[name]).unwrap_err().to_string();
            assert!(
                error.contains(why) && error.contains(name) && error.contains("move it"),
                "{error}"
            );
            assert_eq!(std::fs::read_to_string(at(name)).unwrap(), text);
        }
        list.begin(&["three"]).unwrap();
        std::fs::write(at("three"), "ours").unwrap();
        list.finish().unwrap();
        for name in ["three", "two", "mine", "none"] {
            list.remove(name).unwrap();
        }
        assert_eq!(names(folder.path()), [LIST, "mine", "one", "two"]);
        list.clear().unwrap();
        assert_eq!(names(folder.path()), ["mine", "two"]);
    }

    #[test]
    fn what_is_being_written_is_ours_until_it_is_finished() {
        let (folder, mut list) = folder();
        let at = |name: &str| folder.path().join(name);
        list.begin(&["base"]).unwrap();
        // As after a kill: the list is read again.
        std::fs::write(at("base"), "half").unwrap();
        let mut list = FileManifest::read(folder.path(), LIST).unwrap();
        list.begin(&["base"]).unwrap();
        std::fs::write(at("base"), "whole").unwrap();
        list.finish().unwrap();
        let mut list = FileManifest::read(folder.path(), LIST).unwrap();
        std::fs::write(at("base"), "other").unwrap();
        assert!(list.begin(&["base"]).unwrap_err().to_string().contains(CHANGED));
        list.clear().unwrap();
        assert_eq!(names(folder.path()), ["base"]);
    }

    #[cfg(unix)]
    #[test]
    fn make_changes_nothing_through_a_link() {
        let (folder, mut list) = folder();
        let at = |name: &str| folder.path().join(name);
        std::fs::rename(at("one"), at("kept")).unwrap();
        std::os::unix::fs::symlink("kept", at("one")).unwrap();
        assert!(list.begin(&["one"]).unwrap_err().to_string().contains(LINK));
        list.clear().unwrap();
        assert_eq!(names(folder.path()), ["kept", "one"]);
        for text in ["notes", "{}", r#"{"written_by_trisplat": {"../x": null}}"#] {
            std::fs::write(at(LIST), text).unwrap();
            assert!(
                FileManifest::read(folder.path(), LIST).unwrap_err().to_string().contains(UNKNOWN)
            );
        }
    }
}
