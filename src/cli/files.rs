//! What commands share about the files they write: JSON, and the refusal to replace.

use crate::atomic::AtomicFile;
use crate::error::{Error, Result};
use serde::Serialize;
use std::io::{self, Write};
use std::path::Path;

/// Writes `value` as indented JSON and a final newline.
pub fn print_json(value: &impl Serialize, out: &mut dyn Write) -> io::Result<()> {
    serde_json::to_writer_pretty(&mut *out, value)?;
    writeln!(out)
}

/// Writes `value` as a JSON file that appears whole or not at all.
pub fn save_json(value: &impl Serialize, path: &Path) -> Result<()> {
    let mut file = AtomicFile::create(path)?;
    print_json(value, &mut file).map_err(|e| Error::io(path, e))?;
    file.commit().map(drop)
}

/// True when both names lead to one file.
pub fn is_same(a: &Path, b: &Path) -> bool {
    matches!((std::fs::canonicalize(a), std::fs::canonicalize(b)), (Ok(a), Ok(b)) if a == b)
}

/// The error of a file that exists and may not be replaced.
pub fn is_there(option: &str, path: &Path) -> Error {
    Error::invalid(option, path.display(), "a new file, or --force to replace it")
}
