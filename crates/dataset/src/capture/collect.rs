//! The photos step: upright photos in one folder, in file formats that every pose program reads.

use super::heic::Converter;
use super::kind::FileKind;
use super::log::{Log, tell};
use super::program::CaptureOptions;
use super::source::{CaptureSources, SourcePhoto};
use super::video::Ffmpeg;
use crate::exif::{PhotoNotes, with_notes};
use glam::UVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeSet, HashSet};
use std::path::{Path, PathBuf};
use trisplat_scene::atomic::{self, AtomicFolder, FolderLock, safe_name};
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::lists::median;
use trisplat_scene::report::{StageEvent, StageObserver, counted};
use trisplat_scene::{Error, Limits, Result, input, parallel};

/// Folder of the logs, the database and the models, below that of a capture.
pub(super) const WORK: &str = "capture";
/// The list of a capture's photos, below its folder.
const LIST: &str = "capture/photos.json";
/// JPEG quality of re-encoded photos: the loss is smaller than that of a phone's own encoder.
const QUALITY: u8 = 97;
/// Photos between two checks for a stop request.
const CHUNK: usize = 8;

/// Origin of photos.
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

trisplat_scene::stage!(PhotosDetails, "photos");

/// A photo to be collected.
struct OpenedPhoto {
    source: SourcePhoto,
    /// The file of its pixels: its own, or one that another program made of it.
    file: PathBuf,
    notes: PhotoNotes,
    /// Upright.
    size: UVec2,
    /// The conversion it needs.
    change: PhotoChange,
    is_jpeg: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum PhotoChange {
    /// Copy the file unchanged.
    Copied,
    /// Copy the pixels, and write the notes of the photo into the file.
    Noted,
    /// Rotate it and keep its format.
    Turned,
    /// Convert it to PNG.
    Converted,
}

/// The photos of a capture.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TakenPhotos {
    /// Path, size and time of each input.
    pub(super) inputs: Vec<String>,
    /// In order of the video, or of names.
    pub(super) photos: Vec<TakenPhoto>,
    /// Each folder has a camera of its own.
    pub(super) by_folder: bool,
    /// EXIF focal length of the only camera, px.
    pub(super) focal_px: Option<f64>,
    /// Width and height of the only camera's photos.
    pub(super) size: Option<[u32; 2]>,
}

/// A photo of a capture.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct TakenPhoto {
    /// Its path relative to the photo folder.
    pub(super) name: String,
    /// Its source file.
    pub(super) source: String,
    /// True for a video frame.
    pub(super) frame: bool,
}

/// Path, size and time of each input, and the option that decides about frames.
pub(super) fn inputs(sources: &CaptureSources, options: &CaptureOptions) -> Result<Vec<String>> {
    let files = sources.photos.iter().map(|photo| &photo.path).chain(&sources.videos);
    let about = |path: &PathBuf| {
        let io = |e| Error::io(path, e);
        let meta = std::fs::metadata(path).map_err(io)?;
        let full = std::fs::canonicalize(path).map_err(io)?;
        Ok(format!("{}, {} bytes, {:?}", full.display(), meta.len(), meta.modified().ok()))
    };
    let frames = (!sources.videos.is_empty()).then(|| Ok(format!("{} frames", options.frames)));
    files.map(about).chain(frames).collect()
}

/// The photos that an earlier run took from `inputs` into `folder`; `None` for a new or empty
/// folder, and for one that was set aside because of `force`. Says so in `warnings`.
///
/// # Errors
///
/// A folder that holds something else.
pub(super) fn taken_before(
    folder: &Path,
    inputs: &[String],
    force: bool,
    warnings: &mut Vec<String>,
) -> Result<Option<TakenPhotos>> {
    AtomicFolder::recover(folder)?;
    let list = input::read_text(&folder.join(LIST), &Limits::DEFAULT).ok();
    let before: Option<TakenPhotos> = list.and_then(|text| serde_json::from_str(&text).ok());
    let is_there = |photo: &TakenPhoto| folder.join("images").join(&photo.name).is_file();
    if before.is_some() {
        // Removes what a killed run has left, and stops beside one that works.
        drop(FolderLock::take(folder)?);
    }
    match before {
        Some(before) if before.inputs == inputs && before.photos.iter().all(is_there) => {
            Ok(Some(before))
        }
        Some(_) if force => {
            let aside = set_aside(folder)?;
            let folder = folder.display();
            let aside = aside.display();
            warnings.push(format!("the capture that was in {folder} is in {aside} now"));
            Ok(None)
        }
        Some(_) => {
            let wants = "a new folder: this one holds the capture of other inputs, or some of its photos are gone; with `force` it is \
                         set aside";
            Err(Error::invalid("output", folder.display(), wants))
        }
        None if holds_something(folder) => {
            Err(Error::invalid("output", folder.display(), "a new or empty folder"))
        }
        None => Ok(None),
    }
}

/// Renames a folder, to a name that is free.
fn set_aside(folder: &Path) -> Result<PathBuf> {
    let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let numbered = (2..).map(|n| folder.with_file_name(format!("{name}.old-{n}")));
    let mut names = std::iter::once(folder.with_file_name(format!("{name}.old"))).chain(numbered);
    let aside = names.find(|path| !path.exists()).unwrap_or_default();
    std::fs::rename(folder, &aside).map_err(|e| Error::io(folder, e))?;
    Ok(aside)
}

/// True for a folder with more than what killed runs leave.
fn holds_something(folder: &Path) -> bool {
    let counts = |entry: std::io::Result<std::fs::DirEntry>| {
        entry.is_ok_and(|entry| !atomic::is_leftover(&entry.file_name().to_string_lossy()))
    };
    std::fs::read_dir(folder).is_ok_and(|mut entries| entries.any(counts))
}

/// Collects the photos of `sources` in a folder: all of them or none. With `skip_broken` those that
/// cannot be read are left out, which a warning says.
pub(super) fn collect(
    sources: &CaptureSources,
    inputs: Vec<String>,
    (folder, options, skip_broken): (&Path, &CaptureOptions, bool),
    details: &mut PhotosDetails,
    observer: StageObserver<'_>,
) -> Result<(TakenPhotos, Vec<String>)> {
    let made = AtomicFolder::create(folder)?;
    let mut opened = Vec::new();
    let mut broken = Vec::new();
    let heic = sources.photos.iter().filter(|photo| photo.is_heic);
    let heic = heic.map(|photo| photo.path.as_path());
    let converter = Converter::find(options, &heic.collect::<Vec<_>>(), made.path())?;
    let open =
        |photo: &SourcePhoto| Ok(open(photo, converter.as_ref()).map_err(|e| e.about(&photo.path)));
    let read = in_chunks(&sources.photos, observer, "reading photos", open)?;
    for (source, photo) in sources.photos.iter().zip(read) {
        match photo {
            Ok(photo) => opened.push(photo),
            Err(error) => broken.push((source, error)),
        }
    }
    let mut warnings = Vec::from_iter(left_out(&broken, sources, skip_broken)?);
    warnings.extend(leave_out_small(&mut opened));
    let groups: BTreeSet<String> = opened.iter().map(OpenedPhoto::group).collect();
    let by_folder = groups.len() + sources.videos.len() > 1;

    let mut photos = Vec::new();
    for video in &sources.videos {
        let ffmpeg = Ffmpeg::find(video)?;
        let log = &mut Log::open(&made.place(format!("{WORK}/ffmpeg.log"))?)?;
        let below = if by_folder { video_folder(video, &photos, &groups) } else { String::new() };
        let folder = made.place(Path::new("images").join(&below))?;
        let frames = ffmpeg.take(video, &folder, options.frames, log, observer)?;
        if frames.names.is_empty() {
            let reason = "shows one place only: the camera does not move";
            if opened.len() + sources.videos.len() == 1 {
                let reason = format!("{reason}; walk around what is to be captured");
                return Err(Error::unsupported(video, reason));
            }
            warnings.push(format!("{} {reason}, and it is left out", video.display()));
            continue;
        }
        warnings.extend(frames.warning);
        details.video_frames += frames.total;
        details.frames += frames.names.len() as u64;
        photos.extend(frames.names.into_iter().map(|name| TakenPhoto {
            name: if below.is_empty() { name } else { format!("{below}/{name}") },
            source: video.display().to_string(),
            frame: true,
        }));
    }
    let named: Vec<(&OpenedPhoto, String)> =
        opened.iter().zip(distinct(&opened, by_folder)).collect();
    photos.extend(in_chunks(&named, observer, "taking photos", |(photo, name)| {
        photo.save(&made, name)
    })?);
    let count =
        |is: &dyn Fn(&OpenedPhoto) -> bool| opened.iter().filter(|photo| is(photo)).count() as u64;
    details.photos = photos.len() as u64;
    details.turned = count(&|photo| photo.notes.orientation > 1);
    details.converted = count(&OpenedPhoto::is_converted);
    details.cameras = (groups.len() + sources.videos.len()) as u64;
    details.focal_known = count(&|photo| photo.notes.focal_35.is_some());

    let one = opened.first().filter(|_| !by_folder);
    let focal_px = one.and_then(|photo| photo.notes.focal_px(photo.size));
    let size = one.map(|photo| photo.size.to_array());
    let taken = TakenPhotos { inputs, photos, by_folder, focal_px, size };
    let list = made.place(LIST)?;
    let text = serde_json::to_string_pretty(&taken).unwrap_or_default() + "\n";
    std::fs::write(&list, text).map_err(|e| Error::io(&list, e))?;
    drop(converter);
    made.publish(WORK)?;
    Ok((taken, warnings))
}

/// Largest longer side of a small copy, px.
const MAX_SMALL: u32 = 640;
/// Photos are at least this many times as large as small copies of them.
const SMALL_FACTOR: u32 = 4;

/// Leaves out small copies among large photos, as thumbnails and covers are; says so.
fn leave_out_small(photos: &mut Vec<OpenedPhoto>) -> Option<String> {
    let side = |photo: &OpenedPhoto| photo.size.max_element();
    let usual = median(photos.iter().map(side).collect(), u32::cmp)?;
    let is_small =
        |photo: &OpenedPhoto| side(photo) <= MAX_SMALL && SMALL_FACTOR * side(photo) <= usual;
    let first = photos.iter().find(|photo| is_small(photo))?.source.path.display().to_string();
    let before = photos.len();
    photos.retain(|photo| !is_small(photo));
    let count = counted((before - photos.len()) as u64, "small picture");
    Some(format!("{count} among photos of {usual} px left out, first {first}"))
}

/// The warning about `broken` photos, if they are to be skipped and others are left.
fn left_out(
    broken: &[(&SourcePhoto, Error)],
    sources: &CaptureSources,
    skip_broken: bool,
) -> Result<Option<String>> {
    let Some((photo, first)) = broken.first() else { return Ok(None) };
    let count = broken.len();
    let total = sources.photos.len();
    let broken = format!(
        "{count} of {total} photos {}",
        if count == 1 { "is broken" } else { "are broken" }
    );
    if skip_broken && (count < total || !sources.videos.is_empty()) {
        return Ok(Some(format!("{broken} and left out, first {first}")));
    }
    let folder = photo.path.parent().unwrap_or(&photo.path);
    let reason = format!("{first}; {broken}: repair or remove them");
    if count == total && sources.videos.is_empty() {
        return Err(Error::malformed(folder, "photos", reason));
    }
    Err(Error::broken_photos(folder, "photos", &reason))
}

/// Applies `work` to `list` in order, in batches.
fn in_chunks<A: Sync, B: Send>(
    list: &[A],
    observer: StageObserver<'_>,
    what: &str,
    work: impl Fn(&A) -> Result<B> + Sync,
) -> Result<Vec<B>> {
    let mut done = Vec::with_capacity(list.len());
    for chunk in list.chunks(CHUNK) {
        tell(observer, StageEvent::Noted(&format!("{what}: {} of {}", done.len(), list.len())))?;
        tell(observer, StageEvent::Progressed(done.len() as f64 / list.len() as f64))?;
        let part = parallel::map(chunk, |_, item| work(item));
        done.extend(part.into_iter().collect::<Result<Vec<B>>>()?);
    }
    Ok(done)
}

/// Reads a photo's size and EXIF; of a HEIC photo, what the converter makes of it.
fn open(photo: &SourcePhoto, converter: Option<&Converter>) -> Result<OpenedPhoto> {
    let limits = &Limits::DEFAULT;
    let converter = converter.filter(|_| photo.is_heic);
    let mut source = photo.clone();
    let mut file = photo.path.clone();
    if let Some(converter) = converter {
        file = converter.convert(&photo.path)?;
        source.name = with_ending(&photo.name, "jpg");
    }
    let size = RgbImage::size_of(&file, limits)?;
    let bytes = input::read(&file, limits)?;
    let mut notes = PhotoNotes::of(&bytes);
    if let Some(converter) = converter {
        let original = PhotoNotes::of(&input::read(&photo.path, limits)?);
        converter.check(&photo.path, original.sensor, size)?;
        notes = original.of_copy(notes.orientation, size);
    }
    if converter.is_none() && FileKind::of_name(&source.path) == FileKind::Heic {
        source.name = with_ending(&photo.name, if is_jpeg(&bytes) { "jpg" } else { "png" });
    }
    let change = match (notes.orientation, is_plain(&bytes)) {
        (1, true) if converter.is_some() => PhotoChange::Noted,
        (1, true) => PhotoChange::Copied,
        (_, true) => PhotoChange::Turned,
        (_, false) => PhotoChange::Converted,
    };
    let size = if notes.orientation >= 5 { UVec2::new(size.y, size.x) } else { size };
    Ok(OpenedPhoto { source, file, notes, size, change, is_jpeg: is_jpeg(&bytes) })
}

fn with_ending(name: &str, ending: &str) -> String {
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    format!("{stem}.{ending}")
}

fn is_jpeg(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0xff, 0xd8])
}

/// True for files that every program reads alike: JPEG with one or three channels, 8-bit PNG.
fn is_plain(bytes: &[u8]) -> bool {
    const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";
    /// Byte offset of a PNG's bit depth.
    const PNG_BITS: usize = 24;
    if is_jpeg(bytes) {
        let mut decoder = jpeg_decoder::Decoder::new(bytes);
        let format =
            decoder.read_info().ok().and_then(|()| decoder.info()).map(|info| info.pixel_format);
        matches!(format, Some(jpeg_decoder::PixelFormat::RGB24 | jpeg_decoder::PixelFormat::L8))
    } else {
        bytes.starts_with(PNG) && bytes.get(PNG_BITS) == Some(&8)
    }
}

impl OpenedPhoto {
    /// True if it gets another file format.
    fn is_converted(&self) -> bool {
        self.change == PhotoChange::Converted || self.file != self.source.path
    }

    /// Folder of its camera: photos of the same size and focal length share one.
    fn group(&self) -> String {
        let UVec2 { x, y } = self.size;
        match self.notes.focal_35 {
            Some(focal) => format!("{x}x{y}-{focal:.0}mm"),
            None => format!("{x}x{y}"),
        }
    }

    /// Its `rank`th choice of a name, from 0.
    fn choice(&self, by_folder: bool, rank: usize) -> String {
        let below = if by_folder { self.group() + "/" } else { String::new() };
        let name = below + &self.source.name;
        let dot = name.rfind('.').filter(|dot| !name[*dot..].contains('/')).unwrap_or(name.len());
        let (stem, ending) = name.split_at(dot);
        match (self.change == PhotoChange::Converted, rank) {
            (false, 0) => name,
            (false, _) => format!("{stem}-{}{ending}", rank + 1),
            (true, 0) => format!("{stem}.png"),
            (true, 1) => format!("{name}.png"),
            (true, _) => format!("{name}-{rank}.png"),
        }
    }

    /// Writes it into the photos of `folder` as `name`.
    fn save(&self, folder: &AtomicFolder, name: &str) -> Result<TakenPhoto> {
        let from = &self.file;
        let unread = |e: Error| e.about(&self.source.path);
        let to = folder.place(Path::new("images").join(name))?;
        let io = |e| Error::io(&to, e);
        match self.change {
            PhotoChange::Copied => input::copy(from, &to)?,
            PhotoChange::Noted => {
                let bytes = input::read(from, &Limits::DEFAULT).map_err(unread)?;
                std::fs::write(&to, with_notes(&bytes, &self.notes.upright())).map_err(io)?;
            }
            PhotoChange::Turned | PhotoChange::Converted => {
                let picture = RgbImage::load(from).map_err(unread)?.turned(self.notes.orientation);
                let bytes = if self.change == PhotoChange::Turned && self.is_jpeg {
                    with_notes(&picture.to_jpeg(QUALITY)?, &self.notes.upright())
                } else {
                    picture.to_png()?
                };
                std::fs::write(&to, bytes).map_err(io)?;
            }
        }
        let source = self.source.path.display().to_string();
        Ok(TakenPhoto { name: name.to_owned(), source, frame: false })
    }
}

/// Names of `photos` that differ, also where upper and lower case are one. Photos that keep their
/// format choose first.
fn distinct(photos: &[OpenedPhoto], by_folder: bool) -> Vec<String> {
    let mut taken = HashSet::new();
    let mut names = vec![String::new(); photos.len()];
    for converted in [false, true] {
        for (photo, name) in photos.iter().zip(&mut names) {
            if photo.is_converted() == converted {
                let mut choices = (0..).map(|rank| photo.choice(by_folder, rank));
                *name = choices.find(|name| taken.insert(name.to_lowercase())).unwrap_or_default();
            }
        }
    }
    names
}

/// Folder name for a video's frames: no other video has it, also where upper and lower case are
/// one, and none of the photos' `groups`.
fn video_folder(video: &Path, before: &[TakenPhoto], groups: &BTreeSet<String>) -> String {
    // A list of pairs separates names by spaces.
    let stem =
        video.file_stem().unwrap_or_default().to_string_lossy().replace(char::is_whitespace, "_");
    let stem = safe_name(&stem);
    let taken = |name: &str| {
        let name = name.to_lowercase();
        let has = |photo: &TakenPhoto| photo.name.to_lowercase().starts_with(&format!("{name}/"));
        groups.contains(&name) || before.iter().any(has)
    };
    let numbered = (2..).map(|n| format!("{stem}-{n}"));
    std::iter::once(stem.clone()).chain(numbered).find(|name| !taken(name)).unwrap_or(stem)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ops::ControlFlow;

    #[test]
    fn capture_gives_photos_of_one_stem_distinct_names() {
        let photos = ["A.png", "a.PNG", "b-2.PNG", "a.jpg", "a.webp", "a.tif", "b.c/d.tif"];
        let opened = photos.map(|name| OpenedPhoto {
            source: SourcePhoto { path: PathBuf::new(), name: name.to_owned(), is_heic: false },
            file: PathBuf::new(),
            notes: PhotoNotes::default(),
            size: UVec2::ONE,
            change: if name.contains('w') || name.contains('f') {
                PhotoChange::Converted
            } else {
                PhotoChange::Copied
            },
            is_jpeg: false,
        });
        let names = distinct(&opened, false);
        assert_eq!(
            names,
            ["A.png", "a-2.PNG", "b-2.PNG", "a.jpg", "a.webp.png", "a.tif.png", "b.c/d.png"]
        );
    }

    #[test]
    fn small_copies_among_large_photos_are_left_out() {
        let photo = |side: u32| OpenedPhoto {
            source: SourcePhoto {
                path: PathBuf::from(format!("{side}.jpg")),
                name: String::new(),
                is_heic: false,
            },
            file: PathBuf::new(),
            notes: PhotoNotes::default(),
            size: UVec2::new(side / 2, side),
            change: PhotoChange::Copied,
            is_jpeg: true,
        };
        let mut photos = [4000, 160, 3000, 1000, 4000, 640].map(photo).into();
        let warning = leave_out_small(&mut photos).unwrap();
        assert!(
            warning.contains("2 small pictures among photos of") && warning.contains("160.jpg")
        );
        assert_eq!(photos.len(), 4);
        assert_eq!(
            leave_out_small(&mut [640, 700, 160].map(photo).into()),
            Some("1 small picture among photos of 640 px left out, first 160.jpg".into())
        );
        assert_eq!(leave_out_small(&mut [640, 600, 200].map(photo).into()), None);
    }

    #[test]
    fn a_broken_photo_is_left_out_if_that_is_wanted() {
        let folder = tempfile::tempdir().unwrap();
        let photos = folder.path().join("photos");
        std::fs::create_dir(&photos).unwrap();
        let picture =
            RgbImage { size: UVec2::splat(64), rgb: vec![[200, 90, 30]; 64 * 64], alpha: None };
        let jpeg = picture.to_jpeg(90).unwrap();
        for (name, bytes) in
            [("a.jpg", &jpeg[..]), ("b.jpg", &jpeg[..jpeg.len() / 2]), ("c.jpg", &[])]
        {
            std::fs::write(photos.join(name), bytes).unwrap();
        }
        let sources = CaptureSources::find(std::slice::from_ref(&photos)).unwrap();
        let out = folder.path().join("out");
        let options = CaptureOptions::default();
        let taken = |skip_broken: bool| {
            let how = (out.as_path(), &options, skip_broken);
            collect(&sources, Vec::new(), how, &mut PhotosDetails::default(), &mut |_| {
                ControlFlow::Continue(())
            })
        };
        let error = taken(false).unwrap_err().to_string();
        assert!(
            error.contains("b.jpg") && error.contains("2 of 3") && error.contains("`skip_broken`"),
            "{error}"
        );
        let (taken, warning) = taken(true).unwrap();
        assert_eq!((taken.photos.len(), taken.photos[0].name.as_str()), (1, "a.jpg"));
        assert!(warning[0].contains("2 of 3 photos are broken and left out"), "{warning:?}");
    }

    #[test]
    fn no_video_shares_a_folder_with_another_or_with_photos() {
        let before = TakenPhoto { name: "Walk/frame_000001.jpg".into(), ..TakenPhoto::default() };
        let groups = BTreeSet::from(["640x480".to_owned()]);
        let folder =
            |video: &str| video_folder(Path::new(video), std::slice::from_ref(&before), &groups);
        assert_eq!(
            ["b/walk.mov", "640x480.mp4", "c.mp4"].map(folder),
            ["walk-2", "640x480-2", "c"]
        );
        assert_eq!(["...mp4", "a\\..\\b c.mov", "-x.mp4"].map(folder), ["_", "a_.._b_c", "_x"]);
    }
}
