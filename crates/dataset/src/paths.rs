//! The files that a data set names must be in its own folder, unless the user permits others.

use std::path::{Path, PathBuf};
use trisplat_scene::{Error, Result, input, report::counted};

/// The files of one list, relative to a folder.
#[derive(Debug)]
pub(super) struct NamedFiles<'a> {
    /// The file that names them, for messages.
    pub(super) list: &'a Path,
    /// What they are relative to.
    pub(super) folder: &'a Path,
    pub(super) allow_outside: bool,
    /// Number of absolute paths so far, and the first of them.
    absolute: (usize, Option<String>),
}

impl<'a> NamedFiles<'a> {
    /// None yet.
    pub(super) fn new(list: &'a Path, folder: &'a Path, allow_outside: bool) -> Self {
        Self { list, folder, allow_outside, absolute: (0, None) }
    }

    /// The path of the file `name`, which the list names at `place`. Errors: a file outside the folder
    /// without permission.
    pub(super) fn find(&mut self, place: &str, name: &str) -> Result<PathBuf> {
        let path = Path::new(name);
        if path.is_absolute() {
            self.absolute.0 += 1;
            self.absolute.1.get_or_insert_with(|| name.to_owned());
        } else if input::leaves_folder(path) && !self.allow_outside {
            let reason = format!(
                "names `{name}`, which is outside {}; if that is right, give `allow_outside`",
                if self.folder.as_os_str().is_empty() { Path::new(".") } else { self.folder }.display()
            );
            return Err(Error::malformed(self.list, place, reason));
        }
        Ok(self.folder.join(path))
    }

    /// The warning about absolute paths.
    pub(super) fn warning(self) -> Option<String> {
        let (count, first) = self.absolute;
        let (list, files) = (self.list.display(), counted(count as u64, "file"));
        first.map(|first| format!("{list} names {files} by an absolute path, first `{first}`"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_that_leaves_the_folder_is_an_error_and_an_absolute_one_a_warning() {
        let (list, folder) = (Path::new("set/transforms.json"), Path::new("set"));
        let mut files = NamedFiles::new(list, folder, false);
        assert_eq!(files.find("frame 0", "images/../a.png").unwrap(), Path::new("set/images/../a.png"));
        let message = files.find("frame 1", "../secret.png").unwrap_err().to_string();
        assert!(message.starts_with("set/transforms.json: frame 1: names `../secret.png`"), "{message}");
        assert!(message.contains("`allow_outside`"), "{message}");
        assert_eq!(NamedFiles::new(list, folder, false).warning(), None);
        let mut allowed = NamedFiles::new(list, folder, true);
        assert_eq!(allowed.find("frame 1", "../a.png").unwrap(), Path::new("set/../a.png"));
        if cfg!(unix) {
            assert_eq!(files.find("frame 2", "/a.png").unwrap(), Path::new("/a.png"));
            assert!(files.warning().unwrap().contains("names 1 file by an absolute path, first `/a.png`"));
        }
    }
}
