//! SPZ versions 2 to 4 (nianticlabs/spz): a header and one array per quantity.
//!
//! Versions 2 and 3 are gzip over all of it. Version 4 is not: each array is a zstd frame of its own, and a table of their lengths
//! follows 16 more bytes of header.
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
use crate::source::damaged;
use crate::{ReadOptions, Source, format};
use glam::DVec3;
use ruzstd::decoding::StreamingDecoder;
use std::f64::consts::FRAC_1_SQRT_2;
use std::path::Path;
use trisplat_scene::{Error, ImportedSplats, Limits, Provenance, Result, ScreenFilter, Splats, UpAxis};

const HEADER: usize = 16;
/// Of version 4.
const LONG_HEADER: usize = 32;
/// Gzip makes nothing smaller than this many times.
const LARGEST_RATIO: u64 = 1032;

/// What the header says.
struct Header {
    version: u32,
    count: usize,
    sh_degree: u8,
    fractional_bits: u8,
    antialiased: bool,
}

/// The Gaussians of the file.
pub(crate) fn read(mut source: Source, options: &ReadOptions) -> Result<ImportedSplats> {
    let is_plain = source.head()?.starts_with(b"NGSP");
    let (path, limits) = (&source.path, &options.limits);
    let file = std::io::BufReader::new(&*source.file);
    let bytes = if is_plain {
        streams(path, &read_all(path, file, source.len, limits)?, limits)?
    } else {
        let most = source.len.saturating_mul(LARGEST_RATIO);
        let unpacked = read_all(path, flate2::read::GzDecoder::new(file), most, limits);
        unpacked.map_err(|error| damaged(path, error, "its compressed bytes", "gzip -t"))?
    };
    let header = Header::parse(&source, &bytes)?;
    let splats = header.splats(&source, &bytes[HEADER..], options)?;
    let provenance = Provenance { up: Some(UpAxis::Y), ..Provenance::default() };
    finish(path, splats, provenance, Vec::new(), DVec3::ZERO)
}

/// The short header and the arrays of version 4, which then lie as in version 3.
fn streams(path: &Path, bytes: &[u8], limits: &Limits) -> Result<Vec<u8>> {
    if bytes.len() < LONG_HEADER || word(bytes, 4) != 4 {
        // The header is judged with that of other versions.
        return Ok(bytes[..bytes.len().min(HEADER)].to_vec());
    }
    let cut = |place: &str| Error::malformed(path, place, "lies beyond the end of the file: cut short");
    let (table, arrays) = (word(bytes, 16) as usize, usize::from(bytes[15]));
    let lengths = bytes.get(table..).and_then(|rest| rest.get(..16 * arrays));
    let lengths = lengths.ok_or_else(|| cut("table of arrays"))?;
    let (mut packed, mut out) = (&bytes[table + lengths.len()..], bytes[..HEADER].to_vec());
    let per_splat = [9, 1, 3, 3, 4, 3 * ((u64::from(bytes[12]) + 1).pow(2) - 1)];
    for (i, (entry, each)) in lengths.chunks_exact(16).zip(per_splat).enumerate() {
        let place = format!("array {i}");
        let [length, unpacked] =
            [0, 8].map(|at| u64::from(word(entry, at)) | u64::from(word(entry, at + 4)) << 32);
        let some = usize::try_from(length).ok().and_then(|length| packed.split_at_checked(length));
        let (array, behind) = some.ok_or_else(|| cut(&place))?;
        let decoder = StreamingDecoder::new(array).map_err(|e| Error::io(path, std::io::Error::other(e)));
        let array = decoder.and_then(|decoder| read_all(path, decoder, unpacked, limits));
        let array = array.map_err(|error| damaged(path, error, &place, "zstd -t"))?;
        let wanted = u64::from(word(bytes, 8)) * each;
        if [array.len() as u64, unpacked] != [wanted; 2] {
            let reason = format!("has {} bytes, {unpacked} by the table; expected {wanted}", array.len());
            return Err(Error::malformed(path, place, reason));
        }
        limits.reserve::<u8>(path.display(), &mut out, array.len())?;
        out.extend(array);
        packed = behind;
    }
    Ok(out)
}

/// The number of four bytes from `at`.
fn word(bytes: &[u8], at: usize) -> u32 {
    let mut four = [0; 4];
    four.copy_from_slice(&bytes[at..at + 4]);
    u32::from_le_bytes(four)
}

impl Header {
    fn parse(source: &Source, bytes: &[u8]) -> Result<Self> {
        let malformed = |reason: String| Error::malformed(&source.path, "header", reason);
        if bytes.len() < HEADER || !bytes.starts_with(b"NGSP") {
            return Err(malformed("does not begin with NGSP: not an SPZ file, or a broken one".to_owned()));
        }
        let (version, sh_degree, fractional_bits) = (word(bytes, 4), bytes[12], bytes[13]);
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
        Ok(Self { version, count, sh_degree, fractional_bits, antialiased: bytes[14] & 1 == 1 })
    }

    fn splats(&self, source: &Source, bytes: &[u8], options: &ReadOptions) -> Result<Splats> {
        let all = (usize::from(self.sh_degree) + 1).pow(2) - 1;
        let (turn, rest) = (if self.version == 2 { 3 } else { 4 }, 3 * all);
        let per_splat = 9 + 1 + 3 + 3 + turn + rest;
        if self.count.checked_mul(per_splat).is_none_or(|needed| needed > bytes.len()) {
            let reason = format!(
                "promises {} Gaussians of {per_splat} bytes, but only {} bytes follow: cut short",
                self.count,
                bytes.len()
            );
            return Err(Error::malformed(&source.path, "header", reason));
        }
        let mut left = bytes;
        let mut array = |each: usize| {
            let (array, behind) = left.split_at(self.count * each);
            left = behind;
            array
        };
        let [positions, opacity, colors, scales, turns, harmonics] =
            [array(9), array(1), array(3), array(3), array(turn), array(rest)];
        let degree = self.sh_degree.min(options.sh_degree);
        let mut splats = zeroed(&source.path, self.count, degree, &options.limits)?;
        let (k, unit_length) = (splats.sh_count(), 0.5f64.powi(self.fractional_bits.into()));
        for i in 0..self.count {
            let fixed = |axis: usize| {
                let at = 9 * i + 3 * axis;
                let [low, middle, high] = [positions[at], positions[at + 1], positions[at + 2]];
                f64::from(i32::from_le_bytes([0, low, middle, high]) >> 8) * unit_length
            };
            splats.positions[i] = DVec3::new(fixed(0), fixed(1), fixed(2)).as_vec3();
            let log = |axis: usize| f64::from(scales[3 * i + axis]) / 16.0 - 10.0;
            splats.scales[i] = DVec3::new(log(0), log(1), log(2)).exp().as_vec3();
            splats.opacity[i] = f32::from(opacity[i]) / 255.0;
            splats.rotations[i] = unit(rotation(&turns[turn * i..turn * (i + 1)]));
            let channels = [0, 1, 2];
            splats.sh[i * k] = channels.map(|c| ((f64::from(colors[3 * i + c]) / 255.0 - 0.5) / 0.15) as f32);
            for j in 1..k {
                let at = rest * i + 3 * (j - 1);
                splats.sh[i * k + j] = channels.map(|c| (f32::from(harmonics[at + c]) - 128.0) / 128.0);
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
        let (largest, mut squares, mut parts) = ((word >> 30) as usize, 0.0, [0.0; 4]);
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
