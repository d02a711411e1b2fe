//! The blocks of texels that a picture is stored in.

/// What every side of a picture must be a multiple of.
pub(crate) const BLOCK: u32 = 4;

/// The blocks of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Blocks {
    /// 4x4 texels of two colours from a codebook, entropy-coded.
    Etc1s,
    /// 4x4 texels in 16 bytes.
    Uastc,
}

impl Blocks {
    /// Their name in the format.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Etc1s => "ETC1S",
            Self::Uastc => "UASTC",
        }
    }
}
