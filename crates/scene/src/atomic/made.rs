//! New folders for outputs.

use super::live;
use crate::error::{Error, Result};
use std::path::{Path, PathBuf};

/// New folders: on drop, empty ones are removed.
#[derive(Debug)]
pub struct MadeFolders {
    /// Those inside first.
    folders: Vec<PathBuf>,
}

impl MadeFolders {
    /// Makes `folder` and its parents if missing.
    ///
    /// Errors: what the operating system refuses.
    pub fn make(folder: &Path) -> Result<Self> {
        let missing = folder.ancestors().take_while(|path| !path.as_os_str().is_empty() && !path.exists());
        let made = Self { folders: missing.map(Path::to_owned).collect() };
        std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
        made.folders.iter().for_each(|path| live::register(path));
        Ok(made)
    }
}

impl Drop for MadeFolders {
    fn drop(&mut self) {
        for folder in &self.folders {
            // Fails if it is not empty.
            let _ = std::fs::remove_dir(folder);
            live::unregister(folder);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_in_which_nothing_came_to_be_goes_again() {
        let parent = tempfile::tempdir().unwrap();
        let (old, new) = (parent.path().join("old"), parent.path().join("new"));
        std::fs::create_dir(&old).unwrap();
        drop([MadeFolders::make(&old).unwrap(), MadeFolders::make(&new.join("a/b")).unwrap()]);
        assert!(old.exists() && !new.exists(), "what was there stays");
        let made = MadeFolders::make(&new.join("a/b")).unwrap();
        std::fs::write(new.join("a/file"), "").unwrap();
        drop(made);
        assert!(new.join("a/file").exists() && !new.join("a/b").exists());
    }
}
