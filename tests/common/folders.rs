//! Folders of files.

use std::path::Path;

/// Copies the files of a folder and of those in it; none is empty.
pub(crate) fn copy_folder(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let (path, name) = entry.map(|entry| (entry.path(), entry.file_name())).unwrap();
        if path.is_dir() {
            copy_folder(&path, &to.join(name))
        } else {
            assert!(std::fs::copy(&path, to.join(name)).unwrap() > 0, "{} is empty", path.display())
        }
    }
}
