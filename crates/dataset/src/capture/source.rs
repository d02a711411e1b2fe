//! Inputs of a capture: photos and videos, given as files or folders, without what phones, cameras
//! and programs put beside them.

use super::kind::{FileKind, video_seconds};
use crate::listing::is_beside_photos;
use std::collections::{BTreeSet, HashSet};
use std::path::{Path, PathBuf};
use trisplat_scene::atomic::safe_name;
use trisplat_scene::input::{self, files_below};
use trisplat_scene::report::counted;
use trisplat_scene::{Error, Limits, Result};

/// Longest clip of a Live Photo, seconds: phones record three.
const MAX_CLIP_SECONDS: f64 = 4.0;
/// Fewer photos are no capture, but covers of videos.
const MIN_PHOTOS: usize = 3;

/// Photos and videos, sorted by name.
#[derive(Debug, Default, PartialEq)]
pub(super) struct CaptureSources {
    pub(super) photos: Vec<SourcePhoto>,
    pub(super) videos: Vec<PathBuf>,
    raws: Vec<PathBuf>,
    /// Photos in folders of small copies.
    copies: Vec<PathBuf>,
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
    /// True for HEIC or AVIF, which another program reads.
    pub(super) is_heic: bool,
}

/// Endings of scenes, which have no photos to find poses of.
const SCENE_ENDINGS: [&str; 10] =
    ["ply", "splat", "spz", "sog", "glb", "gltf", "obj", "off", "pt", "html"];

/// Why a file is not taken, and what to do with it.
fn reason_to_refuse(input: &Path) -> &'static str {
    let ending = input.extension().unwrap_or_default().to_ascii_lowercase();
    if ending == "zip" {
        "is a zip archive; unpack it, and give the folder"
    } else if SCENE_ENDINGS.iter().any(|scene| ending == *scene) {
        "is no photo and no video; `trisplat bake` makes a file for an engine of a scene"
    } else {
        "is no photo and no video; give JPEG, HEIC, PNG, WebP, TIFF, MP4 or MOV files, or a folder of them"
    }
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
                        return Err(Error::unsupported(input, reason_to_refuse(input)));
                    }
                }
            }
        }
        found.leave_out_companions()?;
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
            if name.starts_with('.') {
                continue;
            }
            if is_beside_photos(&name) && path.is_dir() {
                self.copies.extend(camera_files(&path));
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
        match FileKind::of(path) {
            FileKind::Other => return Ok(false),
            _ if !self.take(path)? => {}
            kind @ (FileKind::Photo | FileKind::Heic) => {
                let is_heic = kind == FileKind::Heic;
                self.photos.push(SourcePhoto { path: path.to_owned(), name, is_heic });
            }
            FileKind::Video => self.videos.push(path.to_owned()),
            FileKind::Raw => self.raws.push(path.to_owned()),
        }
        Ok(true)
    }

    /// Leaves out what belongs to photos: the clips of Live Photos, raw files and small copies; and
    /// covers of videos.
    ///
    /// # Errors
    ///
    /// A raw photo that is not there in another format.
    fn leave_out_companions(&mut self) -> Result<()> {
        let names: HashSet<String> = self.photos.iter().map(|photo| stem_of(&photo.path)).collect();
        let is_beside = |path: &Path| names.contains(&stem_of(path));
        let is_clip = |path: &PathBuf| {
            names.len() >= MIN_PHOTOS
                && is_beside(path)
                && video_seconds(path).is_some_and(|seconds| seconds <= MAX_CLIP_SECONDS)
        };
        let (clips, videos): (Vec<_>, Vec<_>) =
            std::mem::take(&mut self.videos).into_iter().partition(is_clip);
        self.videos = videos;
        let videos: HashSet<String> = self.videos.iter().map(|path| stem_of(path)).collect();
        let is_cover = |photo: &SourcePhoto| videos.contains(&stem_of(&photo.path));
        let (covers, photos): (Vec<_>, Vec<_>) =
            std::mem::take(&mut self.photos).into_iter().partition(is_cover);
        self.photos = photos;
        let covers: Vec<PathBuf> = covers.into_iter().map(|photo| photo.path).collect();
        // Cameras may write both kinds into folders of their own.
        let stem = |path: &Path| stem_of(Path::new(path.file_name().unwrap_or_default()));
        let stems: HashSet<String> = self.photos.iter().map(|photo| stem(&photo.path)).collect();
        if let Some(alone) = self.raws.iter().find(|raw| !stems.contains(&stem(raw))) {
            let reason = "is a raw photo, which is not read; export JPEG or 16-bit TIFF files with one white balance for all";
            return Err(Error::unsupported(alone, reason));
        }
        let lines = [
            left_out(&clips, "clip", "of photos of the same name"),
            left_out(&covers, "cover", "of videos of the same name"),
            left_out(&self.raws, "raw file", "of photos of the same name"),
            left_out(&self.copies, "picture", "in folders of small copies, masks or depths"),
        ];
        self.warnings.extend(lines.into_iter().flatten());
        Ok(())
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
    FileKind::of_name(path) != FileKind::Other
}

/// A path without its extension, in lower case.
fn stem_of(path: &Path) -> String {
    path.with_extension("").to_string_lossy().to_lowercase()
}

/// The line about files that are left out; `None` without any.
fn left_out(files: &[PathBuf], noun: &str, what: &str) -> Option<String> {
    let count = counted(files.len() as u64, noun);
    Some(format!("{count} {what} left out, first {}", files.first()?.display()))
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

    /// A MOV file that lasts as long.
    fn movie(seconds: u32) -> Vec<u8> {
        let part = |name: &[u8; 4], content: &[u8]| {
            [&(8 + content.len() as u32).to_be_bytes()[..], name, content].concat()
        };
        let times = [0, 0, 600, 600 * seconds].map(u32::to_be_bytes).concat();
        let header = part(b"mvhd", &[&[0; 4], &times[..], &[0; 80]].concat());
        [part(b"ftyp", b"qt  \0\0\0\0"), part(b"mdat", &[7; 99]), part(b"moov", &header)].concat()
    }

    #[test]
    fn companions_of_photos_and_videos_are_left_out() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let write = |name: &str, bytes: &[u8]| {
            std::fs::create_dir_all(at(name).parent().unwrap()).unwrap();
            std::fs::write(at(name), bytes).unwrap();
        };
        for i in 0..4 {
            write(&format!("in/IMG_{i}.JPG"), b"");
            write(&format!("in/img_{i}.mov"), &movie(3));
            write(&format!("in/RAW/IMG_{i}.DNG"), b"");
            write(&format!("in/@eaDir/IMG_{i}.JPG/SYNOPHOTO_THUMB_M.jpg"), b"");
        }
        write("in/IMG_9.MOV", &movie(2));
        write("in/walk.MP4", &movie(60));
        write("in/walk.jpg", b"");
        write("in/Thumbs/IMG_0.jpg", b"");
        let found = CaptureSources::find(&[at("in")]).unwrap();
        assert_eq!(found.photos.len(), 4, "{:?}", found.photos);
        assert_eq!(found.videos, [at("in/IMG_9.MOV"), at("in/walk.MP4")]);
        let lines = ["4 clips", "1 cover of videos", "4 raw files", "5 pictures in folders"];
        for (line, warning) in lines.iter().zip(&found.warnings) {
            assert!(warning.starts_with(line) && warning.contains("first"), "{warning}");
        }
        assert_eq!(found.warnings.len(), lines.len(), "{:?}", found.warnings);
        // A video is not the clip of its cover.
        write("one/scan.mov", &movie(3));
        write("one/scan.jpg", b"");
        let found = CaptureSources::find(&[at("one")]).unwrap();
        assert_eq!((found.photos.len(), found.videos.len()), (0, 1));
        write("in/RAW/IMG_7.DNG", b"");
        let error = CaptureSources::find(&[at("in")]).unwrap_err().to_string();
        assert!(error.contains("IMG_7.DNG: is a raw photo"), "{error}");
    }

    #[test]
    fn first_bytes_decide_the_kind_of_a_camera_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let heic = b"\0\0\0\x18ftypheic\0\0\0\0";
        let jpeg = b"\xff\xd8\xff\xe0\0\x10JFIF\0\x01\x02";
        for (name, bytes, kind) in [
            ("a.JPG", &heic[..], FileKind::Heic),
            ("b.heic", jpeg, FileKind::Photo),
            ("c.png", b"\0\0\0\x18ftypavif\0\0\0\0", FileKind::Heic),
            ("d.jpg", &movie(1), FileKind::Video),
            ("e.mov", heic, FileKind::Heic),
            ("f.HEIC", b"", FileKind::Heic),
            ("g.mp4", b"?", FileKind::Video),
            ("h.nef", jpeg, FileKind::Raw),
            ("i.txt", jpeg, FileKind::Other),
        ] {
            std::fs::write(path(name), bytes).unwrap();
            assert_eq!(FileKind::of(&path(name)), kind, "{name}");
        }
        std::fs::write(path("long.mov"), movie(125)).unwrap();
        assert_eq!(video_seconds(&path("long.mov")), Some(125.0));
        assert_eq!(video_seconds(&path("a.JPG")), None);
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
