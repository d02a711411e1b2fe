//! Kinds of camera files, by their first bytes, and where these say nothing by their names.

use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

const PHOTOS: [&str; 7] = ["jpg", "jpeg", "jpe", "png", "webp", "tif", "tiff"];
const HEIC: [&str; 4] = ["heic", "heif", "hif", "avif"];
const VIDEOS: [&str; 9] = ["mp4", "mov", "m4v", "mkv", "webm", "avi", "mpg", "mts", "3gp"];
const RAW: [&str; 9] = ["dng", "cr2", "cr3", "nef", "arw", "raf", "orf", "rw2", "pef"];
/// Beginnings of the brands of pictures in an ISO file; other brands are videos.
const PICTURE_BRANDS: [&[u8]; 5] = [b"hei", b"hev", b"mif", b"msf", b"avi"];

/// Kind of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FileKind {
    /// A photo that is read as it is.
    Photo,
    /// HEIC or AVIF, which another program reads.
    Heic,
    Video,
    /// A camera's raw picture, which is not read.
    Raw,
    Other,
}

impl FileKind {
    /// By the name alone.
    pub(super) fn of_name(path: &Path) -> Self {
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let is = |list: &[&str]| list.contains(&ending.as_str());
        match () {
            () if is(&PHOTOS) => Self::Photo,
            () if is(&HEIC) => Self::Heic,
            () if is(&VIDEOS) => Self::Video,
            () if is(&RAW) => Self::Raw,
            () => Self::Other,
        }
    }

    /// Of a file that its name calls a photo or a video, by its first bytes; of others by the name.
    pub(super) fn of(path: &Path) -> Self {
        match Self::of_name(path) {
            named @ (Self::Raw | Self::Other) => named,
            named => Self::of_start(path).unwrap_or(named),
        }
    }

    fn of_start(path: &Path) -> Option<Self> {
        let mut start = [0; 12];
        std::fs::File::open(path).ok()?.read_exact(&mut start).ok()?;
        let is_picture = |brand: &[u8]| PICTURE_BRANDS.iter().any(|known| brand.starts_with(known));
        match &start {
            [0xff, 0xd8, 0xff, ..] | [0x89, b'P', b'N', b'G', ..] => Some(Self::Photo),
            [_, _, _, _, b'f', b't', b'y', b'p', brand @ ..] if is_picture(brand) => {
                Some(Self::Heic)
            }
            [_, _, _, _, b'f', b't', b'y', b'p', ..] => Some(Self::Video),
            _ => None,
        }
    }
}

/// Length of a video, seconds, if it is an ISO file (MOV, MP4) that says so.
pub(super) fn video_seconds(path: &Path) -> Option<f64> {
    let mut file = std::fs::File::open(path).ok()?;
    let end = file.metadata().ok()?.len();
    let movie = find_box(&mut file, 0..end, b"moov")?;
    let header = find_box(&mut file, movie, b"mvhd")?;
    file.seek(SeekFrom::Start(header.start)).ok()?;
    let mut bytes = [0; 32];
    file.read_exact(&mut bytes).ok()?;
    let word = |at: usize| Some(u32::from_be_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
    // Version 1 has times of eight bytes.
    let (scale, duration) = match bytes[0] {
        0 => (word(12)?, u64::from(word(16)?)),
        _ => (word(20)?, u64::from(word(24)?) << 32 | u64::from(word(28)?)),
    };
    (scale > 0).then(|| duration as f64 / f64::from(scale))
}

/// The content of the first box of this name in a part of a file.
fn find_box(
    file: &mut std::fs::File,
    part: std::ops::Range<u64>,
    name: &[u8; 4],
) -> Option<std::ops::Range<u64>> {
    let mut at = part.start;
    while at + 8 <= part.end {
        file.seek(SeekFrom::Start(at)).ok()?;
        let mut head = [0; 16];
        file.read_exact(&mut head[..8]).ok()?;
        let [a, b, c, d, ..] = head;
        let (start, length) = match u32::from_be_bytes([a, b, c, d]) {
            0 => (8, part.end - at),
            1 => {
                file.read_exact(&mut head[8..]).ok()?;
                (16, u64::from_be_bytes(head[8..].try_into().ok()?))
            }
            length => (8, u64::from(length)),
        };
        let next = at.checked_add(length).filter(|next| length >= start && *next <= part.end)?;
        if &head[4..8] == name {
            return Some(at + start..next);
        }
        at = next;
    }
    None
}
