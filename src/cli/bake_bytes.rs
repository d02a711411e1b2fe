//! Sizes in bytes, as they are typed.

use std::str::FromStr;

/// A size, written as `5000000`, `5MB` or `5M` (millions), `500kB` or `4MiB`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ByteSize(pub u64);

impl FromStr for ByteSize {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
        let unit = match &text[digits.len()..] {
            "" | "B" => 1.0,
            "k" | "K" | "kB" | "KB" => 1e3,
            "M" | "MB" => 1e6,
            "G" | "GB" => 1e9,
            "KiB" => 1024.0,
            "MiB" => f64::from(1 << 20),
            "GiB" => f64::from(1 << 30),
            _ => 0.0,
        };
        let bytes = digits.parse::<f64>().map_or(0.0, |number| number * unit);
        // NaN is in no range.
        match (1.0..=1e15).contains(&bytes) {
            true => Ok(Self(bytes as u64)),
            false => Err("expected a size of 1 byte or more, as in 5MB, 500kB, 4MiB or 5000000".to_owned()),
        }
    }
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
            ("500k", 500_000),
            ("5M", 5_000_000),
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
