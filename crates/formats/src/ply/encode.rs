//! What both PLY writers share.

use crate::blocks::write_blocks;
use std::io::{self, Write};

/// Floats as they are in a binary little-endian file.
pub(super) fn write_floats(out: &mut dyn Write, floats: &[f32]) -> io::Result<()> {
    if cfg!(target_endian = "little") {
        return out.write_all(bytemuck::cast_slice(floats));
    }
    write_blocks(out, floats.len(), |i, block| block.extend_from_slice(&floats[i].to_le_bytes()))
}

/// A triangle's `list uchar int vertex_indices`.
pub(super) fn push_corners(block: &mut Vec<u8>, corners: [u32; 3]) {
    block.push(3);
    for corner in corners {
        block.extend_from_slice(&corner.to_le_bytes());
    }
}

/// A comment line, unless it is empty.
pub(super) fn push_comment(header: &mut String, comment: &str) {
    if !comment.is_empty() {
        *header += &format!("comment {comment}\n");
    }
}
