//! Reads a file of any format, triangles or Gaussians; the plain case of writing.

use crate::output::{self, Output, OutputOptions, SideFiles};
use crate::source::{ACCEPTED, is_packed};
use crate::{Format, ReadOptions, Source, format, gltf, html, obj, off, ply, pt, splats};
use std::ops::ControlFlow::Continue;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use trisplat_scene::input::{self, guarded};
use trisplat_scene::report::{OutputReport, Report};
use trisplat_scene::{
    Asset, Error, ImportedScene, ImportedSplats, Limits, Result, Splats, SurroundingsStorage,
};

/// Content of an open file, and its format.
#[derive(Debug, Clone, Copy)]
pub(super) enum FileKind {
    /// Triangles.
    Scene(Format),
    /// Gaussians.
    Splats(Format),
}

/// The format of an open file by its first bytes and its name, a checkpoint for every zip archive;
/// otherwise an error that names its first bytes and the accepted formats.
pub(super) fn detect(source: &mut Source) -> Result<Format> {
    let head = source.head()?;
    let named = source.named();
    match format::recognise(&head, &named) {
        Some(format::SPZ) => return Ok(Format::Spz),
        Some(format::SPLAT) => return Ok(Format::Splat),
        Some(kind) => return Err(format::unread(&source.path, kind)),
        None => {}
    }
    if head.starts_with(b"PK")
        && named.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("usdz"))
    {
        let reason = "is a USDZ, which is written and not read; give what it was made from, or convert it to .glb (Blender: import, export)";
        return Err(Error::unsupported(&source.path, reason));
    }
    if let Some(format) = Format::detect(&head, &named) {
        return Ok(format);
    }
    if let Some(kind) = photo(&head) {
        let reason =
            format!("is a photo ({kind}), and no scene: `trisplat make` makes a scene of photos");
        return Err(Error::unsupported(&source.path, reason));
    }
    if head.get(8..).is_some_and(|rest| rest.starts_with(SAFETENSORS)) {
        let reason = format!(
            "is a checkpoint (safetensors), and no scene; of a training of this program, `trisplat train PHOTOS --resume {} -o scene.ply` \
             makes one of it",
            source.path.display()
        );
        return Err(Error::unsupported(&source.path, reason));
    }
    let fault = if head.is_empty() {
        "is empty".to_owned()
    } else if let Some(format) = Format::by_extension(&named) {
        format!("is named like {} but begins with {}", format.name(), preview(&head))
    } else {
        format!("begins with {}, which no reader recognises", preview(&head))
    };
    Err(Error::unsupported(&source.path, format!("{fault}; give {ACCEPTED}")))
}

/// Looks into an open file of that format for triangles or Gaussians.
///
/// # Errors
/// A broken header of a PLY; `Io`.
pub(super) fn kind_of(format: Format, source: &mut Source, limits: &Limits) -> Result<FileKind> {
    let holds_splats = match format {
        Format::Splat | Format::Spz | Format::Sog => true,
        Format::Ply => ply::holds_splats(source)?,
        Format::Pt if splats::sog::is_sog(source)? => return Ok(FileKind::Splats(Format::Sog)),
        Format::Glb | Format::Gltf => gltf::holds_splats(source, limits)?,
        Format::Pt | Format::Off | Format::Obj | Format::Html => false,
    };
    Ok(if holds_splats { FileKind::Splats(format) } else { FileKind::Scene(format) })
}

/// The scene in the file at `path`, in any format that is read; "-" is standard input.
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
    read_as(format, source_of_bytes(bytes, &options.limits)?, options)
}

fn source_of_bytes(bytes: &[u8], limits: &Limits) -> Result<Source> {
    let path = PathBuf::from("<bytes>");
    let (file, len) = input::spool(&path, &mut &*bytes, limits)?;
    Ok(Source { path, file: Arc::new(file), len })
}

/// The scene in an open file of that format.
pub(super) fn read_as(
    format: Format,
    source: Source,
    options: &ReadOptions,
) -> Result<ImportedScene> {
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

/// Beginning of a safetensors file with metadata, behind the length of its header.
const SAFETENSORS: &[u8] = b"{\"__metadata__\"";

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
        Ok(text)
            if !text.contains(|c: char| c.is_control() && c != '\n' && c != '\t' && c != '\r') =>
        {
            format!("{text:?}")
        }
        _ => {
            let hex: Vec<String> = head.iter().take(8).map(|b| format!("{b:02x}")).collect();
            format!("bytes {}", hex.join(" "))
        }
    }
}

// ---- Triangles or Gaussians ---------------------------------------------------------------------

/// Content of a file.
#[derive(Debug, Clone, PartialEq)]
pub enum Content {
    /// Triangles.
    Scene(ImportedScene),
    /// Gaussians.
    Splats(ImportedSplats),
}

impl Content {
    /// The triangles to display, and the Gaussians that they stand for: see
    /// [`ImportedSplats::stand_in`].
    pub fn stand_in(self) -> (ImportedScene, Option<Splats>) {
        match self {
            Self::Scene(loaded) => (loaded, None),
            Self::Splats(loaded) => (loaded.stand_in(), Some(loaded.splats)),
        }
    }
}

/// The triangles or Gaussians in the file at `path`; "-" is standard input. [`read`](crate::read())
/// refuses Gaussians. These come with all their spherical harmonics, because they are drawn.
///
/// # Errors
/// Errors of the format's reader, or an unknown format.
pub fn read_content(path: &Path, options: &ReadOptions) -> Result<Content> {
    let mut source = Source::open(path, &options.limits)?;
    let format = detect(&mut source)?;
    read_content_as(format, source, options)
}

/// All contents of the file at `path`: as of [`read_content`], then the Gaussians beside the
/// triangles of a glTF file.
///
/// # Errors
/// As of [`read_content`].
pub fn read_contents(path: &Path, options: &ReadOptions) -> Result<Vec<Content>> {
    let mut source = Source::open(path, &options.limits)?;
    let format = detect(&mut source)?;
    let triangles = ReadOptions { reads_splats_beside_mesh: true, ..*options };
    let mut contents = vec![read_content_as(format, source.again()?, &triangles)?];
    source.rewind()?;
    if matches!(format, Format::Glb | Format::Gltf)
        && gltf::holds_splats_beside_mesh(&mut source, &options.limits)?
    {
        let options = ReadOptions { sh_degree: 3, ..*options };
        contents.push(read_splats(format, source, &options).map(Content::Splats)?);
    }
    Ok(contents)
}

/// The triangles or Gaussians in the bytes of a file.
///
/// # Errors
/// As [`read_bytes`].
pub fn read_content_bytes(bytes: &[u8], format: Format, options: &ReadOptions) -> Result<Content> {
    read_content_as(format, source_of_bytes(bytes, &options.limits)?, options)
}

/// The triangles or Gaussians in an open file of that format.
fn read_content_as(format: Format, mut source: Source, options: &ReadOptions) -> Result<Content> {
    match kind_of(format, &mut source, &options.limits)? {
        FileKind::Scene(format) => read_as(format, source, options).map(Content::Scene),
        FileKind::Splats(format) => {
            let options = ReadOptions { sh_degree: 3, ..*options };
            read_splats(format, source, &options).map(Content::Splats)
        }
    }
}

/// True when the file at `path` holds Gaussians that are read, by its first bytes; false for a file
/// that cannot be read and for standard input, which is read once.
pub fn holds_splats(path: &Path, limits: &Limits) -> bool {
    path.as_os_str() != "-"
        && Source::open(path, limits).is_ok_and(|mut source| {
            detect(&mut source).is_ok_and(|format| is_of_splats(format, &mut source, limits))
        })
}

/// True when an open file of that format holds Gaussians; false for a broken one.
fn is_of_splats(format: Format, source: &mut Source, limits: &Limits) -> bool {
    matches!(kind_of(format, source, limits), Ok(FileKind::Splats(_)))
}

/// The Gaussians in an open file of that format, with the cameras in a list beside it.
pub(super) fn read_splats(
    format: Format,
    source: Source,
    options: &ReadOptions,
) -> Result<ImportedSplats> {
    let path = source.path.clone();
    guarded(&path, || {
        let mut loaded = match format {
            Format::Splat => splats::read(source, options)?,
            Format::Spz => splats::spz::read(source, options)?,
            Format::Sog => splats::sog::read(source, options)?,
            Format::Glb | Format::Gltf => gltf::read_splats(source, options)?,
            _ => ply::read_splats(source, options)?,
        };
        splats::cameras::add_beside(&path, &mut loaded, &options.limits);
        Ok(loaded)
    })
}

// ---- The plain case of writing: an asset and a file name ----------------------------------------

/// Files that [`write()`] wrote.
#[derive(Debug, Clone, PartialEq)]
pub struct WrittenFiles {
    /// Every file and its size: the requested one first, then those beside it.
    pub files: Vec<OutputReport>,
    /// Notes for the user, one sentence each.
    pub warnings: Vec<String>,
}

/// Writes an asset in the format of the ending of `path`: .glb, .gltf, .obj, .ply, .usdz, .html or
/// .tileset.json.
///
/// Files that belong to it go beside it: the .bin of a glTF, the .mtl of an OBJ and the picture of
/// its texture, a separate backdrop or panorama, a collider, levels of detail and their tileset.
/// They get their names when all of them are complete. Existing files are replaced.
///
/// ```
/// use trisplat_scene::Asset;
/// use trisplat_formats::{self as formats, OutputOptions, ReadOptions};
/// use trisplat_scene::mesh::{Colors, Mesh};
///
/// let mesh = Mesh {
///     positions: vec![glam::Vec3::ZERO, glam::Vec3::X, glam::Vec3::Y],
///     colors: Colors::Face(vec![[1.0, 0.5, 0.0]]), // linear RGB
///     ..Mesh::default()
/// };
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("triangle.glb");
/// let written = formats::write(&Asset::from(mesh), &path, &OutputOptions::default())?;
/// assert_eq!(written.files.len(), 1);
/// let back = formats::read(&path, &ReadOptions::default())?;
/// assert_eq!(back.scene.triangle_count(), 1);
/// # Ok::<(), trisplat_scene::Error>(())
/// ```
///
/// # Errors
/// `Invalid` for a name without a known ending, or standard output for several files; `TooLarge`
/// for a scene that exceeds the format; `Io`.
pub fn write(asset: &Asset, path: &Path, options: &OutputOptions) -> Result<WrittenFiles> {
    let side_files = SideFiles {
        levels: asset.levels.len(),
        backdrop: matches!(asset.surroundings, SurroundingsStorage::BackdropFile),
        sky: asset.sky().is_some(),
        collision: asset.collision.is_some(),
        texture: asset.mesh.texture.is_some(),
    };
    let output = Output::of_scene(path, None, options, &side_files)?;
    let mut report = Report::new("write");
    output::write(asset, &output, output.start()?, options, &mut report, &mut |_| Continue(()))?;
    Ok(WrittenFiles { files: report.outputs, warnings: report.warnings })
}

// ---- The files that the file of a scene names: buffers, pictures, materials, cameras ------------

/// The files that the scene at `path` names, whether they exist or not. A file that cannot be read
/// names none: its reader reports the fault.
pub fn named_files(path: &Path, limits: &Limits) -> Vec<PathBuf> {
    let cameras = splats::cameras::list_path(path);
    // These formats hold everything else themselves; a compressed file would be unpacked to be
    // recognised.
    let is_self_contained = |path: &Path| {
        matches!(
            Format::by_extension(path),
            Some(Format::Ply | Format::Pt | Format::Off | Format::Html)
        )
    };
    let names_nothing =
        cameras.is_none() && is_packed(path) && is_self_contained(&path.with_extension(""));
    if path.as_os_str() == "-" || names_nothing {
        return Vec::new();
    }
    let Ok(mut source) = Source::open(path, limits) else { return Vec::new() };
    let Ok(format) = detect(&mut source) else { return Vec::new() };
    let cameras = cameras.filter(|_| is_of_splats(format, &mut source, limits));
    let parts = match format {
        Format::Glb | Format::Gltf => gltf::named_files(&mut source, limits),
        Format::Obj => obj::named_files(&source, limits),
        _ => Ok(Vec::new()),
    };
    cameras.into_iter().chain(parts.unwrap_or_default()).collect()
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
            let message =
                read(&path, &ReadOptions::with_degree(0)).expect_err("a photo").to_string();
            assert!(message.contains(&format!("is a photo ({kind})")), "{message}");
            assert!(message.contains("`trisplat make`"), "{message}");
        }
    }

    #[test]
    fn an_unknown_file_names_what_was_seen_and_what_is_accepted() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("scene.glb");
        for (content, seen) in
            [(&b""[..], "is empty"), (b"\0\x01rubbish", "named like binary glTF")]
        {
            std::fs::write(&path, content).expect("writable");
            let message =
                read(&path, &ReadOptions::with_degree(0)).expect_err("unknown").to_string();
            assert!(message.contains(seen) && message.contains(".gltf"), "{message}");
        }
    }
}

#[cfg(test)]
mod content_tests {
    use super::*;

    /// Writes `text` as the file `name` and returns the names of the files that it names.
    fn named(name: &str, text: &[u8], beside: &[(&str, &str)]) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in beside {
            std::fs::write(folder.path().join(name), text).unwrap();
        }
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        let files = named_files(&path, &Limits::DEFAULT);
        files.iter().map(|file| file.strip_prefix(&folder).unwrap().display().to_string()).collect()
    }

    #[test]
    fn gaussians_name_the_cameras_beside_them() {
        let splat = [[0u8; 12], [1; 12], [200; 12]].concat()[..32].to_vec();
        let cameras = ("cameras.json", "[]");
        assert_eq!(named("a.splat", &splat, &[cameras]), ["cameras.json"]);
        assert_eq!(named("a.splat", &splat, &[]), [""; 0]);
        assert_eq!(named("a.off", b"OFF", &[cameras]), [""; 0]);
    }

    #[test]
    fn a_gltf_names_its_buffers_and_pictures() {
        let json = br#"{"asset": {"version": "2.0"},
            "buffers": [{"byteLength": 4, "uri": "my%20data.bin"}, {"byteLength": 1, "uri": "data:;base64,AA=="}, {}],
            "images": [{"uri": "a/wall.png"}, {"bufferView": 0}, {"uri": "https://example.org/b.png"}]}"#;
        assert_eq!(named("a.gltf", json, &[]), ["my data.bin", "a/wall.png"]);
        assert_eq!(named("a.txt", &[b"\xef\xbb\xbf", &json[..]].concat(), &[]).len(), 2);
        assert_eq!(named("a.gltf", &json[..90], &[]), [""; 0]);
    }

    #[test]
    fn an_obj_names_its_materials_and_their_pictures() {
        let mtl = "newmtl a\nmap_Kd -clamp on a wall.jpg\nmap_Bump -bm 0.5 bump.png\nnewmtl b\nbump b.png\nKd 1 0 0\n";
        let obj = b"v 0 0 0\nf 1 1 1\nmtllib my scene.mtl\n  mtllib missing.mtl\n";
        let wants = ["my scene.mtl", "a wall.jpg", "bump.png", "b.png", "missing.mtl"];
        assert_eq!(named("a.obj", obj, &[("my scene.mtl", mtl)]), wants);
        assert_eq!(named("a.ply", b"ply\nformat ascii 1.0\n", &[]), [""; 0]);
    }
}
