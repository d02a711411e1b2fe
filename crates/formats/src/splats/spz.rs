//! SPZ versions 2 to 4 (nianticlabs/spz): a header and one array per quantity.
//!
//! Versions 2 and 3 are gzip over all of it. Version 4 is not: each array is a zstd frame of its
//! own, and a table of their lengths follows 16 more bytes of header.
//!
//! ```text
//! header     u32 "NGSP", u32 version, u32 count, u8 SH degree, u8 fractional bits, u8 flags (1: antialiased), u8 arrays (version 4)
//!            version 4: u32 place of the table, 12 bytes reserved; in the table per array u64 packed and u64 unpacked length
//! positions  3 i24 each, in units of 2^-(fractional bits)      opacities  u8
//! colours    3 u8 each: sh[0] = (byte / 255 - 0.5) / 0.15      scales     3 u8 each: exp(byte / 16 - 10)
//! rotations  version 2: x, y, z as byte / 127.5 - 1; later: u32, 10 bits for each but the largest
//! SH         u8 per coefficient and channel, channels innermost: (byte - 128) / 128
//! ```
//! Axes: +x right, +y up, +z back.

use super::{finish, read_all, unit, zeroed};
use crate::gltf::MAX_UNPACK_RATIO;
use crate::source::damaged;
use crate::{ReadOptions, Source, format};
use glam::DVec3;
use ruzstd::decoding::StreamingDecoder;
use std::f64::consts::FRAC_1_SQRT_2;
use std::io::Read;
use std::path::Path;
use trisplat_scene::{
    Error, ImportedSplats, Limits, Provenance, Result, ScreenFilter, Splats, UpAxis, sh_count,
};

/// Bytes of the header of versions 2 and 3.
const HEADER: usize = 16;
/// Bytes of the header of version 4.
const LONG_HEADER: usize = 32;
/// Minimum window of the decoder, bytes: encoders of zstd refer back so far for any array.
const MIN_WINDOW: u64 = 1 << 23;

/// The numbers of the header.
struct SpzHeader {
    version: u32,
    count: usize,
    sh_degree: u8,
    fractional_bits: u8,
    antialiased: bool,
}

/// The next array, at most that many bytes.
type Next<'a> = dyn FnMut(u64) -> Result<Vec<u8>> + 'a;

/// The Gaussians of the file. Nothing is unpacked beyond what the header's count needs, one array
/// at a time.
pub(crate) fn read(mut source: Source, options: &ReadOptions) -> Result<ImportedSplats> {
    let is_plain = source.head()?.starts_with(b"NGSP");
    let path = &source.path;
    let limits = &options.limits;
    let file = std::io::BufReader::new(&*source.file);
    let splats = if is_plain {
        let bytes = read_all(path, file, source.len, limits)?;
        let header = SpzHeader::parse(&source, &bytes, limits)?;
        header.splats(path, &mut frames(path, &bytes, limits)?, options)?
    } else {
        let mut stream = flate2::read::GzDecoder::new(file);
        let mut next = |length: u64| {
            let array = read_all(path, (&mut stream).take(length), length, limits);
            array.map_err(|error| damaged(path, error, "its compressed bytes", "gzip -t"))
        };
        let header = SpzHeader::parse(&source, &next(HEADER as u64)?, limits)?;
        let splats = header.splats(path, &mut next, options)?;
        // The check sum follows the last array.
        next(1)?;
        splats
    };
    let provenance = Provenance { up: Some(UpAxis::Y), ..Provenance::default() };
    finish(path, splats, provenance, Vec::new(), DVec3::ZERO)
}

/// The arrays of version 4, in order.
fn frames<'a>(
    path: &'a Path,
    bytes: &'a [u8],
    limits: &'a Limits,
) -> Result<impl FnMut(u64) -> Result<Vec<u8>> + 'a> {
    let cut = move |place: &str| {
        Error::malformed(path, place, "lies beyond the end of the file: cut short")
    };
    if bytes.len() < LONG_HEADER || word(bytes, 4) != 4 {
        return Err(cut("table of arrays"));
    }
    let table = word(bytes, 16) as usize;
    let arrays = usize::from(bytes[15]);
    let lengths = bytes.get(table..).and_then(|rest| rest.get(..16 * arrays));
    let lengths = lengths.ok_or_else(|| cut("table of arrays"))?;
    let mut packed = &bytes[table + lengths.len()..];
    let mut entries = lengths.chunks_exact(16).enumerate();
    Ok(move |expected: u64| {
        let Some((i, entry)) = entries.next() else { return Ok(Vec::new()) };
        let place = format!("array {i}");
        let [length, unpacked] =
            [0, 8].map(|at| u64::from(word(entry, at)) | u64::from(word(entry, at + 4)) << 32);
        if unpacked != expected {
            let reason = format!("has {unpacked} bytes by the table; expected {expected}");
            return Err(Error::malformed(path, place, reason));
        }
        let some = usize::try_from(length).ok().and_then(|length| packed.split_at_checked(length));
        let (array, behind) = some.ok_or_else(|| cut(&place))?;
        packed = behind;
        let decoder = StreamingDecoder::new_with_max_window_size(array, expected.max(MIN_WINDOW));
        let decoder = decoder.map_err(|e| Error::io(path, std::io::Error::other(e)));
        let array = decoder.and_then(|decoder| read_all(path, decoder, expected, limits));
        array.map_err(|error| damaged(path, error, &place, "zstd -t"))
    })
}

/// The number of four bytes from `at`.
fn word(bytes: &[u8], at: usize) -> u32 {
    let mut four = [0; 4];
    four.copy_from_slice(&bytes[at..at + 4]);
    u32::from_le_bytes(four)
}

impl SpzHeader {
    fn parse(source: &Source, bytes: &[u8], limits: &Limits) -> Result<Self> {
        let malformed = |reason: String| Error::malformed(&source.path, "header", reason);
        if bytes.len() < HEADER || !bytes.starts_with(b"NGSP") {
            return Err(malformed(
                "does not begin with NGSP: not an SPZ file, or a broken one".to_owned(),
            ));
        }
        let version = word(bytes, 4);
        let sh_degree = bytes[12];
        let fractional_bits = bytes[13];
        if !(2..=4).contains(&version) {
            return Err(format::unread(&source.path, &format!("SPZ version {version}")));
        }
        if sh_degree > 3 || fractional_bits > 24 {
            let reason = format!(
                "has SH degree {sh_degree} and {fractional_bits} fractional bits; expected at most 3 and 24"
            );
            return Err(malformed(reason));
        }
        let count = word(bytes, 8) as usize;
        let header =
            Self { version, count, sh_degree, fractional_bits, antialiased: bytes[14] & 1 == 1 };
        let per_splat = header.arrays().iter().sum::<usize>();
        if count as u64 * per_splat as u64 > MAX_UNPACK_RATIO.saturating_mul(source.len) {
            let reason = format!(
                "promises {count} Gaussians of {per_splat} bytes, more than a file of {} bytes can hold: cut short",
                source.len
            );
            return Err(malformed(reason));
        }
        limits.vertices(source.path.display(), count as u64)?;
        Ok(header)
    }

    /// Bytes of a Gaussian in each array: positions, opacities, colours, scales, rotations, SH.
    fn arrays(&self) -> [usize; 6] {
        let harmonics = 3 * (sh_count(self.sh_degree) - 1);
        [9, 1, 3, 3, if self.version == 2 { 3 } else { 4 }, harmonics]
    }

    fn splats(&self, path: &Path, next: &mut Next<'_>, options: &ReadOptions) -> Result<Splats> {
        let [_, _, _, _, turn, rest] = self.arrays();
        let mut array = |each: usize| {
            let bytes = self.count as u64 * each as u64;
            let array = next(bytes)?;
            let count = self.count;
            let has = array.len();
            if has as u64 != bytes {
                let reason = format!(
                    "promises {count} Gaussians; an array has {has} of {bytes} bytes: cut short"
                );
                return Err(Error::malformed(path, "header", reason));
            }
            Ok(array)
        };
        let degree = self.sh_degree.min(options.sh_degree);
        let positions = array(9)?;
        let mut splats = zeroed(path, self.count, degree, &options.limits)?;
        let k = splats.sh_count();
        let unit_length = 0.5f64.powi(self.fractional_bits.into());
        for (position, bytes) in splats.positions.iter_mut().zip(positions.as_chunks::<9>().0) {
            let fixed = |axis: usize| {
                let [low, middle, high] = [0, 1, 2].map(|at| bytes[3 * axis + at]);
                f64::from(i32::from_le_bytes([0, low, middle, high]) >> 8) * unit_length
            };
            *position = DVec3::new(fixed(0), fixed(1), fixed(2)).as_vec3();
        }
        drop(positions);
        for (opacity, byte) in splats.opacity.iter_mut().zip(array(1)?) {
            *opacity = f32::from(byte) / 255.0;
        }
        for (color, bytes) in splats.sh.chunks_exact_mut(k).zip(array(3)?.as_chunks::<3>().0) {
            color[0] = bytes.map(|byte| ((f64::from(byte) / 255.0 - 0.5) / 0.15) as f32);
        }
        for (scale, bytes) in splats.scales.iter_mut().zip(array(3)?.as_chunks::<3>().0) {
            *scale = DVec3::from(bytes.map(|byte| f64::from(byte) / 16.0 - 10.0)).exp().as_vec3();
        }
        for (quaternion, bytes) in splats.rotations.iter_mut().zip(array(turn)?.chunks_exact(turn))
        {
            *quaternion = unit(rotation(bytes));
        }
        let harmonics = array(rest)?;
        for (i, coefficients) in splats.sh.chunks_exact_mut(k).enumerate() {
            let bytes = harmonics[rest * i..].as_chunks::<3>().0;
            for (out, bytes) in coefficients[1..].iter_mut().zip(bytes) {
                *out = bytes.map(|byte| (f32::from(byte) - 128.0) / 128.0);
            }
        }
        if self.antialiased {
            splats.filter = ScreenFilter::ANTIALIASED;
        }
        Ok(splats)
    }
}

/// w, x, y, z of version 2, three bytes, or a later one, four.
fn rotation(bytes: &[u8]) -> [f64; 4] {
    let [mut x, mut y, mut z, mut w] = [0.0; 4];
    if let [a, b, c] = *bytes {
        [x, y, z] = [a, b, c].map(|byte| f64::from(byte) / 127.5 - 1.0);
        w = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
    } else if let [a, b, c, d] = *bytes {
        let mut word = u32::from_le_bytes([a, b, c, d]);
        let largest = (word >> 30) as usize;
        let mut squares = 0.0;
        let mut parts = [0.0; 4];
        for i in (0..4).rev().filter(|i| *i != largest) {
            let size = FRAC_1_SQRT_2 * f64::from(word & 511) / 511.0;
            parts[i] = if word >> 9 & 1 == 1 { -size } else { size };
            squares += size * size;
            word >>= 10;
        }
        parts[largest] = f64::max(1.0 - squares, 0.0).sqrt();
        [x, y, z, w] = parts;
    }
    [w, x, y, z]
}
