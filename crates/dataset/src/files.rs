//! The files of a data set, for those who must not write them.

use super::colmap::with_photos;
use super::posed::Dataset;
use super::transforms::with_extension;
use serde::Deserialize;
use std::path::{Path, PathBuf};
use trisplat_scene::{
    Limits,
    input::{self, files_below},
};

/// The beginnings of the names of files with poses, points and the split.
const NAMES: [&str; 6] = ["transforms", "test.txt", "cameras.", "images.", "points3D.", "rigs."];
/// Folders of a data set that hold such files.
const FOLDERS: [&str; 4] = ["", "sparse", "sparse/0", "colmap/sparse/0"];
/// The folder of masks.
const MASKS: &str = "masks";

/// What of a transforms.json names files.
#[derive(Debug, Default, Deserialize)]
struct NamedFiles {
    #[serde(default)]
    ply_file_path: Option<String>,
    #[serde(default)]
    frames: Vec<NamedFrame>,
}

#[derive(Debug, Deserialize)]
struct NamedFrame {
    file_path: String,
    #[serde(default)]
    mask_path: Option<String>,
}

impl Dataset {
    /// The files of the data set at `path`, a folder or a file, and what they name: poses, points, photos in the
    /// folder `images` and elsewhere, masks. Nothing is decoded, and what cannot be read names nothing.
    pub fn files(path: &Path, images: &Path, limits: &Limits) -> Vec<PathBuf> {
        let root = match path.is_dir() {
            true => path,
            false if NamedFiles::of(path, limits).frames.is_empty() => return vec![path.to_owned()],
            false => path.parent().unwrap_or(Path::new("")),
        };
        let mut files = vec![path.to_owned()];
        // A model may be given by its own folder, below that of the photos.
        let is_model = ["images.bin", "images.txt"].iter().any(|name| root.join(name).is_file());
        let above = is_model.then(|| with_photos(root, images)).flatten().filter(|above| *above != root);
        let roots: Vec<&Path> = std::iter::once(root).chain(above).collect();
        for root in roots {
            FOLDERS.iter().for_each(|folder| files.extend(poses(&root.join(folder))));
            for folder in [images, Path::new(MASKS)] {
                // Photos may lie beside everything else.
                let is_picture = |path: &PathBuf| image::ImageFormat::from_path(path).is_ok();
                files.extend(files_below(&root.join(folder)).into_iter().filter(is_picture));
            }
        }
        let is_json =
            |file: &&PathBuf| file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("json"));
        let named: Vec<PathBuf> =
            files.iter().filter(is_json).flat_map(|file| NamedFiles::of(file, limits).paths(root)).collect();
        files.extend(named);
        files
    }
}

/// The files of poses in `folder` itself.
fn poses(folder: &Path) -> Vec<PathBuf> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let is_one = |name: &str| NAMES.iter().any(|start| name.starts_with(start));
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let found = entries.filter(|entry| entry.file_name().to_str().is_some_and(is_one));
    found.map(|entry| entry.path()).filter(|path| path.is_file()).collect()
}

impl NamedFiles {
    fn of(file: &Path, limits: &Limits) -> Self {
        let text = input::read_text(file, limits).unwrap_or_default();
        serde_json::from_str(&text).unwrap_or_default()
    }

    fn paths(self, root: &Path) -> Vec<PathBuf> {
        let path = |name: String| root.join(name.replace('\\', "/"));
        let photos = self.frames.into_iter().flat_map(|frame| {
            let photo = with_extension(path(frame.file_path));
            std::iter::once(photo).chain(frame.mask_path.map(path))
        });
        photos.chain(self.ply_file_path.map(path)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_points_photos_and_masks_are_found_before_anything_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in
            ["sparse/0/images.bin", "images/a/1.png", "masks/a/1.png", "other/2.jpg", "test.txt", "scene.ply"]
        {
            std::fs::create_dir_all(at(name).parent().unwrap()).unwrap();
            std::fs::write(at(name), "").unwrap();
        }
        #[cfg(unix)]
        std::os::unix::fs::symlink(folder.path(), at("images/again")).unwrap();
        let json =
            r#"{"ply_file_path": "points.ply", "frames": [{"file_path": "other\\2", "mask_path": "m.png"}]}"#;
        std::fs::write(at("transforms.json"), json).unwrap();
        let found = Dataset::files(folder.path(), Path::new("images"), &Limits::DEFAULT);
        let wanted = [
            "sparse/0/images.bin",
            "images/a/1.png",
            "masks/a/1.png",
            "other/2.jpg",
            "m.png",
            "test.txt",
            "points.ply",
            "transforms.json",
        ];
        wanted.iter().for_each(|name| assert!(found.contains(&at(name)), "{name}: {found:?}"));
        assert!(!found.contains(&at("scene.ply")), "{found:?}");
        let same = |path: PathBuf| Dataset::files(&path, Path::new("images"), &Limits::DEFAULT);
        assert!(same(at("transforms.json")).contains(&at("other/2.jpg")));
        assert!(same(at("sparse/0")).contains(&at("images/a/1.png")), "by the folder of the model");
        std::fs::write(at("options.json"), "{}").unwrap();
        assert_eq!(same(at("options.json")), [at("options.json")]);
    }
}
