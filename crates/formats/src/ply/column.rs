//! One number in the rows of an element.

use super::header::Scalar;

/// The place of a number in a row.
#[derive(Debug, Clone, Copy)]
pub struct Column {
    pub(super) offset: usize,
    pub(super) scalar: Scalar,
}

impl Column {
    /// True for an unsigned byte.
    pub fn is_byte(self) -> bool {
        self.scalar == Scalar::U8
    }

    /// The number, as f32; f64 and large integers are rounded.
    #[inline]
    pub(super) fn f32(self, row: &[u8]) -> f32 {
        match self.scalar {
            Scalar::F32 => f32::from_le_bytes(bytes(row, self.offset)),
            Scalar::F64 => f64::from_le_bytes(bytes(row, self.offset)) as f32,
            _ => self.int(row) as f32,
        }
    }

    /// The number, exact for every type.
    #[inline]
    pub fn f64(self, row: &[u8]) -> f64 {
        match self.scalar {
            Scalar::F32 => f32::from_le_bytes(bytes(row, self.offset)).into(),
            Scalar::F64 => f64::from_le_bytes(bytes(row, self.offset)),
            _ => self.int(row) as f64,
        }
    }

    /// The number, truncated if it is a float.
    #[inline]
    pub fn int(self, row: &[u8]) -> i64 {
        match self.scalar {
            Scalar::U8 => row[self.offset].into(),
            Scalar::I8 => (row[self.offset] as i8).into(),
            Scalar::U16 => u16::from_le_bytes(bytes(row, self.offset)).into(),
            Scalar::I16 => i16::from_le_bytes(bytes(row, self.offset)).into(),
            Scalar::U32 => u32::from_le_bytes(bytes(row, self.offset)).into(),
            Scalar::I32 => i32::from_le_bytes(bytes(row, self.offset)).into(),
            Scalar::F32 | Scalar::F64 => self.f32(row) as i64,
        }
    }
}

/// The bytes of one number in a row; a row is always as long as the layout its columns come from.
#[inline]
fn bytes<const N: usize>(row: &[u8], offset: usize) -> [u8; N] {
    let mut out = [0; N];
    out.copy_from_slice(&row[offset..offset + N]);
    out
}
