//! Inputs of a capture: photos and videos, given as files or folders, recognised by extension.

use super::heic::is_heic;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use trisplat_scene::atomic::safe_name;
use trisplat_scene::input::{self, files_below};
use trisplat_scene::{Error, Limits, Result};

const PHOTOS: [&str; 7] = ["jpg", "jpeg", "jpe", "png", "webp", "tif", "tiff"];
const VIDEOS: [&str; 9] = ["mp4", "mov", "m4v", "mkv", "webm", "avi", "mpg", "mts", "3gp"];
const RAW: [&str; 9] = ["dng", "cr2", "cr3", "nef", "arw", "raf", "orf", "rw2", "pef"];

/// Photos and videos, sorted by name.
#[derive(Debug, Default, PartialEq)]
pub(super) struct CaptureSources {
    pub(super) photos: Vec<SourcePhoto>,
    pub(super) videos: Vec<PathBuf>,
    /// Ignored files, and why.
    pub(super) warnings: Vec<String>,
    /// Full paths of the files and folders so far, without links: each is taken once.
    taken: BTreeSet<PathBuf>,
    /// Other names of the same files and folders.
    again: Vec<PathBuf>,
}

/// An input photo.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SourcePhoto {
    pub(super) path: PathBuf,
    /// Its path relative to the given folder, as a relative path that is safe to write.
    pub(super) name: String,
}

enum SourceKind {
    Photo,
    Video,
    /// An unsupported photo, with the remedy.
    Foreign(&'static str),
    Other,
}

impl CaptureSources {
    /// Finds the photos and videos in `inputs`, which are files or folders.
    ///
    /// # Errors
    ///
    /// A missing file; an unsupported photo format; no photos or videos.
    pub(super) fn find(inputs: &[PathBuf]) -> Result<Self> {
        let mut found = Self::default();
        for input in inputs {
            let meta = std::fs::metadata(input).map_err(|e| Error::unread(input, e))?;
            match meta.is_dir() {
                true => found.add_folder(input, "")?,
                // A device may be a video without an end.
                false if !meta.is_file() => input::open(input, &Limits::DEFAULT).map(drop)?,
                false => {
                    if !found.add(input, safe_name(&file_name(input)))? {
                        let is_zip = input
                            .extension()
                            .is_some_and(|ending| ending.eq_ignore_ascii_case("zip"));
                        let reason = if is_zip {
                            "is a zip archive; unpack it, and give the folder"
                        } else {
                            "is no photo and no video; give JPEG, HEIC, PNG, WebP, TIFF, MP4 or MOV files, or a folder of them"
                        };
                        return Err(Error::unsupported(input, reason));
                    }
                }
            }
        }
        if found.photos.is_empty() && found.videos.is_empty() {
            let input = inputs.first().map_or(Path::new(""), PathBuf::as_path);
            let reason = "holds no photo and no video; give a folder of JPEG, HEIC, PNG, WebP or TIFF files, or a video";
            return Err(Error::unsupported(input, reason));
        }
        if let [first, ..] = &found.again[..] {
            let count = found.again.len();
            let first = first.display();
            found.warnings.push(format!(
                "{count} names are links to files or folders that were taken already, and left out, first {first}"
            ));
        }
        found.photos.sort_by(|a, b| a.name.cmp(&b.name));
        if let Some(pair) = found.photos.windows(2).find(|pair| pair[0].name == pair[1].name) {
            let reason =
                format!("has the name of {}; rename one of the two", pair[0].path.display());
            return Err(Error::unsupported(&pair[1].path, reason));
        }
        Ok(found)
    }

    /// Notes a file or folder; false if it was taken before, under any name.
    fn take(&mut self, path: &Path) -> Result<bool> {
        let full = std::fs::canonicalize(path).map_err(|e| Error::io(path, e))?;
        let is_new = self.taken.insert(full);
        if !is_new {
            self.again.push(path.to_owned());
        }
        Ok(is_new)
    }

    /// Folders below `inputs` that hold photos or videos, and files that are links.
    pub(super) fn places(&self, inputs: &[PathBuf]) -> Vec<PathBuf> {
        let files = || self.photos.iter().map(|photo| &photo.path).chain(&self.videos);
        let folders: BTreeSet<&Path> = files().filter_map(|path| path.parent()).collect();
        let found =
            |folder: &&Path| inputs.iter().any(|input| input.is_dir() && folder.starts_with(input));
        let folders = folders.into_iter().filter(found).map(Path::to_owned);
        folders.chain(files().filter(|path| path.is_symlink()).cloned()).collect()
    }

    /// Refuses fewer photos than `least`, unless there is a video. `input` is named in the error.
    pub(super) fn check_number(&self, least: usize, input: &Path) -> Result<()> {
        let count = self.photos.len();
        if count < least && self.videos.is_empty() {
            let photos = if count == 1 { "1 photo is" } else { &format!("{count} photos are") };
            let reason = format!(
                "{photos} not enough; give {least} or more, better 50 to 300 that overlap (docs/from-photos.md)"
            );
            return Err(Error::unsupported(input, reason));
        }
        Ok(())
    }

    fn add_folder(&mut self, folder: &Path, below: &str) -> Result<()> {
        let io = |e| Error::io(folder, e);
        // A link to a folder around it has no end.
        if !self.take(folder)? {
            return Ok(());
        }
        let entries = std::fs::read_dir(folder).map_err(io)?.collect::<std::io::Result<Vec<_>>>();
        let mut paths: Vec<PathBuf> =
            entries.map_err(io)?.into_iter().map(|entry| entry.path()).collect();
        // Files and folders before links to them, which may have any name.
        paths.sort_by_cached_key(|path| (path.is_symlink(), path.clone()));
        for path in paths {
            let name = file_name(&path);
            // Hidden files and folders of systems and programs.
            if name.starts_with('.') || name == "__MACOSX" {
                continue;
            }
            let name = safe_name(&name);
            let name = if below.is_empty() { name } else { format!("{below}/{name}") };
            if path.is_dir() {
                self.add_folder(&path, &name)?;
            } else if path.is_file() {
                self.add(&path, name)?;
            }
        }
        Ok(())
    }

    /// False for a file that is neither photo nor video.
    fn add(&mut self, path: &Path, name: String) -> Result<bool> {
        match kind(path) {
            SourceKind::Photo | SourceKind::Video if !self.take(path)? => {}
            SourceKind::Photo => self.photos.push(SourcePhoto { path: path.to_owned(), name }),
            SourceKind::Video => self.videos.push(path.to_owned()),
            SourceKind::Foreign(remedy) => return Err(Error::unsupported(path, remedy)),
            SourceKind::Other => return Ok(false),
        }
        Ok(true)
    }
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// The photos and videos at `input`, a file or a folder, including those of kinds that are not
/// read.
pub fn camera_files(input: &Path) -> Vec<PathBuf> {
    let mut files = if input.is_dir() { files_below(input) } else { vec![input.to_owned()] };
    files.retain(|path| is_camera_file(path));
    files
}

/// True for a file name that ends like that of a photo or a video.
pub fn is_camera_file(path: &Path) -> bool {
    !matches!(kind(path), SourceKind::Other)
}

fn kind(path: &Path) -> SourceKind {
    let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let is = |list: &[&str]| list.contains(&ending.as_str());
    if is(&PHOTOS) || is_heic(path) {
        SourceKind::Photo
    } else if is(&VIDEOS) {
        SourceKind::Video
    } else if is(&RAW) {
        SourceKind::Foreign(
            "is a raw photo, which is not read; export JPEG or 16-bit TIFF files with one white balance for all",
        )
    } else {
        SourceKind::Other
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photos_and_videos_are_found_in_folders_and_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir_all(at("in/more")).unwrap();
        for name in ["in/b.JPG", "in/more/a.png", "in/notes.txt", "in/._b.jpg", "in/walk.MOV"] {
            std::fs::write(at(name), "").unwrap();
        }
        let found = CaptureSources::find(&[at("in")]).unwrap();
        let names: Vec<&str> = found.photos.iter().map(|photo| photo.name.as_str()).collect();
        assert_eq!(names, ["b.JPG", "more/a.png"]);
        assert_eq!(found.videos, [at("in/walk.MOV")]);
        std::fs::create_dir(at("other")).unwrap();
        std::fs::write(at("other/b.JPG"), "").unwrap();
        let twice = CaptureSources::find(&[at("in"), at("other")]).unwrap_err().to_string();
        assert!(twice.contains("rename one of the two"), "{twice}");
        let text = CaptureSources::find(&[at("in/notes.txt")]).unwrap_err().to_string();
        assert!(text.contains("notes.txt: is no photo"), "{text}");
        std::fs::write(at("in/IMG_1.NEF"), "").unwrap();
        let raw = CaptureSources::find(&[at("in")]).unwrap_err().to_string();
        assert!(raw.contains("IMG_1.NEF: is a raw photo"), "{raw}");
        std::fs::create_dir(at("empty")).unwrap();
        assert!(
            CaptureSources::find(&[at("empty")])
                .unwrap_err()
                .to_string()
                .contains("holds no photo")
        );
    }

    #[cfg(unix)]
    #[test]
    fn every_photo_is_taken_once_whatever_links_a_folder_holds() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir_all(at("in/more")).unwrap();
        for name in ["in/b.jpg", "in/more/c.jpg"] {
            std::fs::write(at(name), "").unwrap();
        }
        // Two links to the folder itself have no end, one to a file and one to a folder come before
        // what they name.
        for (to, link) in
            [("in", "in/x"), ("in", "in/y"), ("in/b.jpg", "in/a.jpg"), ("in/more", "in/a")]
        {
            symlink(at(to), at(link)).unwrap();
        }
        let found = CaptureSources::find(&[at("in"), at("in/more/c.jpg")]).unwrap();
        let names: Vec<&str> = found.photos.iter().map(|photo| photo.name.as_str()).collect();
        assert_eq!(names, ["b.jpg", "more/c.jpg"]);
        assert!(found.warnings[0].starts_with("5 names are links"), "{:?}", found.warnings);
    }
}
