//! Contents by their XXH3 hash, written as sixteen hexadecimal digits.

use serde::Serialize;
use std::io::{self, Read, Write};
use std::path::Path;
use trisplat_scene::{Error, Limits, Result, input};
use xxhash_rust::xxh3::{Xxh3Default, xxh3_64};

/// Bytes read at a time.
const BUFFER: usize = 1 << 20;

/// The hash of a file's bytes.
///
/// Errors: what the operating system refuses; no regular file.
pub(super) fn of_file(path: &Path, limits: &Limits) -> Result<String> {
    let (mut file, _) = input::open(path, limits)?;
    let (mut hash, mut buffer) = (Xxh3Default::new(), vec![0; BUFFER]);
    loop {
        match file.read(&mut buffer).map_err(|e| Error::io(path, e))? {
            0 => return Ok(digits(hash.digest())),
            count => hash.update(&buffer[..count]),
        }
    }
}

/// The hash of a value as JSON.
pub(super) fn of_value(value: &impl Serialize) -> Result<String> {
    let bytes =
        serde_json::to_vec(value).map_err(|e| Error::invalid("manifest", e, "numbers JSON can hold"))?;
    Ok(digits(xxh3_64(&bytes)))
}

/// A writer that hashes what it hands on.
pub(super) struct Hashed<W> {
    to: W,
    hash: Xxh3Default,
}

impl<W: Write> Hashed<W> {
    pub(super) fn new(to: W) -> Self {
        Self { to, hash: Xxh3Default::new() }
    }

    /// The writer, and the hash of all that it was given.
    pub(super) fn end(self) -> (W, String) {
        (self.to, digits(self.hash.digest()))
    }
}

impl<W: Write> Write for Hashed<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.to.write(bytes)?;
        self.hash.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.to.flush()
    }
}

/// A hash as it is written.
pub(super) fn digits(hash: u64) -> String {
    format!("{hash:016x}")
}
