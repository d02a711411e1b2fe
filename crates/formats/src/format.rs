//! The formats that are read: recognised by their first bytes, and by their name only where the bytes are
//! ambiguous.

use serde::{Deserialize, Serialize};
use std::path::Path;
use trisplat_scene::input::BYTE_ORDER_MARK;

/// A format we read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// Polygon file format: our soup PLY or a mesh with vertex or face colours.
    Ply,
    /// A checkpoint written by `torch.save`.
    Pt,
    /// Object file format with colours, as the authors' exporter writes it.
    Off,
    /// Wavefront OBJ.
    Obj,
    /// glTF 2.0, binary container.
    Glb,
    /// glTF 2.0, JSON.
    Gltf,
    /// `.splat`: Gaussians, recognised by its name.
    Splat,
    /// SPZ: Gaussians.
    Spz,
    /// SOG: Gaussians as pictures in a zip archive.
    Sog,
    /// A page of this program, with a GLB in it.
    Html,
}

impl Format {
    /// The format of a file that begins with `head` (64 bytes are enough) and is called `path`.
    ///
    /// Bytes win over the name, because people rename files; the name decides between text formats
    /// that begin alike. `None` when neither decides.
    pub fn detect(head: &[u8], path: &Path) -> Option<Format> {
        let by_name = Self::by_extension(path);
        let text = head.strip_prefix(BYTE_ORDER_MARK).unwrap_or(head);
        match text {
            [b'g', b'l', b'T', b'F', ..] => return Some(Format::Glb),
            [b'P', b'K', 3 | 5, 4 | 6, ..] => return Some(Format::Pt),
            // Pickle protocol 2 and later: torch before 1.6, or a bare pickle.
            [0x80, 2..=5, ..] => return Some(Format::Pt),
            [b'p', b'l', b'y', b'\n' | b'\r', ..] => return Some(Format::Ply),
            _ => {}
        }
        if text.get(..14).is_some_and(|start| start.eq_ignore_ascii_case(b"<!doctype html")) {
            return Some(Format::Html);
        }
        let line = first_line(text);
        let word = line.split(|b| b.is_ascii_whitespace()).next().unwrap_or_default();
        if line.first() == Some(&b'{') {
            return Some(Format::Gltf);
        }
        if word.ends_with(b"OFF") && word.len() <= 7 {
            return Some(Format::Off);
        }
        // Only comments, or a bare list of numbers: the name must decide.
        let plain = line.is_empty() || line[0] == b'#';
        match by_name {
            Some(Format::Obj) => Some(Format::Obj),
            Some(Format::Off) if plain && !text.is_empty() => Some(Format::Off),
            _ if starts_like_obj(word) => Some(Format::Obj),
            _ => None,
        }
    }

    /// The format of the extension of `path`, independent of the content.
    pub fn by_extension(path: &Path) -> Option<Format> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        Some(match extension.as_str() {
            "ply" => Format::Ply,
            "pt" | "pth" => Format::Pt,
            "off" | "coff" => Format::Off,
            "obj" => Format::Obj,
            "glb" => Format::Glb,
            "gltf" => Format::Gltf,
            "html" | "htm" => Format::Html,
            _ => return None,
        })
    }

    /// Its usual name.
    pub fn name(self) -> &'static str {
        match self {
            Format::Ply => "PLY",
            Format::Pt => "PyTorch checkpoint",
            Format::Off => "OFF",
            Format::Obj => "Wavefront OBJ",
            Format::Glb => "binary glTF",
            Format::Gltf => "glTF",
            Format::Splat => ".splat",
            Format::Spz => "SPZ",
            Format::Sog => "SOG",
            Format::Html => "page with a scene",
        }
    }
}

/// The first line that is not blank, trimmed.
fn first_line(text: &[u8]) -> &[u8] {
    text.split(|b| *b == b'\n' || *b == b'\r')
        .map(<[u8]>::trim_ascii)
        .find(|line| !line.is_empty())
        .unwrap_or_default()
}

/// True for the words that can begin an OBJ.
fn starts_like_obj(word: &[u8]) -> bool {
    matches!(word, b"v" | b"vn" | b"vt" | b"f" | b"o" | b"g" | b"s" | b"mtllib" | b"usemtl")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_win_over_the_name() {
        let cases: [(&[u8], &str, Option<Format>); 23] = [
            (b"\xef\xbb\xbfply\nformat", "a.obj", Some(Format::Ply)),
            (b"\xef\xbb\xbfv 0 0 0\n", "-", Some(Format::Obj)),
            (b"\xef\xbb\xbf# a\nv 0 0 0\n", "a.obj", Some(Format::Obj)),
            (b"\xef\xbb\xbfCOFF\n3 1 0", "-", Some(Format::Off)),
            (b"glTF\x02\0\0\0", "a.ply", Some(Format::Glb)),
            (b"PK\x03\x04rest", "a", Some(Format::Pt)),
            (b"\x80\x02}q", "a.bin", Some(Format::Pt)),
            (b"ply\nformat", "a.obj", Some(Format::Ply)),
            (b"ply\r\nformat", "a", Some(Format::Ply)),
            (b"\xef\xbb\xbf { \"asset\"", "a.txt", Some(Format::Gltf)),
            (b"\n\n{\"asset\"", "-", Some(Format::Gltf)),
            (b"COFF\n3 1 0", "a.txt", Some(Format::Off)),
            (b"OFF 3 1 0\n", "a", Some(Format::Off)),
            (b"# made by\nOFF\n", "a.off", Some(Format::Off)),
            (b"# made by\nv 0 0 0\n", "a.obj", Some(Format::Obj)),
            (b"# made by\n", "a.txt", None),
            (b"v 0 0 0\n", "-", Some(Format::Obj)),
            (b"mtllib a.mtl\n", "-", Some(Format::Obj)),
            (b"<!doctype html><!-- trisplat", "a.txt", Some(Format::Html)),
            (b"\xef\xbb\xbf<!DOCTYPE HTML>\n", "a", Some(Format::Html)),
            (b"", "a.ply", None),
            (b"\0\0\0\0", "a.glb", None),
            (b"hello world", "a.txt", None),
        ];
        for (head, path, wanted) in cases {
            assert_eq!(Format::detect(head, Path::new(path)), wanted, "{head:?} {path}");
        }
    }
}
