//! Bytes as base64 text and back (RFC 4648).

const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

/// Appends the text that stands for `bytes`, padded with `=`.
pub(super) fn encode(bytes: &[u8], text: &mut Vec<u8>) {
    let digit = |word: u32, place: u32| DIGITS[(word >> (6 * place) & 63) as usize];
    text.reserve(bytes.len().div_ceil(3) * 4);
    let (triples, rest) = bytes.as_chunks::<3>();
    for &[a, b, c] in triples {
        let word = u32::from_be_bytes([0, a, b, c]);
        text.extend([digit(word, 3), digit(word, 2), digit(word, 1), digit(word, 0)]);
    }
    match *rest {
        [a, b] => {
            let word = u32::from_be_bytes([0, a, b, 0]);
            text.extend([digit(word, 3), digit(word, 2), digit(word, 1), b'=']);
        }
        [a] => {
            let word = u32::from_be_bytes([0, a, 0, 0]);
            text.extend([digit(word, 3), digit(word, 2), b'=', b'=']);
        }
        _ => {}
    }
}

/// The bytes that base64 text stands for, padding optional; none for what is no base64.
pub(super) fn decode(text: &[u8]) -> Option<Vec<u8>> {
    let end = text.iter().rposition(|b| *b != b'=').map_or(0, |last| last + 1);
    let mut bytes = Vec::with_capacity(end / 4 * 3 + 3);
    for group in text[..end].chunks(4) {
        let mut word = 0u32;
        for byte in group {
            let digit = match byte {
                b'A'..=b'Z' => byte - b'A',
                b'a'..=b'z' => byte - b'a' + 26,
                b'0'..=b'9' => byte - b'0' + 52,
                b'+' | b'-' => 62,
                b'/' | b'_' => 63,
                _ => return None,
            };
            word = word << 6 | u32::from(digit);
        }
        let [_, a, b, c] = (word << (6 * (4 - group.len()))).to_be_bytes();
        match group.len() {
            4 => bytes.extend([a, b, c]),
            3 => bytes.extend([a, b]),
            2 => bytes.push(a),
            _ => return None,
        }
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn follows_the_rfc() {
        let cases = [
            ("", ""),
            ("Zg==", "f"),
            ("Zm8=", "fo"),
            ("Zm9v", "foo"),
            ("Zm9vYg", "foob"),
            ("Zm9vYmE=", "fooba"),
        ];
        for (text, bytes) in cases {
            assert_eq!(decode(text.as_bytes()).as_deref(), Some(bytes.as_bytes()), "{text}");
        }
        assert_eq!(decode(b"-_+/"), Some(vec![0xfb, 0xff, 0xbf]));
        for bad in ["Z", "Zm9vY", "Zm 9v", "Z=9v", "Zm\n9"] {
            assert_eq!(decode(bad.as_bytes()), None, "{bad:?}");
        }
    }

    #[test]
    fn decodes_what_it_encoded() {
        let bytes: Vec<u8> = (0..=255).chain((0..=255).rev()).collect();
        for length in 0..bytes.len() {
            let mut text = b"before ".to_vec();
            encode(&bytes[..length], &mut text);
            assert!((text.len() - 7).is_multiple_of(4));
            assert_eq!(decode(&text[7..]).as_deref(), Some(&bytes[..length]));
        }
        let mut text = Vec::new();
        encode(b"foob", &mut text);
        assert_eq!(text, b"Zm9vYg==");
    }
}
