//! The bytes behind buffers: the binary chunk, files beside the document, data URIs.
//!
//! A binary chunk is never held in memory, only the elements of one accessor at a time.

use super::container::{ContainerFile, GlbChunk};
use super::document::{FREE_UNPACKED_BYTES, GltfImage, entry, parse};
use super::meshopt::MAX_UNPACK_RATIO;
use crate::source::LFS_POINTER;
use crate::{ReadOptions, Source};
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use base64::{Engine, alphabet};
use gltf_json::Buffer;
use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, percent_decode_str, utf8_percent_encode};
use serde::Deserialize;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use trisplat_scene::{Error, Limits, Result, input};

/// Every buffer of a document, opened on first use.
pub(crate) struct Buffers<'a> {
    path: PathBuf,
    /// The glTF file itself.
    file: Arc<File>,
    bin: Option<GlbChunk>,
    declared: &'a [Buffer],
    opened: Vec<Option<OpenBuffer>>,
    /// Bytes that may still be unpacked.
    budget: u64,
    options: ReadOptions,
}

/// The place of a buffer's bytes.
enum OpenBuffer {
    /// From this byte of a file: the glTF file itself or one beside it.
    File(Arc<File>, u64),
    /// In the document.
    Inline(Vec<u8>),
}

impl<'a> Buffers<'a> {
    pub(crate) fn new(
        source: Source,
        container: &ContainerFile,
        declared: &'a [Buffer],
        options: &ReadOptions,
    ) -> Self {
        Self {
            budget: FREE_UNPACKED_BYTES + MAX_UNPACK_RATIO * source.len,
            path: source.path,
            file: source.file,
            bin: container.bin(),
            declared,
            opened: (0..declared.len()).map(|_| None).collect(),
            options: *options,
        }
    }

    /// The file of the buffers, for messages.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Length of a buffer in the document.
    pub(crate) fn length(&self, buffer: usize) -> Result<u64> {
        entry(&self.path, "buffer", self.declared, buffer).map(|buffer| buffer.byte_length.0)
    }

    /// Permits everything to be unpacked `times` times: a mesh is read anew for each of its copies.
    pub(crate) fn repeat(&mut self, times: u64) {
        self.budget = self.budget.saturating_mul(times);
    }

    /// Subtracts `bytes` from the limit of unpacked bytes.
    pub(crate) fn spend(&mut self, bytes: u64) -> Result<()> {
        match self.budget.checked_sub(bytes) {
            Some(rest) => {
                self.budget = rest;
                Ok(())
            }
            None => Err(Error::unsupported(
                &self.path,
                format!(
                    "unpacks to more than {MAX_UNPACK_RATIO} times its size, which no valid file does; \
                     if it shows one mesh many times, bake that mesh alone"
                ),
            )),
        }
    }

    /// Fills `bytes` from `offset` of a buffer; both must lie within it.
    pub(crate) fn read(&mut self, buffer: usize, offset: u64, bytes: &mut [u8]) -> Result<()> {
        let length = self.length(buffer)?;
        let end = offset.checked_add(bytes.len() as u64).filter(|end| *end <= length);
        if end.is_none() {
            return Err(Error::malformed(
                &self.path,
                format!("buffer {buffer}"),
                format!("has {length} bytes, but {} are wanted from byte {offset}", bytes.len()),
            ));
        }
        self.open(buffer)?;
        let (mut file, start) = match &self.opened[buffer] {
            Some(OpenBuffer::File(file, start)) => (&**file, *start),
            Some(OpenBuffer::Inline(inline)) => {
                bytes.copy_from_slice(&inline[offset as usize..offset as usize + bytes.len()]);
                return Ok(());
            }
            None => return Ok(()),
        };
        let read = file.seek(SeekFrom::Start(start + offset)).and_then(|_| file.read_exact(bytes));
        read.map_err(|e| Error::io(&self.path, e))
    }

    /// Opens a buffer and checks that all its bytes exist.
    pub(crate) fn open(&mut self, buffer: usize) -> Result<()> {
        self.length(buffer)?;
        if self.opened[buffer].is_none() {
            self.opened[buffer] = Some(self.find(buffer)?);
        }
        Ok(())
    }

    fn find(&self, buffer: usize) -> Result<OpenBuffer> {
        let length = self.length(buffer)?;
        let place = format!("buffer {buffer}");
        let (opened, has) = match &self.declared[buffer].uri {
            None => {
                let bin = self.bin.filter(|_| buffer == 0).ok_or_else(|| {
                    Error::malformed(&self.path, &place, "has no uri and is not the binary chunk")
                })?;
                (OpenBuffer::File(Arc::clone(&self.file), bin.start), bin.length)
            }
            Some(uri) if is_data(uri) => {
                let inline =
                    data(uri).map_err(|reason| Error::malformed(&self.path, &place, reason))?;
                let has = inline.len() as u64;
                (OpenBuffer::Inline(inline), has)
            }
            Some(uri) => self.open_beside(uri, &place)?,
        };
        if has < length {
            return Err(Error::malformed(
                &self.path,
                place,
                format!("promises {length} bytes, but only {has} are there: truncated?"),
            ));
        }
        Ok(opened)
    }

    /// The bytes of a picture at `uri`: in it, or in a file beside the document.
    pub(crate) fn picture(&mut self, uri: &str, place: &str) -> Result<Vec<u8>> {
        if is_data(uri) {
            return data(uri).map_err(|reason| Error::malformed(&self.path, place, reason));
        }
        let (opened, len) = self.open_beside(uri, place)?;
        self.spend(len)?;
        let mut bytes = Vec::new();
        if let OpenBuffer::File(file, _) = opened {
            (&*file).read_to_end(&mut bytes).map_err(|e| Error::io(&self.path, e))?;
        }
        Ok(bytes)
    }

    fn open_beside(&self, uri: &str, place: &str) -> Result<(OpenBuffer, u64)> {
        let refuse = |why: &str| {
            Err(Error::unsupported(&self.path, format!("{place} is at {uri:?}, {why}")))
        };
        if self.path.as_os_str() == "-" {
            return refuse("which standard input cannot reach; give the file by name, or a .glb");
        }
        let name = unescaped(uri);
        let outside = uri.contains(':') || uri.starts_with("//") || Path::new(&name).is_absolute();
        if outside || name.contains('\0') {
            return refuse("which is not beside it; download it and name it by a relative path");
        }
        if input::leaves_folder(Path::new(&name)) && !self.options.allow_outside {
            return refuse(
                "outside the folder of the file; if that is right, give `allow_outside`",
            );
        }
        let path = self.path.parent().unwrap_or(Path::new("")).join(name);
        match input::open(&path, &self.options.limits) {
            Ok((file, len)) => {
                let mut source = Source { path, file: Arc::new(file), len };
                if input::is_lfs_pointer(&source.head()?) {
                    return refuse(&format!("which {LFS_POINTER}"));
                }
                Ok((OpenBuffer::File(source.file, 0), len))
            }
            Err(Error::Unsupported { reason, .. }) => refuse(&format!("which {reason}")),
            Err(error) => Err(error),
        }
    }
}

// ---- Addresses of buffers: relative URI references (RFC 3986) and `data:` URIs (RFC 2397) -------

/// Everything but the unreserved characters.
const RESERVED: &AsciiSet = &NON_ALPHANUMERIC.remove(b'-').remove(b'.').remove(b'_').remove(b'~');

/// Some writers omit the padding or set the last bits; neither loses a byte.
const LENIENT: GeneralPurposeConfig = GeneralPurposeConfig::new()
    .with_decode_allow_trailing_bits(true)
    .with_decode_padding_mode(DecodePaddingMode::Indifferent);
const BASE64: GeneralPurpose = GeneralPurpose::new(&alphabet::STANDARD, LENIENT);
const BASE64_URL: GeneralPurpose = GeneralPurpose::new(&alphabet::URL_SAFE, LENIENT);

/// A file name as a relative URI reference.
pub(crate) fn from_file_name(name: &str) -> String {
    utf8_percent_encode(name, RESERVED).to_string()
}

/// A URI reference with its escapes decoded; other text stays.
pub(super) fn unescaped(uri: &str) -> String {
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

// ---- The files that a document names ------------------------------------------------------------

/// Parts of a document that may name files: buffers and pictures.
#[derive(Debug, Deserialize)]
struct DocumentUris {
    #[serde(default)]
    buffers: Vec<GltfImage>,
    #[serde(default)]
    images: Vec<GltfImage>,
}

/// The files beside `source` that its buffers and pictures are in.
pub fn named_files(source: &mut Source, limits: &Limits) -> Result<Vec<PathBuf>> {
    let container = ContainerFile::read(source, limits)?;
    let DocumentUris { buffers, images } = parse(&source.path, &container.json, limits)?;
    let folder = source.path.parent().unwrap_or(Path::new(""));
    let uris = buffers.into_iter().chain(images).filter_map(|object| object.uri);
    // A URI with a scheme, such as `data:`, is no file.
    let beside = uris.filter(|uri| !is_data(uri) && !uri.contains(':'));
    Ok(beside.map(|uri| folder.join(unescaped(&uri))).collect())
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
