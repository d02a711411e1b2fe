//! `trisplat bake --max-bytes`: as many triangles as files of that size hold.

use crate::bake::max_bytes::{Attempt, most_within};
use crate::bake::{Bake, BakeOptions, Views};
use crate::error::Result;
use crate::formats::output::{self, Output};
use crate::report::Report;
use crate::scene::Loaded;
use std::str::FromStr;

/// A size, written as `5000000`, `5MB` (millions), `500kB` or `4MiB`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ByteSize(pub u64);

impl FromStr for ByteSize {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
        let unit = match &text[digits.len()..] {
            "" | "B" => 1.0,
            "kB" | "KB" => 1e3,
            "MB" => 1e6,
            "GB" => 1e9,
            "KiB" => 1024.0,
            "MiB" => f64::from(1 << 20),
            "GiB" => f64::from(1 << 30),
            _ => 0.0,
        };
        let bytes = digits.parse::<f64>().map_or(0.0, |number| number * unit);
        // NaN is in no range.
        match (1.0..=1e15).contains(&bytes) {
            true => Ok(Self(bytes as u64)),
            false => Err("wants a size of 1 byte or more, as in 5MB, 500kB, 4MiB or 5000000".to_owned()),
        }
    }
}

/// The options with the most triangles whose files, all of `output` together, take at most `limit` bytes. Bakes and counts what would be
/// written, several times.
///
/// Errors: those of a bake and of writing; a limit below what any scene takes.
pub(super) fn fitted(
    limit: ByteSize,
    scenes: &[Loaded],
    mut views: Option<&mut Views>,
    options: &BakeOptions,
    output: &Output,
) -> Result<BakeOptions> {
    let with = |max_triangles: Option<u64>| {
        let mut options = options.clone();
        options.prune.max_triangles = max_triangles;
        options
    };
    let attempt = most_within(limit.0, options.prune.max_triangles, |most| {
        let (tried, mut unread) = (with(most), Report::default());
        let asset = Bake::new(&tried).photos(views.as_deref_mut()).run(scenes.iter().cloned())?;
        let triangles = asset.counts().triangles;
        output::write(&asset, output, output.dry_run(), &tried.output, &mut unread, &mut ())?;
        let bytes = unread.outputs.iter().map(|file| file.bytes).sum();
        Ok(Attempt { max_triangles: most, triangles, bytes })
    })?;
    Ok(with(attempt.max_triangles))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_have_units() {
        for (text, bytes) in [
            ("5000000", 5_000_000),
            ("5MB", 5_000_000),
            ("1.5kB", 1500),
            ("4MiB", 4 << 20),
            ("1GB", 1_000_000_000),
            ("7B", 7),
        ] {
            assert_eq!(text.parse(), Ok(ByteSize(bytes)), "{text}");
        }
        for bad in ["", "0", "-1", "nan", "inf", "5 MB", "MB", "5TB", "5mb", "1e16"] {
            assert!(bad.parse::<ByteSize>().is_err(), "{bad}");
        }
    }
}
