//! Addresses of buffers: relative URI references (RFC 3986) and `data:` URIs (RFC 2397).

use base64::Engine;
use base64::alphabet;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, percent_decode_str, utf8_percent_encode};

/// Everything but the unreserved characters.
const RESERVED: &AsciiSet = &NON_ALPHANUMERIC.remove(b'-').remove(b'.').remove(b'_').remove(b'~');

/// Some writers omit the padding or set the last bits; neither loses a byte.
const LENIENT: GeneralPurposeConfig = GeneralPurposeConfig::new()
    .with_decode_allow_trailing_bits(true)
    .with_decode_padding_mode(DecodePaddingMode::Indifferent);
const BASE64: GeneralPurpose = GeneralPurpose::new(&alphabet::STANDARD, LENIENT);
const BASE64_URL: GeneralPurpose = GeneralPurpose::new(&alphabet::URL_SAFE, LENIENT);

/// A file name as a relative URI reference.
pub fn from_file_name(name: &str) -> String {
    utf8_percent_encode(name, RESERVED).to_string()
}

/// A URI reference with its escapes decoded; other text stays.
pub fn unescaped(uri: &str) -> String {
    percent_decode_str(uri).decode_utf8_lossy().into_owned()
}

/// True for a URI that holds its data.
pub(crate) fn is_data(uri: &str) -> bool {
    uri.starts_with("data:")
}

/// The bytes of a `data:` URI, or why it is invalid.
pub(crate) fn data(uri: &str) -> Result<Vec<u8>, &'static str> {
    let (head, body) = uri.split_once(',').ok_or("is a data URI without a comma")?;
    if !head.ends_with(";base64") {
        return Err("is a data URI that is not base64");
    }
    BASE64.decode(body).or_else(|_| BASE64_URL.decode(body)).map_err(|_| "is not valid base64")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_names_become_uris_and_come_back() {
        for (name, uri) in [
            ("scene-1_a~.bin", "scene-1_a~.bin"),
            ("my scene#2.bin", "my%20scene%232.bin"),
            ("größe.bin", "gr%C3%B6%C3%9Fe.bin"),
        ] {
            assert_eq!(from_file_name(name), uri);
            assert_eq!(unescaped(uri), name);
        }
    }

    #[test]
    fn what_is_no_escape_stays() {
        for uri in ["100%", "%zz%4", "%+4"] {
            assert_eq!(unescaped(uri), uri);
        }
    }

    #[test]
    fn data_may_lack_padding_and_use_either_alphabet() {
        let bytes = |body: &str| data(&format!("data:application/octet-stream;base64,{body}"));
        for (body, wants) in
            [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm9vYg", "foob"), ("Zm9vYmF", "fooba")]
        {
            assert_eq!(bytes(body).as_deref(), Ok(wants.as_bytes()), "{body}");
        }
        assert_eq!(bytes("-_-_"), bytes("+/+/"));
        for bad in ["Z", "Zm9vY", "Zm 9v", "Z=9v", "Zm\n9"] {
            assert!(bytes(bad).is_err(), "{bad:?}");
        }
        for bad in ["data:,abc", "data:;base64", "data:text/plain,Zg=="] {
            assert!(data(bad).is_err(), "{bad:?}");
        }
    }
}
