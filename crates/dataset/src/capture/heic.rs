//! HEIC, as iPhones take photos, and AVIF: an installed program makes JPEG files of them.

use super::program::{CaptureOptions, pythons, said};
use super::video::plain_path;
use std::ffi::OsString;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use trisplat_scene::process::Running;
use trisplat_scene::{Error, Result};

const ENDINGS: [&str; 4] = ["heic", "heif", "hif", "avif"];

/// What a program is asked first, what its answer contains, and the words of a conversion.
type Way = (&'static str, &'static [&'static str], &'static str, &'static [&'static str]);
/// Programs in the order in which they are tried; pillow_heif comes before the last.
const WAYS: [Way; 6] = [
    ("heif-convert", &[], "", &["-q", "97", "IN", "OUT"]),
    ("heif-dec", &[], "", &["-q", "97", "IN", "OUT"]),
    (
        "sips",
        &["--help"],
        "sips",
        &["-s", "format", "jpeg", "-s", "formatOptions", "97", "IN", "--out", "OUT"],
    ),
    ("magick", &["-version"], "heic", &["IN", "-quality", "97", "OUT"]),
    ("convert", &["-version"], "heic", &["IN", "-quality", "97", "OUT"]),
    (
        FFMPEG,
        &["-version"],
        FFMPEG,
        &["-v", "error", "-i", "IN", "-frames:v", "1", "-update", "1", "-q:v", "2", "OUT"],
    ),
];
/// Older ones read a tile of a photo in place of all.
const FFMPEG: &str = "ffmpeg";
/// Probes, or converts, with pillow_heif.
const PYTHON: &str = "import sys, pillow_heif
from PIL import Image
pillow_heif.register_heif_opener()
if sys.argv[1:]:
    Image.open(sys.argv[1]).convert('RGB').save(sys.argv[2], quality=97)
print('pillow_heif')";

/// Whether a photo of this name needs another program.
pub(super) fn is_heic(path: &Path) -> bool {
    let ending = path.extension().unwrap_or_default();
    ENDINGS.iter().any(|known| ending.eq_ignore_ascii_case(known))
}

/// An installed program that reads them, and its words.
#[derive(Debug)]
pub(super) struct Converter {
    program: PathBuf,
    words: Vec<&'static str>,
}

impl Converter {
    /// The first that is installed. `photo` is named in the error.
    ///
    /// Errors: none is.
    pub(super) fn find(options: &CaptureOptions, photo: &Path) -> Result<Self> {
        let ways = WAYS.map(|(name, probe, answer, words)| (PathBuf::from(name), probe, answer, words));
        let (last, first) = ways.split_last().ok_or_else(|| Self::missing(photo))?;
        let python = |path| (path, &["-c", PYTHON][..], "pillow_heif", &["-c", PYTHON, "IN", "OUT"][..]);
        let mut all =
            first.iter().cloned().chain(pythons(options).into_iter().map(python)).chain([last.clone()]);
        let is_there = |(program, probe, answer, _): &(PathBuf, &[&str], &str, &[&str])| {
            said(Command::new(program).args(*probe)).is_some_and(|text| text.contains(answer))
        };
        let found = all.find(is_there).map(|(program, .., words)| Self { program, words: words.to_vec() });
        found.ok_or_else(|| Self::missing(photo))
    }

    fn missing(photo: &Path) -> Error {
        let reason = "is a HEIC or AVIF photo, and no program that reads them is installed: `sudo apt install libheif-examples` (Debian, \
                      Ubuntu), `brew install libheif` (macOS, whose own `sips` reads them too), `winget install ImageMagick.ImageMagick` \
                      (Windows), `pip install pillow-heif` (any system with Python). An iPhone takes JPEG with Settings > Camera > Formats > \
                      Most Compatible";
        Error::unsupported(photo, reason)
    }

    /// Makes the JPEG file `to` of `photo`.
    ///
    /// Errors: what the program says of a photo that it cannot read.
    pub(super) fn convert(&self, photo: &Path, to: &Path) -> Result<()> {
        let io = |e| Error::io(to, e);
        let log = to.with_extension("log");
        let word = |word: &&str| match *word {
            "IN" => plain_path(photo),
            "OUT" => to.into(),
            word => OsString::from(word),
        };
        let mut command = Command::new(&self.program);
        command.args(self.words.iter().map(word)).stdin(Stdio::null()).stdout(Stdio::null());
        command.stderr(File::create(&log).map_err(io)?);
        let ended = Running::start(&mut command).and_then(|mut program| program.wait());
        let status = ended.map_err(|e| Error::io(&self.program, e))?;
        if status.success() && to.is_file() {
            return Ok(());
        }
        let text = std::fs::read_to_string(&log).unwrap_or_default();
        let said = text.lines().rfind(|line| !line.trim().is_empty()).unwrap_or("and says nothing").trim();
        let reason = format!("cannot be converted: {} ended with {status}: {said}", self.program.display());
        Err(Error::malformed(photo, "HEIC", reason))
    }

    /// Whether it may read a part of a photo only.
    pub(super) fn reads_tiles(&self) -> bool {
        self.program == Path::new(FFMPEG)
    }
}
