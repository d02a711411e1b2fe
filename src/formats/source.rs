//! A file to read: opened once, seekable, of known length.

use crate::error::{Error, Result};
use crate::input;
use crate::limits::Limits;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// A file to read: a label for messages, an open handle and its length.
/// Standard input ("-") is spooled to a temporary file first, so that every reader may seek and may
/// compare promised counts with real bytes.
#[derive(Debug)]
pub struct Source {
    /// The path as the user gave it; "-" for standard input.
    pub path: PathBuf,
    /// Open at byte 0.
    pub file: File,
    /// Length in bytes.
    pub len: u64,
}

impl Source {
    /// Opens `path`; "-" is standard input. Folders, devices and pipes are errors that say so.
    pub fn open(path: &Path, limits: &Limits) -> Result<Self> {
        let (file, len) = match path.as_os_str() == "-" {
            true => input::spool(path, &mut std::io::stdin().lock(), limits)?,
            false if path.is_dir() => {
                let reason = "is a folder; give a .ply, .pt, .off, .obj, .glb, .gltf or .html file";
                return Err(Error::unsupported(path, reason));
            }
            false => input::open(path, limits)?,
        };
        Ok(Self { path: path.to_owned(), file, len })
    }

    /// The same open file once more, at byte 0. The two share their place in it: use one at a time.
    pub fn again(&mut self) -> Result<Self> {
        let io = |e| Error::io(&self.path, e);
        self.file.seek(SeekFrom::Start(0)).map_err(io)?;
        Ok(Self { path: self.path.clone(), file: self.file.try_clone().map_err(io)?, len: self.len })
    }

    /// The first bytes, at most 64; the handle is back at byte 0 afterwards.
    pub fn head(&mut self) -> Result<Vec<u8>> {
        let mut head = Vec::new();
        (&mut self.file).take(64).read_to_end(&mut head).map_err(|e| Error::io(&self.path, e))?;
        self.file.seek(SeekFrom::Start(0)).map_err(|e| Error::io(&self.path, e))?;
        Ok(head)
    }
}
