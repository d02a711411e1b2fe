//! Reads a file of any format.

use crate::{Format, ReadOptions, Source, format, gltf, html, obj, off, ply, pt};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use trisplat_scene::input::{self, guarded};
use trisplat_scene::{Error, ImportedScene, Result};

/// The accepted formats, for messages.
const ACCEPTED: &str =
    "a soup or mesh .ply, a training checkpoint .pt, .off, .obj, .glb, .gltf or our own .html";

/// The format of an open file; otherwise an error that names its first bytes and the accepted formats.
pub(super) fn detect(source: &mut Source) -> Result<Format> {
    let (head, named) = (source.head()?, source.named());
    if let Some(kind) = format::recognise(&head, &source.path) {
        return Err(format::refusal(&source.path, kind));
    }
    if head.starts_with(b"PK") && named.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("usdz"))
    {
        let reason = "is a USDZ, which is written and not read; give what it was baked from";
        return Err(Error::unsupported(&source.path, reason));
    }
    if let Some(format) = Format::detect(&head, &named) {
        return Ok(format);
    }
    if let Some(kind) = photo(&head) {
        let reason = format!("is a photo ({kind}), and no scene: `trisplat make` makes a scene of photos");
        return Err(Error::unsupported(&source.path, reason));
    }
    let seen = match (head.is_empty(), Format::by_extension(&named)) {
        (true, _) => "is empty".to_owned(),
        (false, Some(named)) => {
            format!("is named like {} but begins with {}", named.name(), preview(&head))
        }
        (false, None) => format!("begins with {}, which no reader recognises", preview(&head)),
    };
    Err(Error::unsupported(&source.path, format!("{seen}; give {ACCEPTED}")))
}

/// The scene in the file at `path`, whatever its format; "-" is standard input.
///
/// ```
/// use trisplat_formats::{self as formats, ReadOptions};
///
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("square.obj");
/// std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n").unwrap();
/// let loaded = formats::read(&path, &ReadOptions::default())?;
/// assert_eq!(loaded.scene.triangle_count(), 2); // polygons come as triangles
/// assert_eq!(loaded.warnings, ["the file has no colours: every triangle is white"]);
/// # Ok::<(), trisplat_scene::Error>(())
/// ```
///
/// # Errors
/// Errors of the format's reader, or an unknown format.
pub fn read(path: &Path, options: &ReadOptions) -> Result<ImportedScene> {
    let mut source = Source::open(path, &options.limits)?;
    let format = detect(&mut source)?;
    read_as(format, source, options)
}

/// The scene in the bytes of a file.
///
/// # Errors
/// As [`read`]; files beside it, as of a .gltf with a buffer of its own, are not found.
pub fn read_bytes(bytes: &[u8], format: Format, options: &ReadOptions) -> Result<ImportedScene> {
    let path = PathBuf::from("<bytes>");
    let (file, len) = input::spool(&path, &mut &*bytes, &options.limits)?;
    read_as(format, Source { path, file: Arc::new(file), len }, options)
}

/// The scene in an open file of that format.
pub(super) fn read_as(format: Format, source: Source, options: &ReadOptions) -> Result<ImportedScene> {
    let (format, source) = html::inside(format, source)?;
    let path = source.path.clone();
    guarded(&path, || match format {
        Format::Ply => ply::read(source, options),
        Format::Pt => pt::read(source, options),
        Format::Off => off::read(source, options),
        Format::Splat | Format::Spz | Format::Sog => Err(format::refusal(&path, format.name())),
        Format::Obj => obj::read(source, options),
        Format::Glb | Format::Gltf | Format::Html => gltf::read(source, options),
    })
}

/// The kind of a photo that begins with `head`.
fn photo(head: &[u8]) -> Option<&'static str> {
    match head {
        [0xff, 0xd8, 0xff, ..] => Some("JPEG"),
        [0x89, b'P', b'N', b'G', ..] => Some("PNG"),
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => Some("WebP"),
        [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..] => Some("TIFF"),
        [_, _, _, _, b'f', b't', b'y', b'p', b'h', b'e', b'i' | b'v', ..] => Some("HEIC"),
        _ => None,
    }
}

/// The first bytes for a message: as text if possible, else in hex.
fn preview(head: &[u8]) -> String {
    let head = &head[..head.len().min(16)];
    match std::str::from_utf8(head) {
        Ok(text) if !text.contains(|c: char| c.is_control() && c != '\n' && c != '\t' && c != '\r') => {
            format!("{text:?}")
        }
        _ => {
            let hex: Vec<String> = head.iter().take(8).map(|b| format!("{b:02x}")).collect();
            format!("bytes {}", hex.join(" "))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_photo_in_place_of_a_scene_names_make() {
        let heads: [(&[u8], &str); 5] = [
            (b"\xff\xd8\xff\xe0\0\x10JFIF", "JPEG"),
            (b"\x89PNG\r\n\x1a\n", "PNG"),
            (b"RIFF\x10\0\0\0WEBPVP8 ", "WebP"),
            (b"II\x2a\0\x08\0\0\0", "TIFF"),
            (b"\0\0\0\x18ftypheic", "HEIC"),
        ];
        let folder = tempfile::tempdir().expect("a temporary folder");
        for (head, kind) in heads {
            // Also under a scene's name.
            let path = folder.path().join("scene.ply");
            std::fs::write(&path, head).expect("writable");
            let message = read(&path, &ReadOptions::with_degree(0)).expect_err("a photo").to_string();
            assert!(message.contains(&format!("is a photo ({kind})")), "{message}");
            assert!(message.contains("`trisplat make`"), "{message}");
        }
    }

    #[test]
    fn an_unknown_file_names_what_was_seen_and_what_is_accepted() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("scene.glb");
        for (content, seen) in [(&b""[..], "is empty"), (b"\0\x01rubbish", "named like binary glTF")] {
            std::fs::write(&path, content).expect("writable");
            let message = read(&path, &ReadOptions::with_degree(0)).expect_err("unknown").to_string();
            assert!(message.contains(seen) && message.contains(".gltf"), "{message}");
        }
    }
}
