//! `.splat` (antimatter15/splat): 32 bytes per Gaussian, without a header.
//!
//! ```text
//! 3 f32 position   3 f32 scale   4 u8 red, green, blue, opacity   4 u8 rotation w, x, y, z: (byte - 128) / 128
//! ```

use super::build::{finish, read_all, sh0, unit, zeroed};
use crate::{ReadOptions, Source};
use glam::{DVec3, Vec3};
use trisplat_scene::{Error, ImportedSplats, Provenance, Result};

const BYTES: usize = 32;

/// The Gaussians of the file.
pub(super) fn read(source: Source, options: &ReadOptions) -> Result<ImportedSplats> {
    let path = &source.path;
    if !source.len.is_multiple_of(BYTES as u64) {
        let reason =
            format!("{} bytes are no whole number of Gaussians, {BYTES} bytes each: cut short", source.len);
        return Err(Error::malformed(path, "its length", reason));
    }
    let bytes = read_all(path, &*source.file, source.len, &options.limits)?;
    let mut splats = zeroed(path, bytes.len() / BYTES, 0, &options.limits)?;
    for (i, record) in bytes.chunks_exact(BYTES).enumerate() {
        let float = |at: usize| {
            let mut four = [0; 4];
            four.copy_from_slice(&record[4 * at..4 * at + 4]);
            f32::from_le_bytes(four)
        };
        splats.positions[i] = Vec3::new(float(0), float(1), float(2));
        splats.scales[i] = Vec3::new(float(3), float(4), float(5));
        splats.sh[i] = [24, 25, 26].map(|at| sh0(f64::from(record[at]) / 255.0));
        splats.opacity[i] = f32::from(record[27]) / 255.0;
        splats.rotations[i] = unit([28, 29, 30, 31].map(|at| (f64::from(record[at]) - 128.0) / 128.0));
    }
    finish(path, splats, Provenance::default(), Vec::new(), DVec3::ZERO)
}
