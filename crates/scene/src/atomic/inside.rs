//! Whether a path lies in a folder, under any name and through any link.

use std::path::{Component, Path, PathBuf};

/// True if `inner` is `outer` or lies below it. Neither needs to exist.
pub fn lies_inside(inner: &Path, outer: &Path) -> bool {
    let outer = full(outer);
    full(inner).ancestors().any(|path| is_same(path, &outer))
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

/// True of two names of one folder: also where upper and lower case are one, and of a folder mounted twice.
#[cfg(unix)]
fn is_same(a: &Path, b: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let number = |path: &Path| std::fs::metadata(path).ok().map(|meta| (meta.dev(), meta.ino()));
    a == b || number(a).is_some_and(|a| number(b) == Some(a))
}

#[cfg(not(unix))]
fn is_same(a: &Path, b: &Path) -> bool {
    a == b
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_compared_without_dots_and_links() {
        let parent = tempfile::tempdir().unwrap();
        let at = |name: &str| parent.path().join(name);
        std::fs::create_dir_all(at("set/images")).unwrap();
        assert!(lies_inside(&at("set/images"), &at("set")) && lies_inside(&at("set"), &at("set")));
        assert!(!lies_inside(&at("set"), &at("set/images")) && !lies_inside(&at("settle"), &at("set")));
        assert!(lies_inside(&at("set/images/../new/a"), &at("set/new")), "what is missing");
        assert!(!lies_inside(&at("set/images/../../a"), &at("set")));
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(at("set/images"), at("link")).unwrap();
            assert!(lies_inside(&at("link/a"), &at("set")) && lies_inside(&at("set/images/a"), &at("link")));
            assert!(lies_inside(&at("link/../b"), &at("set")), "a link is followed before `..`");
        }
    }
}
