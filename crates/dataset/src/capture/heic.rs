//! HEIC, as iPhones take photos, and AVIF: an installed program makes JPEG files of them.

use super::log::{program, said};
use super::program::{CaptureOptions, python_script, pythons};
use super::video::FFMPEG;
use glam::UVec2;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::atomic::{AtomicUsize, Ordering};
use tempfile::TempDir;
use trisplat_scene::process::Running;
use trisplat_scene::{Error, Result, input};

const ENDINGS: [&str; 4] = ["heic", "heif", "hif", "avif"];

/// First question to a program, a part of its answer, and the arguments of a conversion.
type Way = [&'static str; 3];
/// Programs in the order in which they are tried; Pythons come before the last.
const WAYS: [(&str, Way); 6] = [
    ("heif-convert", ["", "", "-q 97 IN OUT"]),
    ("heif-dec", ["", "", "-q 97 IN OUT"]),
    ("sips", ["--help", "sips", "-s format jpeg -s formatOptions 97 IN --out OUT"]),
    ("magick", ["-version", "heic", "IN -quality 97 OUT"]),
    ("convert", ["-version", "heic", "IN -quality 97 OUT"]),
    // Older ones read a tile of a photo in place of all.
    (FFMPEG, ["-version", FFMPEG, "-v error -i IN -frames:v 1 -update 1 -q:v 2 OUT"]),
];
const PYTHON: Way = ["-c SCRIPT", "ready for HEIC", "-c SCRIPT IN OUT"];
const SCRIPT: &str = "import sys, pillow_heif
from PIL import Image
pillow_heif.register_heif_opener()
if sys.argv[1:]:
    Image.open(sys.argv[1]).convert('RGB').save(sys.argv[2], quality=97)
print('ready for HEIC')";

/// True for a photo name that needs another program.
pub(super) fn is_heic(path: &Path) -> bool {
    let ending = path.extension().unwrap_or_default();
    ENDINGS.iter().any(|known| ending.eq_ignore_ascii_case(known))
}

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
    /// The first that is installed, with a folder for its files in `folder`. `photo` is named in
    /// the error.
    ///
    /// # Errors
    ///
    /// None is.
    pub(super) fn find(options: &CaptureOptions, photo: &Path, folder: &Path) -> Result<Self> {
        let mut ways: Vec<(PathBuf, Way)> = WAYS.map(|(program, way)| (program.into(), way)).into();
        let last = ways.len() - 1;
        ways.splice(last..last, pythons(options).into_iter().map(|python| (python, PYTHON)));
        let is_there = |(program, [probe, answer, _]): &(PathBuf, Way)| {
            let answered = said(self::program(program).args(filled(probe, ["", ""])));
            answered.is_some_and(|text| text.contains(answer))
        };
        let Some((program, [.., words])) = ways.into_iter().find(is_there) else {
            let reason = "is a HEIC or AVIF photo, and no program that reads them is installed: `sudo apt install libheif-examples` (Debian, \
                          Ubuntu), `brew install libheif` (macOS, whose own `sips` reads them too), `winget install ImageMagick.ImageMagick` \
                          (Windows), `pip install pillow-heif` (any system with Python). An iPhone takes JPEG with Settings > Camera > \
                          Formats > Most Compatible";
            return Err(Error::unsupported(photo, reason));
        };
        let folder = tempfile::tempdir_in(folder).map_err(Error::temporary)?;
        Ok(Self { program, words, folder, made: AtomicUsize::new(0) })
    }

    /// A JPEG file of `photo`.
    ///
    /// # Errors
    ///
    /// A photo that the program cannot read, with the program's message.
    pub(super) fn convert(&self, photo: &Path) -> Result<PathBuf> {
        let number = self.made.fetch_add(1, Ordering::Relaxed);
        let at = |ending: &str| self.folder.path().join(format!("{number}.{ending}"));
        // Under a name that no program takes for an option, a pattern or a protocol.
        let ending = photo.extension().unwrap_or_default().to_string_lossy();
        let from = at(&ending);
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
