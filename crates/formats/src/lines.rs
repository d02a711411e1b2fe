//! A text file line by line, with line numbers for messages.

use crate::Source;
use glam::DVec3;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::path::Path;
use std::str::FromStr;
use std::sync::Arc;
use trisplat_scene::input::{self, BYTE_ORDER_MARK};
use trisplat_scene::{Error, Limits, Provenance, Result, UpAxis, excerpt, parallel};

/// Maximum length of a line, bytes: lines of meshes are far shorter, and a longer one means a
/// broken file.
const MAX_LINE_BYTES: usize = 1 << 16;

/// A text file, line by line.
pub(super) struct LineReader<'a> {
    path: &'a Path,
    reader: BufReader<&'a File>,
    line: Vec<u8>,
    /// Counted from 1.
    pub(super) number: u64,
}

impl<'a> LineReader<'a> {
    /// A reader before the first line.
    pub(super) fn new(source: &'a Source) -> Result<Self> {
        source.rewind()?;
        let reader = BufReader::with_capacity(1 << 18, &*source.file);
        Ok(Self { path: &source.path, reader, line: Vec::new(), number: 0 })
    }

    /// Moves on to the next line; false at the end of the file. A line that ends with `\` goes on
    /// in the next one.
    pub(super) fn advance(&mut self) -> Result<bool> {
        self.line.clear();
        loop {
            let read = self.read_line().map_err(|e| Error::io(self.path, e))?;
            self.number += 1;
            if self.line.len() >= MAX_LINE_BYTES && self.line.last() != Some(&b'\n') {
                return Err(self.error("is longer than 64 KiB: not a mesh, or a broken one"));
            }
            let text = self.line.trim_ascii_end();
            if !read || text.last() != Some(&b'\\') || text.starts_with(b"#") {
                break;
            }
            self.line.truncate(text.len() - 1);
            self.line.push(b' ');
        }
        if self.number == 1 && self.line.starts_with(BYTE_ORDER_MARK) {
            self.line.drain(..BYTE_ORDER_MARK.len());
        }
        if std::str::from_utf8(&self.line).is_err() {
            self.line = String::from_utf8_lossy(&self.line).into_owned().into_bytes();
        }
        Ok(!self.line.is_empty())
    }

    /// Appends a line and `\n` in place of its end, which may be `\n`, `\r\n` or the `\r` of old
    /// programs; false at the end of the file.
    fn read_line(&mut self) -> io::Result<bool> {
        let before = self.line.len();
        while self.line.len() < MAX_LINE_BYTES {
            let bytes = self.reader.fill_buf()?;
            let end = bytes.iter().position(|byte| matches!(byte, b'\n' | b'\r'));
            self.line.extend_from_slice(&bytes[..end.unwrap_or(bytes.len())]);
            let Some(end) = end else {
                let count = bytes.len();
                self.reader.consume(count);
                if count == 0 { break } else { continue }
            };
            let is_return = bytes[end] == b'\r';
            self.reader.consume(end + 1);
            if is_return && self.reader.fill_buf()?.first() == Some(&b'\n') {
                self.reader.consume(1);
            }
            self.line.push(b'\n');
            break;
        }
        Ok(self.line.len() > before)
    }

    /// Moves on to the next line with content other than white space and comments.
    pub(super) fn advance_to_text(&mut self) -> Result<bool> {
        while self.advance()? {
            if self.words().next().is_some() {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The trimmed line.
    pub(super) fn text(&self) -> &str {
        std::str::from_utf8(&self.line).unwrap_or_default().trim()
    }

    /// The words of the line up to a `#`, other than that of `1.#QNAN`.
    pub(super) fn words(&self) -> impl Iterator<Item = &str> {
        let text = self.text();
        let mut signs = text.match_indices('#').map(|(at, _)| at);
        let end = signs.find(|at| !text[..*at].ends_with("1."));
        text[..end.unwrap_or(text.len())].split_ascii_whitespace()
    }

    /// The text after the first word, including inner spaces.
    pub(super) fn rest(&self) -> &str {
        self.text().split_once(char::is_whitespace).map_or("", |(_, rest)| rest.trim())
    }

    /// The error of a fault in this line.
    pub(super) fn error(&self, reason: impl Into<String>) -> Error {
        Error::malformed(self.path, format!("line {}", self.number), reason)
    }
}

/// The file, in UTF-8 if it is in UTF-16.
pub(super) fn as_utf8(source: &Source, limits: &Limits) -> Result<Source> {
    let mut source = source.again()?;
    let of = match source.head()?[..] {
        [0xff, 0xfe, ..] => u16::from_le_bytes,
        [0xfe, 0xff, ..] => u16::from_be_bytes,
        _ => return Ok(source),
    };
    limits.document(source.path.display(), source.len)?;
    let mut bytes = Vec::new();
    (&*source.file).read_to_end(&mut bytes).map_err(|e| Error::io(&source.path, e))?;
    let units = bytes[2..].as_chunks::<2>().0.iter().map(|pair| of(*pair));
    let text: String =
        char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect();
    let (file, len) = input::spool(&source.path, &mut text.as_bytes(), limits)?;
    Ok(Source { file: Arc::new(file), len, ..source })
}

/// A word as a number, or a message about it.
pub(super) fn number<T: FromStr>(word: &str) -> Result<T, String> {
    let parsed = word.parse().ok().or_else(|| not_finite(word)?.parse().ok());
    parsed.ok_or_else(|| format!("{:?} is not a number", excerpt(word)))
}

/// The usual spelling of a number that is none, as C and its runtime libraries print it:
/// `nan(ind)`,
/// `-nan(0x400)`, `1.#QNAN`, `-1.#IND00`, `1.#INF`.
pub(super) fn not_finite(word: &str) -> Option<&'static str> {
    let word = word.trim_start_matches(['+', '-']).to_ascii_lowercase();
    let printed = word.strip_prefix("1.#");
    if word.starts_with("nan(") && word.ends_with(')')
        || printed
            .is_some_and(|kind| ["qnan", "snan", "ind"].iter().any(|name| kind.starts_with(name)))
    {
        return Some("nan");
    }
    printed.filter(|kind| kind.starts_with("inf")).map(|_| "inf")
}

// ---- Numbers as text, in as few digits as read back equal ---------------------------------------

/// Appends `value`.
pub(super) fn push_float(block: &mut Vec<u8>, value: f32) {
    let mut buffer = zmij::Buffer::new();
    let text = buffer.format(value);
    block.extend_from_slice(text.strip_suffix(".0").unwrap_or(text).as_bytes());
}

/// Appends `value`.
pub(super) fn push_integer(block: &mut Vec<u8>, value: u64) {
    // Memory takes every byte.
    let _ = write!(block, "{value}");
}

// ---- Rows formatted on all threads, written in order --------------------------------------------

/// Rows per thread and block.
const ROWS: usize = 1 << 13;

/// Writes rows 0 to `count`; `push` appends one row to a buffer.
pub(super) fn write_blocks(
    out: &mut dyn Write,
    count: usize,
    push: impl Fn(usize, &mut Vec<u8>) + Sync,
) -> io::Result<()> {
    let lanes = parallel::threads().max(1);
    let mut blocks = vec![Vec::new(); lanes];
    for round in (0..count).step_by(ROWS * lanes) {
        parallel::for_each(&mut blocks, |lane, block| {
            block.clear();
            let first = round + lane * ROWS;
            for row in first..(first + ROWS).min(count) {
                push(row, block);
            }
        });
        for block in &blocks {
            out.write_all(block)?;
        }
    }
    Ok(())
}

// ---- Names in text ------------------------------------------------------------------------------

/// True where a language may end a line, or show text in another order.
pub(super) fn breaks_text(c: char) -> bool {
    c.is_control() || matches!(c, '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// A name as a string of JSON, C#, Python and Godot, in printable characters of one line.
pub(super) fn quoted(name: &str) -> String {
    on_one_line(&serde_json::Value::from(name).to_string())
}

fn on_one_line(json: &str) -> String {
    let escaped =
        |c: char| if breaks_text(c) { format!("\\u{:04x}", u32::from(c)) } else { c.into() };
    json.chars().map(escaped).collect()
}

// ---- The provenance of a scene, as one comment line of a PLY or OBJ file ------------------------

const KEY: &str = "trisplat ";

/// The comment's text, without the format's comment sign and without a line break. Empty when only
/// defaults are known.
pub(super) fn to_comment(provenance: &Provenance) -> String {
    if *provenance == Provenance::default() {
        return String::new();
    }
    // Plain strings and numbers always serialize.
    serde_json::to_string(provenance)
        .map(|json| format!("{KEY}{}", on_one_line(&json)))
        .unwrap_or_default()
}

/// The provenance in the comments. A broken comment of ours becomes a warning, not an error,
/// because the triangles are valid without it.
pub(super) fn from_comments<'a>(
    comments: impl Iterator<Item = &'a str>,
    warnings: &mut Vec<String>,
) -> Provenance {
    let mut up = None;
    for comment in comments {
        let Some(json) = comment.trim().strip_prefix(KEY).filter(|rest| rest.starts_with('{'))
        else {
            up = up.or_else(|| up_axis(comment));
            continue;
        };
        match serde_json::from_str::<Provenance>(json) {
            Ok(provenance) => {
                let possible = provenance.clone().possible();
                if possible != provenance {
                    let what = "the viewpoint, the placement or the exposure in the trisplat comment is ignored: no scene has such numbers";
                    warnings.push(what.to_owned());
                }
                return possible;
            }
            Err(error) => warnings.push(format!("the trisplat comment is ignored: {error}")),
        }
    }
    Provenance { up, ..Provenance::default() }
}

/// The up axis in a comment of another program: "Vertical Axis: z" (nerfstudio), "Vertical axis: 0
/// -1 0" (brush), "up_axis = +Y", "Z-up".
fn up_axis(comment: &str) -> Option<UpAxis> {
    const NAMES: [&str; 5] = ["vertical axis", "up axis", "up_axis", "upaxis", "up"];
    let text = comment.trim().to_lowercase();
    let named = NAMES.iter().find_map(|name| text.strip_prefix(name));
    let axis = named
        .or_else(|| text.strip_suffix("up").map(|axis| axis.trim_end_matches([' ', '-', '_'])))?;
    let axis = axis.trim_matches([' ', ':', '=', '+', '"']);
    let numbers: Vec<f64> = axis.split([' ', ',']).filter_map(|word| word.parse().ok()).collect();
    if let [x, y, z] = numbers[..] {
        let up = DVec3::new(x, y, z);
        return (up.is_finite() && up != DVec3::ZERO).then(|| UpAxis::nearest(up));
    }
    serde_json::from_value(axis.into()).ok()
}

/// The up axis that one of these programs of modelling or of reconstruction writes, each with its
/// name in lower case; none if no comment names one.
pub(super) fn up_of_program<'a>(
    comments: impl Iterator<Item = &'a str>,
    programs: &[(&str, UpAxis)],
) -> Option<UpAxis> {
    let named = |comment: &str| {
        let comment = comment.to_lowercase();
        programs.iter().find(|(name, _)| comment.contains(name)).map(|(_, up)| *up)
    };
    comments.into_iter().find_map(named)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_and_floats_are_written_short_and_read_back_equal() {
        for value in [0, 7, 10, 4_294_967_295, u64::MAX] {
            let mut text = Vec::new();
            push_integer(&mut text, value);
            assert_eq!(String::from_utf8_lossy(&text), value.to_string());
        }
        for value in [0.0f32, -1.0, 0.1, 1e-45, f32::MAX, -1.234_567_9e-8, 16_777_216.0] {
            let mut text = Vec::new();
            push_float(&mut text, value);
            let text = String::from_utf8_lossy(&text).into_owned();
            assert_eq!(text.parse::<f32>().map(f32::to_bits), Ok(value.to_bits()), "{text}");
            assert!(text.len() <= 15, "{text}");
        }
    }
}

#[cfg(test)]
mod provenance_tests {
    use super::*;
    use proptest::prelude::*;
    use trisplat_scene::Placement;
    use trisplat_scene::camera::{OrbitRange, Viewpoint};

    proptest! {
        #[test]
        fn reads_back_equal(source in ".{0,20}", scale in 1e-30f64..1e30, x: f32, seed: u64) {
            let center = [x as f64, seed as f64 * 1e-7, -scale];
            prop_assume!(x.is_finite());
            let provenance = Provenance {
                generator: Some("trisplat 0.1.0".into()),
                source: Some(format!("{source}\r\n{source}")),
                trainer: None,
                up: Some(UpAxis::NegY),
                usual_up: None,
                placement: Placement { up: UpAxis::Z.into(), rotate: -scale, scale, center },
                viewpoint: Some(Viewpoint {
                    eye: [1.0, seed as f64 * 1e-7, -scale.sqrt()],
                    target: [0.0; 3],
                    up: [0.0, 1.0, 0.0],
                    fov: 50.0,
                    radius: Some(x.abs().into()),
                    orbit: Some(OrbitRange { turn: Some([-scale.min(360.0), 0.1]), elevation: [-0.3, 1.0 / 3.0] }),
                }),
                backdrop_faces: seed as u32,
                exposure: Some([0.5, 0.0, 1.0]),
                cameras: vec![[0.5; 8]],
            };
            let comment = to_comment(&provenance);
            prop_assert!(!comment.contains(['\n', '\r']));
            let mut warnings = Vec::new();
            let back = from_comments(["made by hand", comment.as_str()].into_iter(), &mut warnings);
            prop_assert_eq!(back, provenance);
            prop_assert!(warnings.is_empty());
        }
    }

    #[test]
    fn a_viewpoint_or_placement_that_cannot_be_is_a_warning() {
        for (place, with) in [
            ("scale", "1e308"),
            ("scale", "0"),
            ("eye", "[1e39,0,0]"),
            ("fov", "1e308"),
            ("fov", "0"),
        ] {
            let provenance = Provenance {
                viewpoint: Some(Viewpoint {
                    eye: [1.0; 3],
                    target: [0.0; 3],
                    up: [0.0, 1.0, 0.0],
                    fov: 50.0,
                    radius: None,
                    orbit: None,
                }),
                ..Provenance::default()
            };
            let mut json = serde_json::to_value(&provenance).unwrap();
            let part = if place == "scale" { "placement" } else { "viewpoint" };
            json[part][place] = serde_json::from_str(with).unwrap();
            let mut warnings = Vec::new();
            let back = from_comments([format!("{KEY}{json}").as_str()].into_iter(), &mut warnings);
            assert!(back != provenance || part == "placement", "{back:?}");
            assert_eq!(
                (back.placement, warnings.len()),
                (Placement::IDENTITY, 1),
                "{place} {with}"
            );
            assert_eq!(back.viewpoint.is_some(), part == "placement", "{place} {with}");
        }
    }

    #[test]
    fn other_programs_name_the_up_axis_in_their_own_words() {
        let up = |comment: &str| {
            from_comments(["made by hand", comment].into_iter(), &mut Vec::new()).up
        };
        for (comment, axis) in [
            ("Vertical Axis: z", UpAxis::Z),
            ("vertical axis: -Y", UpAxis::NegY),
            ("Vertical axis: 0.1 -0.9 0", UpAxis::NegY),
            ("up_axis = +Y", UpAxis::Y),
            ("Z-up", UpAxis::Z),
            ("y up", UpAxis::Y),
        ] {
            assert_eq!(up(comment), Some(axis), "{comment}");
        }
        for comment in [
            "made up",
            "Vertical axis: 0 0 0",
            "Vertical axis: nan 0 0",
            "up to date",
            "vertical axis",
        ] {
            assert_eq!(up(comment), None, "{comment}");
        }
    }

    #[test]
    fn a_broken_comment_is_a_warning() {
        let mut warnings = Vec::new();
        let back = from_comments(["trisplat {\"up\":\"sideways\"}"].into_iter(), &mut warnings);
        assert_eq!(back, Provenance::default());
        assert_eq!(warnings.len(), 1);
    }
}
