//! The layout of the binary buffer: the streams of all parts, compressed or not.

use super::container::{stream_offsets, write_padding};
use super::encode;
use super::meshopt;
use super::options::GltfOptions;
use super::part::{ScenePart, all_streams, parts};
use std::io::{self, Write};
use std::path::Path;
use trisplat_scene::{Asset, Error, Result};

/// The content of a file, without the bytes themselves.
pub(crate) struct Content<'a> {
    pub(crate) asset: &'a Asset,
    pub(crate) options: &'a GltfOptions,
    pub(crate) parts: Vec<ScenePart<'a>>,
    /// Compressed streams in file order, when compressing.
    pub(crate) compressed: Option<Vec<Vec<u8>>>,
    /// Start of each stream in the file's buffer, in file order.
    pub(crate) starts: Vec<u64>,
    pub(crate) bin_bytes: u64,
    /// The pages of the texture, behind the streams, when there is one.
    pub(crate) pictures: Vec<Picture>,
}

/// A picture in the file's buffer.
pub(crate) struct Picture {
    pub(crate) start: u64,
    pub(crate) bytes: Vec<u8>,
}

impl<'a> Content<'a> {
    pub(crate) fn new(path: &Path, asset: &'a Asset, options: &'a GltfOptions) -> Result<Self> {
        let parts = parts(path, asset, options)?;
        let compressed = if options.meshopt {
            Some(meshopt::compress(&parts, options).map_err(|e| Error::unsupported(path, e))?)
        } else {
            None
        };
        let (starts, mut bin_bytes) = match &compressed {
            Some(streams) => stream_offsets(streams.iter().map(|s| s.len() as u64)),
            None => stream_offsets(all_streams(&parts).map(|(part, stream)| part.bytes(stream, options))),
        };
        let mut pictures = Vec::new();
        for page in asset.mesh.texture.iter().flat_map(|texture| &texture.pages) {
            let bytes = options.texture.bytes(page.picture())?;
            let start = bin_bytes.next_multiple_of(4);
            bin_bytes = start + bytes.len() as u64;
            pictures.push(Picture { start, bytes });
        }
        Ok(Self { asset, options, parts, compressed, starts, bin_bytes, pictures })
    }

    /// Streams the binary buffer, padding between the streams included.
    pub(crate) fn write_bin(&self, out: &mut dyn Write) -> io::Result<()> {
        let mut at = 0;
        let mut scratch = Vec::new();
        for (i, (part, stream)) in all_streams(&self.parts).enumerate() {
            write_padding(out, at)?;
            at = self.starts[i];
            at += match &self.compressed {
                Some(streams) => {
                    out.write_all(&streams[i])?;
                    streams[i].len() as u64
                }
                None => {
                    encode::write(out, part, stream, self.options, &mut scratch)?;
                    part.bytes(stream, self.options)
                }
            };
        }
        for picture in &self.pictures {
            write_padding(out, at)?;
            out.write_all(&picture.bytes)?;
            at = picture.start + picture.bytes.len() as u64;
        }
        Ok(())
    }
}
