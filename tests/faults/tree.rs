//! The files of a folder and what is in them.

use std::collections::BTreeMap;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

/// Contents by name, relative to the folder; of an empty folder its name and a slash.
pub(crate) type Tree = BTreeMap<String, Vec<u8>>;

pub(crate) fn read(folder: &Path) -> Tree {
    let mut tree = Tree::new();
    collect(folder, "", &mut tree);
    tree
}

fn collect(folder: &Path, prefix: &str, tree: &mut Tree) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries.map(Result::unwrap) {
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        if entry.path().is_dir() {
            let name = format!("{name}/");
            let before = tree.len();
            collect(&entry.path(), &name, tree);
            if tree.len() == before {
                tree.insert(name, Vec::new());
            }
        } else {
            tree.insert(name, std::fs::read(entry.path()).unwrap());
        }
    }
}

pub(crate) fn write(folder: &Path, tree: &Tree) {
    for (name, bytes) in tree {
        let path = folder.join(name);
        if is_folder(name) {
            std::fs::create_dir_all(path).unwrap();
            continue;
        }
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, bytes).unwrap();
        if bytes.starts_with(b"#!") {
            std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755)).unwrap();
        }
    }
}

/// True of the name of an empty folder.
pub(crate) fn is_folder(name: &str) -> bool {
    name.ends_with('/')
}

/// True of what a killed run may leave behind until the next one.
pub(crate) fn is_leftover(name: &str) -> bool {
    name.split('/').any(trisplat_scene::atomic::is_leftover)
}
