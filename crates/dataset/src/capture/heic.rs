//! HEIC, as iPhones take photos, and AVIF: an installed program makes JPEG files of them.

use super::log::program;
use super::program::{CaptureOptions, python_script, pythons};
use super::video::FFMPEG;
use crate::exif::PhotoNotes;
use glam::UVec2;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::atomic::{AtomicUsize, Ordering};
use tempfile::TempDir;
use trisplat_scene::image::RgbImage;
use trisplat_scene::process::Running;
use trisplat_scene::{Error, Limits, Result, input};

/// Programs in the order in which they are tried, and the arguments of a conversion; Pythons come
/// before the last.
const WAYS: [(&str, &str); 6] = [
    ("heif-convert", "-q 97 IN OUT"),
    ("heif-dec", "-q 97 IN OUT"),
    ("sips", "-s format jpeg -s formatOptions 97 IN --out OUT"),
    ("magick", "IN -quality 97 OUT"),
    ("convert", "IN -quality 97 OUT"),
    // Older ones read a tile of a photo in place of all.
    (FFMPEG, "-nostdin -v error -i IN -frames:v 1 -update 1 -q:v 2 OUT"),
];
const PYTHON: &str = "-c SCRIPT IN OUT";
const SCRIPT: &str = "import sys, pillow_heif
from PIL import Image
pillow_heif.register_heif_opener()
Image.open(sys.argv[1]).convert('RGB').save(sys.argv[2], quality=97)";
/// Photos that are tried, should the first be broken.
const TRIED: usize = 3;

/// An installed program that reads them.
#[derive(Debug)]
pub(super) struct Converter {
    program: PathBuf,
    words: &'static str,
    /// Folder of its files while this exists.
    folder: TempDir,
    made: AtomicUsize,
}

impl Converter {
    /// The first that converts one of `photos`, with a folder for its files in `folder`.
    ///
    /// # Errors
    ///
    /// None does.
    pub(super) fn find(
        options: &CaptureOptions,
        photos: &[&Path],
        folder: &Path,
    ) -> Result<Option<Self>> {
        let Some(first) = photos.first() else { return Ok(None) };
        let mut ways: Vec<(PathBuf, &str)> = WAYS.map(|(name, words)| (name.into(), words)).into();
        let last = ways.len() - 1;
        ways.splice(last..last, pythons(options).into_iter().map(|python| (python, PYTHON)));
        let mut failures = Vec::new();
        for (program, words) in ways {
            let folder = tempfile::tempdir_in(folder).map_err(Error::temporary)?;
            let converter = Self { program, words, folder, made: AtomicUsize::new(0) };
            for photo in photos.iter().take(TRIED) {
                match converter.try_on(photo) {
                    Ok(()) => return Ok(Some(converter)),
                    // The program is not there.
                    Err(Error::Io { path, .. }) if path == converter.program => break,
                    Err(error) => failures.push(error),
                }
            }
        }
        let failed = failures.first().map_or(String::new(), |error| format!(" (as {error})"));
        let reason = format!(
            "is a HEIC or AVIF photo, and no program that reads it is installed{failed}: `sudo apt install libheif-examples` \
             (Debian, Ubuntu), `brew install libheif` (macOS, whose own `sips` reads them too), `winget install \
             ImageMagick.ImageMagick` (Windows), `pip install pillow-heif` (any system with Python). An iPhone takes JPEG with \
             Settings > Camera > Formats > Most Compatible"
        );
        Err(Error::unsupported(first, reason))
    }

    /// Converts `photo` as a trial.
    fn try_on(&self, photo: &Path) -> Result<()> {
        let converted = self.convert(photo)?;
        let size = RgbImage::size_of(&converted, &Limits::DEFAULT).map_err(|e| e.about(photo))?;
        let notes = PhotoNotes::of(&input::read(photo, &Limits::DEFAULT)?);
        self.check(photo, notes.sensor, size)
    }

    /// A JPEG file of `photo`.
    ///
    /// # Errors
    ///
    /// A photo that the program cannot read, with the program's message.
    pub(super) fn convert(&self, photo: &Path) -> Result<PathBuf> {
        let number = self.made.fetch_add(1, Ordering::Relaxed);
        let at = |ending: &str| self.folder.path().join(format!("{number}.{ending}"));
        // Under a name that no program takes for an option, a pattern, a protocol or another kind.
        let ending = "heic";
        let from = at(ending);
        let to = at("jpg");
        let log = at("log");
        input::copy(photo, &from)?;
        let names = [format!("{number}.{ending}"), format!("{number}.jpg")];
        let mut command = program(&self.program);
        command.args(filled(self.words, names.each_ref().map(String::as_str)));
        command.current_dir(self.folder.path()).stdin(Stdio::null()).stdout(Stdio::null());
        command.stderr(File::create(&log).map_err(|e| Error::io(&log, e))?);
        let ended = Running::start(&mut command).and_then(|mut program| program.wait());
        let status = ended.map_err(|e| Error::io(&self.program, e))?;
        // The next run removes the rest.
        let _ = std::fs::remove_file(from);
        if status.success() && to.is_file() {
            return Ok(to);
        }
        let text = std::fs::read_to_string(&log).unwrap_or_default();
        let said =
            text.lines().rfind(|line| !line.trim().is_empty()).unwrap_or("and says nothing").trim();
        let reason =
            format!("cannot be converted: {} ended with {status}: {said}", self.program.display());
        Err(Error::malformed(photo, "HEIC", reason))
    }

    /// Refuses a picture of `size` of a `photo` that is larger, if this program may read a part
    /// only.
    pub(super) fn check(&self, photo: &Path, whole: Option<UVec2>, size: UVec2) -> Result<()> {
        let is_part = whole.is_some_and(|whole| whole.max_element() > size.max_element());
        if is_part && self.program == Path::new(FFMPEG) {
            let reason = "is read only in part by this ffmpeg; install libheif (`heif-convert`) or a newer ffmpeg";
            return Err(Error::unsupported(photo, reason));
        }
        Ok(())
    }
}

/// Words for a program, with the names of files in its folder.
fn filled(words: &str, [from, to]: [&str; 2]) -> impl Iterator<Item = String> {
    words.split_whitespace().map(move |word| match word {
        "IN" => from.into(),
        "OUT" => to.into(),
        "SCRIPT" => python_script(SCRIPT),
        word => word.into(),
    })
}
