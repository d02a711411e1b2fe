//! A `.basis` file of ETC1S or UASTC, taken apart. Numbers are little-endian, places count from its start.
//!
//! ```text
//! header   0 "sB"   14 slices (3 bytes)   20 format
//!          39 endpoints (2), their place (4) and bytes (3)   48 selectors (2), their place (4) and bytes (3)
//!          57 tables: place (4), bytes (4)   65 slices: place (4)
//! slice    23 bytes: 5 width (2)   7 height (2)   13 place (4)   17 bytes (4)
//! ```

use super::blocks::Blocks;
use glam::UVec2;

const SIGNATURE: u64 = u16::from_le_bytes(*b"sB") as u64;
const SLICE_BYTES: usize = 23;

/// The parts of a file.
#[derive(Debug)]
pub(super) struct Basis<'a> {
    pub(super) blocks: Blocks,
    /// Of ETC1S only, else empty.
    pub(super) endpoints: Codebook<'a>,
    pub(super) selectors: Codebook<'a>,
    pub(super) tables: &'a [u8],
    /// One for each mip level, the finest first.
    pub(super) slices: Vec<Slice<'a>>,
}

/// A codebook and its number of entries.
#[derive(Debug, Default)]
pub(super) struct Codebook<'a> {
    pub(super) entries: u16,
    pub(super) bytes: &'a [u8],
}

/// The blocks of a mip level.
#[derive(Debug)]
pub(super) struct Slice<'a> {
    pub(super) size: UVec2,
    pub(super) bytes: &'a [u8],
}

impl<'a> Basis<'a> {
    /// Takes the file of `levels` mip levels apart; the error says what is not as expected.
    pub(super) fn read(file: &'a [u8], levels: usize) -> Result<Self, String> {
        let bytes = Bytes(file);
        if bytes.number(0, 2)? != SIGNATURE {
            return Err("the encoder wrote no .basis file".to_owned());
        }
        let slices = bytes.number(14, 3)?;
        if slices != levels as u64 {
            return Err(format!("the encoder wrote {slices} pictures instead of {levels}"));
        }
        let codebook = |at: usize| -> Result<Codebook<'a>, String> {
            Ok(Codebook { entries: bytes.number(at, 2)? as u16, bytes: bytes.part(at + 2, at + 6, 3)? })
        };
        let first = bytes.number(65, 4)? as usize;
        let slice = |number: usize| {
            let at = first + number * SLICE_BYTES;
            let size = UVec2::new(bytes.number(at + 5, 2)? as u32, bytes.number(at + 7, 2)? as u32);
            Ok(Slice { size, bytes: bytes.part(at + 13, at + 17, 4)? })
        };
        let slices = (0..levels).map(slice).collect::<Result<_, String>>()?;
        let (blocks, endpoints, selectors, tables) = match bytes.number(20, 1)? {
            0 => (Blocks::Etc1s, codebook(39)?, codebook(48)?, bytes.part(57, 61, 4)?),
            _ => (Blocks::Uastc, Codebook::default(), Codebook::default(), &[][..]),
        };
        Ok(Self { blocks, endpoints, selectors, tables, slices })
    }
}

/// Numbers and parts of a file.
#[derive(Clone, Copy)]
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn slice(self, at: usize, count: usize) -> Result<&'a [u8], String> {
        let end = at.checked_add(count);
        end.and_then(|end| self.0.get(at..end))
            .ok_or_else(|| format!("the .basis file ends before byte {at}"))
    }

    /// A number of `count` bytes.
    fn number(self, at: usize, count: usize) -> Result<u64, String> {
        Ok(self.slice(at, count)?.iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte)))
    }

    /// What a place of 4 bytes and a length of `count` bytes point at.
    fn part(self, place: usize, length: usize, count: usize) -> Result<&'a [u8], String> {
        self.slice(self.number(place, 4)? as usize, self.number(length, count)? as usize)
    }
}
