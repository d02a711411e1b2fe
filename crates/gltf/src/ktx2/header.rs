//! The first bytes of a KTX2 file, and what KHR_texture_basisu asks of them.

use super::blocks::{BLOCK, Blocks};
use glam::UVec2;

/// The first bytes of every file.
pub(super) const IDENTIFIER: [u8; 12] = *b"\xABKTX 20\xBB\r\n\x1A\n";
/// Bytes of the header with the index of its parts.
pub(super) const HEADER_BYTES: usize = 80;
/// Where the index gives the bytes of the finest level after unpacking.
const UNPACKED_AT: usize = HEADER_BYTES + 16;
/// Colour models of the data format descriptor.
pub(super) const MODEL_ETC1S: u8 = 163;
pub(super) const MODEL_UASTC: u8 = 166;
/// Transfer functions of the data format descriptor.
pub(super) const TRANSFER_SRGB: u8 = 2;

/// True when `bytes` begin as a KTX2 file does.
pub(crate) fn is_ktx2(bytes: &[u8]) -> bool {
    bytes.starts_with(&IDENTIFIER)
}

/// What the header and the data format descriptor say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Header {
    pub(crate) size: UVec2,
    pub(crate) levels: u32,
    pub(crate) blocks: Blocks,
    transfer: u8,
    /// Bytes of the finest level's blocks after unpacking, which decoders allocate; 0 of ETC1S.
    unpacked: u64,
    /// Layers, faces and depth make it another thing than one picture.
    is_one_picture: bool,
}

impl Header {
    /// Reads the header; the error names what is not as in a file of these blocks.
    pub(crate) fn read(bytes: &[u8]) -> Result<Self, String> {
        if !is_ktx2(bytes) {
            return Err("is not KTX2".to_owned());
        }
        let cut = || "is a KTX2 file that is cut short".to_owned();
        if bytes.len() < HEADER_BYTES {
            return Err(cut());
        }
        let word = |at: usize| -> Result<u32, String> {
            let found = bytes.get(at..at + 4).and_then(|four| four.try_into().ok());
            found.map(u32::from_le_bytes).ok_or_else(cut)
        };
        let [format, width, height, depth] = [word(12)?, word(20)?, word(24)?, word(28)?];
        let [layers, faces, levels] = [word(32)?, word(36)?, word(40)?];
        let descriptor = word(48)? as usize;
        let model = word(descriptor.saturating_add(12))?.to_le_bytes();
        let blocks = match model[0] {
            MODEL_ETC1S if format == 0 => Blocks::Etc1s,
            MODEL_UASTC if format == 0 => Blocks::Uastc,
            _ => return Err("is KTX2 of other blocks than ETC1S and UASTC".to_owned()),
        };
        let unpacked = u64::from(word(UNPACKED_AT)?) | u64::from(word(UNPACKED_AT + 4)?) << 32;
        Ok(Self {
            unpacked,
            size: UVec2::new(width, height),
            levels,
            blocks,
            transfer: model[2],
            is_one_picture: depth == 0 && layers <= 1 && faces == 1,
        })
    }

    /// Whether the finest level says to have as many bytes as it has blocks.
    pub(crate) fn is_unpacked_as_expected(&self) -> bool {
        let blocks = u64::from(self.size.x.div_ceil(BLOCK)) * u64::from(self.size.y.div_ceil(BLOCK));
        self.unpacked == if self.blocks == Blocks::Uastc { 16 * blocks } else { 0 }
    }

    /// What KHR_texture_basisu forbids of a colour texture.
    pub(crate) fn faults(&self) -> Vec<String> {
        let Self { size, levels, .. } = *self;
        let all = 1 + size.max_element().max(1).ilog2();
        let mut faults = Vec::new();
        if size.min_element() == 0 || size % BLOCK != UVec2::ZERO {
            faults.push(format!("is {size} texels; expected multiples of {BLOCK}"));
        }
        if levels != 1 && levels != all {
            faults.push(format!("has {levels} mip levels; expected 1 or all {all}"));
        }
        if self.transfer != TRANSFER_SRGB {
            faults.push("is not marked as sRGB, which colours are".to_owned());
        }
        if !self.is_unpacked_as_expected() {
            faults.push(format!(
                "says that its finest level has {} bytes, which is not what it has",
                self.unpacked
            ));
        }
        if !self.is_one_picture {
            faults.push("has layers, faces or depth; expected one picture".to_owned());
        }
        faults
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The header of a file with these mip levels.
    fn header(size: [u32; 2], levels: u32, model: [u8; 4]) -> Vec<u8> {
        let mut bytes = IDENTIFIER.to_vec();
        let words = [0, 1, size[0], size[1], 0, 0, 1, levels, 0, 104, 44];
        bytes.extend(words.iter().flat_map(|word: &u32| word.to_le_bytes()));
        bytes.resize(104 + 12, 0);
        bytes.extend(model);
        bytes
    }

    #[test]
    fn faults_are_named_and_other_files_refused() {
        let good = header([64, 32], 7, [MODEL_ETC1S, 1, TRANSFER_SRGB, 0]);
        let read = Header::read(&good).unwrap();
        assert_eq!((read.size, read.levels, read.blocks), (UVec2::new(64, 32), 7, Blocks::Etc1s));
        assert!(read.faults().is_empty());
        let bad = Header::read(&header([30, 32], 3, [MODEL_UASTC, 1, 1, 0])).unwrap().faults();
        for (fault, wants) in bad.iter().zip(["multiples of 4", "all 6", "sRGB", "finest level"]) {
            assert!(fault.contains(wants), "{fault}");
        }
        assert_eq!(bad.len(), 4);
        for at in 0..good.len() {
            assert!(Header::read(&good[..at]).is_err(), "{at}");
        }
        assert!(Header::read(&header([4, 4], 1, [162, 1, 2, 0])).unwrap_err().contains("other blocks"));
    }
}
