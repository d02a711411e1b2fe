//! COLMAP's text model: cameras.txt, images.txt, points3D.txt.

use super::colmap_model::{self, ColmapModel, ImageRow, ListedPoint};
use glam::{DMat3, DVec3, Vec2};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use trisplat_scene::{Error, Limits, Result, excerpt, input};

/// Reads cameras and images of a folder; observations are kept if `observations` is set.
pub(super) fn read(folder: &Path, limits: &Limits, observations: bool) -> Result<ColmapModel> {
    let mut model = ColmapModel::default();
    read_cameras(&mut TextFile::open(folder.join("cameras.txt"), limits)?, &mut model)?;
    read_images(&mut TextFile::open(folder.join("images.txt"), limits)?, observations, &mut model)?;
    Ok(model)
}

/// `CAMERA_ID MODEL WIDTH HEIGHT PARAMS...`
fn read_cameras(lines: &mut TextFile, model: &mut ColmapModel) -> Result<()> {
    while lines.next_entry()? {
        let mut words = lines.words();
        let id = words.number("camera id")?;
        let name = words.word("camera model")?.to_owned();
        let size = [words.number("width")?, words.number("height")?];
        let params: Vec<f64> = words.rest("parameter")?;
        let lens = colmap_model::lens(&lines.path, &name, size, &params)?;
        model.cameras.insert(id, lens);
    }
    Ok(())
}

/// `IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME`, then a line of `X Y POINT3D_ID` triples, perhaps
/// empty.
fn read_images(lines: &mut TextFile, keep: bool, model: &mut ColmapModel) -> Result<()> {
    while lines.next_entry()? {
        let mut words = lines.words();
        let id: u32 = words.number("image id")?;
        let quaternion = words.numbers::<4>("quaternion")?;
        let translation = DVec3::from(words.numbers::<3>("translation")?);
        let camera = words.number("camera id")?;
        let name = words.text.trim().to_owned();
        if name.is_empty() {
            return Err(lines.malformed(format!("image {id} has no name")));
        }
        let number = lines.number;
        let mut observations = Vec::new();
        if lines.next_line()? {
            let mut words = lines.words();
            while !words.text.is_empty() {
                let [x, y] = words.numbers("2D point")?;
                let point: i64 = words.number("3D point id")?;
                if let Some(point) = u64::try_from(point).ok().filter(|_| keep) {
                    observations.push((point, Vec2::new(x as f32, y as f32)));
                }
            }
        }
        let rotation = DMat3::IDENTITY;
        let image = ImageRow { name, camera, rotation, translation, observations };
        model.add_image(image, quaternion, |reason| {
            Error::malformed(&lines.path, format!("line {number}"), reason)
        });
    }
    Ok(())
}

/// The points of the file at `path`: `POINT3D_ID X Y Z R G B ERROR TRACK...`
pub(super) fn points(path: &Path, limits: &Limits) -> Result<Vec<ListedPoint>> {
    let lines = &mut TextFile::open(path.to_owned(), limits)?;
    let mut points = Vec::new();
    while lines.next_entry()? {
        let mut words = lines.words();
        let id = words.number("point id")?;
        let position = DVec3::from(words.numbers::<3>("position")?);
        let rgb = [words.number("red")?, words.number("green")?, words.number("blue")?];
        points.push(ListedPoint::of(id, position, rgb, words.number("error")?));
        lines.limits.vertices(lines.path.display(), points.len() as u64)?;
    }
    Ok(points)
}

/// A file read line by line, with the line number.
struct TextFile {
    path: PathBuf,
    reader: BufReader<File>,
    line: String,
    number: u64,
    limits: Limits,
}

impl TextFile {
    fn open(path: PathBuf, limits: &Limits) -> Result<Self> {
        let (file, _) = input::open(&path, limits)?;
        let reader = BufReader::with_capacity(1 << 18, file);
        Ok(Self { reader, path, line: String::new(), number: 0, limits: *limits })
    }

    /// Goes to the next line; false at the end of the file.
    fn next_line(&mut self) -> Result<bool> {
        self.line.clear();
        self.number += 1;
        let max_bytes = self.limits.document_bytes.saturating_add(1);
        let result = (&mut self.reader).take(max_bytes).read_line(&mut self.line);
        let bytes = result.map_err(|e| match e.kind() {
            std::io::ErrorKind::InvalidData => {
                self.malformed("is not text; a binary model ends in .bin")
            }
            _ => Error::io(&self.path, e),
        })?;
        self.limits.document(
            format_args!("{}: line {}", self.path.display(), self.number),
            bytes as u64,
        )?;
        if self.number == 1 && self.line.starts_with('\u{feff}') {
            self.line.remove(0);
        }
        Ok(bytes > 0)
    }

    /// Goes to the next line that is neither empty nor a comment; false at the end of the file.
    fn next_entry(&mut self) -> Result<bool> {
        while self.next_line()? {
            let line = self.line.trim_start();
            if !line.is_empty() && !line.starts_with('#') {
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn words(&self) -> LineWords<'_> {
        LineWords { lines: self, text: self.line.trim() }
    }

    fn malformed(&self, reason: impl Into<String>) -> Error {
        Error::malformed(&self.path, format!("line {}", self.number), reason)
    }
}

/// The rest of a line.
struct LineWords<'a> {
    lines: &'a TextFile,
    text: &'a str,
}

impl<'a> LineWords<'a> {
    fn word(&mut self, what: &str) -> Result<&'a str> {
        let (word, rest) = self.text.split_once(char::is_whitespace).unwrap_or((self.text, ""));
        if word.is_empty() {
            return Err(self.lines.malformed(format!("the {what} is missing")));
        }
        self.text = rest.trim_start();
        Ok(word)
    }

    fn number<T: FromStr>(&mut self, what: &str) -> Result<T> {
        let word = self.word(what)?;
        word.parse().map_err(|_| {
            self.lines.malformed(format!("the {what} `{}` is not such a number", excerpt(word)))
        })
    }

    fn numbers<const N: usize>(&mut self, what: &str) -> Result<[f64; N]> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.number(what)?;
        }
        Ok(numbers)
    }

    fn rest(&mut self, what: &str) -> Result<Vec<f64>> {
        let mut numbers = Vec::new();
        while !self.text.is_empty() {
            numbers.push(self.number(what)?);
        }
        Ok(numbers)
    }
}
