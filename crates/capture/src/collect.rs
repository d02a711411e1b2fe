//! The first step: collects upright photos in one folder, in file formats that every pose program reads.

use super::exif::{PhotoNotes, with_notes};
use super::folder::CaptureFolder;
use super::logged::Log;
use super::names::{Wanted, distinct};
use super::options::CaptureOptions;
use super::source::{SourcePhoto, Sources};
use super::step::{Step, tell};
use super::stored::{self, StoredPhoto, StoredPhotos, WORK};
use super::video::Ffmpeg;
use glam::UVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::Path;
use std::time::UNIX_EPOCH;
use trisplat_scene::parallel;
use trisplat_scene::{
    Error, Limits, Result,
    image::RgbImage,
    input,
    report::{StageDetails, StageEvent, StageObserver},
};
use xxhash_rust::xxh3::xxh3_64;

/// JPEG quality of re-encoded photos: the loss is smaller than that of a phone's own encoder.
const QUALITY: u8 = 97;
/// Photos between two checks for a stop request.
const CHUNK: usize = 8;

/// Where photos came from.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct PhotosDetails {
    /// Number of photos in the folder.
    pub photos: u64,
    /// Number of these that are video frames.
    pub frames: u64,
    /// Total number of frames in the videos.
    pub video_frames: u64,
    /// Photos that were turned upright.
    pub turned: u64,
    /// Photos that were converted to another file format.
    pub converted: u64,
    /// Number of cameras, told apart by photo size and EXIF focal length.
    pub cameras: u64,
    /// Photos with a focal length in EXIF.
    pub focal_known: u64,
}

impl StageDetails for PhotosDetails {
    const STAGE: &'static str = "photos";
}

/// A photo to be collected.
struct Opened {
    source: SourcePhoto,
    notes: PhotoNotes,
    /// Upright.
    size: UVec2,
    /// The conversion it needs.
    change: Change,
    is_jpeg: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Change {
    /// Copy the file unchanged.
    Copied,
    /// Rotate it and keep its format.
    Turned,
    /// Convert it to PNG.
    Converted,
}

/// A key of `sources` and options: the same key gives the same photos.
pub(super) fn key(sources: &Sources, options: &CaptureOptions) -> Result<String> {
    let mut text = format!("photos 1 {}\n", if sources.videos.is_empty() { 0 } else { options.frames });
    for path in sources.photos.iter().map(|photo| &photo.path).chain(&sources.videos) {
        let meta = std::fs::metadata(path).map_err(|e| Error::io(path, e))?;
        let modified = meta.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
        let full = std::fs::canonicalize(path).map_err(|e| Error::io(path, e))?;
        text += &format!("{} {} {:?}\n", full.display(), meta.len(), modified);
    }
    Ok(format!("{:016x}", xxh3_64(text.as_bytes())))
}

/// Collects the photos of `sources` in `folder`: all of them or none.
pub(super) fn collect(
    sources: &Sources,
    folder: &mut CaptureFolder,
    options: &CaptureOptions,
    key: &str,
    details: &mut PhotosDetails,
    observer: StageObserver<'_>,
) -> Step<StoredPhotos> {
    let made = folder.make()?;
    let images = made.path().join("images");
    let work = made.path().join(WORK);
    std::fs::create_dir_all(&work).map_err(|e| Error::io(&work, e))?;
    let opened = in_chunks(&sources.photos, observer, "reading photos", open)?;
    let groups: BTreeSet<String> = opened.iter().map(Opened::group).collect();
    let by_folder = groups.len() + sources.videos.len() > 1;

    let mut photos = Vec::new();
    let mut log = Log::open(&work.join("ffmpeg.log"))?;
    for video in &sources.videos {
        let ffmpeg = Ffmpeg::find(video)?;
        let below = if by_folder { video_folder(video, &photos, &groups) } else { String::new() };
        let (names, frames) = ffmpeg.take(video, &images.join(&below), options.frames, &mut log, observer)?;
        details.video_frames += frames;
        details.frames += names.len() as u64;
        let source = video.display().to_string();
        photos.extend(names.into_iter().map(|name| StoredPhoto {
            name: if below.is_empty() { name } else { format!("{below}/{name}") },
            source: source.clone(),
            frame: true,
            exposure_stops: None,
        }));
    }
    drop(log);
    if sources.videos.is_empty() {
        let unused = work.join("ffmpeg.log");
        std::fs::remove_file(&unused).map_err(|e| Error::io(&unused, e))?;
    }
    let wanted: Vec<Wanted> = opened.iter().map(|photo| photo.wanted(by_folder)).collect();
    let named: Vec<(&Opened, String)> = opened.iter().zip(distinct(&wanted)).collect();
    photos.extend(in_chunks(&named, observer, "taking photos", |(photo, name)| photo.save(&images, name))?);
    let count = |is: &dyn Fn(&Opened) -> bool| opened.iter().filter(|photo| is(photo)).count() as u64;
    details.photos = photos.len() as u64;
    details.turned = count(&|photo| photo.notes.orientation > 1);
    details.converted = count(&|photo| photo.change == Change::Converted);
    details.cameras = (groups.len() + sources.videos.len()) as u64;
    details.focal_known = count(&|photo| photo.notes.focal_35.is_some());

    let one = opened.first().filter(|_| !by_folder);
    let stored = StoredPhotos {
        key: key.to_owned(),
        photos,
        by_folder,
        focal_px: one.and_then(|photo| photo.notes.focal_px(photo.size)),
        size: one.map(|photo| photo.size.to_array()),
    };
    stored::write(&work.join("photos.json"), &stored)?;
    folder.manifest.publish(made, "images/", WORK)?;
    Ok(stored)
}

/// Applies `work` to `list` in order, in batches.
fn in_chunks<A: Sync, B: Send>(
    list: &[A],
    observer: StageObserver<'_>,
    what: &str,
    work: impl Fn(&A) -> Result<B> + Sync,
) -> Step<Vec<B>> {
    let mut done = Vec::with_capacity(list.len());
    for chunk in list.chunks(CHUNK) {
        tell(observer, StageEvent::Noted(&format!("{what}: {} of {}", done.len(), list.len())))?;
        tell(observer, StageEvent::Progressed(done.len() as f64 / list.len() as f64))?;
        let part = parallel::map(chunk, |_, item| work(item));
        done.extend(part.into_iter().collect::<Result<Vec<B>>>()?);
    }
    Ok(done)
}

/// Reads a photo's size and EXIF.
fn open(source: &SourcePhoto) -> Result<Opened> {
    let limits = &Limits::DEFAULT;
    let size = RgbImage::size_of(&source.path, limits)?;
    let bytes = input::read(&source.path, limits)?;
    let notes = PhotoNotes::of(&bytes);
    let change = match (notes.orientation, is_plain(&bytes)) {
        (1, true) => Change::Copied,
        (_, true) => Change::Turned,
        (_, false) => Change::Converted,
    };
    let size = if notes.orientation >= 5 { UVec2::new(size.y, size.x) } else { size };
    Ok(Opened { source: source.clone(), notes, size, change, is_jpeg: is_jpeg(&bytes) })
}

fn is_jpeg(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0xff, 0xd8])
}

/// True for files that every program reads alike: JPEG with one or three channels, 8-bit PNG.
fn is_plain(bytes: &[u8]) -> bool {
    const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";
    /// Byte offset of a PNG's bit depth.
    const PNG_BITS: usize = 24;
    match is_jpeg(bytes) {
        true => {
            let mut decoder = jpeg_decoder::Decoder::new(bytes);
            let format = decoder.read_info().ok().and_then(|()| decoder.info()).map(|info| info.pixel_format);
            matches!(format, Some(jpeg_decoder::PixelFormat::RGB24 | jpeg_decoder::PixelFormat::L8))
        }
        false => bytes.starts_with(PNG) && bytes.get(PNG_BITS) == Some(&8),
    }
}

impl Opened {
    /// Folder of its camera: photos of the same size and focal length share one.
    fn group(&self) -> String {
        let UVec2 { x, y } = self.size;
        match self.notes.focal_35 {
            Some(focal) => format!("{x}x{y}-{focal:.0}mm"),
            None => format!("{x}x{y}"),
        }
    }

    /// The name it is to have.
    fn wanted(&self, by_folder: bool) -> Wanted {
        let below = if by_folder { self.group() + "/" } else { String::new() };
        Wanted { name: below + &self.source.name, to_png: self.change == Change::Converted }
    }

    /// Writes it into `images` as `name`.
    fn save(&self, images: &Path, name: &str) -> Result<StoredPhoto> {
        let from = &self.source.path;
        let to = images.join(name);
        let io = |e| Error::io(&to, e);
        let folder = to.parent().unwrap_or(images);
        std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
        match self.change {
            Change::Copied => input::copy(from, &to)?,
            Change::Turned | Change::Converted => {
                let picture = RgbImage::load(from)?.turned(self.notes.orientation);
                let bytes = match self.change == Change::Turned && self.is_jpeg {
                    true => with_notes(&picture.to_jpeg(QUALITY)?, &self.notes.upright()),
                    false => picture.to_png()?,
                };
                std::fs::write(&to, bytes).map_err(io)?;
            }
        }
        let (source, exposure_stops) = (from.display().to_string(), self.notes.exposure_stops);
        Ok(StoredPhoto { name: name.to_owned(), source, frame: false, exposure_stops })
    }
}

/// Folder name for a video's frames: no other video has it, also where upper and lower case are one, and none of the photos' `groups`.
fn video_folder(video: &Path, before: &[StoredPhoto], groups: &BTreeSet<String>) -> String {
    let stem = video.file_stem().unwrap_or_default().to_string_lossy().replace(['/', '\\'], "_");
    let taken = |name: &str| {
        let name = name.to_lowercase();
        let has = |photo: &StoredPhoto| photo.name.to_lowercase().starts_with(&format!("{name}/"));
        groups.contains(&name) || before.iter().any(has)
    };
    let numbered = (2..).map(|n| format!("{stem}-{n}"));
    std::iter::once(stem.clone()).chain(numbered).find(|name| !taken(name)).unwrap_or(stem)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_video_shares_a_folder_with_another_or_with_photos() {
        let before = StoredPhoto { name: "Walk/frame_000001.jpg".into(), ..StoredPhoto::default() };
        let groups = BTreeSet::from(["640x480".to_owned()]);
        let folder = |video: &str| video_folder(Path::new(video), std::slice::from_ref(&before), &groups);
        assert_eq!(["b/walk.mov", "640x480.mp4", "c.mp4"].map(folder), ["walk-2", "640x480-2", "c"]);
    }
}
