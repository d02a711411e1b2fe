//! Whether two paths are one file.

use super::names::resolved;
use std::path::{Path, PathBuf};

/// Identity of a file or folder: equal for all names and links, whether it exists or not.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct FileId(Identity);

#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum Identity {
    /// Device and number of an existing file.
    #[cfg(unix)]
    Number(u64, u64),
    /// The full name of a missing file, or on systems without file numbers.
    Name(PathBuf),
}

impl FileId {
    /// That of `path`.
    pub fn of(path: &Path) -> Self {
        let path = resolved(path);
        #[cfg(unix)]
        if let Ok(meta) = std::fs::metadata(&path) {
            use std::os::unix::fs::MetadataExt;
            return Self(Identity::Number(meta.dev(), meta.ino()));
        }
        if let Ok(full) = std::fs::canonicalize(&path) {
            return Self(Identity::Name(full));
        }
        let name = path.file_name().unwrap_or_default().to_owned();
        // Names that differ only in case are one file on most disks of these systems.
        let name = match cfg!(any(windows, target_os = "macos")) {
            true => name.to_string_lossy().to_lowercase().into(),
            false => name,
        };
        let folder = folder_of(&path);
        let folder = std::fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
        Self(Identity::Name(folder.join(name)))
    }
}

/// The folder that holds `path`.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}
