//! JSON, as commands print and write it, and standard output. A reader that closes it early (`| head`) causes no error.

use serde::Serialize;
use std::io::{self, ErrorKind, Write};
use trisplat_scene::{Error, Result, atomic::AtomicFile};

/// Writes `value` as indented JSON and a final newline.
pub fn print_json(value: &impl Serialize, out: &mut dyn Write) -> io::Result<()> {
    serde_json::to_writer_pretty(&mut *out, value)?;
    writeln!(out)
}

/// Writes `value` as JSON into a file that was started.
pub fn save_json(value: &impl Serialize, mut file: AtomicFile) -> Result<()> {
    print_json(value, &mut file).map_err(|e| Error::io(file.path(), e))?;
    file.commit().map(drop)
}

/// Standard output that discards text once its reader is gone.
#[derive(Debug, Default)]
pub(super) struct Stdout;

impl Write for Stdout {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match io::stdout().write(bytes) {
            Err(e) if e.kind() == ErrorKind::BrokenPipe => Ok(bytes.len()),
            written => written,
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match io::stdout().flush() {
            Err(e) if e.kind() == ErrorKind::BrokenPipe => Ok(()),
            flushed => flushed,
        }
    }
}
