//! A file to read: opened once, seekable, of known length.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use trisplat_scene::{Error, Limits, Result, input};

/// A file to read: a label for messages, an open handle and its length. Standard input ("-") is spooled to a
/// temporary file first, so that every reader may seek, and may compare counts with the real length.
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
    /// Opens `path`; "-" is standard input. Folders, devices and pipes are errors.
    pub fn open(path: &Path, limits: &Limits) -> Result<Self> {
        let (file, len) = match path.as_os_str() == "-" {
            true => input::spool(path, &mut std::io::stdin().lock(), limits)?,
            false if path.is_dir() => {
                let reason = "is a folder; give a .ply, .pt, .off, .obj, .glb, .gltf or .html file";
                return Err(Error::unsupported(path, reason));
            }
            false => input::open(path, limits)?,
        };
        let (file, len) = match is_packed(path) {
            true => unpacked(path, file, len, limits)?,
            false => (file, len),
        };
        Ok(Self { path: path.to_owned(), file: Arc::new(file), len })
    }

    /// Its name without the ending of a compressed file.
    pub fn named(&self) -> PathBuf {
        match is_packed(&self.path) {
            true => self.path.with_extension(""),
            false => self.path.clone(),
        }
    }

    /// The same open file again, at byte 0. Both share their position: use one at a time.
    pub fn again(&mut self) -> Result<Self> {
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

/// Whether the name has the ending of gzip. (Some formats are compressed inside.)
pub(crate) fn is_packed(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("gz"))
}

/// The uncompressed content of a gzip file, in a temporary file; any other file itself.
fn unpacked(path: &Path, mut file: File, len: u64, limits: &Limits) -> Result<(File, u64)> {
    let io = |e| Error::io(path, e);
    let mut magic = [0; 2];
    let read = (&mut file).take(2).read(&mut magic).map_err(io)?;
    file.seek(SeekFrom::Start(0)).map_err(io)?;
    if (read, magic) != (2, GZIP) {
        return Ok((file, len));
    }
    let unpacked = input::spool(path, &mut flate2::read::MultiGzDecoder::new(file), limits);
    unpacked.map_err(|error| damaged(path, error, "its compressed bytes", "gzip -t"))
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

// ---- What the caller will use of a file, and the limits that apply to it -----------------------------

/// The parts of a file to load, and the limits for it. By default everything, within the default limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReadOptions {
    /// Highest degree of spherical harmonics to load, 0 to 3; the bake asks for 0. The rest is skipped on disk.
    pub sh_degree: u8,
    /// Limits on the file.
    pub limits: Limits,
    /// Whether a glTF document may name files outside its folder.
    pub allow_outside: bool,
}

impl ReadOptions {
    /// Spherical harmonics up to that degree, and the default limits.
    pub const fn with_degree(sh_degree: u8) -> Self {
        Self { sh_degree, limits: Limits::DEFAULT, allow_outside: false }
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
}
