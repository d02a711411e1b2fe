//! Names of an output's files during writing, and whether two paths are one file.

use std::path::{Component, Path, PathBuf};
use xxhash_rust::xxh3::xxh3_64;

/// Longest file name that works everywhere, bytes.
const MAX_NAME_BYTES: usize = 255;
/// The inner folder in which the files of a folder are made.
pub(super) const ASIDE: &str = ".folder.trisplat.new";
/// Maximum number of links to follow, as on Linux.
const MAX_LINKS: usize = 40;

/// Names that Windows keeps for devices, with any ending.
const DEVICES: [&str; 6] = ["CON", "PRN", "AUX", "NUL", "CONIN$", "CONOUT$"];
/// The same, followed by a digit.
const NUMBERED_DEVICES: [&str; 2] = ["COM", "LPT"];

/// Make a file name of a foreign `name`: without separators, `..`, characters or names with a
/// meaning for a system, and without a leading dash, which programs take for an option.
pub fn safe_name(name: &str) -> String {
    let is_special = |c: char| c.is_control() || "/\\:*?\"<>|".contains(c);
    let plain = name.replace(is_special, "_");
    // Windows drops dots and spaces at the end.
    let plain = plain.trim_end_matches(['.', ' ']);
    let stem = plain.split('.').next().unwrap_or_default().to_ascii_uppercase();
    let stem = stem.trim_end();
    let is_device = DEVICES.contains(&stem)
        || NUMBERED_DEVICES.iter().any(|device| {
            stem.strip_prefix(device)
                .is_some_and(|end| end.len() == 1 && end.as_bytes()[0].is_ascii_digit())
        });
    match plain.strip_prefix(['-', '.', ' ']) {
        Some(rest) => format!("_{rest}"),
        None if plain.is_empty() || is_device => format!("_{plain}"),
        None => plain.to_owned(),
    }
}

/// Make a relative path of a foreign one: the parts of `path` as [`safe_name`]s; `.`, `..`
/// and empty parts are left out.
pub fn safe_path(path: &str) -> PathBuf {
    let parts = path.split('/').filter(|part| !["", ".", ".."].contains(part));
    parts.map(safe_name).collect()
}

/// The temporary file of `target`: `.NAME.trisplat.tmp` beside it.
pub fn temporary_name(target: &Path) -> PathBuf {
    sibling(target, "tmp")
}

/// The name of the replaced file of `target` while its set is published.
pub(super) fn aside_name(target: &Path) -> PathBuf {
    sibling(target, "old")
}

/// The name of a temporary file's target.
pub(super) fn target_of_temporary(name: &str) -> Option<&str> {
    name.strip_prefix('.')?.strip_suffix(".trisplat.tmp")
}

/// True for names that only this program gives, and a killed run leaves.
pub fn is_leftover(name: &str) -> bool {
    name.starts_with('.')
        && [".trisplat.tmp", ".trisplat.old", ".trisplat.new"].iter().any(|end| name.ends_with(end))
}

/// `.NAME.trisplat.ENDING` beside `target`; a name too long for that is replaced by its hash.
fn sibling(target: &Path, ending: &str) -> PathBuf {
    let name = target.file_name().unwrap_or_default();
    let ending = format!(".trisplat.{ending}");
    let mut whole = std::ffi::OsString::from(".");
    if name.len() + 1 + ending.len() <= MAX_NAME_BYTES {
        whole.push(name)
    } else {
        whole.push(format!("{:016x}", xxh3_64(name.as_encoded_bytes())))
    }
    whole.push(ending);
    target.with_file_name(whole)
}

/// The target of `path` if its last part is a symbolic link; the target may not exist yet.
pub fn resolved(path: &Path) -> PathBuf {
    let mut path = path.to_owned();
    for _ in 0..MAX_LINKS {
        let Ok(to) = std::fs::read_link(&path) else { break };
        path = path.parent().unwrap_or(Path::new("")).join(to);
    }
    path
}

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
    /// Identity of the file or folder at `path`.
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
        let name = if cfg!(any(windows, target_os = "macos")) {
            name.to_string_lossy().to_lowercase().into()
        } else {
            name
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

/// True if `inner` is `outer` or lies below it. Neither needs to exist.
pub fn lies_inside(inner: &Path, outer: &Path) -> bool {
    let outer = FileId::of(&full(outer));
    full(inner).ancestors().any(|path| FileId::of(path) == outer)
}

/// The absolute path without links; parts that do not exist stay as they are.
fn full(path: &Path) -> PathBuf {
    let mut full = std::env::current_dir().unwrap_or_default();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir => drop(full.pop()),
            part => full.push(part),
        }
        full = std::fs::canonicalize(&full).unwrap_or(full);
    }
    full
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foreign_names_become_names_of_files_in_a_folder() {
        let rows = [
            ("a b.jpg", "a b.jpg"),
            ("x\\..\\..\\y.jpg", "x_.._.._y.jpg"),
            ("../y", "_._y"),
            ("..", "_"),
            ("", "_"),
            ("-rf", "_rf"),
            (".hidden", "_hidden"),
            ("c:y", "c_y"),
            ("a\nb\u{1b}", "a_b_"),
            ("nul.txt", "_nul.txt"),
            ("COM1", "_COM1"),
            ("com12 .txt", "com12 .txt"),
            ("console", "console"),
            ("end. .", "end"),
        ];
        for (name, safe) in rows {
            assert_eq!(safe_name(name), safe, "{name:?}");
            assert_eq!(safe_name(safe), safe, "{name:?} twice");
        }
        assert_eq!(safe_path("/a/../-b/./c\\d.jpg"), Path::new("a/_b/c_d.jpg"));
    }

    #[test]
    fn paths_are_compared_without_dots_and_links() {
        let parent = tempfile::tempdir().unwrap();
        let at = |name: &str| parent.path().join(name);
        std::fs::create_dir_all(at("set/images")).unwrap();
        assert!(lies_inside(&at("set/images"), &at("set")) && lies_inside(&at("set"), &at("set")));
        assert!(
            !lies_inside(&at("set"), &at("set/images")) && !lies_inside(&at("settle"), &at("set"))
        );
        assert!(lies_inside(&at("set/images/../new/a"), &at("set/new")), "what is missing");
        assert!(!lies_inside(&at("set/images/../../a"), &at("set")));
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(at("set/images"), at("link")).unwrap();
            assert!(
                lies_inside(&at("link/a"), &at("set"))
                    && lies_inside(&at("set/images/a"), &at("link"))
            );
            assert!(lies_inside(&at("link/../b"), &at("set")), "a link is followed before `..`");
        }
    }
}
