//! Files that appear whole or not at all.
//!
//! Bytes go to a temporary file beside the target, which takes the target's name at
//! [`AtomicFile::commit`]. A dropped, uncommitted file leaves nothing behind. Devices and pipes
//! cannot be replaced by renaming, so they (and standard output) are written directly.

use crate::error::{Error, Result};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Large enough that a write costs a copy and not a system call.
const BUFFER_BYTES: usize = 1 << 20;

/// A buffered file under construction.
#[derive(Debug)]
pub struct AtomicFile {
    path: PathBuf,
    bytes: u64,
    to: Destination,
}

#[derive(Debug)]
enum Destination {
    Temporary(BufWriter<NamedTempFile>),
    Direct(BufWriter<File>),
    Stdout(BufWriter<std::io::Stdout>),
    Nowhere,
}

impl AtomicFile {
    /// Starts a file that will be called `path`; "-" is standard output.
    pub fn create(path: &Path) -> Result<Self> {
        let io = |e| Error::io(path, e);
        let to = if path.as_os_str() == "-" {
            Destination::Stdout(BufWriter::with_capacity(BUFFER_BYTES, std::io::stdout()))
        } else if std::fs::metadata(path).is_ok_and(|m| !m.is_file()) {
            let file = File::options().write(true).open(path).map_err(io)?;
            Destination::Direct(BufWriter::with_capacity(BUFFER_BYTES, file))
        } else {
            let file = temporary_beside(path).map_err(io)?;
            Destination::Temporary(BufWriter::with_capacity(BUFFER_BYTES, file))
        };
        Ok(Self { path: path.to_owned(), bytes: 0, to })
    }

    /// Counts bytes and keeps none: a dry run.
    pub fn nowhere(path: &Path) -> Self {
        Self { path: path.to_owned(), bytes: 0, to: Destination::Nowhere }
    }

    /// The name it will have.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Flushes, gives the file its name and returns its size in bytes.
    pub fn commit(mut self) -> Result<u64> {
        let io = |e| Error::io(&self.path, e);
        self.to.flush().map_err(io)?;
        if let Destination::Temporary(file) = self.to {
            let file = file.into_inner().map_err(|e| Error::io(&self.path, e.into_error()))?;
            file.persist(&self.path).map_err(|e| Error::io(&self.path, e.error))?;
        }
        Ok(self.bytes)
    }

    /// As [`AtomicFile::commit`], but the bytes are on the disk before the file has its name: after a power cut there
    /// is the file that was there before, or this one whole.
    pub fn commit_synced(mut self) -> Result<u64> {
        let io = |e| Error::io(&self.path, e);
        self.to.flush().map_err(io)?;
        if let Destination::Temporary(file) = &self.to {
            file.get_ref().as_file().sync_all().map_err(io)?;
        }
        self.commit()
    }
}

impl Write for AtomicFile {
    fn write(&mut self, buf: &[u8]) -> std::io::Result<usize> {
        let written = self.to.write(buf)?;
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.to.flush()
    }
}

impl Write for Destination {
    fn write(&mut self, buf: &[u8]) -> std::io::Result<usize> {
        match self {
            Destination::Temporary(file) => file.write(buf),
            Destination::Direct(file) => file.write(buf),
            Destination::Stdout(out) => out.write(buf),
            Destination::Nowhere => Ok(buf.len()),
        }
    }

    fn flush(&mut self) -> std::io::Result<()> {
        match self {
            Destination::Temporary(file) => file.flush(),
            Destination::Direct(file) => file.flush(),
            Destination::Stdout(out) => out.flush(),
            Destination::Nowhere => Ok(()),
        }
    }
}

fn temporary_beside(path: &Path) -> std::io::Result<NamedTempFile> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    builder.prefix(".trisplat-").suffix(".tmp");
    // Ordinary permissions less the umask, as any tool's output has; temporary files are private.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dropped_file_leaves_nothing_and_a_committed_one_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.glb");
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(b"half").unwrap();
        drop(file);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);

        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(b"whole").unwrap();
        assert_eq!(file.commit().unwrap(), 5);
        assert_eq!(std::fs::read(&path).unwrap(), b"whole");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
