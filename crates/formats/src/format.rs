//! The formats that are read: recognised by their first bytes, and by their name only where the
//! bytes are ambiguous.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::Path;
use trisplat_scene::input::BYTE_ORDER_MARK;
use trisplat_scene::{Error, excerpt, first_of};

/// A format we read.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema,
)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// Polygon file format: our soup PLY or a mesh with vertex or face colours.
    #[default]
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
    pub(crate) fn detect(head: &[u8], path: &Path) -> Option<Format> {
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
            _ => match word {
                b"v" | b"vn" | b"vt" | b"f" | b"o" | b"g" | b"s" | b"mtllib" | b"usemtl" => {
                    Some(Format::Obj)
                }
                _ => None,
            },
        }
    }

    /// The format of the extension of `path`, independent of the content.
    pub(crate) fn by_extension(path: &Path) -> Option<Format> {
        let extension = path.extension()?.to_str()?;
        let has =
            |endings: &[&str]| endings.iter().any(|ending| extension.eq_ignore_ascii_case(ending));
        FORMATS.iter().find(|(.., endings)| has(endings)).map(|(format, ..)| *format)
    }

    /// Its usual name.
    pub fn name(self) -> &'static str {
        FORMATS[self as usize].1
    }
}

/// The formats in their order: usual name, and extensions that tell them.
const FORMATS: [(Format, &str, &[&str]); 10] = [
    (Format::Ply, "PLY", &["ply"]),
    (Format::Pt, "PyTorch checkpoint", &["pt", "pth"]),
    (Format::Off, "OFF", &["off", "coff"]),
    (Format::Obj, "Wavefront OBJ", &["obj"]),
    (Format::Glb, "binary glTF", &["glb"]),
    (Format::Gltf, "glTF", &["gltf"]),
    (Format::Splat, ".splat", &[]),
    (Format::Spz, "SPZ", &[]),
    (Format::Sog, "SOG", &[]),
    (Format::Html, "page with a scene", &["html", "htm"]),
];

/// The first line that is not blank, trimmed.
fn first_line(text: &[u8]) -> &[u8] {
    text.split(|b| *b == b'\n' || *b == b'\r')
        .map(<[u8]>::trim_ascii)
        .find(|line| !line.is_empty())
        .unwrap_or_default()
}

// ---- Files of 3D Gaussian splatting (Kerbl et al. 2023), which hold no triangles ----------------

/// The extension of glTF that holds them.
pub(crate) const GLTF_EXTENSION: &str = "KHR_gaussian_splatting";
/// Its extension for an SPZ file in place of accessors.
pub(crate) const SPZ_EXTENSION: &str = "KHR_gaussian_splatting_compression_spz_2";

/// The names of formats that have readers.
pub(crate) const SPZ: &str = "SPZ";
pub(crate) const SPLAT: &str = ".splat";
/// The names of formats that have none.
pub(crate) const UNREAD: [&str; 5] =
    [".ksplat", "LCC", ".splatv (which move in time)", ".spx", ".rad"];

/// The refusal of a file of Gaussians where triangles are expected; `kind` is the usual name of the
/// format.
pub(crate) fn refusal(path: &Path, kind: &str) -> Error {
    let reason = format!(
        "holds 3D Gaussians ({kind}), blurred ellipsoids instead of triangles; `trisplat bake` turns them into triangles, and `trisplat info` and \
         `trisplat render` read them too"
    );
    Error::unsupported(path, reason)
}

/// The refusal of Gaussians in a format without a reader.
pub(crate) fn unread(path: &Path, kind: &str) -> Error {
    let reason = format!(
        "holds 3D Gaussians as {kind}, which is not read; save them as PLY, .splat, SPZ (versions 2 to 4), SOG (version 2) or glTF, as SuperSplat \
         (superspl.at/editor) does"
    );
    Error::unsupported(path, reason)
}

/// The name of the format when a file that begins with `head` and is called `path` holds Gaussians.
///
/// `.splat` and `.ksplat` have no signature: their name decides, unless the first bytes are those
/// of another format.
pub(crate) fn recognise(head: &[u8], path: &Path) -> Option<&'static str> {
    let extension =
        path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    // A record of numbers may begin like a bare pickle; nothing else is taken for one.
    let other = !head.starts_with(&[0x80]) && Format::detect(head, path).is_some();
    match (head, extension.as_str()) {
        ([b'N', b'G', b'S', b'P', ..], _) | ([0x1f, 0x8b, ..], "spz") => Some(SPZ),
        (_, "splat") if !other && !head.is_empty() => Some(SPLAT),
        (_, "ksplat") if !other && !head.is_empty() => Some(UNREAD[0]),
        (_, "splatv") if !head.is_empty() => Some(UNREAD[2]),
        (_, "spx") if !head.is_empty() => Some(UNREAD[3]),
        (_, "rad") if !other && !head.is_empty() => Some(UNREAD[4]),
        // A JSON document beside its data.
        (_, "lcc") if !head.is_empty() => Some(UNREAD[1]),
        _ => None,
    }
}

/// True for the entries of an archive that is a scene in SOG: pictures of the Gaussians'
/// parameters.
pub(crate) fn is_sog(entries: &[String]) -> bool {
    let has = |file: &str| entries.iter().any(|name| name.rsplit('/').next() == Some(file));
    has("meta.json") && (has("means_l.webp") || has("means_l.png"))
}

/// True for the tensors of a checkpoint of Gaussians: gsplat's, nerfstudio's.
pub(crate) fn are_parameters(tensors: &[String]) -> bool {
    let has = |names: &[&str]| {
        names.iter().any(|name| tensors.iter().any(|key| key.rsplit('.').next() == Some(name)))
    };
    has(&["quats", "_rotation", "scales", "_scaling", "opacities"])
        && has(&["means", "means3D", "_xyz"])
}

/// The refusal of Gaussians in a checkpoint of PyTorch.
pub(crate) fn gaussian_checkpoint(path: &Path) -> Error {
    let reason = "holds 3D Gaussians as a checkpoint, which is not read; give the point_cloud.ply of the run, or export one \
                  (nerfstudio: `ns-export gaussian-splat`)";
    Error::unsupported(path, reason)
}

/// Names of extensions in drafts of [`GLTF_EXTENSION`], which was ratified with another layout.
const DRAFTS: [&str; 4] = [
    "KHR_spz_compression",
    "KHR_spz_gaussian_splats_compression",
    "KHR_gaussian_splatting_compression_spz",
    "CESIUM_gaussian_splatting",
];

/// True for the name of an extension of a draft.
pub(crate) fn is_draft(extension: &str) -> bool {
    DRAFTS.contains(&extension)
}

/// The refusal of Gaussians in a draft of the extension; `sign` is what tells it.
pub(crate) fn draft(path: &Path, sign: &str) -> Error {
    let reason = format!(
        "holds 3D Gaussians in a draft of {GLTF_EXTENSION} (with {sign}), which is not read; save them as PLY, SPZ or the ratified \
         {GLTF_EXTENSION} with the program that wrote it"
    );
    Error::unsupported(path, reason)
}

// ---- JSON files that are neither scenes nor lists of photos, recognised for a helpful message

/// The refusal of a JSON file in place of a scene or a list of photos; `None` for an unknown kind.
pub fn foreign_json(path: &Path, json: &[u8]) -> Option<Error> {
    let json: Value = serde_json::from_slice(json).ok()?;
    let has = |keys: &[&str]| keys.iter().all(|key| json.get(key).is_some());
    if has(&["means", "quats", "scales"]) {
        return Some(unread(path, "SOG with missing files,"));
    }
    if has(&["lodLevels", "filenames"]) {
        return Some(streamed_sog(path, &json));
    }
    if has(&["geometricError", "root"]) {
        let reason = "is a tileset (3D Tiles), a list of files with tiles: give one of the files it names, or what it was baked from";
        return Some(Error::unsupported(path, reason));
    }
    let version = json.pointer("/asset/version").and_then(Value::as_str);
    let is_old = version.is_some_and(|version| version.starts_with('1'))
        || json.get("meshes").is_some_and(Value::is_object);
    is_old.then(|| {
        Error::unsupported(path, "is glTF 1.0: convert it to glTF 2.0, with Blender for example")
    })
}

/// The refusal of the list of a streamed SOG, which names its files of the finest level.
fn streamed_sog(path: &Path, list: &Value) -> Error {
    let all: Vec<&str> =
        list["filenames"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    let finest: Vec<&str> = all.iter().copied().filter(|name| name.starts_with("0_")).collect();
    let named = if finest.is_empty() { &all } else { &finest };
    let reason = format!(
        "is the list of a streamed SOG, a scene in parts and levels of detail: give its whole in another format, or a part of its \
         finest level: {}",
        first_of(named.iter().map(|name| excerpt(name)), 3)
    );
    Error::unsupported(path, reason)
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

#[cfg(test)]
mod gaussians_tests {
    use super::*;

    #[test]
    fn bytes_of_other_formats_win_over_the_name() {
        let cases: [(&[u8], &str, Option<&str>); 9] = [
            (b"\x1f\x8b\x08\0", "a.spz", Some("SPZ")),
            (b"\x1f\x8b\x08\0", "a.gz", None),
            (b"NGSP\x04\0\0\0", "-", Some("SPZ")),
            (b"\x80\x02\x12\x3f", "a.splat", Some(".splat")),
            (b"\0\x01\0\0", "a.KSPLAT", Some(".ksplat")),
            (b"ply\nformat", "a.splat", None),
            (b"glTF\x02\0\0\0", "a.ksplat", None),
            (b"", "a.splat", None),
            (b"\0\x01\0\0", "a.bin", None),
        ];
        for (head, path, wanted) in cases {
            assert_eq!(recognise(head, Path::new(path)), wanted, "{head:?} {path}");
        }
    }

    #[test]
    fn checkpoints_of_gaussians_are_known_by_their_tensors() {
        let keys = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        assert!(are_parameters(&keys(&["splats.means", "splats.quats", "splats.scales"])));
        assert!(are_parameters(&keys(&["_xyz", "_rotation", "_scaling"])));
        assert!(are_parameters(&keys(&[
            "p._model.gauss_params.means",
            "p._model.gauss_params.opacities"
        ])));
        assert!(!are_parameters(&keys(&["triangles_points", "sigma", "features_dc"])));
    }
}
