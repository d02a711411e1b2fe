//! JSON, as commands print and write it.

use serde::Serialize;
use std::io::{self, Write};
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
