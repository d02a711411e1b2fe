//! A file to read: opened once, seekable, of known length.

use crate::format::foreign_json;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use trisplat_scene::{Error, Limits, Result, input};
use zip::write::{SimpleFileOptions, ZipWriter};

/// The formats that are read, for messages.
pub(crate) const ACCEPTED: &str = "a soup, mesh or Gaussian splats (.ply), .splat, .spz, .sog, a training checkpoint .pt, .off, .obj, .glb, .gltf or our own .html";
/// Name of the list of an unzipped SOG.
const SOG_LIST: &str = "meta.json";

/// A file to read: a label for messages, an open handle and its length. Standard input ("-") is
/// spooled to a temporary file first, so that every reader may seek, and may compare counts with
/// the real length.
#[derive(Debug)]
pub struct Source {
    /// The path as the user gave it; "-" for standard input.
    pub path: PathBuf,
    /// Open at byte 0; shared with the results of [`Source::again`].
    pub file: Arc<File>,
    /// Length in bytes.
    pub len: u64,
}

impl Source {
    /// Opens `path`; "-" is standard input. Folders, devices and pipes are errors, except for an
    /// unzipped SOG, given by its folder or its `meta.json`, which is zipped again.
    pub fn open(path: &Path, limits: &Limits) -> Result<Self> {
        if let Some(folder) = unzipped_sog(path) {
            let (file, len) = zip_folder(&folder, limits)?;
            return Ok(Self { path: path.to_owned(), file: Arc::new(file), len });
        }
        let (mut file, mut len) = if path.as_os_str() == "-" {
            input::spool(path, &mut std::io::stdin().lock(), limits)?
        } else if path.is_dir() {
            return Err(folder_error(path));
        } else {
            input::open(path, limits)?
        };
        if is_packed(path) {
            (file, len) = unpack_gzip(path, file, len, limits)?;
        }
        let mut source = Self { path: path.to_owned(), file: Arc::new(file), len };
        if input::is_lfs_pointer(&source.head()?) {
            return Err(Error::unsupported(path, LFS_POINTER));
        }
        Ok(source)
    }

    /// Its name without the ending of a compressed file.
    pub fn named(&self) -> PathBuf {
        if is_packed(&self.path) { self.path.with_extension("") } else { self.path.clone() }
    }

    /// The same open file again, at byte 0. Both share their position: use one at a time.
    pub fn again(&self) -> Result<Self> {
        self.rewind()?;
        Ok(Self { path: self.path.clone(), file: Arc::clone(&self.file), len: self.len })
    }

    /// The first bytes, at most 64; the handle is back at byte 0 afterwards.
    pub fn head(&mut self) -> Result<Vec<u8>> {
        let mut head = Vec::new();
        (&*self.file).take(64).read_to_end(&mut head).map_err(|e| Error::io(&self.path, e))?;
        self.rewind()?;
        Ok(head)
    }

    /// Back to byte 0.
    pub fn rewind(&self) -> Result<()> {
        (&*self.file).rewind().map_err(|e| Error::io(&self.path, e))
    }
}

/// Reason why a file of a clone without git-lfs is not read.
pub(crate) const LFS_POINTER: &str =
    "is a pointer of git-lfs, not the file; run `git lfs pull` in its repository";

/// The error for a folder in place of a file.
fn folder_error(path: &Path) -> Error {
    let reason = if path.join("scene.ply").is_file() && path.join("photos").is_dir() {
        format!(
            "is a folder of `trisplat make`: its scene is {0}/scene.ply, its data set {0}/photos",
            path.display()
        )
    } else if path.join(STREAMED_LIST).is_file() {
        let list = path.join(STREAMED_LIST);
        return foreign_json(&list, &input::read(&list, &Limits::DEFAULT).unwrap_or_default())
            .unwrap_or_else(|| Error::unsupported(path, "is a folder of a streamed SOG"));
    } else {
        format!("is a folder; give {ACCEPTED}; `trisplat make` makes a scene of photos")
    };
    Error::unsupported(path, reason)
}

/// Name of the list of a streamed SOG.
const STREAMED_LIST: &str = "lod-meta.json";

/// The folder of an unzipped SOG that is given by itself or by its `meta.json`.
pub fn unzipped_sog(path: &Path) -> Option<PathBuf> {
    let is_list = path.file_name().is_some_and(|name| name == SOG_LIST);
    let folder = if is_list { path.parent()? } else { path };
    let has = |name: &str| folder.join(name).is_file();
    (has(SOG_LIST) && has("means_l.webp")).then(|| folder.to_owned())
}

/// The files of a folder as a zip archive, in a temporary file.
fn zip_folder(folder: &Path, limits: &Limits) -> Result<(File, u64)> {
    let io = |e| Error::io(folder, e);
    let entries =
        std::fs::read_dir(folder).map_err(io)?.collect::<std::io::Result<Vec<_>>>().map_err(io)?;
    let mut files: Vec<PathBuf> = entries.into_iter().map(|entry| entry.path()).collect();
    files.retain(|path| {
        path.is_file() && path.extension().is_some_and(|e| e == "webp" || e == "json")
    });
    files.sort();
    let zip_error = |e: zip::result::ZipError| Error::temporary(e.into());
    let mut zip = ZipWriter::new(tempfile::tempfile().map_err(Error::temporary)?);
    let stored = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    for path in files {
        let (file, len) = input::open(&path, limits)?;
        zip.start_file_from_path(path.file_name().unwrap_or_default(), stored)
            .map_err(zip_error)?;
        std::io::copy(&mut file.take(len), &mut zip).map_err(|e| Error::io(&path, e))?;
    }
    let mut file = zip.finish().map_err(zip_error)?;
    let len = file.seek(SeekFrom::End(0)).map_err(Error::temporary)?;
    file.rewind().map_err(Error::temporary)?;
    Ok((file, len))
}

/// True when the name has the ending of gzip. (Some formats are compressed inside.)
pub(crate) fn is_packed(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("gz"))
}

/// The uncompressed content of a gzip file, in a temporary file; any other file itself.
fn unpack_gzip(path: &Path, mut file: File, len: u64, limits: &Limits) -> Result<(File, u64)> {
    let io = |e| Error::io(path, e);
    let mut magic = [0; 2];
    let read = (&mut file).take(2).read(&mut magic).map_err(io)?;
    file.seek(SeekFrom::Start(0)).map_err(io)?;
    if (read, magic) != (2, GZIP) {
        return Ok((file, len));
    }
    let place = "its compressed bytes";
    let damaged = |error| damaged(path, error, place, "gzip -t");
    let mut stream = flate2::read::MultiGzDecoder::new(file);
    let mut head = Vec::new();
    (&mut stream).take(HEAD_BYTES).read_to_end(&mut head).map_err(io).map_err(damaged)?;
    let max_bytes = HEAD_BYTES.saturating_add(max_body_bytes(&head, len));
    let mut whole = head.chain(stream).take(max_bytes.saturating_add(1));
    let (file, unpacked) = input::spool(path, &mut whole, limits).map_err(damaged)?;
    if unpacked > max_bytes {
        let reason = format!(
            "unpack to more than {max_bytes} bytes, which is more than such a header needs; `gunzip` the file if that is right"
        );
        return Err(Error::malformed(path, place, reason));
    }
    Ok((file, unpacked))
}

/// Maximum bytes of a file's header.
const HEAD_BYTES: u64 = 1 << 20;
/// Maximum bytes of a number in text.
const MAX_NUMBER_BYTES: u64 = 64;
/// Maximum numbers of a face: its corners, and their count.
const MAX_FACE_NUMBERS: u64 = 4097;
/// Maximum unpacked size of formats without counts, in packed sizes: text shrinks to a tenth,
/// seldom to a hundredth.
const MAX_TEXT_RATIO: u64 = 128;

/// Maximum bytes behind the header of a file that begins with `head`; `packed` is its compressed
/// size.
fn max_body_bytes(head: &[u8], packed: u64) -> u64 {
    let head = head.strip_prefix(input::BYTE_ORDER_MARK).unwrap_or(head);
    if let [b'g', b'l', b'T', b'F', _, _, _, _, a, b, c, d, ..] = *head {
        return u32::from_le_bytes([a, b, c, d]).into();
    }
    if !head.starts_with(b"ply") {
        return MAX_TEXT_RATIO.saturating_mul(packed.max(HEAD_BYTES));
    }
    let mut rows = 0u64;
    let mut all = 0u64;
    for line in String::from_utf8_lossy(head).lines().take_while(|line| line.trim() != "end_header")
    {
        match line.split_whitespace().collect::<Vec<_>>()[..] {
            ["element", _, count] => rows = count.parse().unwrap_or(0),
            ["property", "list", ..] => {
                all = all.saturating_add(rows.saturating_mul(MAX_NUMBER_BYTES * MAX_FACE_NUMBERS))
            }
            ["property", ..] => all = all.saturating_add(rows.saturating_mul(MAX_NUMBER_BYTES)),
            _ => {}
        }
    }
    all
}

/// The error of a decoder that met wrong bytes, with the program that tests them.
pub(crate) fn damaged(path: &Path, error: Error, place: &str, test: &str) -> Error {
    use std::io::ErrorKind::{InvalidData, InvalidInput, Other, UnexpectedEof};
    match error {
        Error::Io { source, .. }
            if matches!(source.kind(), InvalidInput | InvalidData | UnexpectedEof | Other) =>
        {
            Error::malformed(path, place, format!("end too soon or are damaged; `{test}` tests it"))
        }
        other => other,
    }
}

/// The first bytes of a gzip file.
const GZIP: [u8; 2] = [0x1f, 0x8b];

// ---- What the caller will use of a file, and the limits that apply to it ------------------------

/// The parts of a file to load, and the limits for it. By default everything, within the default
/// limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReadOptions {
    /// Highest degree of spherical harmonics to load, 0 to 3; the bake asks for 0. The rest is
    /// skipped on disk.
    pub sh_degree: u8,
    /// Limits on the file.
    pub limits: Limits,
    /// True when a glTF document may name files outside its folder.
    pub allow_outside: bool,
    /// True when the caller reads Gaussians beside a mesh too: then nothing is said of them.
    pub reads_splats_beside_mesh: bool,
}

impl ReadOptions {
    /// Spherical harmonics up to that degree, and the default limits.
    pub const fn with_degree(sh_degree: u8) -> Self {
        Self {
            sh_degree,
            limits: Limits::DEFAULT,
            allow_outside: false,
            reads_splats_beside_mesh: false,
        }
    }
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self::with_degree(3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn a_compressed_file_is_read_and_a_damaged_one_is_refused() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("square.obj.gz");
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        packed.write_all(b"v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n").expect("in memory");
        let bytes = packed.finish().expect("in memory");
        std::fs::write(&path, &bytes).expect("writable");
        let source = Source::open(&path, &Limits::DEFAULT).expect("readable");
        let loaded = crate::obj::read(source, &crate::ReadOptions::default()).expect("readable");
        assert_eq!(loaded.scene.triangle_count(), 1);
        std::fs::write(&path, &bytes[..bytes.len() - 12]).expect("writable");
        let error = Source::open(&path, &Limits::DEFAULT).expect_err("cut short").to_string();
        assert!(error.contains("square.obj.gz") && error.contains("gzip -t"), "{error}");
        std::fs::write(&path, &bytes).expect("writable");
        let few = Limits { file_bytes: 20, ..Limits::DEFAULT };
        assert!(Source::open(&path, &few).is_err(), "larger than the limit once unpacked");
    }

    #[test]
    fn a_bomb_of_ply_gz_is_not_unpacked_beyond_what_its_counts_need() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
            element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
        let glb = [&b"glTF\x02\0\0\0"[..], &100u32.to_le_bytes()].concat();
        for (name, head) in
            [("a.ply.gz", ply.as_bytes()), ("a.glb.gz", &glb), ("a.obj.gz", b"v 0 0 0\n")]
        {
            let path = folder.path().join(name);
            let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
            packed.write_all(head).expect("in memory");
            packed.write_all(&vec![b'\n'; 200 << 20]).expect("in memory");
            std::fs::write(&path, packed.finish().expect("in memory")).expect("writable");
            let error = Source::open(&path, &Limits::DEFAULT).expect_err(name).to_string();
            assert!(
                error.contains(name) && error.contains("more than such a header needs"),
                "{error}"
            );
        }
        assert_eq!(max_body_bytes(ply.as_bytes(), 1), 64 * (3 * 3 + 4097));
        // Text without counts may shrink as much as it likes below 128 MiB.
        let path = folder.path().join("b.obj.gz");
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
        packed
            .write_all(&[&b"v 0 0 0\n"[..], &vec![b'\n'; 100 << 20]].concat())
            .expect("in memory");
        std::fs::write(&path, packed.finish().expect("in memory")).expect("writable");
        assert!(Source::open(&path, &Limits::DEFAULT).is_ok());
        assert_eq!(max_body_bytes(b"v 0 0 0\n", 2 << 20), 256 << 20);
    }
}
