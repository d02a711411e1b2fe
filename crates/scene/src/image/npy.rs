//! Floats as NumPy reads them: a header of one line, then the numbers. `numpy.load("a.npy")` is all that others need.

use crate::atomic::AtomicFile;
use crate::error::{Error, Result};
use std::io::Write;
use std::path::Path;

/// Bytes that the header is a multiple of.
const ALIGNED: usize = 64;

/// Writes an array of this shape, its last axis the fastest, into a file that appears whole or not at all.
///
/// Errors: what the operating system refuses.
pub fn save(path: &Path, shape: &[u32], values: &[f32]) -> Result<()> {
    let mut file = AtomicFile::create(path)?;
    let mut write = |bytes: &[u8]| file.write_all(bytes).map_err(|e| Error::io(path, e));
    write(&header(shape))?;
    match cfg!(target_endian = "little") {
        true => write(bytemuck::cast_slice(values))?,
        false => values.iter().try_for_each(|value| write(&value.to_le_bytes()))?,
    }
    file.commit().map(drop)
}

/// Magic, version 1.0, length, and a Python dictionary, padded so that numbers are aligned.
fn header(shape: &[u32]) -> Vec<u8> {
    let sides: String = shape.iter().map(|side| format!("{side}, ")).collect();
    let mut text = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({sides}), }}");
    let before = 10;
    while !(before + text.len() + 1).is_multiple_of(ALIGNED) {
        text.push(' ');
    }
    text.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes
}
