//! The point cloud beside a `transforms.json`: a PLY file of coloured points.

use super::found::FoundPoint;
use crate::error::{Error, Result};
use glam::DVec3;
use std::path::Path;

/// The types of PLY properties: names in either spelling, and bytes.
const TYPES: [(&str, &str, usize); 8] = [
    ("char", "int8", 1),
    ("uchar", "uint8", 1),
    ("short", "int16", 2),
    ("ushort", "uint16", 2),
    ("int", "int32", 4),
    ("uint", "uint32", 4),
    ("float", "float32", 4),
    ("double", "float64", 8),
];

/// Reads x, y, z and, where there are any, red, green, blue of the first element, which must be `vertex`.
pub(super) fn read(path: &Path) -> Result<Vec<FoundPoint>> {
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
    let header = Header::parse(path, &bytes)?;
    let mut points = Vec::new();
    let mut row = vec![0.0; header.properties.len()];
    let mut body = &bytes[header.length..];
    let mut lines = body.split(|b| *b == b'\n').filter(|line| !line.trim_ascii().is_empty());
    for index in 0..header.count {
        let read = match header.encoding {
            Encoding::Ascii => lines.next().and_then(|line| header.read_words(line, &mut row)),
            Encoding::Little => header.read_bytes(&mut body, false, &mut row),
            Encoding::Big => header.read_bytes(&mut body, true, &mut row),
        };
        if read.is_none() {
            let reason = format!("cannot be read; {} points were promised", header.count);
            return Err(Error::malformed(path, format!("point {index}"), reason));
        }
        let at = |column: usize| row.get(column).copied().unwrap_or(0.0);
        let [x, y, z] = header.position.map(at);
        let rgb = header.rgb.map_or([128; 3], |columns| columns.map(|c| at(c) as u8));
        points.push(FoundPoint { position: DVec3::new(x, y, z), rgb, error: None });
    }
    Ok(points)
}

enum Encoding {
    Ascii,
    Little,
    Big,
}

struct Header {
    encoding: Encoding,
    count: usize,
    /// Index into [`TYPES`] of every property.
    properties: Vec<usize>,
    position: [usize; 3],
    rgb: Option<[usize; 3]>,
    /// Bytes up to the first point.
    length: usize,
}

impl Header {
    fn parse(path: &Path, bytes: &[u8]) -> Result<Self> {
        let bad = |line: usize, reason: &str| {
            Error::malformed(
                path,
                format!("header line {}", line + 1),
                format!("{reason}: wants a PLY of points"),
            )
        };
        let (mut encoding, mut count, mut elements) = (None, None, 0);
        let (mut names, mut properties) = (Vec::new(), Vec::new());
        let mut length = 0;
        for (number, line) in bytes.split_inclusive(|b| *b == b'\n').enumerate() {
            length += line.len();
            let text = std::str::from_utf8(line).map_err(|_| bad(number, "is not text"))?;
            let words: Vec<&str> = text.split_whitespace().collect();
            match words[..] {
                ["ply"] if number == 0 => {}
                _ if number == 0 => return Err(bad(number, "does not say `ply`")),
                ["format", "ascii", _] => encoding = Some(Encoding::Ascii),
                ["format", "binary_little_endian", _] => encoding = Some(Encoding::Little),
                ["format", "binary_big_endian", _] => encoding = Some(Encoding::Big),
                ["element", "vertex", n] if elements == 0 => {
                    count = Some(n.parse::<usize>().map_err(|_| bad(number, "has no such count"))?);
                    elements = 1;
                }
                ["element", ..] if elements == 0 => return Err(bad(number, "does not start with vertices")),
                ["element", ..] => elements += 1,
                ["property", kind, name] if elements == 1 => {
                    let known = TYPES.iter().position(|(a, b, _)| *a == kind || *b == kind);
                    properties.push(known.ok_or_else(|| bad(number, "has no such type"))?);
                    names.push(name.to_owned());
                }
                ["property", "list", ..] if elements == 1 => return Err(bad(number, "has a list")),
                ["end_header"] => {
                    let column = |name: &str| names.iter().position(|n| n == name);
                    let three = |a, b, c| Some([column(a)?, column(b)?, column(c)?]);
                    let (Some(encoding), Some(count)) = (encoding, count) else {
                        return Err(bad(number, "format or vertices are missing"));
                    };
                    let position = three("x", "y", "z").ok_or_else(|| bad(number, "x, y or z is missing"))?;
                    let rgb = three("red", "green", "blue").filter(|c| c.iter().all(|&c| properties[c] == 1));
                    return Ok(Self { encoding, count, properties, position, rgb, length });
                }
                _ => {}
            }
        }
        Err(Error::malformed(path, "header", "does not end: wants a PLY of points"))
    }

    fn read_words(&self, line: &[u8], row: &mut [f64]) -> Option<()> {
        let mut words = std::str::from_utf8(line).ok()?.split_whitespace();
        for value in row {
            *value = words.next()?.parse().ok()?;
        }
        Some(())
    }

    fn read_bytes(&self, body: &mut &[u8], big: bool, row: &mut [f64]) -> Option<()> {
        for (value, &kind) in row.iter_mut().zip(&self.properties) {
            let (bytes, rest) = body.split_at_checked(TYPES[kind].2)?;
            *body = rest;
            // Little-endian, widened with zeros.
            let mut wide = [0u8; 8];
            wide[..bytes.len()].copy_from_slice(bytes);
            if big {
                wide[..bytes.len()].reverse();
            }
            let low = u64::from_le_bytes(wide);
            *value = match TYPES[kind].0 {
                "char" => f64::from(low as u8 as i8),
                "short" => f64::from(low as u16 as i16),
                "int" => f64::from(low as u32 as i32),
                "float" => f64::from(f32::from_bits(low as u32)),
                "double" => f64::from_bits(low),
                _ => low as f64,
            };
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_bytes(bytes: &[u8]) -> Result<Vec<FoundPoint>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.ply");
        std::fs::write(&path, bytes).unwrap();
        read(&path)
    }

    fn header(format: &str) -> String {
        format!(
            "ply\nformat {format} 1.0\ncomment x\nelement vertex 2\nproperty double x\nproperty float y\n\
             property short z\nproperty uchar red\nproperty uint8 green\nproperty uchar blue\n\
             element face 0\nproperty list uchar int vertex_indices\nend_header\n"
        )
    }

    fn body(big: bool) -> Vec<u8> {
        let mut bytes = Vec::new();
        for (x, y, z, rgb) in [(1.25f64, -2.5f32, -3i16, [1u8, 2, 255]), (1e6, 0.0, 4, [9, 8, 7])] {
            let mut push = |b: &[u8]| bytes.extend_from_slice(b);
            if big {
                push(&x.to_be_bytes());
                push(&y.to_be_bytes());
                push(&z.to_be_bytes());
            } else {
                push(&x.to_le_bytes());
                push(&y.to_le_bytes());
                push(&z.to_le_bytes());
            }
            push(&rgb);
        }
        bytes
    }

    #[test]
    fn all_three_encodings_say_the_same() {
        let little = [header("binary_little_endian").into_bytes(), body(false)].concat();
        let big = [header("binary_big_endian").into_bytes(), body(true)].concat();
        let ascii = format!("{}1.25 -2.5 -3 1 2 255\n1e6 0 4 9 8 7\n", header("ascii"));
        for bytes in [little.as_slice(), &big, ascii.as_bytes()] {
            let points = read_bytes(bytes).unwrap();
            assert_eq!(points.len(), 2);
            assert_eq!(points[0].position, DVec3::new(1.25, -2.5, -3.0));
            assert_eq!(points[0].rgb, [1, 2, 255]);
            assert_eq!(points[1].position, DVec3::new(1e6, 0.0, 4.0));
        }
    }

    #[test]
    fn every_prefix_fails_cleanly() {
        let whole = [header("binary_little_endian").into_bytes(), body(false)].concat();
        for len in 0..whole.len() {
            assert!(read_bytes(&whole[..len]).is_err(), "{len}");
        }
        let greedy = header("ascii").replace("vertex 2", "vertex 18446744073709551615");
        assert!(read_bytes(greedy.as_bytes()).is_err());
    }
}
