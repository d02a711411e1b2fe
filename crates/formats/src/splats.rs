//! Shared code of the readers of Gaussian splats, and the format `.splat`.
//!
//! Arrays within limits, conversions, and the end of every reader. Readers of other formats:
//! [`sog`], [`spz`], [`crate::ply`], [`crate::gltf`].

use crate::finish::note_origin;
use crate::{ReadOptions, Source};
use glam::{DVec3, Quat, Vec3};
use std::io::Read;
use std::path::Path;
use trisplat_scene::report::counted;
use trisplat_scene::{Error, ImportedSplats, Limits, Provenance, Result, SH_C0, Splats, sh_count};

pub(crate) mod cameras;
pub(crate) mod kinds;
pub(crate) mod sog;
pub(crate) mod spz;

/// As many Gaussians of zeros.
pub(crate) fn zeroed(path: &Path, count: usize, sh_degree: u8, limits: &Limits) -> Result<Splats> {
    limits.vertices(path.display(), count as u64)?;
    let coefficients = count.saturating_mul(sh_count(sh_degree));
    Ok(Splats {
        positions: limits.zeroed(path.display(), count)?,
        scales: limits.zeroed(path.display(), count)?,
        rotations: limits.zeroed(path.display(), count)?,
        opacity: limits.zeroed(path.display(), count)?,
        sh: limits.zeroed(path.display(), coefficients)?,
        sh_degree,
        ..Splats::default()
    })
}

/// All bytes of a stream, at most `max_bytes`, within the limit of one array.
pub(crate) fn read_all(
    path: &Path,
    from: impl Read,
    max_bytes: u64,
    limits: &Limits,
) -> Result<Vec<u8>> {
    limits.reserve::<u8>(path.display(), &mut Vec::new(), 0)?;
    let max_bytes = max_bytes.min(limits.array_bytes);
    let mut bytes = Vec::new();
    from.take(max_bytes.saturating_add(1))
        .read_to_end(&mut bytes)
        .map_err(|e| Error::io(path, e))?;
    limits.reserve::<u8>(path.display(), &mut bytes, 0)?;
    Ok(bytes)
}

/// The rotation of a quaternion w, x, y, z of any length; not finite where it has none.
pub(crate) fn unit([w, x, y, z]: [f64; 4]) -> Quat {
    let length = (w * w + x * x + y * y + z * z).sqrt();
    let [w, x, y, z] = [w, x, y, z].map(|part| (part / length) as f32);
    Quat::from_xyzw(x, y, z, w)
}

/// Unit quaternion from its smallest three components; `largest` is the index of the fourth.
pub(crate) fn with_largest(others: [f64; 3], largest: u8) -> [f64; 4] {
    let rest = (1.0 - others.iter().map(|x| x * x).sum::<f64>()).max(0.0).sqrt();
    let mut all = [others[0], others[1], others[2], rest];
    all[usize::from(largest)..].rotate_right(1);
    all
}

/// The coefficient of degree 0 of a channel, sRGB-encoded.
pub(crate) fn sh0(channel: f64) -> f32 {
    ((channel - 0.5) / f64::from(SH_C0)) as f32
}

/// The finite Gaussians; a warning counts the others. `origin` was subtracted
/// from their positions.
///
/// # Errors
///
/// None are left; numbers out of range.
pub(crate) fn finish(
    path: &Path,
    mut splats: Splats,
    mut provenance: Provenance,
    mut warnings: Vec<String>,
    origin: DVec3,
) -> Result<ImportedSplats> {
    let total = splats.len();
    if total == 0 {
        return Err(Error::malformed(path, "Gaussians", "there are none in the file"));
    }
    if splats.validate().is_err() {
        splats.validate_shape()?;
        let finite: Vec<bool> = (0..total).map(|i| splats.is_finite(i)).collect();
        splats.retain(|i| finite[i]);
        if splats.is_empty() {
            let reason = format!(
                "none of the {total} Gaussians is finite: they hold NaN or infinite numbers, or rotations of length 0"
            );
            return Err(Error::malformed(path, "values", reason));
        }
        splats.validate().map_err(|e| Error::malformed(path, "values", e.to_string()))?;
        if let Some(first) = finite.iter().position(|finite| !finite) {
            let dropped = counted((total - splats.len()) as u64, "Gaussian");
            warnings.push(format!(
                "dropped {dropped} with non-finite values (first: Gaussian {first})"
            ));
        }
    }
    note_origin(&mut provenance, &mut warnings, origin);
    Ok(ImportedSplats { splats, provenance, warnings, cameras: Vec::new() })
}

// ---- `.splat` (antimatter15/splat): 32 bytes per Gaussian, without a header ---------------------

const BYTES: usize = 32;

/// The Gaussians of the file.
pub(crate) fn read(source: Source, options: &ReadOptions) -> Result<ImportedSplats> {
    let path = &source.path;
    if !source.len.is_multiple_of(BYTES as u64) {
        let reason = format!(
            "{} bytes are no whole number of Gaussians, {BYTES} bytes each: cut short",
            source.len
        );
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
        splats.rotations[i] =
            unit([28, 29, 30, 31].map(|at| (f64::from(record[at]) - 128.0) / 128.0));
    }
    finish(path, splats, Provenance::default(), Vec::new(), DVec3::ZERO)
}
