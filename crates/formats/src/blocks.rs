//! Rows formatted on all threads, written in order.

use std::io::{self, Write};
use trisplat_scene::parallel;

/// Rows per thread and block.
const ROWS: usize = 1 << 13;

/// Writes rows 0 to `count`; `push` appends one row to a buffer.
pub(super) fn write_blocks(
    out: &mut dyn Write,
    count: usize,
    push: impl Fn(usize, &mut Vec<u8>) + Sync,
) -> io::Result<()> {
    let lanes = parallel::threads().max(1);
    let mut blocks = vec![Vec::new(); lanes];
    for round in (0..count).step_by(ROWS * lanes) {
        parallel::for_each(&mut blocks, |lane, block| {
            block.clear();
            let first = round + lane * ROWS;
            for row in first..(first + ROWS).min(count) {
                push(row, block);
            }
        });
        for block in &blocks {
            out.write_all(block)?;
        }
    }
    Ok(())
}
