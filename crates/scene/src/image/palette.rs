//! The palette of a PNG file: its decoder trusts it, so it is checked first.

use super::png::PNG_START;
use crate::error::{Error, Result};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

/// Most colours of a palette, of 3 bytes each (PNG specification, 11.2.2).
const MOST_COLORS: u32 = 256;

/// Errors: a palette that is not of 1 to 256 whole colours. Checks the chunks up to the first pixels; other
/// formats have no palette.
pub(super) fn check(path: &Path, file: &mut (impl Read + Seek)) -> Result<()> {
    match bad_palette(file).map_err(|e| Error::io(path, e))? {
        None => Ok(()),
        Some((at, bytes)) => {
            let reason = format!("{bytes} bytes are no palette of 1 to {MOST_COLORS} colours; copy it again");
            Err(Error::malformed(path, format!("PLTE chunk at byte {at}"), reason))
        }
    }
}

/// Place and length of the first invalid palette, bytes.
fn bad_palette(file: &mut (impl Read + Seek)) -> io::Result<Option<(u64, u32)>> {
    let mut head = [0; 8];
    let mut at = PNG_START.len() as u64;
    if !read(file, &mut head)? || head != PNG_START {
        return Ok(None);
    }
    // The decoder refuses a file that ends here.
    while read(file, &mut head)? {
        let [a, b, c, d, name @ ..] = head;
        let len = u32::from_be_bytes([a, b, c, d]);
        match &name {
            b"PLTE" if !len.is_multiple_of(3) || !(3..=3 * MOST_COLORS).contains(&len) => {
                return Ok(Some((at, len)));
            }
            b"IDAT" => break,
            _ => {}
        }
        // Name, length and checksum.
        at += 12 + u64::from(len);
        file.seek(SeekFrom::Start(at))?;
    }
    Ok(None)
}

/// False at the end of the file.
fn read(file: &mut impl Read, bytes: &mut [u8; 8]) -> io::Result<bool> {
    match file.read_exact(bytes) {
        Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => Ok(false),
        read => read.map(|()| true),
    }
}
